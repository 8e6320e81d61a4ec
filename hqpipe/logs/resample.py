"""A uniform clock for a trial whose clock jitters; only done when asked for."""

from __future__ import annotations

import numpy as np

from hqpipe.logs.checks import clock
from hqpipe.logs.columns import TIME, RawTable

_HELD = ("position_command", "effort_command", "valve_command", "contact")


def resample(table: RawTable, rate_hz: float | None = None) -> RawTable:
    """Interpolate every column onto a uniform clock.

    Measured signals are interpolated linearly; commands and contacts keep the value that was last sent.

    Args:
        table: columns with a strictly increasing `time`.
        rate_hz: the new rate; by default that of the median sample time.
    """
    time = clock(table.columns[TIME])
    time = (time - time[0]).astype(np.float64) if time.dtype.kind == "i" else time
    dt = 1.0 / rate_hz if rate_hz else float(np.median(np.diff(time)))
    count = int(np.floor((time[-1] - time[0]) / dt + 1e-9)) + 1
    uniform = time[0] + dt * np.arange(count)
    last = np.clip(np.searchsorted(time, uniform + 1e-9 * dt, side="right") - 1, 0, len(time) - 1)
    columns = {}
    for name, values in table.columns.items():
        held = name.rsplit("/", 1)[-1] in _HELD or name.startswith("command/")
        columns[name] = values[last] if held else np.interp(uniform, time, values)
    columns[TIME] = uniform
    return RawTable(table.path, columns, table.metadata)
