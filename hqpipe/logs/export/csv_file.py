"""A trial as CSV: the columns of the log format, as they were recorded."""

from __future__ import annotations

from pathlib import Path

from hqpipe.logs.columns import order_columns
from hqpipe.logs.trajectory import LogSet, Trial


def write_csv(path: Path, log_set: LogSet, trial: Trial) -> None:
    """Write one trial, with every number in as many digits as it takes to read the same float64 back.

    Args:
        path: of the new file. log_set: that the trial belongs to; not used. trial: its columns, `time` first.
    """
    import pyarrow as pa
    from pyarrow import csv

    columns = trial.trajectory.columns()
    names = order_columns(columns, trial.trajectory.joints)
    csv.write_csv(pa.table({name: columns[name] for name in names}), path)
