"""What may be said of a change where the models of then and now err as much as holding the torque."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hqpipe.gap.levels import Changed, Levels, compare

ADVICE = (
    "log command and response of the drive at a higher rate, or compare the same motion before and after each change"
)


def by_levels(
    content: dict[str, Any], then: Levels, now: Levels, unpredicted: Sequence[str], unit: str
) -> tuple[dict[str, Any], str | None]:
    """An answer that found no change, with what the levels of the torque say of joints that no model predicts.

    Args:
        content: of diagnosis.json, with the verdict `no_gap`. then, now: see `hqpipe.gap.levels`.
        unpredicted: joints whose models err as much as holding the torque. unit: of the torque.

    Returns:
        The content, and why nothing can be told if that is so.
    """
    changed, apart = compare(then, now, unpredicted)
    lines = [_line(c, unit) for c in changed]
    if apart:
        lines.append(
            f"nothing can be said of a change in {', '.join(apart)}: the model errs as much as holding the torque, and the "
            "trials are too few or of another motion than those of the reference, so that the torque itself cannot be compared"
        )
    same = [joint for joint in unpredicted if joint not in apart and joint not in {c.joint for c in changed}]
    if same:
        lines.append(
            f"{', '.join(same)}: the model errs as much as holding the torque; the mean torque in each direction is as it was"
        )
    content = content | {"warnings": [*lines, *content["warnings"]]}
    if changed:
        rest = {"share_of_gap": 1.0, "above_noise": True, "where": [], "depends_on": []}
        return content | {"verdict": "unknown", "unexplained": rest, "next_experiment": ADVICE}, None
    return content, lines[0] if apart and set(apart) >= set(content["logs"]["joints"]) else None


def _line(found: Changed, unit: str) -> str:
    share = found.now / found.then - 1.0
    return (
        f"{found.joint}: at the same motion the mean torque {found.direction} is {found.now:.3g} {unit}, it was "
        f"{found.then:.3g} ({share:+.0%}); the model errs as much as holding the torque and cannot say why"
    )
