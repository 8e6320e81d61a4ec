"""A known truth, integrated by scipy, is recovered from position and command alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from servo_plant import Truth, fit, log_set

from hqpipe.layers.servo import Servo

GAINS = (("kp", 40.0), ("kd", 3.0))
HALF_A_SAMPLE = 0.0025  # s; beside a delay, commands count as if they had come in the middle between two rows
LOAD = (("mass_kg", 0.5), ("lever_m", 0.4))


@cache
def model(truth: Truth, drive: tuple = (), load: tuple = (), size: float = 0.5):
    return Servo().joints(log_set(truth, seconds=7.0, drive=dict(drive), load=dict(load), size=size)).models[0]


def test_inertia_friction_and_delay_with_stated_gains():
    found = fit(model(Truth(friction=0.8, delay=0.012), GAINS), ("coulomb_friction", "command_delay"))
    assert found["inertia"] == pytest.approx(0.05, rel=0.03)
    assert found["gravity_sin"] == pytest.approx(2.0, rel=0.03)
    assert found["coulomb_friction.friction_nm"] == pytest.approx(0.8, rel=0.03)
    assert found["command_delay.delay_s"] == pytest.approx(0.012 + HALF_A_SAMPLE, abs=3e-4)


def test_without_stated_gains_everything_is_in_radians_of_error():
    joint = model(Truth(friction=0.8, delay=0.012))
    found = fit(joint, ("coulomb_friction", "command_delay"))
    assert found["inertia"] == pytest.approx(0.05 / 40.0, rel=0.05)
    assert found["drag"] == pytest.approx(3.0 / 40.0, rel=0.03)
    assert found["coulomb_friction.friction_nm"] == pytest.approx(0.8 / 40.0, rel=0.03)
    assert found["command_delay.delay_s"] == pytest.approx(0.012 + HALF_A_SAMPLE, abs=5e-4)
    assert {p.name: p.unit for p in joint.base} == {
        "inertia": "s²",
        "drag": "s",
        "gravity_sin": "rad",
        "gravity_cos": "rad",
        "command_lead_s": "s",
    }


def test_damping_against_a_target_at_rest_is_no_delay():
    joint = model(Truth())
    alone, delayed = fit(joint, ()), fit(joint, ("command_delay",))
    assert alone["drag"] == pytest.approx(3.0 / 40.0, rel=0.02)
    assert delayed["command_delay.delay_s"] < HALF_A_SAMPLE + 0.5 * joint.dt


def test_bias_of_the_position_loop():
    """The drive's zero is 0.03 rad beside that of the log: error = command − position + bias."""
    logs = log_set(Truth(), seconds=7.0)
    moved = (replace(t, trajectory=_earlier_command(t.trajectory, 0.03)) for t in logs.trials)
    found = fit(Servo().joints(replace(logs, trials=tuple(moved))).models[0], ("position_bias",))
    assert found["position_bias.rad"] == pytest.approx(0.03, rel=0.01)
    assert found["rms"] < 1e-4


def _earlier_command(trajectory, bias: float):
    return replace(trajectory, position_command=trajectory.position_command - bias)


@pytest.mark.parametrize("back_emf", [0.0, 1.0])
def test_a_limit_holds_for_all_of_the_torque_or_beside_the_back_emf(back_emf):
    """A current loop limits what it puts out; a full duty has the back-EMF beside it."""
    joint = model(Truth(limit=2.0, limit_beside_drag=back_emf == 1.0), GAINS, (), 0.8)
    found = fit(joint, ("torque_limit",))
    assert found["torque_limit.back_emf_share"] == pytest.approx(back_emf, abs=0.1)
    assert joint.setting.torque * (1.0 - found["torque_limit.share_cut_off"]) == pytest.approx(2.0, rel=0.05)


def test_backlash():
    found = fit(model(Truth(gap=0.03), GAINS), ("backlash",))
    assert found["backlash.gap"] == pytest.approx(0.03, rel=0.1)
    assert found["inertia"] == pytest.approx(0.05 + Truth().motor_inertia, rel=0.1)


def test_load_dependent_friction_behind_a_logged_duty():
    """m 0.5 kg on 0.4 m: 0.08 kg·m², 1.96133 N·m."""
    truth = Truth(duty=True, inertia=0.08, gravity=1.96133, share=0.3)
    joint = model(truth, (), LOAD, 0.7)
    found = fit(joint, ("load_dependent_friction",))
    assert found["load_dependent_friction.coefficient"] == pytest.approx(0.3, abs=0.01)
    assert found["gain"] == pytest.approx(4.0, rel=0.02)
    assert found["drag"] == pytest.approx(0.4, rel=0.05)
    assert found["heldout"] < 0.1 * fit(joint, ("coulomb_friction",))["heldout"]


def test_duty_of_an_unknown_motor_gives_shares_of_its_stall_torque():
    truth = Truth(duty=True, inertia=0.08, gravity=2.0, share=0.3)
    joint = model(truth, (), (), 0.7)
    found = fit(joint, ("load_dependent_friction",))
    assert found["load_dependent_friction.coefficient"] == pytest.approx(0.3, abs=0.01)
    assert found["inertia"] == pytest.approx(0.08 / 4.0, rel=0.03)
    assert found["gravity_sin"] == pytest.approx(2.0 / 4.0, rel=0.03)
    assert "stall torque" in joint.notes[0] and "load" in joint.notes[0]


def test_torque_limit_is_reported_as_a_torque():
    joint = model(Truth(limit=2.0), GAINS, (), 0.8)
    found = fit(joint, ("torque_limit",))
    name, value, unit = joint.reported("torque_limit", "share_cut_off", found["torque_limit.share_cut_off"])
    assert (name, unit) == ("effort_max_nm", "N·m")
    assert value == pytest.approx(2.0, rel=0.03)
