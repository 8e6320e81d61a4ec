"""The hydraulics against closed formulas (Merritt 1967; Jelali & Kroll 2003)."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.plant import hydraulics

RIGID = {"chain": {"stiffness": 5.0e7, "tooth_stiffness": 1.0e8}}
FRICTIONLESS = {"coulomb_friction": 0.0, "stribeck_friction": 0.0, "viscous_friction": 0.0}
SHUT = {"rated_flow": 1.0e-20}


@pytest.mark.parametrize("load_pressure", [-8.0e6, 0.0, 8.0e6])
@pytest.mark.parametrize("opening", [0.3, 1.0])
def test_steady_flow_follows_the_orifice_formula(bench, opening, load_pressure):
    rig = bench({"cylinder": {"leakage": 0.0}})
    supply, tank = float(rig.supply["pressure"][0]), 0.5e6
    s, e, p, m = rig.state[0], rig.ledger[0], rig.joint[0], rig.machine[0]
    s["spool"] = opening
    s["pressure_a"] = 0.5 * (supply + tank + load_pressure)
    s["pressure_b"] = 0.5 * (supply + tank - load_pressure)
    before = float(s["oil_a"])
    hydraulics.exchange_oil(p, m, s, e, supply, p["fluid_bulk_modulus"], 1.0, 1.0, 1.0e-9)
    flow = (s["oil_a"] - before) / 1.0e-9
    rated = p["valve_rated_flow"] * opening
    expected = rated * np.sqrt((supply - tank - load_pressure) / p["valve_rated_drop"])
    assert flow == pytest.approx(expected, rel=5e-3)


def test_no_load_speed_at_full_valve(bench):
    """11.3 rad/s: the flow at half the supply pressure over each land, through piston area and sprocket."""
    rig = bench()
    flow = 3.167e-4 * np.sqrt(20.5e6 / 7.0e6)
    assert flow / (8.0e-4 * 0.06) == pytest.approx(11.3, rel=0.01)
    rig.commands[:] = 1.0
    middle = rig.joint["position_middle"].copy()
    rig.run(0.05, lambda t: middle + 11.29 * (t - 0.05))  # moved at that speed, the pair needs no pressure difference
    difference = rig.state["pressure_a"] - rig.state["pressure_b"]
    assert np.abs(difference).max() < 1.5e6


def test_trapped_oil_is_a_spring_of_the_analytic_stiffness(bench):
    rig = bench({"cylinder": {"leakage": 0.0, **FRICTIONLESS}, "valve": SHUT, **RIGID})
    middle, turn = rig.joint["position_middle"].copy(), 0.002
    p = rig.joint[0]
    volume_a, volume_b = (volume[0] for volume in rig.volume())
    oil = p["fluid_bulk_modulus"] * p["cylinder_area_a"] ** 2 * (1.0 / volume_a + 1.0 / volume_b)
    chain = 1.0 / (1.0 / (2.0 * p["chain_stiffness"]) + 1.0 / p["chain_tooth_stiffness"])
    rig.run(0.2, lambda t: middle + turn * min(t / 0.1, 1.0))
    expected = turn * p["radius"] ** 2 / (1.0 / oil + 1.0 / chain)
    assert -rig.state["torque"][0] == pytest.approx(expected, rel=0.04)


def test_unequal_dead_volumes_make_the_stiffness_depend_on_position(bench):
    def stiffness(at: float, **volumes: float) -> float:
        rig = bench({"cylinder": {"leakage": 0.0, **FRICTIONLESS, **volumes}, "valve": SHUT})
        rig.angles = rig.angles + at
        rig.fill(10.0e6, 10.0e6)
        first, turn = rig.angles.copy(), 0.002
        rig.run(0.1, lambda t: first + turn * min(t / 0.05, 1.0))
        return -rig.state["torque"][0] / turn

    even = stiffness(0.5) / stiffness(-0.5)
    uneven = [stiffness(at, dead_volume_a=2.0e-5, dead_volume_b=2.0e-4) for at in (0.5, -0.5)]
    assert even == pytest.approx(1.0, abs=0.01)
    assert uneven[0] / uneven[1] < 0.8


def test_leak_time_constant(bench):
    rig = bench({"cylinder": FRICTIONLESS, "valve": SHUT, **RIGID})
    rig.fill(14.0e6, 7.0e6)
    rig.run(0.01)
    p, s = rig.joint[0], rig.state[0]
    volume = rig.volume()[0][0]
    oil = p["fluid_bulk_modulus"] * p["cylinder_area_a"] ** 2 * 2.0 / volume
    chain = 1.0 / (1.0 / (2.0 * p["chain_stiffness"]) + 1.0 / p["chain_tooth_stiffness"])
    # The chain gives with the load, so its compliance stores oil like a larger chamber.
    constant = volume / (2.0 * p["fluid_bulk_modulus"] * p["cylinder_leakage"]) * (1.0 + oil / chain)
    start = s["pressure_a"] - s["pressure_b"]
    rig.run(constant)
    assert (s["pressure_a"] - s["pressure_b"]) / start == pytest.approx(np.exp(-1.0), rel=0.05)


def test_dry_friction_holds_a_piston_perfectly_still(bench):
    rig = bench({"cylinder": {"coulomb_friction": 500.0, "leakage": 0.0}, "valve": SHUT})
    rig.run(0.05)
    rest = rig.state["x_a"].copy()
    area, oil = rig.joint["cylinder_area_a"][0], rig.state["oil_a"].copy()
    rig.state["oil_a"] = oil * (1.0 + 0.5 * 500.0 / area / rig.joint["fluid_bulk_modulus"])  # half of what breaks away
    rig.run(0.2)
    np.testing.assert_array_equal(rig.state["x_a"], rest)
    np.testing.assert_array_equal(rig.state["v_a"], 0.0)
    rig.state["oil_a"] = oil * (1.0 + 3.0 * 530.0 / area / rig.joint["fluid_bulk_modulus"])
    rig.run(0.05)
    assert (rig.state["x_a"] > rest + 1e-6).all()


def test_chain_never_pushes(bench):
    assert hydraulics.strand_tension(bench().joint[0], -1e-3, 5.0) == 0.0
    assert hydraulics.strand_tension(bench().joint[0], 1e-6, -50.0) == 0.0


@pytest.mark.parametrize("swelling", [0.0, 5.0e-14])
@pytest.mark.parametrize("pressure", [0.0, 1.0e5, 3.0e7])
def test_pressure_and_oil_content_are_inverse(pressure, swelling):
    oil = hydraulics.chamber_oil(pressure, 1.2e-4, 0.7e9, swelling)
    assert hydraulics.chamber_pressure(oil, 1.2e-4, 0.7e9, swelling) == pytest.approx(pressure, rel=1e-6, abs=1e-3)


def test_all_joints_moving_sag_the_supply_and_it_recovers(bench):
    rig = bench()
    middle = rig.joint["position_middle"].copy()
    idle = float(rig.supply["pressure"][0])
    rig.commands[:] = 0.9
    rig.run(0.08, lambda t: middle + 8.0 * (t - 0.04))
    sagged = float(rig.supply["pressure"][0])
    rig.commands[:] = 0.0
    rig.run(1.0)
    assert sagged < idle - 0.5e6
    assert rig.supply["pressure"][0] == pytest.approx(idle, abs=0.15e6)


def test_halving_the_substep_converges_at_first_order(bench):
    def torque(substep: float) -> np.ndarray:
        rig = bench({"cylinder": FRICTIONLESS}, substep)
        rig.commands[:] = 0.2
        middle = rig.joint["position_middle"].copy()
        rig.run(0.1, lambda t: middle + 0.1 * np.sin(20.0 * t))
        return rig.state["torque"].copy()

    coarse, medium, fine, finest = (torque(h) for h in (1.0e-4, 5.0e-5, 2.5e-5, 1.25e-5))
    errors = [np.abs(x - finest).max() for x in (coarse, medium, fine)]
    assert errors[0] < 0.02 * np.abs(finest).max()
    assert errors[1] < 0.7 * errors[0]
    assert errors[2] < 0.6 * errors[1]
