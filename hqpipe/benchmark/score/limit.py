"""The smallest effect that is named nine times in ten, beside that of an oracle that knows which effect it is.

The oracle is the same diagnosis with a library that holds the true effect alone: it knows the form, and has to estimate
everything else and to accept by the same rules. What the oracle names and the diagnosis does not was lost among the
other effects of the library.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from hqpipe.benchmark.score.case import Judged
from hqpipe.benchmark.score.detection_curve import (
    LEAST_CASES,
    LEAST_EFFECT_CASES,
    Comparison,
    Curve,
    compare,
    fit_curve,
)
from hqpipe.benchmark.score.share import tally
from hqpipe.benchmark.score.truth import extra_error

KIND = "faint"
MEASURE, AIM, MOST = "smallest effect named 9 times in 10, against the oracle's", "≤ 1.5 ×", 1.5
LEAST_EXTRA = 0.02  # of the machine's own gap: below it, what fit and gait do by chance is as large; assumption
AXES = {
    "extra": "error that the effect adds, over the machine's own",
    "factor": "size of the effect over the small one",
}
"""Axes of the curves; the aim is judged on the first, `extra_error`. For each effect the two are proportional, but the
same factor adds 0.3 to 2.5 times the machine's own error, so that the pooled curve over the factor is flat for want of
a common scale, and its limit is that of the effects that add least, at the end of the sizes that are drawn. The factor
is kept beside it because it is known without error."""
AIMED = "extra"
BINS = 5  # of the chart: for factors from 1/16 to 2 one for each doubling


def limits(judged: Sequence[Judged], oracle: Sequence[Judged]) -> dict[str, Any]:
    """Curves, limits and their ratio over both axes, and by effect; JSON-able.

    Args:
        judged, oracle: the faint cases with the diagnosis and with the oracle's, in the same order.

    Returns:
        cases; aim (the row of the table); axes: by name of `AXES`; effects: rows; false_names: of the diagnosis.
    """
    if [case.answer.case for case in judged] != [case.answer.case for case in oracle]:
        raise ValueError("limits: the oracle's cases are not those of the diagnosis")
    named, known = _named(judged), _named(oracle)
    strict = _named(judged, strict=True)
    sizes = {"extra": _extras(judged), "factor": _factors(judged)}
    usable = {name: ~np.isnan(values) for name, values in sizes.items()}
    found = {name: _axis(name, *(values[usable[name]] for values in (sizes[name], named, known))) for name in AXES}
    only_first = fit_ratio(*(values[usable[AIMED]] for values in (sizes[AIMED], strict, known)))
    return {
        "cases": len(judged),
        "aim": _row(found[AIMED], only_first),
        "axes": found,
        "effects": _by_effect(judged, named, known),
        "false_names": tally(bool(case.false_names()) for case in judged),
    }


def fit_ratio(sizes: np.ndarray, named: np.ndarray, other: np.ndarray) -> float | None:
    """Ratio of two limits without an interval; None where one of them is not known."""
    first, second = fit_curve(sizes, named), fit_curve(sizes, other)
    return first.limit / second.limit if first.limit is not None and second.limit is not None else None


def _named(judged: Sequence[Judged], strict: bool = False) -> np.ndarray:
    return np.array([any(case.of(effect, strict) for effect in case.sought) for case in judged], dtype=bool)


def _factors(judged: Sequence[Judged]) -> np.ndarray:
    return np.array([case.answer.sought[0].factor for case in judged], dtype=float)


def _extras(judged: Sequence[Judged]) -> np.ndarray:
    """NaN where the gaps are not known."""
    values = [extra_error(case.gaps) for case in judged]
    return np.array([np.nan if value is None else max(value, LEAST_EXTRA) for value in values], dtype=float)


def _axis(name: str, sizes: np.ndarray, named: np.ndarray, known: np.ndarray) -> dict[str, Any]:
    compared = compare(sizes, named, known)
    curves = {"diagnosis": fit_curve(sizes, named), "oracle": fit_curve(sizes, known)}
    return {
        "text": AXES[name],
        **{who: _curve(curve, compared.limits95[i]) for i, (who, curve) in enumerate(curves.items())},
        **_ratio(compared),
        "bins": _bins(sizes, named, known),
    }


def _curve(curve: Curve, ci95: Any) -> dict[str, Any]:
    content = asdict(curve)
    del content["raw"]  # may be infinite, and says nothing that `reason` does not
    return content | {"limit_ci95": list(ci95) if ci95 else None}


def _ratio(compared: Comparison) -> dict[str, Any]:
    return {
        "ratio": compared.ratio,
        "least_ratio": compared.least,
        "reason": compared.reason,
        "ratio_ci95": list(compared.ci95) if compared.ci95 else None,
    }


def _bins(sizes: np.ndarray, named: np.ndarray, known: np.ndarray) -> list[dict[str, Any]]:
    """Shares named in ranges of the same width on the logarithmic axis."""
    if not len(sizes):
        return []
    edges = np.geomspace(sizes.min(), sizes.max(), BINS + 1)
    which = np.clip(np.searchsorted(edges, sizes, side="right") - 1, 0, BINS - 1)
    return [
        {
            "low": float(edges[i]),
            "high": float(edges[i + 1]),
            "diagnosis": tally(named[which == i].tolist()),
            "oracle": tally(known[which == i].tolist()),
        }
        for i in range(BINS)
    ]


def _row(axis: dict[str, Any], strict: float | None) -> dict[str, Any]:
    """The aim's row: met where the ratio or its lower bound decides it."""
    ratio, least = axis["ratio"], axis["least_ratio"]
    met = ratio <= MOST if ratio is not None else False if least is not None and least > MOST else None
    return {
        "measure": MEASURE,
        "aim": AIM,
        "met": met,
        "ratio": ratio,
        "least_ratio": least,
        "ci95": axis["ratio_ci95"],
        "of": axis["diagnosis"]["cases"],
        "limits": [axis["diagnosis"]["limit"], axis["oracle"]["limit"]],
        "reason": axis["reason"],
        "strict": {"ratio": strict},
    }


def _by_effect(judged: Sequence[Judged], named: np.ndarray, known: np.ndarray) -> list[dict[str, Any]]:
    """How often each effect was named by either, and the limits where there are cases enough."""
    names, factors = np.array([case.answer.sought[0].effect for case in judged]), _factors(judged)
    rows = []
    for effect in sorted(set(names.tolist())):
        inside = names == effect
        curves = [fit_curve(factors[inside], outcome[inside], LEAST_EFFECT_CASES) for outcome in (named, known)]
        first, second = (curve.limit for curve in curves)
        rows.append(
            {
                "effect": effect,
                "cases": int(inside.sum()),
                "named": curves[0].named,
                "oracle": curves[1].named,
                "limit": first,
                "oracle_limit": second,
                "ratio": first / second if first is not None and second is not None else None,
                "reason": [curve.reason for curve in curves],
            }
        )
    return rows


__all__ = ["KIND", "LEAST_CASES", "MEASURE", "fit_ratio", "limits"]
