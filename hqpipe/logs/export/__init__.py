"""Log sets as files that other tools read: one file per trial."""

from __future__ import annotations

from hqpipe.registry import Registry

EXPORTERS = Registry(
    "export format",
    {"mcap": "hqpipe.logs.export.mcap_file:write_mcap", "csv": "hqpipe.logs.export.csv_file:write_csv"},
)
"""Format, which is also the ending of its files → function of (path, log set, trial)."""
