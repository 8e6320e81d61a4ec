"""The posterior of a diagnosed model: as sure as its intervals, with the sets that may stand in the place of those found."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from plant_logs import broken, values
from planted_logs import logs_of, size

from hqpipe.actuators.augmented import OF_THE_LOG
from hqpipe.actuators.files import load_actuator
from hqpipe.actuators.posterior_file import FILE, load_posterior
from hqpipe.gap import layer_diagnosis
from hqpipe.gap.change.since import EarlierLogs
from hqpipe.gap.diagnosis import diagnose, write_diagnosis
from hqpipe.gap.model_posterior import AS_FOUND, _together
from hqpipe.identify.found import Exchange
from hqpipe.identify.thresholds import CONFUSED
from hqpipe.machine import EFFECTS

NORMAL = 1.959964  # half width of a 95 % interval over the deviation
DELAYS = ("command_delay", "valve_delay", "valve_lag", "channel_skew")
DELAY, OTHER = "command_delay_delay_s", "valve_delay_delay_s"


def without(*kept):
    """A part of the library keeps these tests short."""
    return tuple(name for name in EFFECTS if name not in kept)


@pytest.fixture(scope="module")
def delayed():
    """Three joints with a delay of the command, in noise that hides which delay it is."""
    return diagnose(logs_of([size("command_delay")] * 3, noise=80.0), without=without(*DELAYS))


@pytest.fixture(scope="module")
def biased():
    """One joint with a deadband and an offset of its sensor, one with none."""
    logs = logs_of([size("valve_deadband", "torque_bias"), {}], seconds=3.0)
    return diagnose(logs, without=without("valve_deadband", "torque_bias"))


def numbers(posterior, joint, field):
    """Mean and deviation of a number of a joint as it was found."""
    (group,) = (group for group in posterior.held if joint in group.joints)
    at = posterior.fields.index(field)
    return group.mean[at], np.sqrt(group.scatter[at, at])


def test_the_deviations_are_those_of_the_intervals(biased):
    (cause,) = (cause for cause in biased.content["causes"] if cause["effect"] == "valve_deadband")
    (joint,) = cause["joints"]
    for name, number in cause["parameters"].items():
        mean, deviation = numbers(biased.posterior, joint, f"valve_deadband_{name}")
        if name == "half_width":  # the rounding is reported as its root
            np.testing.assert_allclose(mean, number["value"], rtol=1e-5)
            np.testing.assert_allclose(
                [mean - NORMAL * deviation, mean + NORMAL * deviation], number["ci95"], rtol=1e-4
            )
        assert deviation > 0.0


def test_draws_are_as_wide_as_the_intervals(biased):
    (cause,) = (cause for cause in biased.content["causes"] if cause["effect"] == "valve_deadband")
    actuator = biased.augmented
    table = biased.posterior.draw(actuator, 1000, np.random.default_rng(0))
    column = list(actuator.FIELDS).index("valve_deadband_half_width")
    drawn = table[:, actuator.joints.index(cause["joints"][0]), column]
    low, high = cause["parameters"]["half_width"]["ci95"]
    np.testing.assert_allclose(np.quantile(drawn, [0.025, 0.975]), [low, high], atol=0.15 * (high - low))
    assert (table[:, 1, column] == 0.0).all(), "the joint without a cause has none in any robot"


def test_an_inverse_is_drawn_as_the_fit_has_it():
    logs = logs_of([size("orifice_flow")], seconds=4.0)
    found = diagnose(logs, without=without("orifice_flow"))
    (cause,) = found.content["causes"]
    mean, deviation = numbers(found.posterior, logs.joints[0], "orifice_flow_effort_max_nm")
    ends = [1.0 / (mean + NORMAL * deviation), 1.0 / (mean - NORMAL * deviation)]
    limit = cause["parameters"]["effort_max_nm"]
    np.testing.assert_allclose([1.0 / mean, *ends], [limit["value"], *limit["ci95"]], rtol=1e-4)


def test_what_the_sensors_show_is_no_part_of_it(biased):
    assert {"valve_deadband", "torque_bias"} <= {cause["effect"] for cause in biased.content["causes"]}
    owners = {name for name in OF_THE_LOG for field in biased.posterior.fields if field.startswith(name)}
    assert not owners and {"k1", "k2", "k3", "valve_deadband_half_width"} <= set(biased.posterior.fields)


def test_a_cause_and_its_rivals_are_alternatives_of_all_joints_together(delayed):
    (cause,) = delayed.content["causes"]
    assert cause["effect"] == "command_delay" and len(cause["joints"]) == 3 and "valve_delay" in cause["confused_with"]
    (choice,) = delayed.posterior.choices
    assert sorted(choice.joints) == sorted(delayed.augmented.joints) and delayed.posterior.groups == ()
    names = [alternative.name for alternative in choice.alternatives]
    assert names[0] == AS_FOUND and "valve_delay in place of command_delay" in names
    assert len(names) == 1 + len(cause["confused_with"])
    weights = choice.weights
    assert weights.sum() == pytest.approx(1.0) and weights.max() == weights[0]
    assert (weights >= 0.9 * CONFUSED * weights[0]).all()


def test_a_robot_has_one_delay_in_all_of_its_joints(delayed):
    actuator, posterior = delayed.augmented, delayed.posterior
    table = posterior.draw(actuator, 400, np.random.default_rng(0))
    command, valve = (table[..., list(actuator.FIELDS).index(name)] for name in (DELAY, OTHER))
    (number,) = posterior.chosen(400, np.random.default_rng(0))
    other = [a.name for a in posterior.choices[0].alternatives].index("valve_delay in place of command_delay")
    assert 0 < np.sum(number == other) < 100
    np.testing.assert_array_equal(valve != 0.0, np.tile((number == other)[:, None], (1, 3)))
    np.testing.assert_array_equal(command != 0.0, np.tile((number == 0)[:, None], (1, 3)))
    assert valve[number == other].mean() > 0.002, "its own number, fitted in the place of the other"


def test_each_alternative_has_the_base_that_was_fitted_beside_it(delayed):
    found, other = (
        next(a for a in delayed.posterior.choices[0].alternatives if a.name.startswith(start)).groups[0]
        for start in (AS_FOUND, "valve_delay")
    )
    k1 = delayed.posterior.fields.index("k1")
    assert found.mean[k1] != other.mean[k1] and found.scatter[k1, k1] > 0.0 < other.scatter[k1, k1]


def test_it_is_written_beside_the_model_and_read_again(delayed, tmp_path):
    for folder in (tmp_path / "a", tmp_path / "b"):
        write_diagnosis(delayed, folder)
    assert (tmp_path / "a" / FILE).read_bytes() == (tmp_path / "b" / FILE).read_bytes()
    actuator = load_actuator(tmp_path / "a")
    again = load_posterior(tmp_path / "a", actuator)
    drawn = [p.draw(actuator, 20, np.random.default_rng(1)) for p in (again, delayed.posterior)]
    np.testing.assert_array_equal(*drawn)
    raw = json.loads((tmp_path / "a" / FILE).read_text(encoding="utf-8"))
    raw["choices"][0]["alternatives"][1]["weight"] = 2.0
    (tmp_path / "a" / FILE).write_text(json.dumps(raw), encoding="utf-8")
    with pytest.raises(Exception, match="weight: is 2, expected 0 to 1: run hqpipe diagnose again"):
        load_posterior(tmp_path / "a", actuator)


def test_the_same_logs_give_the_same_posterior_with_any_number_of_workers(tmp_path):
    logs = logs_of([size("command_delay")] * 2, noise=80.0, seconds=4.0)
    for workers in (1, 2):
        write_diagnosis(diagnose(logs, without=without(*DELAYS), workers=workers), tmp_path / str(workers))
    assert (tmp_path / "1" / FILE).read_bytes() == (tmp_path / "2" / FILE).read_bytes()


def test_what_other_channels_have_settled_is_no_alternative(monkeypatch):
    """A report that no longer lists a rival: the posterior has what the report says."""
    logs = logs_of([size("command_delay")] * 2, noise=80.0, seconds=4.0)
    plain = diagnose(logs, without=without(*DELAYS))
    assert plain.posterior.choices

    def settled(causes, findings, compared):
        return [replace(cause, rivals=()) for cause in causes]

    monkeypatch.setattr(layer_diagnosis, "settle_offsets", settled)
    found = diagnose(logs, without=without(*DELAYS))
    assert found.posterior.choices == () and len(found.posterior.groups) == 2


def exchanging(name, *exchanges):
    steps = tuple(Exchange(leaves, joins, 1.0, None) for leaves, joins in exchanges)
    return SimpleNamespace(model=SimpleNamespace(joint=name), exchanges=steps)


def test_joints_with_an_exchange_in_common_draw_together_also_by_way_of_others():
    delay, friction, lag = ("delay", "lag"), ("dry", "viscous"), ("lag", "delay")
    joints = [exchanging("a", delay), exchanging("b", friction), exchanging("c"), exchanging("d", lag)]
    assert [[j.model.joint for j in batch] for batch in _together(joints)] == [["a"], ["b"], ["d"]]
    joints.append(exchanging("e", friction, delay))
    assert [[j.model.joint for j in batch] for batch in _together(joints)] == [["a", "b", "e"], ["d"]]


def test_changes_since_an_earlier_record_have_none():
    logs = logs_of([{}, {}], seconds=4.0)
    later = broken(logs, values("effort", lambda torque: 1.2 * torque))
    found = diagnose(later, without=without("torque_bias"), earlier=EarlierLogs(logs))
    assert found.augmented is not None and found.posterior is None
