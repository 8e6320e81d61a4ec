"""Swapped and flipped channels are named; joints that are driven alike are not accused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, log_set, plant_logs, real, recorded, values, without_pressures

from hqpipe.gap.checks.sanity_wiring import wiring_defects
from hqpipe.gap.checks.unsigned import never_negative

LFR, LFP, LFK, RFP, RFK = 0, 1, 2, 4, 5


def wired(channels, *cycle):
    """Column k of the cycle gets what belongs to the next joint."""

    def change(t):
        order = np.arange(len(t.joints))
        order[list(cycle)] = [*cycle[1:], cycle[0]]
        return replace(t, **{name: getattr(t, name)[:, order] for name in channels})

    return change


@pytest.mark.parametrize("source", ["pressure", "load_cell"])
@pytest.mark.parametrize("kind", ["multisine", "chirp"])
def test_sound_wiring(source, kind):
    logs = plant_logs((0, 1), source, kind=kind)
    assert wiring_defects(logs, set()) == []
    assert wiring_defects(broken(logs, without_pressures), set()) == []


@pytest.mark.parametrize("name", ["emps", "so101"])
def test_real_machines_are_wired_right(name):
    logs = real(name)
    assert wiring_defects(logs, set(never_negative(logs.trials, "effort"))) == []


@pytest.mark.parametrize("channel", ["effort", "position", "velocity", "position_command"])
@pytest.mark.parametrize("pair", [(LFK, RFK), (LFR, LFP), (LFP, LFK)])
def test_one_channel_of_two_joints(channel, pair):
    logs = broken(plant_logs(), without_pressures)
    (found,) = wiring_defects(broken(logs, wired([channel], *pair)), set())
    assert (found.kind, found.channel, found.fatal) == ("swapped", channel, True)
    assert set(found.joints) == {logs.joints[j] for j in pair}
    assert len(found.trials) == 2


def test_effort_swapped_in_one_trial():
    (found,) = wiring_defects(broken(plant_logs(), wired(["effort"], LFK, RFP), [1]), set())
    assert (found.channel, found.trials, set(found.joints)) == ("effort", ("t1.parquet",), {"LFK", "RFP"})


def test_three_columns_in_a_ring():
    (found,) = wiring_defects(broken(plant_logs(), wired(["effort"], LFK, RFP, LFP)), set())
    assert found.channel == "effort" and set(found.joints) == {"LFK", "RFP", "LFP"}


def test_position_and_velocity_of_two_joints():
    logs = broken(plant_logs(), wired(["position", "velocity"], LFK, RFK))
    (found,) = wiring_defects(logs, set())
    assert "position and velocity of LFK and RFK swapped in every trial" in found.message


def test_joints_driven_alike_are_left_alone():
    """Two joints that move and pull alike, up to noise: exchanging them changes nothing that could be known."""
    twin = recorded(0)

    def alike(t):
        rng = np.random.default_rng(0)
        copies = {}
        for name, noise in (("position", 1e-5), ("velocity", 1e-3), ("effort", 1.0), ("position_command", 0.0)):
            array = getattr(t, name).copy()
            array[:, RFK] = array[:, LFK] + noise * rng.standard_normal(t.samples)
            copies[name] = array
        return replace(t, **copies)

    logs = log_set([without_pressures(alike(t)) for t in (twin, recorded(1))])
    assert wiring_defects(broken(logs, wired(["effort"], LFK, RFK)), set()) == []


@pytest.mark.parametrize("channel", ["effort", "velocity", "position", "position_command"])
def test_flipped_sign(channel):
    logs = broken(plant_logs(), without_pressures)
    (found,) = wiring_defects(broken(logs, values(channel, np.negative, LFK)), set())
    assert (found.kind, found.channel, found.joints) == ("sign_flipped", channel, ("LFK",))


def test_effort_without_a_sign_is_not_called_flipped():
    logs = broken(plant_logs(), values("effort", lambda v: -np.abs(v)))
    everyone = set(logs.joints)
    assert not any(d.channel == "effort" for d in wiring_defects(logs, everyone))


def test_rows_that_run_backwards():
    logs = broken(plant_logs(), lambda t: replace(t, **{n: v[::-1] for n, v in t.channels().items()}))
    (found,) = wiring_defects(logs, set())
    assert found.kind == "rows_out_of_order" and "backwards in time in every trial" in found.message


@pytest.mark.parametrize("change", ['{"valve": {"hysteresis": 0.1}}', '{"chain": {"slack": 0.003}}'])
@pytest.mark.parametrize("kind", ["chirp"])
def test_a_poor_machine_is_not_a_miswired_one(change, kind):
    assert wiring_defects(plant_logs((7, 8), changes=change, kind=kind), set()) == []
