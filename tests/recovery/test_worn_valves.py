"""A worn machine of the reference plant: larger sets fit no worse than their parts, and its valve is read as it is built."""

from __future__ import annotations

import json
import sys
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from hqpipe.identify.identify import identify
from hqpipe.identify.prior import prior_odds
from hqpipe.identify.rounds import searched
from hqpipe.identify.search import Search
from hqpipe.layers.actuator import Actuator
from hqpipe.logs.end_stops import mark_end_stops

sys.path.insert(0, str(Path(__file__).parents[1] / "unit" / "gap"))
from plant_logs import plant_logs

WORN = {"valve": {"delay": 0.010, "overlap": 0.06, "bandwidth_hz": 12.0}}
GAIN = 2.5  # valve opening per rad of the plant's position loop
SETTLED = 2e-4  # share of the squared error: the prior of a number that does nothing moves a fit by less
JOINTS = {"LFR": 0, "LHK": 8}
RANDOM_SETS, LARGEST = 6, 5


@pytest.fixture(scope="module")
def machine():
    logs, _ = mark_end_stops(plant_logs(seeds=(0, 1, 2), changes=json.dumps(WORN)))
    return Actuator().joints(logs)


@pytest.fixture(params=JOINTS)
def search(request, machine):
    model = machine.models[JOINTS[request.param]]
    assert model.joint == request.param
    return Search(model, prior_odds(model, {}, 0))


def names_of(search):
    return [effect.name for effect in search.model.effects if effect.named]


def no_worse(larger, *parts):
    return all(larger.solution.square <= (1.0 + SETTLED) * part.solution.square for part in parts)


def test_pairs_fit_no_worse_than_their_effects(search):
    base, names = search.base, names_of(search)
    singles = {name: search.grown_by(base, name) for name in names}
    assert all(no_worse(single, base) for single in singles.values())
    for one, other in combinations(names, 2):
        pair = search.grown_by(singles[one], other)
        assert no_worse(pair, singles[one], singles[other]), sorted(pair.names)


def test_sets_fit_no_worse_than_what_they_were_grown_from(search):
    rng, names = np.random.default_rng(19), names_of(search)
    for _ in range(RANDOM_SETS):
        known = search.base
        for name in rng.permutation(names)[:LARGEST].tolist():
            larger = search.grown_by(known, name)
            assert no_worse(larger, known), sorted(larger.names)
            known = larger


def test_sets_fit_no_worse_than_what_an_effect_is_taken_out_of(search):
    known = searched(search, alone=False)
    for name in sorted(known.names):
        smaller = search.without(known, name)
        assert no_worse(search.known[known.names], smaller), name


def test_what_most_joints_have_is_tried_as_a_whole(machine):
    """A joint that alone would end in a lag without the delay."""
    model = next(model for model in machine.models if model.joint == "RFK")
    search = Search(model, prior_odds(model, {}, 0))
    names = {"valve_delay", "valve_lag", "valve_deadband"}
    usual = search.grown_along(sorted(names))
    assert usual.names == names
    assert usual.solution.square < 0.5 * search.grown_along(["valve_lag"]).solution.square


def test_a_worn_valve_is_read_in_the_terms_of_the_plant(machine):
    found = identify(machine, workers=2)
    for joint in found.found:
        named = {cause.effect: cause for cause in joint.causes}
        assert set(named) - {"orifice_flow"} == {"valve_delay", "valve_lag", "valve_deadband"}, joint.model.joint
        value = {
            (effect, number.name): joint.model.reported(effect, number.name, number.value)[1]
            for effect, cause in named.items()
            for number in cause.numbers
        }
        damping, lag = value["valve_lag", "damping_ratio"], value["valve_lag", "time_constant_s"]
        assert value["valve_delay", "delay_s"] == pytest.approx(0.010, rel=0.15)
        assert damping == pytest.approx(0.8, rel=0.15)
        assert damping / (np.pi * lag) == pytest.approx(12.0, rel=0.1), "Hz"
        assert value["valve_deadband", "half_width"] == pytest.approx(0.06 / GAIN, rel=0.1)
