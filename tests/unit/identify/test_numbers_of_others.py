"""What most joints have, in a joint where its number is unlike theirs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.identify.identify import identify
from hqpipe.identify.joint_search import JointSearch
from hqpipe.identify.model import Effect, LayerJoints, Parameter
from hqpipe.identify.numbers_of_others import OwnNumber, own_numbers, range_of
from hqpipe.identify.prior import prior_odds

LAGS = (0.46, 0.50, 0.53, 0.48, 0.51, 0.55)


class NearlyAlike(ToyJoint):
    """A lag and a delay that do the same but for so little that the noise hides it."""

    effects = tuple(Effect(name, (Parameter("size", "1", 0.0, 0.5, 0.0),)) for name in ("lag", "delay"))
    unlike = 0.005

    def _part(self, files, truth, *others):
        samples, regressors = super()._part(files, {}, *others)
        inertia, offset, friction, _, spring, *_ = regressors
        regressors = np.stack([inertia, offset, friction, friction + self.unlike * spring])
        numbers = [truth.get(name, 0.0) for name in ("lag", "delay")]
        return _with_output(samples, samples.output + numbers @ regressors[2:]), regressors


def _with_output(samples, output):
    return type(samples)(
        samples.files, samples.trial, samples.time, samples.position, samples.velocity, output, samples.held
    )


def _named(*truths):
    models = [NearlyAlike(f"joint_{k}", truth, seed=k) for k, truth in enumerate(truths)]
    found = identify(LayerJoints("joint_motion", "rmse", 0.1, "", tuple(models))).found
    return [{cause.effect: cause for cause in joint.causes} for joint in found]


def test_what_is_more_than_the_others_have_is_told_beside_it():
    *others, last = _named(*({"lag": lag} for lag in LAGS), {"lag": 0.5, "delay": 0.6})
    assert all(set(joint) == {"lag"} for joint in others)
    assert set(last) == {"lag", "delay"}
    low, high = range_of([joint["lag"].numbers[0].value for joint in others])
    assert low <= last["lag"].numbers[0].value <= high * (1.0 + 1e-9)
    assert last["lag"].numbers[0].value + last["delay"].numbers[0].value == pytest.approx(1.1, rel=0.03)
    assert "lag" in last["delay"].confused_with  # its own lag may as well be as large as both


def test_a_number_that_the_logs_show_to_be_its_own_stays(monkeypatch):
    monkeypatch.setattr(NearlyAlike, "unlike", 0.1)
    *_, last = _named(*({"lag": lag} for lag in LAGS), {"lag": 1.1})
    assert set(last) == {"lag"}
    assert last["lag"].numbers[0].value == pytest.approx(1.1, rel=0.05)


def test_joints_whose_numbers_scatter_alike_keep_them():
    for joint, lag in zip(_named(*({"lag": lag} for lag in LAGS)), LAGS, strict=True):
        assert set(joint) == {"lag"}
        assert joint["lag"].numbers[0].value == pytest.approx(lag, rel=0.05)


def test_the_range_of_the_others_holds_one_more_number_as_often_as_it_says_and_stays_where_a_few_do_not_belong():
    rng = np.random.default_rng(0)
    draws = rng.normal(4.0, 0.3, (4000, 12))
    ranges = [range_of(draw[:-1]) for draw in draws]
    held = np.mean([low <= draw[-1] <= high for (low, high), draw in zip(ranges, draws, strict=True)])
    assert 0.9 < held < 0.97
    low, high = range_of([*draws[0][:8], 9.0, 9.1, 9.2])
    assert high < 6.0


def _joint(effect, number, *rivals):
    return SimpleNamespace(causes=[_cause(effect, number, rivals)])


def _cause(effect, number, rivals=(), unit="s"):
    return SimpleNamespace(effect=effect, numbers=(SimpleNamespace(value=number, unit=unit),), confused_with=rivals)


def test_a_number_is_a_joints_own_if_it_is_unlike_that_of_the_others_and_something_else_may_be_in_its_place():
    others = [_joint("lag", lag) for lag in LAGS]
    shared = frozenset({"lag"})
    assert set(own_numbers([*others, _joint("lag", 1.0, "delay")], shared)) == {len(LAGS)}
    assert own_numbers([*others, _joint("lag", 1.0)], shared) == {}  # nothing else could be in its place
    assert own_numbers([*others, _joint("lag", 0.5, "delay")], shared) == {}
    assert own_numbers([*others, _joint("lag", 1.0, "delay")], frozenset()) == {}
    both = _joint("lag", 1.0, "delay")
    both.causes.append(_cause("delay", 0.2))
    assert own_numbers([*others, both], shared) == {}  # it has both already
    (own,) = own_numbers([*others, _joint("lag", 1.0, "delay")], shared)[len(LAGS)]
    assert isinstance(own, OwnNumber)
    assert own.others[0] < min(LAGS) < max(LAGS) < own.others[1] < 1.0
    assert own_numbers([_joint("lag", 0.5), _joint("lag", 1.0, "delay")], shared) == {}  # two joints: which one is odd?


def test_joints_share_no_torques():
    torques = [SimpleNamespace(causes=[_cause("friction", torque, ("offset",), "N·m")]) for torque in (*LAGS, 1.0)]
    assert own_numbers(torques, frozenset({"friction"})) == {}


def test_a_number_is_the_joints_own_again_where_what_stood_beside_it_is_gone():
    search = JointSearch(NearlyAlike("joint", {"lag": 0.6, "delay": 0.5}), prior_odds)
    search.first(alone=True)
    kept = frozenset(search.answered().kept.effects)
    assert kept == {"delay"}
    own = OwnNumber("delay", ("lag",), range_of(LAGS))
    both = {cause.effect: cause for cause in search.as_others_have((kept, [own])).causes}
    assert set(both) == {"lag", "delay"}
    assert both["delay"].numbers[0].value < 0.7
    (delay,) = search.without("lag").causes
    assert delay.effect == "delay"
    assert delay.numbers[0].value == pytest.approx(1.1, rel=0.03)
