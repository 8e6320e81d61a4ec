"""What lies beside an actuator model that logs are compared with: read, or refused by name."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from hqpipe.actuators.augmented import Augmented
from hqpipe.actuators.files import save_actuator
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.posterior import Group, Posterior
from hqpipe.actuators.posterior_file import save_posterior
from hqpipe.errors import ConfigError
from hqpipe.gap.change.model_files import Left, digest, left_of, variances
from hqpipe.machine.layout import neutral_row, slot

RADIUS, GAINS = 0.2, {"k1": 13500.0, "k2": 0.05, "k3": 540.0, "k4": 1.8}
ENTRY = {"joint": "LFR", "coefficients": [], "free_run_rmse": 5.0, "noise": 3.0, "persistence_rmse": 40.0}


@pytest.fixture
def model(tmp_path):
    model = Hydraulic.build(("LFR",), dt=1e-3, **GAINS, sprocket_radius=RADIUS, effort_limit=900.0)
    save_actuator(model, tmp_path)
    return model


def write_fit(folder, entry):
    (folder / "fit.json").write_text(json.dumps({"per_joint": {"fits": [entry]}}))


def write_diagnosis(folder, rows):
    (folder / "diagnosis.json").write_text(json.dumps({"gap": {"noise_floor": 3.0}}))
    with (folder / "residuals.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, ["trial", "joint", "family", "rmse", "rmse_after", "rmse_persistence"])
        writer.writeheader()
        writer.writerows(rows)


def test_a_fit_says_what_it_left_and_how_much_its_logs_moved(model, tmp_path):
    write_fit(tmp_path, ENTRY)
    assert left_of(tmp_path, model) == {"LFR": Left(16.0, 1600.0)}
    write_fit(tmp_path, {name: value for name, value in ENTRY.items() if name != "persistence_rmse"})
    assert left_of(tmp_path, model)["LFR"].swing is None


def test_a_diagnosis_says_it_of_whole_joints_and_with_its_causes(tmp_path):
    model = Augmented(("LFR", "LFP"), np.tile(neutral_row(), (2, 1)), 1e-3)
    row = {"trial": "all", "family": "all", "rmse": 9.0, "rmse_after": 5.0, "rmse_persistence": 40.0}
    other = {**row, "joint": "LFP", "rmse_after": "", "rmse_persistence": ""}
    part = {**row, "joint": "LFR", "family": "speed", "rmse_after": 70.0}
    write_diagnosis(tmp_path, [{**row, "joint": "LFR"}, part, other])
    assert left_of(tmp_path, model) == {"LFR": Left(16.0, 1600.0), "LFP": Left(72.0, None)}


def test_the_posterior_counts_before_intervals_that_end_at_a_bound(model, tmp_path):
    cut = {"name": "k4", "ci95": [0.0, 3.6]}
    write_fit(tmp_path, {**ENTRY, "coefficients": [cut]})
    assert variances(tmp_path, model)["LFR"].keys() == {slot("base", "k4")}
    scatter = np.diag([100.0**2, 0.0, 0.0, 1.5**2])
    group = Group(
        ("LFR",), np.array(list(GAINS.values())), scatter, None, 0, np.zeros(4), np.array([np.inf, 1.0, np.inf, np.inf])
    )
    save_posterior(Posterior("hydraulic", tuple(GAINS), (group,)), model, tmp_path)
    found = variances(tmp_path, model)["LFR"]
    assert found == {
        slot("base", "k1"): pytest.approx((100.0 * RADIUS**2) ** 2),
        slot("base", "k4"): pytest.approx((1.5 * RADIUS) ** 2),
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"per_joint": {"fits": [{"joint":', r"fit\.json:1: not JSON .*run hqpipe fit-actuator again"),
        ("[]", r"fit\.json: expected an object, got a list of 0"),
        ('{"per_joint": {"fits": {}}}', r"fit\.json: per_joint\.fits: expected a list, got an object"),
        (
            '{"per_joint": {"fits": [{"joint": "LFR"}]}}',
            r"per_joint\.fits\[0\]\.joint: missing field 'free_run_rmse' beside it",
        ),
    ],
)
def test_a_broken_fit_is_named(model, tmp_path, text, message):
    (tmp_path / "fit.json").write_text(text)
    with pytest.raises(ConfigError, match=message):
        left_of(tmp_path, model)


def test_a_coefficient_of_another_name_is_refused(model, tmp_path):
    write_fit(tmp_path, {**ENTRY, "coefficients": [{"name": "k9"}]})
    with pytest.raises(ConfigError, match=r"coefficients\[0\]\.name: 'k9'.*, expected k1 or k2 or k3 or k4"):
        variances(tmp_path, model)


def test_a_broken_diagnosis_is_named(tmp_path):
    model = Augmented(("LFR",), neutral_row()[None], 1e-3)
    row = {"trial": "all", "joint": "LFR", "family": "all", "rmse": "x", "rmse_after": "", "rmse_persistence": ""}
    write_diagnosis(tmp_path, [row])
    with pytest.raises(ConfigError, match=r"residuals\.csv: joint LFR: rmse: expected a number, got 'x'"):
        left_of(tmp_path, model)
    (tmp_path / "residuals.csv").write_text("trial,joint\n")
    with pytest.raises(ConfigError, match=r"residuals\.csv: no column 'family': run hqpipe diagnose again"):
        left_of(tmp_path, model)


def test_the_digest_covers_every_file_that_counts(model, tmp_path):
    before = digest(tmp_path)
    (tmp_path / "comparison.csv").write_text("a rival")
    assert digest(tmp_path) == before
    write_fit(tmp_path, ENTRY)
    assert digest(tmp_path) != before
