"""What looks wrong in single trials, and how many such findings become one line each.

A check finds something in one file and one joint. Whoever reads the warnings wants to know what is wrong, in how many
trials and in which joints: findings of one kind that say the same are told once.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from hqpipe.logs.columns import joint_column

SHOWN = 6  # names in a list, after which only their number is told
NUMBER = "{}"  # in a text: where the figure of a finding goes


@dataclass(frozen=True)
class Finding:
    """One suspicion about one file.

    Attributes:
        kind: of which check; findings of different kinds are never told together.
        file: in which it was found.
        text: what was found, without file and column; `{}` stands for `size`.
        joint, channel: of the column concerned, which begins the line; None for what concerns the whole file.
        size: the figure that differs from file to file.
    """

    kind: str
    file: str
    text: str
    joint: str | None = None
    channel: str | None = None
    size: float | None = None


def grouped(findings: Iterable[Finding], files: Sequence[str]) -> list[str]:
    """One line for each thing that was found, in the order in which it was found first.

    Args:
        findings: of any checks. files: every file that they could have been found in.
    """
    lines: dict[tuple[str, str | None, str], list[Finding]] = {}
    for finding in findings:
        lines.setdefault((finding.kind, finding.channel, finding.text), []).append(finding)
    return [f"{in_trials([f.file for f in found], files)}: {_line(found)}" for found in lines.values()]


def in_trials(found: Iterable[str], files: Collection[object]) -> str:
    """ "in 10 of 12 trials (a, b and 8 more)", "in every trial", or the file where there is but one.

    Args:
        found: files, in any order and number. files: all of them.
    """
    named = list(dict.fromkeys(found))
    if len(named) == 1:
        return named[0]
    if set(named) >= set(files):
        return "in every trial"
    return f"in {len(named)} of {len(files)} trials ({listed(named, most=3)})"


def listed(names: Iterable[str], most: int = SHOWN, separator: str = ", ") -> str:
    """Names in a message: the first ones, then how many more."""
    names = list(names)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return separator.join(names[:most]) + more


def _line(found: list[Finding]) -> str:
    first = found[0]
    text = first.text.replace(NUMBER, _span([f.size for f in found if f.size is not None]))
    if first.joint is None:
        return text
    joints = list(dict.fromkeys(f.joint for f in found))
    others = f" (and of {listed(joints[1:])})" if len(joints) > 1 else ""
    return f"{joint_column(first.joint, first.channel)}{others} {text}"


def _span(sizes: list[float]) -> str:
    """One figure, or from the least to the greatest."""
    if not sizes:
        return ""
    low, high = (f"{size:.4g}" for size in (min(sizes), max(sizes)))
    return low if low == high else f"{low} … {high}"
