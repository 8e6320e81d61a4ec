"""The score of a diagnosis on cases whose effects were withheld."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from hqpipe.benchmark.score.case import Judged
from hqpipe.benchmark.score.groups import CHANGE_MEASURES, Measure, baselines, effects, families, planted, row_of
from hqpipe.benchmark.score.limit import KIND as FAINT
from hqpipe.benchmark.score.limit import limits
from hqpipe.benchmark.score.share import tally
from hqpipe.benchmark.score.truth import CHANGE, QUADRUPED, true_shares, true_shrink

FORMAT = "hqpipe-blind-score/1"
BINS = 5  # of the reliability curve: with some hundred causes each keeps enough to be judged
MIXTURE = "mixture"
ORACLE_KINDS = (FAINT, MIXTURE, "single", "place")
"""Kinds of cases that an oracle answers too: the same diagnosis with a library of the true effects alone. What it does not
name, or not in every joint, is not lost among other effects, but hidden in these logs from this method."""
NO_NAME = "(no name)"
NO_EFFECT = "(no effect)"


def score(judged: Sequence[Judged], oracle: Sequence[Judged] = ()) -> dict[str, Any]:
    """All measures; JSON-able.

    Faint cases count for the limit of detection alone: their effects are meant to be missed half of the time, and what
    is said of them is as vague as they are. Their false names are told beside it.

    Args:
        judged: every case with its diagnosis. oracle: those of `ORACLE_KINDS`, in the same order, with the oracle's, which
            knows the effects that were left out of the library too.
    """
    faint = [case for case in judged if case.answer.kind == FAINT]
    clear = [case for case in judged if case.answer.kind != FAINT]
    measures = [*MEASURES, *(CHANGE_MEASURES if any(case.answer.kind == CHANGE for case in clear) else ())]
    aims = [row_of(clear, measure) for measure in measures]
    rows = [row for case in clear for row in case.parameters()]
    aims += _parameter_aims(rows)
    limit = limits(faint, [case for case in oracle if case.answer.kind == FAINT]) if faint else None
    known = [case for case in oracle if case.answer.kind != FAINT]
    return {
        "format": FORMAT,
        "cases": len(judged),
        "failed": [{"case": c.answer.case, "error": c.error} for c in judged if c.content is None],
        "aims": [*aims, limit["aim"]] if limit else aims,
        "more": _more(clear, faint, known),
        "calibration": calibration(clear),
        "detection": detection(clear),
        "limit": limit,
        "confusion": confusion(clear),
        "parameters": rows,
        "shrink": [row for case in clear if (row := _shrink_row(case))],
        "families": families(clear, measures),
        "effects": effects(clear),
        "baselines": baselines(clear, [measure for measure in measures if measure[0] not in _NEED_LOGS]),
        "misses": misses(judged, {case.answer.case: case for case in known}),
    }


def _is_typical_single(case: Judged) -> bool:
    """On other machines than the quadruped, whose sizes were chosen by the gap that they make, only if it makes one."""
    return (
        case.answer.kind == "single"
        and not case.unnamable
        and (case.answer.machine == QUADRUPED or any(effect in case.needed for effect in case.sought))
        and all(effect.size in ("typical", None) for effect in case.answer.sought)
    )


def _claims_all(case: Judged) -> bool:
    """The found set is the planted one, so that its claimed shrink is comparable with the true one.

    Beside something ordinary whose own gap is not known it is not: the machine without the effects may have it too.
    """
    if len(case.counted) < len(case.namable):
        return False
    return bool(case.answer.effects and case.gaps and case.causes and not case.unnamable and case.exact())


def _shrink_covered(case: Judged, strict: bool) -> bool:
    low, high = case.content["gap"]["shrink_ci95"]
    return low <= true_shrink(case.gaps) <= high and (not strict or case.exact(strict=True))


_PLACE, _SHRINK = "place (joint, quarter) right", "claimed shrink within its interval of the true one"
_NEED_LOGS = (_PLACE, _SHRINK)  # an answer that looks at no logs claims neither
MEASURES: tuple[Measure, ...] = (
    (
        "single effect, typical size: it is the top cause",
        "≥ 98 %",
        0.98,
        _is_typical_single,
        lambda case, strict: case.top_is_right(strict),
    ),
    (
        "exact set of causes, mixtures of 2–4",
        "≥ 90 %",
        0.90,
        lambda case: case.answer.kind == MIXTURE and not case.unnamable,
        lambda case, strict: case.exact(strict),
    ),
    (
        "no false alarm on logs with no effect",
        "≥ 98 %",
        0.98,
        lambda case: case.answer.kind == "none",
        lambda case, strict: case.alarms_rightly(strict),
    ),
    (
        "effect not in the library: unknown, and no false name",
        "≥ 90 %",
        0.90,
        lambda case: case.unnamable,
        lambda case, strict: case.admits_ignorance(),
    ),
    (
        _PLACE,
        "≥ 95 %",
        0.95,
        lambda case: case.place_is_right() is not None,
        lambda case, strict: bool(case.place_is_right(strict)),
    ),
    (
        _SHRINK,
        "≥ 95 %",
        0.95,
        _claims_all,
        _shrink_covered,
    ),
)


def _parameter_aims(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Parameters only count where the effect itself was named, so that both columns are the same."""
    close, covered = tally(row["close"] for row in rows), tally(row["covered"] for row in rows)
    near = None if close["share"] is None else close["share"] >= 0.90
    well = None if covered["share"] is None else 0.93 <= covered["share"] <= 0.97
    return [
        {"measure": "parameters within 10 %", "aim": "≥ 90 %", "met": near, **close, "strict": close},
        {
            "measure": "95 % intervals of the parameters cover",
            "aim": "93–97 %",
            "met": well,
            **covered,
            "strict": covered,
        },
    ]


def _more(judged: Sequence[Judged], faint: Sequence[Judged], known: Sequence[Judged]) -> list[dict[str, Any]]:
    """Measures without an aim; `judged` without the faint cases, `known`: the others with the oracle's diagnosis."""
    nameable = [c for c in judged if c.counted]
    worth = planted(nameable)
    causes = [(case, cause) for case in judged for cause in case.causes]
    definitions = {
        "recall: effects of the library that make a gap and were named": [bool(c.of(e)) for c, e in worth],
        "the same, without small ones": [bool(c.of(e)) for c, e in worth if e.size != "small"],
        "precision: names that are right": [_is_right(case, cause) for case, cause in causes],
        "exact set, one effect in some joints or for some time": [
            c.exact() for c in nameable if c.answer.kind == "place"
        ],
        "claimed share of an effect within its interval of the true one (up to three effects)": [
            row["covered"] for case in judged if _claims_all(case) for row in _share_rows(case)
        ],
        "diagnosis finished": [case.content is not None for case in (*judged, *faint)],
        "nothing false named beside a faint effect": [not c.false_names() for c in faint if c.content is not None],
    }
    for count in (2, 3, 4):
        definitions[f"exact set, mixtures of {count}"] = [
            c.exact() for c in nameable if c.answer.kind == MIXTURE and len(c.answer.sought) == count
        ]
    withheld = {c.answer.case: c for c in judged if c.without}
    if withheld:
        pairs = [(withheld[c.answer.case], c) for c in known]
        definitions[
            "the same, or a name that leaves no more error than the true effects do: no log of this kind refutes it"
        ] = [case.admits_ignorance() or case.imitates(oracle) for case, oracle in pairs]
    elif known:
        asked = {c.answer.case for c in known}
        definitions |= {
            "exact set, mixtures of 2–4, by an oracle that knows which effects it may be": [
                c.exact() for c in known if c.answer.kind == MIXTURE
            ],
            "place right by that oracle, which is not asked for effects outside the library": _places(known),
            "place right in the same cases": _places([c for c in judged if c.answer.case in asked]),
        }
    return [{"measure": name, **tally(outcomes)} for name, outcomes in definitions.items()]


def _places(judged: Sequence[Judged]) -> list[bool]:
    return [right for case in judged if (right := case.place_is_right()) is not None]


def _is_right(case: Judged, cause: Any) -> bool:
    return cause["effect"] not in case.false_names()


def _share_rows(case: Judged) -> list[dict[str, Any]]:
    shares, rows = true_shares(case.gaps, [e.effect for e in case.answer.effects]), []
    for effect in case.answer.effects:
        named = case.of(effect, strict=True)
        if effect.effect in shares and len(named) == 1:
            low, high = named[0]["shrink_ci95"]
            rows.append({"effect": effect.effect, "covered": low <= shares[effect.effect] <= high})
    return rows


def _shrink_row(case: Judged) -> dict[str, Any] | None:
    if not _claims_all(case):
        return None
    gap = case.content["gap"]
    return {
        "case": case.answer.case,
        "true": true_shrink(case.gaps),
        "claimed": gap["shrink"],
        "ci95": list(gap["shrink_ci95"]),
        "covered": _shrink_covered(case, False),
    }


def calibration(judged: Sequence[Judged]) -> dict[str, Any]:
    """Brier score (Brier, Monthly Weather Review 78, 1950) and reliability curve of the causes' probabilities."""
    pairs = [(float(cause["probability"]), _is_right(case, cause)) for case in judged for cause in case.causes]
    bins = []
    for index in range(BINS):
        low, high = index / BINS, (index + 1) / BINS
        inside = [(p, r) for p, r in pairs if low <= p < high or (index == BINS - 1 and p == high)]
        mean = sum(p for p, _ in inside) / len(inside) if inside else None
        bins.append({"low": low, "high": high, "mean_probability": mean, **tally(r for _, r in inside)})
    brier = sum((p - right) ** 2 for p, right in pairs) / len(pairs) if pairs else None
    return {"brier": brier, "causes": len(pairs), "bins": bins}


def detection(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    """Share named by effect and size among the cases with one effect; "any" pools the effects."""
    seen: dict[tuple[str, str], list[bool]] = {}
    for case in judged:
        if case.answer.kind != "single" or case.unnamable:
            continue
        for effect in case.sought:
            for name in ("any", effect.effect):
                seen.setdefault((name, effect.size or "typical"), []).append(bool(case.of(effect)))
    order = ("small", "typical", "large")
    keys = sorted(seen, key=lambda key: (key[0] != "any", key[0], order.index(key[1])))
    return [{"effect": name, "size": size, **tally(seen[name, size])} for name, size in keys]


def confusion(judged: Sequence[Judged]) -> dict[str, Any]:
    """True effect against the first name, over the cases with one effect or none; "(no name)" if there is none."""
    counts: Counter[tuple[str, str]] = Counter()
    for case in judged:
        if len(case.answer.sought) <= 1 and case.content is not None:
            true = next((effect.effect for effect in case.answer.sought), NO_EFFECT)
            counts[true, case.causes[0]["effect"] if case.causes else NO_NAME] += 1
    truths = sorted({true for true, _ in counts}, key=lambda name: (name == NO_EFFECT, name))
    named = sorted({name for _, name in counts}, key=lambda name: (name == NO_NAME, name))
    return {"truth": truths, "named": named, "counts": [[counts[t, n] for n in named] for t in truths]}


_ALL = (*MEASURES, *CHANGE_MEASURES)


def misses(judged: Sequence[Judged], known: Mapping[str, Judged] | None = None) -> list[dict[str, str]]:
    """Every case that fails one of the measures that have an aim: case, kind, truth, answer, and which.

    Args:
        known: case → the same with the oracle's diagnosis.
    """
    found, known = [], known or {}
    for case in judged:
        failed = [text for text, _, _, selects, right in _ALL if selects(case) and not right(case, False)]
        if case.answer.kind == "single" and not failed and not case.unnamable and not case.exact():
            failed = ["the set of causes is not exact"]
        if case.answer.kind == FAINT:  # not to name it is no miss
            failed = ["a false name beside a faint effect"] if case.false_names() else []
        if case.content is None:
            failed = ["the diagnosis failed"]
        if failed:
            failed += [f"{name} is not asked for in these logs" for name in sorted(case.not_asked)]
        if failed and case.answer.case in known:
            failed += _hidden(case, known[case.answer.case])
        if failed:
            found.append(
                {
                    "case": case.answer.case,
                    "kind": case.answer.kind,
                    "truth": case.truth_text(),
                    "answer": case.answer_text(),
                    "missed": "; ".join(failed),
                }
            )
    return found


def _hidden(case: Judged, known: Judged) -> list[str]:
    """What the oracle does not see either, or could not refute."""
    if case.without:
        return ["the name leaves no more error than the true effects"] if case.imitates(known) else []
    missed = {"set": not known.exact(), "place": known.place_is_right() is False}
    return [f"the oracle misses the {name} too" for name, true in missed.items() if true]
