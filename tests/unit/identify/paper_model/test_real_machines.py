"""Two real machines, if their logs are beside the checkout."""

from __future__ import annotations

from pathlib import Path

import pytest

from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.identify.rivals.compare import compare_models
from hqpipe.logs.log_set import read_log_set

DATA = Path(__file__).resolve().parents[4] / ".." / "shared" / "data"


def real(name):
    if not (DATA / name).is_dir():
        pytest.skip(f"real logs of {name} are not at ../shared/data/{name}")
    return DATA / name


def test_a_drive_without_memory_is_found_to_have_none(tmp_path):
    """EMPS: the drive force is a static law of position error and velocity, so k2 ends at 1."""
    (tmp_path / "motion_a.parquet").symlink_to((real("emps") / "motion_a.parquet").resolve())
    log_set = read_log_set(tmp_path)
    assert log_set.joints == ("slide",)
    result = fit_actuator(log_set)
    (fit,) = result.fits
    assert fit["k2"].value > 0.9
    rows = compare_models(log_set, {"hydraulic": result.model})
    pooled = {row.model: row for row in rows if row.joint == row.trial == "all"}
    assert pooled["hydraulic"].free_run_skill > 0.8, "half a metre of motion is predicted from its own trial"


def test_an_unsigned_current_is_warned_about():
    log_set = read_log_set(real("so101"))
    assert len(log_set.joints) == 6 and len(log_set.trials) == 10
    assert any("seems to have lost the sign" in text for text in log_set.warnings)
    result = fit_actuator(log_set)
    assert result.dt == pytest.approx(0.02, rel=0.01)
