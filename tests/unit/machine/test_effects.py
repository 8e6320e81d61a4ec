"""What every candidate effect says of itself, and the laws of single effects."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.machine import EFFECTS
from hqpipe.machine.backlash import transmitted, wound_up
from hqpipe.machine.compose.shared import delayed
from hqpipe.machine.coulomb_friction import coulomb, strained, turn
from hqpipe.machine.direction_asymmetry import asymmetric
from hqpipe.machine.flow_saturation import saturate
from hqpipe.machine.gain_drift import drifted
from hqpipe.machine.integral_action import integrate, wound_up_for
from hqpipe.machine.layout import FIELDS, WIDTH, neutral_row, slot, slots
from hqpipe.machine.load_dependent_friction import load_friction
from hqpipe.machine.orifice_flow import orifice
from hqpipe.machine.position_dependent_stiffness import LEAST, exchanged, smaller, stiffened
from hqpipe.machine.stribeck_friction import sticking
from hqpipe.machine.supply_droop import sag
from hqpipe.machine.transmission_compliance import softened
from hqpipe.machine.valve_deadband import deadband
from hqpipe.machine.valve_lag import follow, lag_share, mean_share, swing
from hqpipe.machine.viscous_friction import viscous

# The rows of the layers actuator and sensing in the specification, with the parameters that the file format names, the
# second thing that warm oil does, and the valve that is open round its centre.
SPECIFIED = {
    "command_delay": ("actuator", ["delay_s"]),
    "valve_delay": ("actuator", ["delay_s"]),
    "valve_lag": ("actuator", ["time_constant_s"]),
    "valve_deadband": ("actuator", ["half_width"]),
    "valve_underlap": ("actuator", ["half_width"]),
    "flow_saturation": ("actuator", ["limit"]),
    "orifice_flow": ("actuator", ["effort_max_nm"]),
    "supply_droop": ("actuator", ["droop", "recovery_s"]),
    "direction_asymmetry": ("actuator", ["ratio"]),
    "position_dependent_stiffness": ("actuator", ["slope_per_rad"]),
    "gain_drift": ("actuator", ["rate_per_s"]),
    "leakage_drift": ("actuator", ["rate_per_s"]),
    "integral_action": ("actuator", ["ki"]),
    "coulomb_friction": ("actuator", ["friction_nm", "asymmetry_nm"]),
    "stribeck_friction": ("actuator", ["static_nm", "velocity_rad_s", "exponent"]),
    "viscous_friction": ("actuator", ["nm_s_per_rad"]),
    "load_dependent_friction": ("actuator", ["coefficient"]),
    "backlash": ("actuator", ["gap"]),
    "transmission_compliance": ("actuator", ["stiffness_nm_per_rad"]),
    "torque_bias": ("sensing", ["nm"]),
    "torque_scale": ("sensing", ["ratio"]),
    "position_bias": ("sensing", ["rad"]),
    "channel_skew": ("sensing", ["skew_s"]),
    "unsigned_sensor": ("sensing", []),
}
# Suffix of a parameter's name → the unit that it promises.
SUFFIXES = {
    "nm_s_per_rad": "N·m·s/rad",
    "nm_per_rad": "N·m/rad",
    "slope_per_rad": "1/rad",
    "rate_per_s": "1/s",
    "velocity_rad_s": "rad/s",
    "exponent": "1",
    "_rad": "rad",
    "_nm": "N·m",
    "_s": "s",
}


def test_names_are_those_of_the_specification():
    assert set(EFFECTS) == set(SPECIFIED)
    assert all(effect.name == name for name, effect in EFFECTS.items())


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_describes_itself(name):
    effect = EFFECTS[name]
    layer, parameters = SPECIFIED[name]
    own = {p.name for p in effect.parameters}
    assert effect.layer == layer
    assert set(parameters) <= own and all(not p.search.counts for p in effect.parameters if p.name not in parameters)
    for text in (effect.meaning, effect.source, effect.experiment, effect.advice):
        assert len(text) > 10 and "\n" not in text
    assert effect.least_joints >= 1


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.parameters])
def test_parameters_have_units_bounds_and_starts(name):
    parameters = EFFECTS[name].parameters
    assert parameters[0].search.counts, "the first parameter is the one that shows the effect"
    for p in parameters:
        expected = next((unit for suffix, unit in SUFFIXES.items() if p.name.endswith(suffix)), None)
        assert p.unit == (expected or p.unit) and p.unit
        s = p.search
        assert s.lower < s.upper and s.starts
        assert all(s.lower <= start <= s.upper for start in s.starts)
        if s.counts and name != "torque_scale":
            assert s.lower <= 0.0 <= s.upper, "the neutral value must be within the bounds"
        if s.lower < 0.0 and s.counts and s.starts != (0.0,):
            assert {np.sign(start) for start in s.starts} == {-1.0, 1.0}, "either sign must be tried"


def test_row_holds_every_number_once():
    assert len(FIELDS) == WIDTH == len(set(FIELDS))
    for name, effect in EFFECTS.items():
        names = [FIELDS[i][1] for i in slots(name)]
        assert names == ([p.name for p in effect.parameters] if effect.blocks else [])
    row = neutral_row()
    assert row.shape == (WIDTH,) and np.isinf(row[slot("setting", "effort_limit")])
    for name, effect in EFFECTS.items():
        for column, p in zip(slots(name), effect.parameters, strict=False):
            assert (row[column] == 0.0) or not p.search.counts


def test_deadband_is_a_rounded_dead_zone():
    for x in np.linspace(-0.05, 0.05, 41):
        assert deadband(x, 0.0, 0.0) == pytest.approx(x)
        sharp = np.sign(x) * max(abs(x) - 0.01, 0.0)
        assert deadband(x, 0.01, 0.0) == pytest.approx(sharp, abs=1e-15)
        assert deadband(-x, 0.01, 0.16) == -deadband(x, 0.01, 0.16)
        soft = deadband(x, 0.01, 0.16)
        assert abs(sharp) - 1e-15 <= abs(soft) <= abs(sharp) + 0.001 + 1e-15
        if abs(abs(x) - 0.01) >= 0.004:
            assert soft == pytest.approx(sharp, abs=1e-15)
    assert deadband(0.01, 0.01, 0.16) == pytest.approx(0.001)
    grid = np.linspace(0.004, 0.016, 2001)
    values = np.array([deadband(x, 0.01, 0.16) for x in grid])
    slope = np.diff(values) / np.diff(grid)
    assert 0.0 <= slope.min() and slope.max() <= 1.0 + 1e-9, "monotonic"
    assert np.abs(np.diff(slope)).max() < 0.002, "no corner"


def test_saturation_clips_at_the_limit_and_is_off_at_zero():
    assert saturate(0.3, 1.0 / 0.1) == pytest.approx(0.1)
    assert saturate(-0.3, 1.0 / 0.1) == pytest.approx(-0.1)
    assert saturate(0.05, 10.0) == 0.05
    assert saturate(1e9, 0.0) == 1e9


def test_asymmetry_and_drift():
    assert asymmetric(0.2, 0.1) == pytest.approx(0.22)
    assert asymmetric(-0.2, 0.1) == pytest.approx(-0.18)
    assert asymmetric(-0.2, 0.0) == -0.2
    assert drifted(0.2, 0.01, 10.0) == pytest.approx(0.22)
    assert drifted(-0.2, -0.5, 10.0) == 0.0, "no negative gain"


def test_lag_reaches_1_minus_1_over_e_after_its_time_constant():
    spool, share = 0.0, lag_share(0.02, 1e-3)
    for _ in range(20):
        spool = follow(spool, 1.0, share)
    assert spool == pytest.approx(1.0 - np.exp(-1.0))
    assert lag_share(0.0, 1e-3) == 1.0
    assert follow(0.3, 0.7, 1.0) == pytest.approx(0.7)


@pytest.mark.parametrize("damping", [0.4, 1.0, 3.0])
def test_spool_of_second_order_is_its_equation_solved(damping):
    constant, dt, fine, target = 0.02, 1e-3, 20000, 0.7
    y, v = 0.3 - target, 5.0
    yy, yv, vy, vv, my, mv = swing(constant, 1.0 / damping**2, dt)
    omega = 2.0 * damping / constant
    x, rate, total = 0.3, v, 0.0
    for _ in range(fine):
        rate += dt / fine * omega * (omega * (target - x) - 2.0 * damping * rate)
        x += dt / fine * rate
        total += x / fine
    assert target + yy * y + yv * v == pytest.approx(x, abs=1e-5)
    assert vy * y + vv * v == pytest.approx(rate, rel=1e-4)
    assert target + my * y + mv * v == pytest.approx(total, abs=1e-5)


def test_a_spool_without_a_damping_ratio_is_of_first_order():
    shares = swing(0.02, 0.0, 1e-3)
    assert shares == (1.0 - lag_share(0.02, 1e-3), 0.0, 0.0, 0.0, 1.0 - mean_share(0.02, 1e-3), 0.0)
    assert swing(0.0, 1.0, 1e-3) == (0.0,) * 6, "no lag, whatever its shape"
    nearly = swing(0.02, 1e-8, 1e-3)
    np.testing.assert_allclose(np.delete(nearly, 2), np.delete(shares, 2), atol=1e-6)  # its speed does not last


def test_integrator_sums_and_is_clamped_both_ways():
    assert integrate(0.1, 0.2, 3.0, 0.0, 1e-3) == pytest.approx(0.1 + 3.0 * 0.2 * 1e-3)
    assert integrate(0.1, 100.0, 3.0, 5.0, 1e-3) == pytest.approx(0.2)
    assert integrate(0.1, -1000.0, 3.0, 5.0, 1e-3) == pytest.approx(-0.2)
    assert integrate(0.1, 5.0, 0.0, 0.0, 1e-3) == 0.1


def test_delay_interpolates_and_holds_the_ends():
    signal = np.array([5.0, 0.0, 1.0, 3.0, 6.0, 9.0])
    first, last = 1, 4
    assert delayed(signal, first, last, 3 - (0.0)) == 3.0
    assert delayed(signal, first, last, 3 - (1.0)) == 1.0
    assert delayed(signal, first, last, 3 - (0.25)) == pytest.approx(2.5)
    assert delayed(signal, first, last, 2 - (1.75)) == pytest.approx(0.0)
    assert delayed(signal, first, last, 3 - (50.0)) == 0.0
    assert delayed(signal, first, last, 4 - (0.0)) == 6.0
    assert delayed(signal, first, last, 4 - (-3.0)) == 6.0


def test_orifice_without_load_passes_all_and_brakes_only_the_loaded_side():
    assert orifice(0.1, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.0) == orifice(-0.1, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.0) == 1.0
    assert orifice(0.1, 300.0, 0.0, 0.0, 0.0, 0.0, 0.0) == 1.0
    assert orifice(0.1, 360.0, 1e-3, 0.0, 0.0, 0.0, 0.0) == pytest.approx(np.sqrt(0.64))
    assert orifice(-0.1, -360.0, 1e-3, 0.0, 0.0, 0.0, 0.0) == pytest.approx(np.sqrt(0.64))
    assert orifice(-0.1, 360.0, 1e-3, 0.0, 0.0, 0.0, 0.0) == pytest.approx(np.sqrt(1.36))
    assert orifice(0.1, 2000.0, 1e-3, 0.0, 0.0, 0.0, 0.0) == 0.0, "no flow backwards"
    assert orifice(0.1, 0.0, 0.0, 0.36, 0.0, 0.0, 0.0) == pytest.approx(0.8), "a sagging supply"


def test_unequal_chambers_feel_the_supply_only_where_they_are_fed():
    loss, half = 0.2, 0.5
    for leaning, stiffer, softer in ((1.0, 0.1, -0.1), (-1.0, -0.1, 0.1)):
        assert orifice(stiffer, 0.0, 0.0, loss, 0.0, leaning, 0.0) == pytest.approx(np.sqrt(1.0 - 2.0 * loss)), "fed"
        assert orifice(softer, 0.0, 0.0, loss, 0.0, leaning, 0.0) == pytest.approx(1.0), "drained"
    settled = orifice(0.1, 0.0, 0.0, loss, -loss, half, 0.0), orifice(-0.1, 0.0, 0.0, loss, -loss, half, 0.0)
    assert settled == pytest.approx((np.sqrt(1.0 - loss),) * 2), "once the mean pressure has followed"
    assert orifice(0.1, 300.0, 1e-3, 0.0, 0.0, half, 0.0) == pytest.approx(
        orifice(0.1, 300.0, 1e-3, 0.0, 0.0, 0.0, 0.0)
    )


def test_mean_pressure_follows_the_supply_as_the_oil_is_exchanged():
    mean, loss, opening, gain, largest = 0.0, 0.01, 0.1, 20.0, 1000.0
    for _ in range(1000):  # one time constant: both roots fall and rise by half of what the mean is off by
        mean = exchanged(mean, loss, opening, 0.0, 1.0 / largest, 0.0, 0.0, 0.0, 0.0, 1.0, gain, 0.0, 1e-3)
    assert mean == pytest.approx(-loss * (1.0 - np.exp(-1.0)), rel=0.01)
    assert exchanged(0.3, loss, opening, 0.0, 0.0, 0.5, 0.1, 0.0, 1.0, 1.0, gain, 9.0, 1e-3) == 0.3, "no orifice"
    still = exchanged(0.0, 0.0, opening, 400.0, 1.0 / largest, 0.0, 0.1, 0.0, 1.0, 1.0, gain, 9.0, 1e-3)
    assert still == 0.0, "equal chambers"
    emptied = exchanged(-0.5, 0.0, -0.1, 500.0, 1.0 / largest, 0.9, 0.0, 0.0, 0.0, 1.0, 1e6, 0.0, 1e-3)
    assert emptied == -0.5, "no pressure below the tank's"


@pytest.mark.parametrize(("slope", "length"), [(1.5, 0.4), (-1.5, 0.4), (0.6, 0.8)])
def test_torque_and_mean_pressure_are_those_of_two_chambers(slope, length):
    """Against the continuity equations of both chambers, each with its own pressure, and finer steps."""
    largest, gain, oil, leak, dt = 900.0, 2000.0, 9000.0, 0.05, 1e-3
    of_one, of_other = (1.0 / length - slope) / 2.0, (1.0 / length + slope) / 2.0  # 1/rad: one over their lengths
    a = b = 0.5  # pressures over that of the supply
    torque = mean = 0.0
    fine, differences = 20, []
    for k in range(1500):
        angle, velocity = 0.15 * np.sin(0.012 * k), 1.8 * np.cos(0.012 * k)
        opening = 0.02 * np.sin(0.03 * k) + velocity * oil * dt / gain
        stiff, lean = stiffened(1.0, 0.0, angle, 0.0, slope, length)
        passed = orifice(opening, torque, 1.0 / largest, 0.0, mean, lean, 0.0)
        change = gain * opening * passed - leak * torque - oil * dt * velocity
        mean = exchanged(mean, 0.0, opening, torque, 1.0 / largest, lean, leak, 0.0, velocity, stiff, gain, oil, dt)
        torque += stiff * change
        for _ in range(fine):
            fed, drained = (1.0 - a, b) if opening > 0.0 else (a, 1.0 - b)
            into, out_of = (gain * opening * np.sqrt(2.0 * part) / largest for part in (fed, drained))
            moved = oil * dt * velocity / largest + leak * (a - b)
            volume_a, volume_b = 1.0 / of_one + angle, 1.0 / of_other - angle
            a += length / volume_a * (into - moved) / fine
            b -= length / volume_b * (out_of - moved) / fine
        differences.append((torque - largest * (a - b), mean - (a + b - 1.0), torque, mean))
    off, off_mean, torques, means = np.array(differences).T
    assert np.std(torques) > 100.0 and np.std(means) > 0.02
    assert np.sqrt(np.mean(off**2)) < 0.03 * np.std(torques)
    assert np.sqrt(np.mean(off_mean**2)) < 0.1 * np.std(means)


def test_integrator_that_winds_up_while_the_joint_is_held():
    ki, error, integral, opened = 0.8, 0.03, 0.0, 0.03
    for _ in range(2000):
        integral = integrate(integral, opened - integral, ki, 0.0, 1e-3)
    error = opened - integral
    assert wound_up_for(error, ki, 0.0, 2.0) == pytest.approx(integral, rel=1e-3)
    assert wound_up_for(error, ki, 1.0 / 0.01, 2.0) == pytest.approx(0.01), "its limit"
    assert wound_up_for(error, ki, 0.0, 0.0) == wound_up_for(0.0, ki, 0.0, 1e9) == 0.0


def test_sag_settles_at_droop_times_speed_and_recovers():
    share, loss = lag_share(0.1, 1e-3), 0.0
    for _ in range(3000):
        loss = sag(loss, 4.0, 0.05, share)
    assert loss == pytest.approx(0.2)
    for _ in range(100):
        loss = sag(loss, 0.0, 0.05, share)
    assert loss == pytest.approx(0.2 * np.exp(-1.0))


def test_the_smaller_chamber_makes_the_slope_and_is_never_empty():
    for slope, length in ((0.5, 0.4), (-1.5, 0.6)):
        assert smaller(0.0, slope, length) == pytest.approx((1.0, -slope * length))
        higher, lower = (smaller(offset, slope, length)[0] for offset in (1e-4, -1e-4))
        assert (higher - lower) / 2e-4 == pytest.approx(slope, rel=1e-3)
    assert smaller(0.3, 0.0, 0.5) == (1.0, 0.0)
    assert smaller(-9.0, -1.0, 0.5)[0] == smaller(9.0, 1.0, 0.5)[0] == 0.5 + 0.5 / LEAST
    assert 0.0 > smaller(0.0, 1e6, 0.5)[1] > -1.0


def test_compliance_in_series_halves_the_stiffness_of_an_equal_spring():
    oil = 21.6 / 1e-3  # N·m/rad
    assert softened(1.0, oil, 0.0) == 1.0
    assert softened(0.8, oil, 1.0 / oil) == pytest.approx(0.4)


@pytest.mark.parametrize("half", [0.0, 20.0])
def test_wound_up_turns_transmitted_round(half):
    for wound in np.linspace(-200.0, 200.0, 81):
        passed = transmitted(wound, half)
        assert passed == pytest.approx(np.sign(wound) * max(abs(wound) - half, 0.0))
        assert transmitted(-wound, half) == -passed
        if abs(passed) > 0.0:
            assert wound_up(wound, passed, half, 1e9) == pytest.approx(wound)
            assert wound_up(0.0, passed, half, 0.0) == pytest.approx(wound)
        else:
            assert wound_up(wound, 0.0, half, 5.0) == pytest.approx(wound), "only the model knows where it is"


def test_chatter_within_the_slack_does_not_tighten_the_chain():
    assert wound_up(3.0, 2.0, 20.0, 5.0) == 3.0
    assert wound_up(3.0, -2.0, 20.0, 5.0) == 3.0
    assert wound_up(3.0, 8.0, 20.0, 5.0) == 28.0
    assert wound_up(25.0, 2.0, 20.0, 5.0) == 22.0
    assert wound_up(25.0, -2.0, 20.0, 5.0) == 20.0


def test_a_piston_that_sticks_passes_on_what_its_spring_says():
    """The torque behind it is −K_t Δq, whatever the oil does, until the friction can hold no more."""
    friction, spring, dt = 20.0, 4e4, 1e-3
    oil, behind, joint, turned = 60.0, 50.0, 0.0, 0.5
    for pull, travel in ((4.0, 1e-4), (-15.0, -3e-4), (6.0, 2e-4), (-30.0, 1e-5), (3.0, -2e-4)):
        sticking = behind - spring * travel
        strain = strained(travel / dt, dt, friction / spring)
        turned = turn(turned, oil, oil + pull, friction, strain, 0.0, 3e4, travel / dt, dt)
        oil, joint = oil + pull, joint + travel
        behind = min(max(sticking, oil - friction), oil + friction)
        assert oil - friction * turned == pytest.approx(behind)


@pytest.mark.parametrize("arm", [1.0, 0.8])
def test_the_oil_alone_moves_a_piston_on_a_slack_chain(arm):
    """It sticks while the oil does not overcome its friction, wherever the joint goes within the slack."""
    friction, stiffness, half, dt = 20.0, 3e4, 45.0, 1e-3
    oil, piston, joint = 4.0, 1e-4, 0.0
    turned, wound = oil / friction, oil + stiffness * (piston - joint)
    slips = 0
    for flow, travel in (
        (3.0, 2e-4),
        (0.0, -3e-4),
        (18.0, 1e-4),
        (6.0, 4e-4),
        (-30.0, -5e-4),
        (-15.0, 1e-4),
        (2.0, -6e-4),
    ):
        oil, joint = oil + flow, joint + arm * travel
        slip = np.sign(oil) * max(abs(oil) - friction, 0.0)
        oil, piston, slips = oil - slip, piston + slip / stiffness, slips + (slip != 0.0)
        before, wound = wound, wound + flow - stiffness * arm * travel
        strain = strained(travel / dt, dt, 1e-3)
        turned = turn(turned, before, wound, friction, strain, half, stiffness, arm * travel / dt, dt)
        assert friction * turned == pytest.approx(oil)
        assert wound - friction * turned == pytest.approx(stiffness * (piston - joint))
        assert transmitted(wound - friction * turned, half) == 0.0, "the chain stays slack"
    assert slips == 3


def test_direction_of_friction_has_ends_and_needs_a_friction():
    tight = 0.0, 0.0, 0.0, 1e-3
    assert turn(0.9, 0.0, 1.0, 10.0, 0.05, *tight) == 1.0 and turn(-0.9, 1.0, 0.0, 10.0, -0.05, *tight) == -1.0
    assert turn(0.3, 5.0, 5.0, 10.0, 0.0, *tight) == 0.3, "at rest it stays"
    assert turn(0.3, 5.0, 9.0, 0.0, 0.1, *tight) == 0.3


def test_friction_laws():
    assert coulomb(1.0, 20.0, 5.0) == 25.0 and coulomb(-1.0, 20.0, 5.0) == -15.0
    assert coulomb(0.0, 20.0, 5.0) == 0.0
    assert viscous(-2.0, 3.0) == -6.0
    assert load_friction(-1.0, -100.0, 0.1) == pytest.approx(-10.0)
    assert load_friction(1.0, -100.0, 0.1) == pytest.approx(10.0)
    assert sticking(0.0, 0.2, 2.0) == 1.0
    assert sticking(-0.2, 0.2, 0.5) == pytest.approx(1.0 / np.e)
    assert sticking(5.0, 0.2, 2.0) == pytest.approx(0.0, abs=1e-12)
    assert sticking(0.4, 0.2, 0.5) > sticking(0.4, 0.2, 2.0), "the tail"
