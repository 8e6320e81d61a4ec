"""What the servo layer gives: units, candidates, masks, noise, and that what is absent does nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from servo_plant import Truth, fit, log_set

from hqpipe.errors import IdentificationError
from hqpipe.identify.model import all_parameters
from hqpipe.layers import LAYERS
from hqpipe.layers.servo import Servo
from hqpipe.layers.servo.candidates import POSITION_SHAPE
from hqpipe.registry import load

GAINS = {"kp": 40.0, "kd": 3.0}
QUICK = {"seconds": 5.0}


@pytest.fixture(scope="module")
def plain():
    return log_set(Truth(friction=0.5), **QUICK)


@pytest.fixture(scope="module")
def loaded():
    return log_set(Truth(inertia=0.08, gravity=1.96133), drive=GAINS, load={"mass_kg": 0.5, "lever_m": 0.4}, **QUICK)


def names(model) -> set[str]:
    return {effect.name for effect in model.effects}


def start_values(model) -> np.ndarray:
    return np.array([p.neutral for p in all_parameters(model)])


def stated(logs, **drive: float):
    """The same logs with other numbers of the drive."""
    return replace(logs, trials=tuple(replace(trial, drive={"*": drive}) for trial in logs.trials))


def test_registered():
    assert load(LAYERS["servo"]) is Servo


def test_neutral_values_are_inert_bit_for_bit(plain, loaded):
    for logs in (plain, loaded):
        model = Servo().joints(logs).models[0]
        bare = Servo().joints(logs, without=names(model)).models[0]
        assert not bare.effects
        for heldout in (False, True):
            assert np.array_equal(model.error(start_values(model), heldout), bare.error(start_values(bare), heldout))


def test_a_shape_number_of_an_absent_effect_does_nothing(plain):
    model = Servo().joints(plain).models[0]
    values = start_values(model)
    reference = model.error(values)
    at = [p.name for p in all_parameters(model)].index("velocity_rad_s")
    values[at] *= 3.0
    assert np.array_equal(model.error(values), reference)


def test_every_effect_changes_the_prediction(plain, loaded):
    duty = log_set(Truth(duty=True), size=0.7, **QUICK)
    for logs in (plain, loaded, duty):
        model = Servo().joints(logs).models[0]
        reference = model.error(start_values(model))
        at = len(model.base)
        for effect in model.effects:
            values = start_values(model)
            for i, p in enumerate(effect.parameters, at):
                values[i] = p.starts[-1] if p.starts else min(p.neutral + p.spread, p.high)
            at += len(effect.parameters)
            assert np.all(np.isfinite(model.error(values)))
            assert not np.array_equal(model.error(values), reference), effect.name


def test_dry_friction_holds_a_joint_still():
    """More friction than gravity asks for: the joint stays where it is, to the bit."""
    logs = log_set(Truth(), **QUICK)
    trials = []
    for trial in logs.trials:
        t = trial.trajectory
        q = np.full_like(t.position, 0.3)
        q[: t.samples // 4] = t.position[: t.samples // 4]
        trials.append(replace(trial, trajectory=replace(t, position=q, position_command=q + 0.01)))
    model = Servo().joints(replace(logs, trials=tuple(trials))).models[0]
    values = start_values(model)
    at = [p.name for p in all_parameters(model)]
    values[: len(model.base)] = 0.0
    values[at.index("inertia")] = 1e-3
    values[at.index("friction_nm")] = 0.02
    standing = model.fit.time > 2.5
    assert np.max(np.abs(model.error(values)[standing])) < 1e-12


def test_units_and_candidates_follow_what_is_known(plain, loaded):
    unknown = Servo().joints(plain).models[0]
    assert {p.unit for e in unknown.effects if e.name == "coulomb_friction" for p in e.parameters} == {"rad"}
    assert not {"viscous_friction", "armature", "gain_error"} & names(unknown)
    assert "position_bias" in names(unknown) and "offset" not in {p.name for p in unknown.base}
    assert "kp" in unknown.notes[0]
    gains = Servo().joints(stated(plain, **GAINS)).models[0]
    assert [p.name for p in gains.base] == [
        "inertia",
        "drag_tolerance",
        "gravity_sin",
        "gravity_cos",
        "command_lead_s",
    ]
    assert [p.unit for p in gains.base] == ["kg·m²", "1", "N·m", "N·m", "s"]
    assert "viscous_friction" in names(gains) and "armature" not in names(gains)
    (gain_error,) = (effect for effect in gains.effects if effect.name == "gain_error")
    assert gain_error.excludes == {"viscous_friction"}  # with an unknown load the two are one
    assert gains.notes == ()
    load = Servo().joints(loaded).models[0]
    assert [p.name for p in load.base] == [
        "inertia",
        "gain_tolerance",
        "drag_tolerance",
        "mounting_rad",
        "command_lead_s",
    ]
    assert all(abs(p.high) == abs(p.low) <= 0.0625 for p in load.base[:3])
    assert {"armature", "gain_error", "position_bias", "viscous_friction"} <= names(load)


def test_a_sliding_joint_has_no_gravity_by_angle():
    model = Servo().joints(log_set(Truth(gravity=0.0), kind="prismatic", drive=GAINS, **QUICK)).models[0]
    assert model.unit == "m"
    assert [(p.name, p.unit) for p in model.base] == [
        ("inertia", "kg"),
        ("drag_tolerance", "1"),
        ("offset", "N"),
        ("command_lead_s", "s"),
    ]


def test_firmware_gains_of_trials_keep_their_ratio(plain):
    """Twice the gain of the firmware in a trial is twice the torque per error there."""
    trials = [
        replace(trial, drive={"*": {"firmware_kp": kp}}) for trial, kp in zip(plain.trials, (200, 400), strict=True)
    ]
    model = Servo().joints(replace(plain, trials=tuple(trials))).models[0]
    assert np.array_equal(model.scale.gain, [200 / 300, 400 / 300])
    assert "kp = 1" in model.notes[0]


def test_a_tolerance_counts_no_more_where_its_effect_is_present(loaded):
    """Armature and tolerance of the stated inertia are one number: with both free neither would be known."""
    model = Servo().joints(loaded).models[0]
    at = {p.name: k for k, p in enumerate(all_parameters(model))}
    values = start_values(model)
    values[at["kg_m2"]] = 0.02
    reference = model.error(values)
    values[at["inertia"]] = 0.003
    assert np.array_equal(model.error(values), reference)
    values[at["kg_m2"]] = 0.0
    assert not np.array_equal(model.error(values), model.error(start_values(model)))


def test_what_is_wrong_with_an_initial_state_has_died_out_where_a_window_begins(plain):
    """Where the drive closes the loop; behind a logged duty nothing brings a joint back."""
    duty = log_set(Truth(duty=True), size=0.7, **QUICK)
    for logs, run_in in ((plain, True), (duty, False)):
        model = Servo().joints(logs).models[0]
        assert (model.setting.run_in > 0) == run_in
        assert (model.noise[0] < 1.5 * model.setting.sensor_noise) == run_in


def test_windows_do_not_cross_gaps(plain):
    observed = np.ones((plain.trials[0].trajectory.samples, 1), dtype=bool)
    observed[300:400] = False
    trials = tuple(replace(t, trajectory=replace(t.trajectory, observed=observed)) for t in plain.trials)
    model = Servo().joints(replace(plain, trials=trials)).models[0]
    time = plain.trials[0].trajectory.time
    assert not np.any((model.fit.time >= time[300]) & (model.fit.time < time[400]))
    assert np.any(model.fit.time > time[400])
    whole = Servo().joints(plain).models[0]
    spoilt = replace(trials[0], trajectory=_spoilt(trials[0].trajectory, slice(310, 390)))
    other = Servo().joints(replace(plain, trials=(spoilt, trials[1]))).models[0]
    assert len(other.fit.output) == len(model.fit.output) < len(whole.fit.output)


def _spoilt(trajectory, rows):
    q = trajectory.position.copy()
    q[rows] += 0.2
    return replace(trajectory, position=q)


def test_the_noise_is_what_it_leaves_in_the_error_of_the_true_model():
    """An encoder of 0.5 mrad steps leaves that in the samples, and more in the initial velocity."""
    logs = log_set(Truth(), drive=GAINS, seconds=8.0)
    step = 5e-4
    trials = []
    for trial in logs.trials:
        q = np.round(trial.trajectory.position / step) * step
        trials.append(replace(trial, trajectory=replace(trial.trajectory, position=q)))
    model = Servo().joints(replace(logs, trials=tuple(trials))).models[0]
    found = fit(model, ())
    assert model.noise[0] >= step / np.sqrt(12.0)
    assert found["rms"] == pytest.approx(model.noise[0], rel=0.3)


def test_windows_as_long_as_asked_for(plain):
    found = Servo().joints(plain, window_s=0.2)
    assert found.window_s == 0.2 and found.window_reason == "as asked for"
    assert len(found.models[0].fit.output) % 40 == 0


def test_left_out_effects(plain):
    model = Servo().joints(plain, without={"backlash", POSITION_SHAPE}).models[0]
    assert not {"backlash", POSITION_SHAPE} & names(model)


def test_logs_without_a_command(plain):
    trials = tuple(replace(t, trajectory=replace(t.trajectory, position_command=None)) for t in plain.trials)
    bare = replace(plain, trials=trials)
    assert Servo().lacking(plain) == []
    assert Servo().lacking(bare) == ["joint/<name>/position_command"]
    with pytest.raises(IdentificationError, match="joint/j/position_command"):
        Servo().joints(bare)


def test_without_held_out_trials(plain):
    model = Servo().joints(replace(plain, trials=plain.trials[:1])).models[0]
    assert len(model.error(start_values(model), heldout=True)) == 0
    assert len(model.heldout.output) == 0 and model.noise[1] == 0.0


def test_a_joint_at_rest_is_left_out_and_named(plain):
    """Two joints, of which one stands."""
    trials = []
    for trial in plain.trials:
        t = trial.trajectory
        both = {name: np.hstack([values, np.full_like(values, 0.1)]) for name, values in t.channels().items()}
        trials.append(replace(trial, trajectory=replace(t, joints=("j", "still"), **both)))
    found = Servo().joints(replace(plain, joints=("j", "still"), trials=tuple(trials)))
    assert [model.joint for model in found.models] == ["j"]
    assert "moves" in found.left["still"]


def test_a_sliding_load_is_its_mass():
    logs = log_set(
        Truth(inertia=0.5, gravity=0.0),
        kind="prismatic",
        drive=GAINS,
        load={"mass_kg": 0.4, "arm_mass_kg": 0.1},
        **QUICK,
    )
    model = Servo().joints(logs).models[0]
    assert model.scale.inertia == pytest.approx([0.5, 0.5])
    assert "position_bias" not in names(model)
    assert fit(model, ())["rms"] < 1e-4


def test_a_joint_that_moves_for_a_moment_only_has_the_size_of_that_motion():
    steps, dt = 8000, 0.005
    q, u = np.full(steps, 0.1), np.full(steps, 0.1)
    q[4000:4021], q[4021:], u[3990:] = np.linspace(0.1, 0.6, 21), 0.6, 0.6
    logs = log_set(Truth(), drive=GAINS, **QUICK)
    columns = {"time": np.arange(steps) * dt, "position": q[:, None], "position_command": u[:, None]}
    columns["velocity"] = np.gradient(q, dt)[:, None]
    trials = tuple(replace(t, trajectory=replace(t.trajectory, **columns)) for t in logs.trials)
    model = Servo().joints(replace(logs, trials=trials)).models[0]
    assert model.setting.speed == pytest.approx(5.0, rel=0.2)
    (dry,) = next(effect for effect in model.effects if effect.name == "coulomb_friction").parameters
    assert dry.spread > 0.1


def test_a_torque_limit_is_the_same_in_another_record(plain):
    (one,) = Servo().joints(plain).models
    (two,) = Servo().joints(plain).models
    two.setting = replace(two.setting, torque=2.0 * one.setting.torque)
    values = start_values(one)
    place = [(e.name, p.name) for e in one.effects for p in e.parameters].index(("torque_limit", "share_cut_off"))
    values[len(one.base) + place] = 0.4
    referred = one.referred_to(values, two)
    limits = [
        model.reported("torque_limit", "share_cut_off", float(numbers[len(one.base) + place]))[1]
        for model, numbers in ((one, values), (two, referred))
    ]
    assert limits[0] == pytest.approx(limits[1])
