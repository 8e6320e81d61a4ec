"""The score of withheld-effect cases by family of machines, by effect, and beside answers that look at no logs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import fmean, median
from typing import Any

from hqpipe.benchmark.score.baselines import null_answers, random_answers
from hqpipe.benchmark.score.case import Judged
from hqpipe.benchmark.score.share import tally
from hqpipe.benchmark.score.truth import CHANGE, TrueEffect
from hqpipe.benchmark.score.utility import utility

Selects = Callable[[Judged], bool]
Right = Callable[[Judged, bool], bool]
Measure = tuple[str, str, float | None, Selects, Right]
"""Text, aim, least share, which cases, what counts as right (strictly, or with `confused_with`)."""

CHANGE_MEASURES: tuple[Measure, ...] = (
    (
        "change since earlier logs: exactly what changed is named",
        "≥ 90 %",
        0.90,
        lambda case: case.answer.kind == CHANGE and bool(case.answer.sought) and not case.unnamable,
        lambda case, strict: case.exact(strict),
    ),
    (
        "no change since earlier logs: no gap",
        "≥ 98 %",
        0.98,
        lambda case: case.answer.kind == CHANGE and not case.answer.sought,
        lambda case, strict: case.verdict == "no_gap" and not case.causes,
    ),
)
"""Aims of cases with earlier logs: those of sets of causes and of false alarms."""
OF_GROUPS = {
    "exact": "exact set of causes, all cases with effects of the library alone",
    "recall": "effects named",
    "precision": "names that are right",
}


def row_of(judged: Sequence[Judged], measure: Measure) -> dict[str, Any]:
    """One measure over the cases that it selects; JSON-able."""
    text, aim, least, selects, right = measure
    chosen = [case for case in judged if selects(case)]
    main = tally(right(case, False) for case in chosen)
    met = None if least is None or main["share"] is None else main["share"] >= least
    return {"measure": text, "aim": aim, "met": met, **main, "strict": tally(right(case, True) for case in chosen)}


def planted(judged: Sequence[Judged]) -> list[tuple[Judged, TrueEffect]]:
    """Every effect of the library that makes a gap, with its case."""
    return [(case, effect) for case in judged for effect in case.needed]


def probability(case: Judged, effect: TrueEffect) -> float:
    """That the diagnosis gives a planted effect: of the cause with its name, 0 where there is none."""
    return max((float(cause["probability"]) for cause in case.causes if cause["effect"] == effect.effect), default=0.0)


def families(judged: Sequence[Judged], measures: Sequence[Measure]) -> list[dict[str, Any]]:
    """By family of machines: every measure, sets, names, parameters, mean probability of the true causes, m_utl.

    `hidden` effects of the library make no gap in their case, so that nothing is lost without their names; those `not_asked`
    make one, and the diagnosis of such logs does not choose from them.

    Args:
        judged: without the faint cases. measures: those of the aims.
    """
    return [
        {"family": name, **_figures(cases, measures), "parameters": _parameters(cases)}
        for name, cases in _by(judged, lambda case: case.answer.machine).items()
    ]


def _figures(judged: Sequence[Judged], measures: Sequence[Measure]) -> dict[str, Any]:
    pairs = planted(judged)
    nameable = [case for case in judged if case.answer.sought and not case.unnamable]
    named = [
        [cause["effect"] not in case.false_names(strict) for case in judged for cause in case.causes]
        for strict in (0, 1)
    ]
    own = {
        "exact": ([case.exact() for case in nameable], [case.exact(strict=True) for case in nameable]),
        "recall": ([bool(c.of(e)) for c, e in pairs], [bool(c.of(e, strict=True)) for c, e in pairs]),
        "precision": named,
    }
    rows = [{"measure": OF_GROUPS[key], **tally(main), "strict": tally(strict)} for key, (main, strict) in own.items()]
    return {
        "cases": len(judged),
        "hidden": sum(len(case.counted) - len(case.needed) for case in judged),
        "not_asked": sum(len(case.not_asked) for case in judged),
        "measures": [*(row_of(judged, measure) for measure in measures), *rows],
        "probability": _mean(probability(case, effect) for case, effect in pairs),
        "utility": _mean(utility(case) for case in judged),
    }


def effects(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    """By family and effect: how often it was named, with which probability, how well its numbers are, and where it was not.

    Args:
        judged: without the faint cases.

    Returns:
        Rows with `named` (with `confused_with`) and its `strict`; of an effect outside the library, how often an answer
        admitted that there is one.
        `falsely`: cases in which the name was given and stands for nothing that is there.
    """
    rows = []
    for family, cases in _by(judged, lambda case: case.answer.machine).items():
        true = {effect.effect for case in cases for effect in _asked(case)}
        false = {name for case in cases for name in case.false_names()}
        rows += [{"family": family, **_effect_row(name, cases)} for name in sorted(true | false)]
    return rows


def _effect_row(name: str, cases: Sequence[Judged]) -> dict[str, Any]:
    having = [case for case in cases if name in {effect.effect for effect in _asked(case)}]
    pairs = [(case, effect) for case, effect in planted(having) if effect.effect == name]
    hidden = [case for case in having if name not in {effect.effect for effect in case.namable}]
    admitted = [case.admits_ignorance() for case in hidden]
    return {
        "effect": name,
        "cases": len(having),
        "outside": bool(hidden),
        "named": tally([bool(c.of(e)) for c, e in pairs] + admitted),
        "strict": tally([bool(c.of(e, strict=True)) for c, e in pairs] + admitted),
        "probability": _mean(probability(case, effect) for case, effect in pairs),
        "falsely": sum(name in case.false_names() for case in cases),
        "parameters": _parameters(having, name),
    }


def _asked(case: Judged) -> list[TrueEffect]:
    """What an answer is judged by: effects of the library that count, and those that it does not hold."""
    return [effect for effect in case.answer.effects if effect in case.counted or effect not in case.namable]


def _parameters(cases: Sequence[Judged], effect: str | None = None) -> dict[str, Any]:
    rows = [row for case in cases for row in case.parameters() if effect in (None, row["effect"])]
    return {
        "median_error": median(abs(row["error"]) for row in rows) if rows else None,
        "close": tally(row["close"] for row in rows),
        "covered": tally(row["covered"] for row in rows),
    }


def baselines(judged: Sequence[Judged], measures: Sequence[Measure]) -> list[dict[str, Any]]:
    """The diagnosis, Null and Random: the measures that need no place and no number, mean probability, m_utl.

    Args:
        judged: without the faint cases. measures: those of the aims that Null and Random can be judged by.
    """
    answers = {"diagnosis": list(judged), "null": null_answers(judged), "random": random_answers(judged)}
    return [{"answers": name, **_figures(cases, measures)} for name, cases in answers.items()]


def _by(judged: Sequence[Judged], key: Callable[[Judged], str]) -> Mapping[str, list[Judged]]:
    found: dict[str, list[Judged]] = {}
    for case in judged:
        found.setdefault(key(case), []).append(case)
    return found


def _mean(values: Iterable[float]) -> float | None:
    listed = list(values)
    return fmean(listed) if listed else None
