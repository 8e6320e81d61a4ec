"""The model of one joint: inert at neutral bit for bit, the paper's law underneath, units, numbers held as their inverse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from position_loop_logs import DT, changed, neutral

from hqpipe.identify.model import all_parameters
from hqpipe.layers.actuator import Actuator
from hqpipe.layers.actuator.parameters import BASE_NAMES
from hqpipe.layers.actuator.spool_hysteresis import command_behind
from hqpipe.logs.joint_kinds import PRISMATIC
from hqpipe.machine import EFFECTS


def alone(model, *names):
    """The joint with some of its effects of the loops, without the shapes."""
    effects = [
        e.name for e in model.effects for _ in e.parameters
    ]  # one may hold a number that acts in another's place
    places = tuple(p for name, p in zip(effects, model.places, strict=False) if name in names)
    kept = tuple(e for e in model.effects if e.name in names)
    return replace(model, effects=kept, places=places, shape_scale=np.zeros(0), stepped=None)


def placed(model, effect, name):
    """Index into the values of a parameter of an effect."""
    at = len(model.base)
    for other in model.effects:
        if other.name == effect:
            return at + [p.name for p in other.parameters].index(name)
        at += len(other.parameters)
    raise AssertionError(f"{effect} is not among the effects")


def held_at_its_bounds(model):
    return all(p.low <= p.neutral <= p.high for p in all_parameters(model))


@pytest.mark.parametrize("heldout", [False, True])
def test_every_effect_at_neutral_leaves_the_base_model_bit_for_bit(model, heldout):
    bare = alone(model)
    expected = bare.error(neutral(bare), heldout)
    assert len(expected) > 100 and held_at_its_bounds(model)
    assert np.array_equal(model.error(neutral(model), heldout), expected)
    for name in dict.fromkeys(owner for owner, _ in model.places):
        one = alone(model, name)
        assert np.array_equal(one.error(neutral(one), heldout), expected), name


def test_the_numbers_beside_a_neutral_first_number_do_nothing(model):
    expected = model.error(neutral(model))
    for effect in (e for e in model.effects if e.named):
        values = neutral(model)
        for p in effect.parameters[1:]:
            values[placed(model, effect.name, p.name)] = p.low + 0.3 * (p.high - p.low)
        assert np.array_equal(model.error(values), expected), effect.name


@pytest.mark.parametrize(
    "share,unequal,acts", [(0.9, 0.1, False), (1.1, 0.1, True), (1.1, -0.1, True), (1.1, 0.02, False)]
)
def test_unequal_areas_act_where_the_orifice_bends_the_flow_and_a_rod_can_be(model, share, unequal, acts):
    orifice, areas = placed(model, "orifice_flow", "effort_max_nm"), placed(model, "direction_asymmetry", "areas")
    values = neutral(model)
    values[orifice] = share * all_parameters(model)[orifice].least
    expected = model.error(values)
    values[areas] = unequal
    assert (areas in model.idle(values)) is not acts
    assert np.array_equal(model.error(values), expected) is not acts


@pytest.mark.parametrize(
    "share,unequal,zero,bias,counts",
    [
        (1.1, 0.0, 0.01, 0.0, 1),
        (1.1, 0.02, 0.01, 0.0, 1),
        (0.9, 0.0, 0.01, 0.0, 0),
        (1.1, 0.1, 0.01, 0.0, 0),
        (1.1, 0.0, 0.0, 5.0, 0),
    ],
)
def test_sides_are_alike_to_within_a_tolerance_beside_an_orifice_and_an_offset_of_the_position(
    model, share, unequal, zero, bias, counts
):
    values = neutral(model)
    places = [("orifice_flow", "effort_max_nm"), ("direction_asymmetry", "areas"), ("position_bias", "rad")]
    orifice, areas, offset, torque_bias = (placed(model, *place) for place in (*places, ("torque_bias", "nm")))
    values[[areas, offset, torque_bias]] = unequal, zero, bias
    values[orifice] = share * all_parameters(model)[orifice].least
    columns = model.tolerances(values)
    assert columns.shape == (len(model.fit.time), counts)
    assert (np.sum(columns**2, axis=0) > 0.0).all()


@pytest.mark.parametrize("ratio", [0.0, 0.03])
def test_a_mean_pressure_strays_only_where_the_directions_have_no_ratio(model, ratio):
    slope, strayed = (placed(model, "position_dependent_stiffness", name) for name in ("slope_per_rad", "strayed"))
    values = neutral(model)
    values[[slope, placed(model, "direction_asymmetry", "ratio")]] = 0.6, ratio
    expected = model.error(values)
    values[strayed] = 0.01
    assert (strayed in model.idle(values)) is (ratio != 0.0)
    assert np.array_equal(model.error(values), expected) is (ratio != 0.0)


@pytest.mark.parametrize(
    "share,offset,beyond", [(1.1, 0.11, True), (1.1, -0.11, True), (1.1, 0.09, False), (0.9, 0.11, False)]
)
def test_an_offset_beyond_a_tenth_of_the_largest_torque_is_none_of_a_sensor(model, share, offset, beyond):
    orifice, torque_bias = placed(model, "orifice_flow", "effort_max_nm"), placed(model, "torque_bias", "nm")
    values = neutral(model)
    assert model.beyond(values) == ()
    values[orifice] = share * all_parameters(model)[orifice].least
    values[torque_bias] = offset / values[orifice]
    assert model.beyond(values) == (("torque_bias",) if beyond else ())


@pytest.mark.parametrize("share,sound", [(1.1, True), (0.9, False)])
def test_an_offset_within_a_hundredth_of_the_largest_torque_may_be_that_of_a_sound_sensor(model, share, sound):
    orifice = placed(model, "orifice_flow", "effort_max_nm")
    values = neutral(model)
    assert model.sound_sizes(values) == {}
    values[orifice] = share * all_parameters(model)[orifice].least
    assert model.sound_sizes(values) == ({"torque_bias": pytest.approx(0.01 / values[orifice])} if sound else {})
    assert alone(model, "orifice_flow").sound_sizes(neutral(alone(model, "orifice_flow"))) == {}


@pytest.mark.parametrize(
    "share,offset,told", [(1.1, 0.009, True), (1.1, -0.009, True), (1.1, 0.011, False), (0.9, 0.009, False)]
)
def test_a_remark_tells_of_an_offset_that_a_sound_sensor_may_have(model, share, offset, told):
    orifice, torque_bias = placed(model, "orifice_flow", "effort_max_nm"), placed(model, "torque_bias", "nm")
    values = neutral(model)
    values[orifice] = share * all_parameters(model)[orifice].least
    assert model.remarks((), values) == ()
    values[torque_bias] = offset / values[orifice]
    assert any("logged effort has an offset" in remark for remark in model.remarks((), values)) is told
    assert model.remarks(("torque_bias",), values) == ()


@pytest.mark.parametrize("offset,idle", [(0.0, False), (0.05, True), (-0.05, True)])
def test_unequal_areas_do_nothing_beside_an_offset_of_the_torque(model, offset, idle):
    places = ("orifice_flow", "effort_max_nm"), ("torque_bias", "nm"), ("direction_asymmetry", "areas")
    orifice, torque_bias, areas = (placed(model, *place) for place in places)
    values = neutral(model)
    values[orifice] = 1.1 * all_parameters(model)[orifice].least
    values[torque_bias] = offset / values[orifice]
    expected = model.error(values)
    values[areas] = 0.06
    assert (areas in model.idle(values)) is idle
    assert np.array_equal(model.error(values), expected) is idle


@pytest.mark.parametrize("share,offset,same", [(1.1, 0.01, True), (0.9, 0.01, False), (1.1, 0.0, False)])
def test_an_offset_beside_an_orifice_may_be_unequal_areas(model, share, offset, same):
    orifice, torque_bias = placed(model, "orifice_flow", "effort_max_nm"), placed(model, "torque_bias", "nm")
    values = neutral(model)
    assert model.same_by_law(values) == {}
    values[orifice] = share * all_parameters(model)[orifice].least
    values[torque_bias] = offset / values[orifice]
    assert model.same_by_law(values) == ({"torque_bias": ("direction_asymmetry",)} if same else {})


def test_unequal_areas_that_were_left_out_are_no_name_for_an_offset(model):
    joint = alone(model, "orifice_flow", "torque_bias")
    orifice, torque_bias = placed(joint, "orifice_flow", "effort_max_nm"), placed(joint, "torque_bias", "nm")
    values = neutral(joint)
    values[orifice] = 1.1 * all_parameters(joint)[orifice].least
    values[torque_bias] = 0.01 / values[orifice]
    assert joint.same_by_law(values) == {}
    assert joint.sound_sizes(values) == {"torque_bias": values[torque_bias]}, "a sensor is as good with or without them"
    values[torque_bias] *= 11.0
    assert joint.beyond(values) == ("torque_bias",)


def test_areas_without_an_orifice_do_nothing(model):
    joint = alone(model, "direction_asymmetry")
    values, areas = neutral(joint), placed(joint, "direction_asymmetry", "areas")
    expected = joint.error(values)
    values[areas] = 0.1
    assert areas in joint.idle(values) and np.array_equal(joint.error(values), expected)


def test_every_effect_and_every_shape_does_something(model):
    expected = model.error(neutral(model))
    for effect in model.effects:
        values, first = neutral(model), effect.parameters[0]
        values[placed(model, effect.name, first.name)] = first.starts[-1] if first.starts else first.spread
        assert np.max(np.abs(model.error(values) - expected)) > 1e-3, effect.name


def test_the_base_is_the_law_of_the_paper_from_the_logged_torque_on(logs, model):
    base = dict(zip([p.name for p in model.base], neutral(model), strict=False))
    t, record = logs.fit[0].trajectory, model.records[0]
    q, command, measured = t.position[:, 0], t.position_command[:, 0], t.effort[:, 0]
    expected = []
    for first in record.signals.first:
        torque = measured[first]
        for k in range(first, first + record.signals.steps):
            u, v = command[k] - q[k], (q[k + 1] - q[k]) / DT
            braked = u * abs(torque) if torque * u < 0.0 else 0.0
            torque = torque + base["k1"] * u - base["k2"] * torque - base["k3"] * v + base["k4"] * braked
            if k + 1 - first in record.step:
                expected.append(torque - measured[k + 1])
    assert model.error(neutral(model)) == pytest.approx(np.array(expected), rel=1e-8, abs=1e-7)


def test_what_a_planted_machine_is_made_of_leaves_its_noise_alone(model):
    values = neutral(model)
    values[:4] = [540.0, 0.05, 21.6, 0.36]  # see planted_effects.GAINS
    left = np.sqrt(np.mean(model.error(values) ** 2))
    assert left == pytest.approx(model.noise[0], rel=0.1)
    assert model.noise[0] == pytest.approx(3.0, rel=0.2)  # N·m, of the sensor; that of the start of a window fades


def test_persistence_holds_the_torque_at_the_start_of_the_window(model):
    samples, first = model.fit, model.records[0].signals.first
    held = samples.held.reshape(len(first), -1)
    assert np.all(held == held[:, :1])
    assert np.array_equal(held[:, 0], model.records[0].signals.effort[first])
    assert samples.output.shape == samples.time.shape == samples.velocity.shape


def test_an_inverse_number_is_held_as_one_over_what_is_reported(model):
    assert model.reported("orifice_flow", "effort_max_nm", 1.0 / 900.0) == (
        "effort_max_nm",
        pytest.approx(900.0),
        "N·m",
    )
    assert model.reported("flow_saturation", "limit", 20.0) == ("limit", pytest.approx(0.05), "rad")
    assert model.reported("flow_saturation", "limit", 0.0)[1] == np.inf
    assert model.reported("valve_deadband", "half_width", 0.02) == ("half_width", 0.02, "rad")
    assert model.reported("viscous_friction", "nm_s_per_rad", 3.0) == ("nm_s_per_rad", 3.0, "N·m·s/rad")
    limit = next(e for e in model.effects if e.name == "orifice_flow").parameters[0]
    values = neutral(model)
    values[placed(model, "orifice_flow", "effort_max_nm")] = limit.high
    assert limit.neutral == 0.0 and np.isfinite(model.error(values)).all()


def test_a_joint_that_slides_is_judged_in_newton_and_metre(logs, model):
    sliding = Actuator().joints(replace(logs, kinds=dict.fromkeys(logs.joints, PRISMATIC))).models[0]
    assert (model.unit, sliding.unit) == ("N·m", "N")
    assert np.array_equal(sliding.error(neutral(sliding)), model.error(neutral(model)))
    units = {(owner, name): sliding.reported(owner, name, 1.0)[2] for owner, name in sliding.places if owner in EFFECTS}
    assert units["orifice_flow", "effort_max_nm"] == "N" and units["flow_saturation", "limit"] == "m"
    assert units["viscous_friction", "nm_s_per_rad"] == "N·s/m" and units["supply_droop", "droop"] == "s/m"
    assert units["position_dependent_stiffness", "slope_per_rad"] == "1/m"
    assert not any("rad" in unit or "command" in unit for unit in units.values())


def test_a_joint_beside_one_that_slides_keeps_its_share_of_the_flow(logs):
    def slide(t):
        small = np.array([1.0, 0.01])
        return replace(
            t, position=t.position * small, velocity=t.velocity * small, position_command=t.position_command * small
        )

    kinds = {logs.joints[0]: "revolute", logs.joints[1]: PRISMATIC}
    turning, sliding = Actuator().joints(replace(changed(logs, slide), kinds=kinds)).models
    speeds = [np.sqrt(np.mean(t.signals.velocity**2)) for t in (turning.records[0], sliding.records[0])]
    assert turning.draws[0] == 1.0 and sliding.draws[0] == pytest.approx(speeds[0] / speeds[1], rel=0.01)


def test_a_shape_that_grows_with_time_grows_alike_in_a_shorter_held_out_trial(logs):
    short = tuple(t if t.split == "fit" else replace(t, trajectory=t.trajectory.section(0, 1500)) for t in logs.trials)
    joint = Actuator().joints(replace(logs, trials=short), window_s=0.1).models[0]
    at = [p.name for p in all_parameters(joint)[-len(joint.shape_scale) :]].index("offset_drift_1")
    slopes = []
    for record, shapes in zip(joint.records, joint.shapes, strict=True):
        first = shapes[at].reshape(record.windows, -1)[:, 0]  # of each window
        slopes.append(np.polyfit(record.signals.time[record.signals.first], first, 1)[0])
    assert slopes[1] == pytest.approx(slopes[0], rel=1e-6)


def test_the_pump_is_only_asked_for_where_the_supply_pauses(logs):
    def droop_of(log_set):
        joint = Actuator().joints(log_set).models[0]
        return [p.name for p in next(e for e in joint.effects if e.name == "supply_droop").parameters]

    def steady(t):
        return replace(t, velocity=np.where(t.velocity >= 0.0, 1.0, -1.0))

    def pausing(t):
        return replace(t, velocity=t.velocity * (t.time % 1.0 > 0.4)[:, None])

    assert "pump_velocity_rad_s" not in droop_of(changed(logs, steady))
    assert "pump_velocity_rad_s" in droop_of(changed(logs, pausing))


@pytest.mark.parametrize(("source", "asked"), [("load_cell", True), ("pressure", False)])
def test_friction_is_asked_for_where_the_sensor_feels_it(logs, source, asked):
    names = {e.name for e in Actuator().joints(replace(logs, effort_source=source)).models[0].effects}
    assert ("coulomb_friction" in names) == ("load_dependent_friction" in names) == asked
    assert {"valve_deadband", "orifice_flow"} <= names


def test_sensitivities_that_the_joint_gives_are_those_of_differences(model):
    values, parameters = neutral(model), all_parameters(model)
    before, given = model.error(values).copy(), 0
    for index in range(len(parameters)):
        exact = model.sensitivity(values, index)
        if exact is not None:
            moved = values.copy()
            moved[index] += 0.5
            np.testing.assert_allclose((model.error(moved) - before) / 0.5, exact, rtol=1e-6, atol=1e-6)
            given += 1
    assert given == len(model.shape_scale) > 10


def test_a_gain_that_changes_suddenly_changes_what_begins_after_its_moment_and_stands_beside_no_drift(model):
    """A window that ends before the moment is as it was; one that begins after it is that of another gain."""
    values, change = neutral(model), next(e for e in model.effects if e.name == "sudden_change")
    values[placed(model, "sudden_change", "gain_step")] = 0.3
    other = neutral(model)
    other[[0, 3]] *= 1.3  # of what the opening does: flow, and impacts
    before, after, whole = (model.error(each).copy() for each in (neutral(model), values, other))
    s = model.records[0].signals
    begins, ends = s.time[s.first], s.time[s.first + s.steps]
    moment = s.time[model.stepped[0] > 0.5].min()
    for window, same in ((ends < moment, before), (begins >= moment, whole)):
        sample = np.broadcast_to(window[:, None], model.records[0].judged.shape)[model.records[0].judged]
        assert sample.any()
        np.testing.assert_allclose(after[sample], same[sample], rtol=1e-5, atol=1e-3)
    drift = next(e for e in model.effects if e.name == "gain_drift")
    assert "gain_drift" in change.excludes and "sudden_change" in drift.excludes
    assert np.array_equal(model.row(values), model.row(neutral(model))), "it is no number of the machine"


@pytest.mark.parametrize("timed", ["gain_drift", "leakage_drift"])
def test_a_sudden_change_does_nothing_beside_what_changes_in_time(model, timed):
    """An earlier record may have such a drift, and nothing excludes its effects."""
    values, change = neutral(model), placed(model, "sudden_change", "gain_step")
    assert change not in model.idle(values)
    values[placed(model, timed, "rate_per_s")] = 0.01
    expected = model.error(values).copy()
    values[change] = 0.3
    assert change in model.idle(values)
    assert np.array_equal(model.error(values), expected)


def test_shapes_inside_the_law_leave_nothing_behind_in_the_runs_that_follow(model):
    """Of what is kept from run to run the signals that they change are others."""
    kept = neutral(model)
    step = placed(model, "sudden_change", "gain_step")
    play, lag = placed(model, "hysteresis", "half_play"), placed(model, "valve_lag", "time_constant_s")
    both = {play: 0.01, step: 0.2}
    for numbers in ({}, {play: 0.01}, both, {play: 0.02, lag: 0.01}, {step: 0.2, lag: 0.01}, {lag: 0.01}, {}):
        values = kept.copy()
        values[list(numbers)] = list(numbers.values())
        assert np.array_equal(model.error(values), replace(model).error(values)), numbers


def test_a_spool_with_a_play_stands_after_each_reversal_until_the_play_is_passed(logs, model):
    t, values = logs.fit[0].trajectory, neutral(model)
    values[placed(model, "hysteresis", "half_play")] = half_play = 0.3 * np.std(t.position_command - t.position)
    s = model.records[0].signals
    opening, late = s.command - s.position, command_behind(s, half_play) - s.position
    assert np.max(np.abs(late - opening)) == pytest.approx(half_play)
    standing = np.diff(late)[np.abs(late - opening)[1:] < 0.999 * half_play]
    assert len(standing) > 100 and np.max(np.abs(standing)) < 1e-12, "it stands until the play is passed"
    assert np.max(np.abs(model.error(values) - model.error(neutral(model)))) > 1.0


def test_a_moment_arm_that_changes_is_told_in_a_remark(model):
    values, slope = neutral(model), BASE_NAMES.index("arm_slope")
    assert model.remarks((), values) == ()
    values[slope] = 0.2 / np.ptp(model.fit.position)  # a fifth of the arm in the middle, from one end to the other
    (remark,) = model.remarks((), values)
    assert "changes by about 20 %" in remark
    values[slope] *= 0.1
    assert model.remarks((), values) == ()
