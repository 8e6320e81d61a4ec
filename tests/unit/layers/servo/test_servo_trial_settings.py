"""Gains and loads that differ between trials and that nobody stated; the torque from other joints; which input counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from servo_plant import Truth, fit, log_set

from hqpipe.layers.servo import Servo
from hqpipe.layers.servo.scale import by_duty
from hqpipe.logs.differentiate import differentiate

ONE = Truth(friction=0.5)
QUICK = {"seconds": 6.0}


def several(*truths: Truth):
    """One log set of all trials."""
    sets = [log_set(truth, first=10 * k, **QUICK) for k, truth in enumerate(truths)]
    return replace(sets[0], trials=tuple(trial for one in sets for trial in one.trials))


def test_gains_that_nobody_stated_are_found_and_told():
    model = Servo().joints(several(ONE, replace(ONE, kp=80.0))).models[0]
    assert model.settings.gains and not model.settings.loads
    found = fit(model, ("coulomb_friction",))
    assert found["gain_ratio_1"] == pytest.approx(2.0, rel=0.02) or found["gain_ratio_1"] == pytest.approx(
        0.5, rel=0.02
    )
    assert found["rms"] < 1e-4 and found["heldout"] < 1e-3
    (told,) = (note for note in model.notes if "differs between trials" in note)
    assert "gain" in told and "firmware_kp" in told and "fit_10.parquet" in told


def test_loads_that_nobody_stated_are_found_beside_stated_gains():
    heavy = replace(ONE, inertia=0.09, gravity=3.6)
    logs = several(ONE, heavy)
    stated = tuple(replace(trial, drive={"*": {"kp": 40.0, "kd": 3.0}}) for trial in logs.trials)
    model = Servo().joints(replace(logs, trials=stated)).models[0]
    assert model.settings.loads and not model.settings.gains
    found = fit(model, ("coulomb_friction",))
    ratio = 1.8 if found["gravity_ratio_1"] > 1.0 else 1.0 / 1.8
    assert found["gravity_ratio_1"] == pytest.approx(ratio, rel=0.03)
    assert found["inertia_ratio_1"] == pytest.approx(ratio, rel=0.05)


def test_a_held_out_trial_with_a_setting_of_no_fit_trial_is_not_judged():
    logs = several(ONE, replace(ONE, kp=80.0))
    trials = (logs.trials[0], logs.trials[1], logs.trials[3], replace(logs.trials[2], split="fit"))
    only = (replace(trials[3], split="heldout"), *trials[:1], replace(trials[1], split="fit"))
    model = Servo().joints(replace(logs, trials=only)).models[0]
    assert model.settings.group.max() == 0  # the fit trials agree, and they alone decide
    mixed = several(ONE, replace(ONE, kp=80.0), replace(ONE, kp=20.0))
    kept = tuple(trial for trial in mixed.trials if not trial.file.startswith("fit_20"))
    model = Servo().joints(replace(mixed, trials=kept)).models[0]
    assert len(model.settings.gain) == 3 and len(model.settings.fitted) == 1
    judged = {model.heldout.files[k] for k in np.unique(model.heldout.trial)}
    assert judged and not any("20" in file for file in judged)
    assert any("not judged: no fit trial has their setting" in note for note in model.notes)


def test_one_setting_has_no_ratios():
    model = Servo().joints(several(ONE, ONE)).models[0]
    assert not any("ratio" in p.name for p in model.base)
    assert not any("differs" in note for note in model.notes)


def test_the_command_is_the_input_where_one_law_leads_to_the_duty():
    logs = log_set(ONE, **QUICK)

    def with_duty(trial, gain: float, noise: float):
        t = trial.trajectory
        duty = gain * (t.position_command - t.position) - 0.05 * differentiate(t.position, t.dt)
        duty = duty + noise * np.random.default_rng(0).normal(size=duty.shape)
        return replace(trial, split="fit", trajectory=replace(t, duty=duty))

    assert not by_duty([with_duty(trial, 1.0, 0.0) for trial in logs.trials], "j")
    assert by_duty([with_duty(t, gain, 0.0) for t, gain in zip(logs.trials, (1.0, 2.0), strict=True)], "j")
    assert by_duty([with_duty(trial, 1.0, 1.0) for trial in logs.trials], "j")
    assert not by_duty(list(logs.trials), "j")


def test_torque_from_another_joint_stands_beside_the_base():
    """The neighbour's acceleration pushes the joint: a command that moves by that torque over kp."""
    logs = log_set(replace(ONE, gravity=0.0), **QUICK)
    trials = []
    for k, trial in enumerate(logs.trials):
        t = trial.trajectory
        other = 0.6 * np.sin(2.0 * np.pi * 1.1 * t.time + k)[:, None]
        push = 0.02 * np.gradient(np.gradient(other[:, 0], t.dt), t.dt)[:, None]  # N·m
        both = {
            "position": np.hstack([t.position, other]),
            "velocity": np.hstack([t.velocity, differentiate(other, t.dt)]),
            "position_command": np.hstack([t.position_command + push / 40.0, other]),
        }
        trials.append(replace(trial, trajectory=replace(t, joints=("j", "k"), **both)))
    found = Servo().joints(replace(logs, joints=("j", "k"), trials=tuple(trials)))
    model = next(model for model in found.models if model.joint == "j")
    (context,) = (effect for effect in model.effects if effect.context)
    alone, beside = fit(model, ("coulomb_friction",)), fit(model, ("coulomb_friction", context.name))
    assert beside["rms"] < 0.3 * alone["rms"] and beside["heldout"] < 0.3 * alone["heldout"]
    assert beside["coulomb_friction.friction_nm"] == pytest.approx(0.5 / 40.0, rel=0.03)
    assert all(not effect.context for effect in Servo().joints(logs).models[0].effects)
