"""What may be said of a layer: the verdict, from the errors alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from layer_cases import cause, layer_found, log_set, made_up, toy

from hqpipe.gap.answer.layer_verdict import weigh_layer
from hqpipe.gap.residuals.layer_errors import layer_errors


@pytest.fixture(scope="module")
def model():
    made = toy("hip", 0)
    made.noise = (0.1, 0.1)
    return made


def verdict(model, base, named, full, causes):
    found = layer_found(made_up(model, base, named, full, [cause("a")] if causes else []))
    return weigh_layer(layer_errors(found, log_set([model]))).verdict(causes)


@pytest.mark.parametrize(
    ("base", "named", "full", "causes", "expected"),
    [
        (0.1, 0.1, 0.1, False, "no_gap"),
        (5.0, 5.0, 5.0, False, "unknown"),
        (5.0, 5.0, 2.0, False, "unknown"),
        (5.0, 0.1, 0.1, True, "explained"),
        (5.0, 1.5, 1.45, True, "explained"),  # far above the noise, but nothing more can be predicted
        (5.0, 3.4, 2.0, True, "partly_explained"),
        (5.0, 4.5, 4.5, True, "partly_explained"),  # most of it stays, whatever it is
    ],
)
def test_verdict(model, base, named, full, causes, expected):
    assert verdict(model, base, named, full, causes) == expected


def test_what_is_left_counts_relative_to_the_spread_and_in_the_unit_of_the_joints(model):
    """A strong joint keeps most of its error, a weak one that had a larger share of its spread loses it."""
    strong = toy("knee", 0)
    for part in ("fit", "heldout"):
        setattr(strong, part, replace(getattr(strong, part), output=20.0 * getattr(strong, part).output))
    spread = np.std(model.fit.output)
    joints = [made_up(model, 0.4 * spread, 0.05 * spread), made_up(strong, 2.0 * spread, 1.6 * spread)]
    evidence = weigh_layer(layer_errors(layer_found(*joints), log_set([model, strong])))
    assert evidence.left < 0.1 and evidence.verdict(True) == "partly_explained"
    assert replace(evidence, one_unit=False).verdict(True) == "explained"


def test_a_machine_is_not_explained_where_a_joint_keeps_most_of_its_gap(model):
    joints = [toy(f"joint_{i}", i) for i in range(8)]

    def verdict_with(last_before, last_left):
        found = [made_up(joint, 5.0, 0.5) for joint in joints[:-1]]
        found.append(made_up(joints[-1], last_before, last_left))
        evidence = weigh_layer(layer_errors(layer_found(*found), log_set(joints)))
        assert evidence.left < 0.25
        return evidence.verdict(True)

    assert verdict_with(5.0, 4.5) == "partly_explained"
    assert verdict_with(5.0, 3.0) == "explained"
    assert verdict_with(2.5, 2.5) == "explained"  # as small beside the gaps of the others


def test_an_error_that_is_certain_but_small_beside_the_motion_is_no_gap(model):
    model_of_little_noise = toy("hip", 0)
    model_of_little_noise.noise = (1e-4, 1e-4)
    spread = np.std(model_of_little_noise.fit.output)
    assert verdict(model_of_little_noise, 0.003 * spread, 0.003 * spread, 0.003 * spread, False) == "no_gap"
    assert verdict(model_of_little_noise, 0.03 * spread, 0.03 * spread, 0.03 * spread, False) == "unknown"


def test_what_an_earlier_record_missed_is_no_change(model):
    found = layer_found(made_up(model, 5.0, 5.0, 5.0))
    errors = layer_errors(found, log_set([model]))
    assert weigh_layer(errors, np.array([26.0])).verdict(False) == "no_gap"
    assert weigh_layer(errors, np.array([4.0])).verdict(False) == "unknown"


@pytest.mark.parametrize("size,expected", [(30.0, ["unknown", "partly_explained"]), (0.5, ["no_gap", "explained"])])
def test_an_error_far_above_the_noise_is_a_gap_however_short_it_lasts(model, size, expected):
    """A limit that is reached once: the blocks of a bootstrap may miss it, noise cannot make it."""
    found = made_up(model, 0.1, 0.1, 0.1, [cause("a")])
    rare = found.base.heldout.copy()
    rare[:5] = size
    once = replace(found.base, heldout=rare)
    found = replace(found, base=once, named=once, full=once)
    evidence = weigh_layer(layer_errors(layer_found(found), log_set([model])))
    assert [evidence.verdict(causes) for causes in (False, True)] == expected
