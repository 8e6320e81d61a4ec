"""Causes that are small beside what no effect explains: each goes for good, so that the search for them ends."""

from __future__ import annotations

from types import SimpleNamespace

from hqpipe.identify import minor_causes

CLOSES = {"coulomb_friction": 0.30, "spring": 0.10, "backlash": 0.05}


def test_an_effect_that_went_does_not_come_back_when_the_next_one_goes(monkeypatch):
    calls = []

    def answer(search, known):
        calls.append(known)
        assert len(calls) <= len(CLOSES), "an effect came back"
        left = 0.5 if known else 1.0  # nothing is explained, whatever is left
        return SimpleNamespace(closes={name: CLOSES[name] for name in known}, unexplained=left)

    monkeypatch.setattr(minor_causes, "answer", answer)
    search = SimpleNamespace(
        barred=set(),
        without=lambda known, name: SimpleNamespace(names=known.names - {name}),
        improved=lambda known: known.names,
    )
    best = SimpleNamespace(names=frozenset(CLOSES))
    first = SimpleNamespace(closes=CLOSES, unexplained=0.5)
    (last,) = minor_causes.without_minor_causes([(search, best)], [first])
    assert set(last.closes) == {"coulomb_friction"}
    assert search.barred == {"spring", "backlash"}
