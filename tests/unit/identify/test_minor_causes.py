"""Causes that are small beside what no effect explains: each goes for good, so that the search for them ends."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace

from hqpipe.identify import joint_search
from hqpipe.identify.found import BesideUnknown, JointCause
from hqpipe.identify.joint_search import JointSearch
from hqpipe.identify.minor_causes import without_minor_causes

CLOSES = {"coulomb_friction": 0.30, "spring": 0.10, "backlash": 0.05}


@dataclass
class Answered:
    """What is told of an answer here."""

    beside_unknown: dict
    full: SimpleNamespace
    model: object = field(default=None)
    causes: tuple = ()


def answered(closes: dict, unknown: float) -> Answered:
    """closes: cause → its share. unknown: share that is left."""
    shares = {name: BesideUnknown(share, unknown) for name, share in closes.items()}
    return Answered(shares, SimpleNamespace(effects=tuple(shares)))


def test_an_effect_that_went_does_not_come_back_when_the_next_one_goes(monkeypatch):
    calls = []

    def answer(search, known):
        calls.append(known)
        assert len(calls) <= len(CLOSES), "an effect came back"
        left = 0.5 if known else 1.0  # nothing is explained, whatever is left
        return answered({name: CLOSES[name] for name in known}, left)

    monkeypatch.setattr(joint_search, "answer", answer)
    joint = JointSearch(None, None)
    joint._search = SimpleNamespace(
        barred=set(),
        without=lambda known, name: SimpleNamespace(names=known.names - {name}),
        improved=lambda known: known.names,
    )
    joint._known = SimpleNamespace(names=frozenset(CLOSES))
    (last,) = without_minor_causes([answered(CLOSES, 0.5)], lambda least: {0: joint.without(least[0])})
    assert set(last.beside_unknown) == {"coulomb_friction"}
    assert joint._search.barred == {"spring", "backlash"}


def test_what_closes_little_goes_where_something_is_unexplained_and_no_other_joint_shows_it_better():
    faint, clear, sound = {"torque_bias": 0.002}, {"torque_bias": 0.03}, {}

    def barred(*joints, unknown):
        told = []

        def without(least):
            told.append(dict(least))
            return {j: answered({}, unknown) for j in least}

        without_minor_causes([answered(dict(closes), unknown) for closes in joints], without)
        return told

    assert barred(faint, faint, sound, sound, unknown=0.01) == [{0: "torque_bias", 1: "torque_bias"}]
    assert barred(faint, clear, sound, sound, unknown=0.01) == []  # as many as together close enough
    assert barred(*[faint] * 4, clear, unknown=0.02) == [{2: "torque_bias", 3: "torque_bias"}]
    assert barred(faint, faint, sound, sound, unknown=0.0) == []


def test_what_joins_only_where_another_effect_is_barred_goes_with_it():
    """Not what was asked for all along, nor what could not be told from that."""
    begun = answered({"valve_lag": 0.1, "orifice_flow": 0.9}, 0.5)
    begun.causes = (JointCause("valve_lag", 0.9, (), ("valve_delay",)),)
    in_turn = [
        {"orifice_flow": 0.9, "integral_action": 0.9, "valve_delay": 0.8},
        {"orifice_flow": 0.9, "valve_delay": 0.8},
    ]
    told = []

    def without(least):
        told.append(dict(least))
        return {0: answered(in_turn[len(told) - 1], 0.5)}

    (last,) = without_minor_causes([begun], without)
    assert told == [{0: "valve_lag"}, {0: "integral_action"}]
    assert set(last.beside_unknown) == {"orifice_flow", "valve_delay"}


def test_what_is_named_for_what_fits_best_was_asked_for():
    begun = answered({"valve_lag": 0.8, "orifice_flow": 0.9}, 0.0)
    begun.full = SimpleNamespace(effects=("valve_delay", "orifice_flow"))
    begun.causes = (JointCause("valve_lag", 0.9, (), ("valve_delay",)), JointCause("orifice_flow", 1.0, ()))
    (last,) = without_minor_causes([begun], lambda least: {0: answered({}, 0.5)})
    assert last is begun
