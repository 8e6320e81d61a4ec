from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from hqpipe.errors import ConfigError, DivergedError, HqpipeError, LogError


def test_the_text_ends_with_the_fix():
    error = LogError("a.parquet: column 'tme' is unknown", file=Path("a.parquet"), field="tme", fix="rename it")
    assert str(error) == "a.parquet: column 'tme' is unknown: rename it"
    assert error.to_json() == {"message": str(error), "file": "a.parquet", "field": "tme", "fix": "rename it"}


def test_what_is_not_known_is_null():
    assert HqpipeError("failed").to_json() == {"message": "failed", "file": None, "field": None, "fix": None}


@pytest.mark.parametrize("kind", [LogError, DivergedError])
def test_errors_cross_processes_whole(kind):
    error = kind("wrong", file="a", field="b", fix="c")
    assert pickle.loads(pickle.dumps(error)).to_json() == error.to_json()


def test_an_error_is_told_of_the_file_that_it_came_from():
    error = LogError("dt is -1", field="dt", fix="write seconds").in_file("actuator.json", ConfigError)
    assert isinstance(error, ConfigError) and error.exit_code == 2
    assert str(error) == "actuator.json: dt is -1: write seconds"
    assert (error.file, error.field, error.fix) == ("actuator.json", "dt", "write seconds")
