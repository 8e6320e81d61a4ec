"""Sound logs to start from."""

from __future__ import annotations

import pytest
from log_builders import make_columns, put


@pytest.fixture
def columns():
    return make_columns()


@pytest.fixture
def logs(tmp_path, columns):
    """A directory of two sound trials, without logset.yaml."""
    folder = tmp_path / "logs"
    put(folder, "a.parquet", columns)
    put(folder, "b.parquet", make_columns(seed=1))
    return folder
