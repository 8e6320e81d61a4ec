"""A larger set of effects fits no worse than what it was grown from, on logs of a worn machine."""

from __future__ import annotations

import json
from itertools import combinations

import numpy as np
import pytest
from plant_logs import plant_logs

from hqpipe.effects.layout import slot
from hqpipe.gap.accuse import output_noise
from hqpipe.gap.joint_data import joint_data
from hqpipe.gap.joint_state import library
from hqpipe.gap.set_fit import JointFitter

WORN = {"valve": {"delay": 0.010, "overlap": 0.06, "bandwidth_hz": 12.0}}
ROUNDING, HELD = 1e-6, 1e-4  # the second with an integrator, whose start is searched to that (HELD_CLOSE)
JOINTS = {"LFR": 0, "LHK": 8}
RANDOM_SETS, LARGEST = 8, 5


@pytest.fixture(scope="module", params=JOINTS)
def fitter(request):
    logs, j = plant_logs(changes=json.dumps(WORN)), JOINTS[request.param]
    fit, heldout = ([trial.trajectory for trial in split] for split in (logs.fit, logs.heldout))
    return JointFitter(joint_data(fit, heldout, j, "position", 100, output_noise(heldout, j, "position")))


NAMES = library("position", "pressure", 12)


def no_worse(fit, *parts):
    allowed = 1.0 + (HELD if "integral_action" in fit.effects else ROUNDING)
    return all(fit.loss <= allowed * part.loss for part in parts)


def test_pairs_fit_no_worse_than_their_effects(fitter):
    singles = {name: fitter.fit((name,)) for name in NAMES}
    assert all(no_worse(fit, fitter.fit()) for fit in singles.values())
    for pair in combinations(NAMES, 2):
        parts = [singles[name] for name in pair]
        fitter.fit(pair, parts[:1], 6)
        assert no_worse(fitter.fit(pair, parts, 6), *parts), pair


def test_sets_fit_no_worse_than_what_they_were_grown_from(fitter):
    rng = np.random.default_rng(19)
    for _ in range(RANDOM_SETS):
        grown = fitter.fit()
        for name in rng.permutation(NAMES)[:LARGEST].tolist():
            larger = fitter.fit((*grown.effects, name), [grown], 6)
            assert no_worse(larger, grown), larger.effects
            grown = larger


def test_a_worn_valve_is_read_in_the_plants_own_terms(fitter):
    names = ("valve_delay", "valve_lag", "valve_deadband", "orifice_flow")
    fit = fitter.fit(names)
    assert fit.loss < 0.05 * fitter.fit().loss
    delay, lag, damping, width = (
        fit.row[slot(*key)]
        for key in (
            ("valve_delay", "delay_s"),
            ("valve_lag", "time_constant_s"),
            ("valve_lag", "damping_ratio"),
            ("valve_deadband", "half_width"),
        )
    )
    assert delay == pytest.approx(0.010, rel=0.1)
    assert 1.0 / damping == pytest.approx(0.8, rel=0.1)
    assert 1.0 / (np.pi * lag * damping) == pytest.approx(12.0, rel=0.05), "Hz"
    assert width == pytest.approx(0.06 / 2.5, rel=0.1), "overlap over the loop's gain"
