"""What the fit says when the logs do not determine what is asked."""

from __future__ import annotations

import json

import numpy as np
import pytest
from identify.small_logs import log_set, trajectory

from hqpipe.errors import IdentificationError, UsageError
from hqpipe.identify.paper_model import fit_actuator as module
from hqpipe.identify.paper_model.fit_actuator import fit_actuator


def still(samples=2000, joints=("hip", "knee"), which=(0, 1)):
    """Chosen joints hold a constant command under a constant load."""
    trial = trajectory(samples=samples, joints=joints)
    for j in which:
        trial.position[:, j] = 0.29
        trial.position_command[:, j] = 0.30
        trial.velocity[:, j] = 0.0
    return trial


def test_no_motion_anywhere_names_every_coefficient():
    with pytest.raises(IdentificationError, match="none of k1 … k4 can be identified: neither the command nor"):
        fit_actuator(log_set(still(), splits=["fit"]))


def test_one_idle_joint_does_not_spoil_the_others():
    result = fit_actuator(log_set(still(which=(1,)), splits=["fit"]))
    knee = result.fits[1]
    assert all(c.value is None and not c.identifiable for c in knee.coefficients)
    assert (result.model.parameters[1, :4] == 0.0).all(), "an unknown joint holds its torque"
    assert result.fits[0]["k1"].identifiable
    assert sum("knee" in text for text in result.warnings) == 4


def test_steady_load_cannot_separate_k1_from_k2():
    trial = trajectory(samples=2000, joints=("hip",))
    trial.position[:] = 0.28 + 1e-6 * np.sin(np.arange(2000))[:, None]
    trial.position_command[:] = 0.30
    trial.velocity[:] = 0.0
    steady = trajectory(
        samples=2000,
        joints=("hip",),
        position=trial.position,
        position_command=trial.position_command,
        velocity=trial.velocity,
        effort=5000.0 * (trial.position_command - trial.position),
    )
    with pytest.raises(IdentificationError, match="too poor to tell the coefficients apart"):
        fit_actuator(log_set(steady, splits=["fit"]))


def test_proportional_velocity_and_error_give_up_k3():
    trial = trajectory(samples=3000, joints=("hip",))
    velocity = 40.0 * (trial.position_command - trial.position)
    rng = np.random.default_rng(0)
    effort = np.cumsum(rng.normal(size=(3000, 1)), axis=0)
    logs = log_set(trajectory(samples=3000, joints=("hip",), velocity=velocity, effort=effort), splits=["fit"])
    fit = fit_actuator(logs).fits[0]
    assert fit["k3"].value is None and "cannot be told from" in fit["k3"].reason
    assert fit["k2"].identifiable


def ruled(velocity, error):
    """One joint that obeys eq. (7) with k = (400, 0.04, 8, 0), plus noise of 1 N·m; velocity and error (T,)."""
    samples = len(velocity)
    position = np.concatenate(([0.0], np.cumsum(velocity)[:-1] * 1e-3))
    torque = np.zeros(samples)
    for k in range(samples - 1):
        torque[k + 1] = 400.0 * error[k] + 0.96 * torque[k] - 8.0 * velocity[k]
    torque += np.random.default_rng(0).normal(size=samples)
    found = {"position": position, "velocity": velocity, "position_command": position + error, "effort": torque}
    columns = {name: values[:, None] for name, values in found.items()}
    return log_set(trajectory(samples=samples, joints=("hip",), **columns), splits=["fit"])


@pytest.mark.parametrize(("speed_per_error", "lone"), [(0.0, {"k3"}), (40.0, {"k1", "k3"})])
def test_what_one_of_sixty_windows_decides_is_said_and_neither_given_an_interval_nor_drawn(speed_per_error, lone):
    """Elsewhere the joint rests, or moves in proportion to its error, which tells only how k1 and k3 add up."""
    t = np.arange(6001) * 1e-3
    error = 0.1 * np.sin(17.0 * t) + 0.05 * np.sin(70.0 * t)
    velocity = speed_per_error * error
    velocity[2010:2090] = 2.0 * np.sin(np.arange(80) / 80.0 * 2.0 * np.pi)
    result = fit_actuator(ruled(velocity, error))
    drawn = result.posterior.draw(result.model, 50, np.random.default_rng(0))[:, 0, :4]
    for name, truth, column in zip(("k1", "k2", "k3"), (400.0, 0.04, 8.0), drawn.T, strict=False):
        found = result.fits[0][name]
        assert found.value == pytest.approx(truth, rel=0.01), "the model keeps what the window says"
        assert found.identifiable == (name not in lone) == (found.ci95 is not None)
        assert any(f"hip: {name} is not identifiable: one window" in text for text in result.warnings) == (name in lone)
        assert (column == found.value).all() if name in lone else 0.0 < column.std() < 0.01 * truth


def test_too_few_windows_for_an_interval_ask_for_none(monkeypatch):
    def refused(*_):
        raise AssertionError("the scatter between four windows says nothing")

    monkeypatch.setattr(module, "uncertainty", refused)
    result = fit_actuator(log_set(trajectory(samples=401), splits=["fit"]))
    assert result.posterior is None
    assert {c.ci95 for fit in result.fits for c in fit.coefficients} == {None}
    assert (result.model.parameters[:, 0] > 0.0).any()


def test_a_coefficient_on_its_bound_is_warned_about():
    trial = trajectory(samples=3000, joints=("hip",))
    against = trajectory(samples=3000, joints=("hip",), effort=-2000.0 * (trial.position_command - trial.position))
    result = fit_actuator(log_set(against, splits=["fit"]))
    assert result.fits[0]["k1"].at_bound and result.fits[0]["k1"].value == 0.0
    assert any("hip: k1 is on its physical bound 0" in text for text in result.warnings)


def test_settings_are_checked():
    logs = log_set(trajectory(), splits=["fit"])
    with pytest.raises(UsageError, match="scope is 'shard' – did you mean 'shared'"):
        fit_actuator(logs, scope="shard")
    with pytest.raises(UsageError, match="sprocket_radius: no value for joint 'knee'"):
        fit_actuator(logs, sprocket_radius={"hip": 0.06, "kne": 0.06})


def test_other_control_modes_are_said():
    logs = log_set(trajectory(), splits=["fit"], control_mode="torque")
    assert any("control mode is torque" in text for text in fit_actuator(logs).warnings)


def test_result_is_plain_data_and_deterministic():
    logs = log_set(trajectory(samples=2000), splits=["fit"])
    limits = {"hip": 300.0, "knee": 400.0}
    first, second = (fit_actuator(logs, sprocket_radius=0.06, effort_limit=limits) for _ in range(2))
    text = json.dumps(first.to_dict(), allow_nan=False)
    assert text == json.dumps(second.to_dict())
    assert first.model.joints == ("hip", "knee")
    np.testing.assert_array_equal(first.model.column("effort_limit"), [300.0, 400.0])
    assert first.model.dt == pytest.approx(1e-3)
