"""An actuator model as the record that logs are compared with, and what does not fit together."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from planted_logs import logs_of

from hqpipe.actuators.augmented import Augmented
from hqpipe.actuators.files import save_actuator
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.stiff_pd import StiffPD
from hqpipe.errors import UsageError
from hqpipe.gap.change.since import FAMILIAR, check_alike, earlier_actuator
from hqpipe.machine.layout import NOT_KNOWN, neutral_row, slot

JOINTS = ("LFR", "LFP")
RADIUS = 0.2


@pytest.fixture(scope="module")
def logs():
    return logs_of([{}, {}], seconds=2.0)


def hydraulic(**changes):
    columns = {
        "k1": 13500.0,
        "k2": [0.05, 0.06],
        "k3": 540.0,
        "k4": 1.8,
        "sprocket_radius": RADIUS,
        "effort_limit": 900.0,
    }
    return Hydraulic.build(JOINTS, dt=1e-3, **(columns | changes))


def test_the_paper_s_coefficients_become_joint_space(tmp_path):
    save_actuator(hydraulic(), tmp_path)
    found = earlier_actuator(tmp_path)
    row = found.rows["LFP"]
    gains = [row[slot("base", name)] for name in ("k1", "k2", "k3", "k4")]
    assert gains == pytest.approx([540.0, 0.06, 21.6, 0.36])
    assert row[slot("setting", "effort_limit")] == 900.0
    assert found.header().keys() == {"path", "kind", "sha256"} and found.header()["kind"] == "actuator"
    assert np.isnan(row[slot("coulomb_friction", "presliding_rad")]), "the model does not say it"
    assert "no intervals" in found.warnings[0] and "how much its own logs moved" in found.warnings[1]


def test_intervals_of_the_fit_are_in_joint_space_too(tmp_path):
    save_actuator(hydraulic(), tmp_path)
    coefficients = [{"name": "k1", "ci95": [13000.0, 14000.0]}, {"name": "k4", "ci95": None}]
    fits = [
        {"joint": joint, "coefficients": coefficients, "free_run_rmse": 5.0, "noise": 3.0, "persistence_rmse": 40.0}
        for joint in JOINTS
    ]
    (tmp_path / "fit.json").write_text(json.dumps({"per_joint": {"fits": fits}}))
    found = earlier_actuator(tmp_path)
    assert found.sd["LFR"] == {slot("base", "k1"): pytest.approx(1000.0 / 2 / 1.96 * RADIUS**2, rel=1e-3)}
    assert (found.left["LFR"].error, found.left["LFR"].swing) == (16.0, 1600.0) and not found.warnings
    assert found.familiar("LFR", 1600.0) == FAMILIAR * 16.0
    assert found.familiar("LFR", 3200.0) == 2.0 * FAMILIAR * 16.0, "it errs more where the output moves more"


def test_coefficients_of_long_samples_become_those_of_the_controller_s_steps(tmp_path):
    """A held opening at a held speed turns the torque by as much in a sample of 5 ms as in five of 1 ms."""
    model = replace(hydraulic(), dt=5e-3)
    save_actuator(model, tmp_path)
    row = earlier_actuator(tmp_path).rows[model.joints[0]]
    k1, k2, k3 = (row[slot("base", name)] for name in ("k1", "k2", "k3"))
    torque = 0.0
    for _ in range(5):
        torque += k1 * 0.01 - k2 * torque - k3 * 0.3
    radius = model.column("sprocket_radius")[0]
    coarse = [model.column(name)[0] * radius**power for name, power in (("k1", 2), ("k3", 2))]
    assert torque == pytest.approx(coarse[0] * 0.01 - coarse[1] * 0.3, rel=5 * k2)
    assert (1.0 - k2) ** 5 == pytest.approx(1.0 - model.column("k2")[0])
    assert row[slot("setting", "sample_time")] == pytest.approx(1e-3)


def test_a_diagnosed_model_brings_its_effects(tmp_path):
    rows = np.tile(neutral_row(), (2, 1))
    rows[:, slot("base", "k1")] = 540.0
    rows[1, slot("valve_lag", "time_constant_s")] = 0.01
    rows[:, slot("setting", "held")] = 2.0
    save_actuator(Augmented(JOINTS, rows, 1e-3), tmp_path)
    found = earlier_actuator(tmp_path)
    rows[:, slot("setting", "held")] = NOT_KNOWN  # other logs begin in their own way
    np.testing.assert_array_equal([found.rows[joint] for joint in JOINTS], rows)


def test_a_model_without_coefficients_is_refused(tmp_path):
    save_actuator(StiffPD.build(JOINTS, kp=100.0, kd=1.0, effort_limit=np.inf), tmp_path)
    with pytest.raises(UsageError, match=r"kind 'stiff_pd' has no coefficients.*artifacts/diagnosis or the logs"):
        earlier_actuator(tmp_path)


@pytest.mark.parametrize(
    "change,message",
    [
        ({"mode": "torque"}, r"control modes position and torque: give a reference of the same mode"),
        ({"joints": ("LFR", "LFQ")}, r"joints LFR, LFP and LFR, LFQ, without 'LFP': give"),
        ({"dt": 1.4e-3}, r"sample times 0\.001 s and 0\.0014 s"),
        ({"source": "pressure"}, r"torques from load_cell and from pressure"),
    ],
)
def test_what_does_not_fit_together_names_both(logs, change, message):
    told = {"path": "then", "mode": "position", "joints": JOINTS, "dt": 1e-3, "source": None}
    check_alike(logs, **told)
    with pytest.raises(UsageError, match=message) as caught:
        check_alike(logs, **(told | change))
    assert "synthetic and the reference then" in str(caught.value) and "\n" not in str(caught.value)


def test_valve_mode_is_refused(logs):
    with pytest.raises(UsageError, match=r"control mode valve.*position mode only: diagnose such logs without"):
        check_alike(replace(logs, control_mode="valve"), "then", "valve", JOINTS, 1e-3)
