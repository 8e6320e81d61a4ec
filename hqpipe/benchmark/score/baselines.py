"""Answers that look at no logs, beside which a score is read: Null names nothing, Random draws effects at the cases' rate.

Baselines of the diagnostic competitions (jdekleer/dxc26synth, commit 6da03bd, README); Random of theirs draws one component.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hqpipe.benchmark.score.case import Judged

DRAWS = 20  # answers of Random to each case: with 100 cases the mean of a share is known to about 0.01
SEED = 0  # equal cases give equal scores


def null_answers(judged: Sequence[Judged]) -> list[Judged]:
    """Every case answered with no gap."""
    return [replace(case, content=_content([], "no_gap", 0.0), left={}, error="") for case in judged]


def random_answers(judged: Sequence[Judged]) -> list[Judged]:
    """`DRAWS` answers to every case: each effect of its library with the same probability, in all joints of the case.

    That probability is the number of planted effects over that of the effects asked for, over all cases. Where no effect is
    drawn the answer is `unknown` as often as the cases have something outside the library, else `no_gap`.
    """
    asked = [sorted(case.library - set(case.without)) for case in judged]
    rate = sum(len(case.counted) for case in judged) / max(sum(map(len, asked)), 1)
    outside = sum(case.unnamable for case in judged) / max(len(judged), 1)
    rng = np.random.default_rng(SEED)
    answers = []
    for case, names in zip(judged, asked, strict=True):
        for _ in range(DRAWS):
            drawn = [name for name in names if rng.random() < rate]
            drawn = [drawn[i] for i in rng.permutation(len(drawn))]
            quiet = "unknown" if rng.random() < outside else "no_gap"
            content = _content(
                [_cause(name, case, rate) for name in drawn], "explained" if drawn else quiet, float(bool(drawn))
            )
            answers.append(replace(case, content=content, left={}, error=""))
    return answers


def _content(causes: list[dict[str, Any]], verdict: str, shrink: float) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "gap": {"shrink": shrink, "shrink_ci95": [0.0, 1.0]},
        "where": [],
        "causes": causes,
        "unexplained": {"above_noise": False, "where": []},
    }


def _cause(name: str, case: Judged, probability: float) -> dict[str, Any]:
    return {
        "effect": name,
        "joints": sorted(case.joints),
        "probability": probability,
        "parameters": {},
        "shrink_ci95": [0.0, 1.0],
        "confused_with": [],
    }
