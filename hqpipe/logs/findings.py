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


@dataclass(frozen=True)
class Group:
    """Findings that say the same of several files or joints: of each of the joints in each of the files.

    Attributes:
        members: in the order in which they were found.
    """

    members: tuple[Finding, ...]

    @property
    def files(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(finding.file for finding in self.members))

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(finding.joint for finding in self.members if finding.joint is not None))

    @property
    def of_first(self) -> str:
        """What was found in the first joint, with figures from the least to the greatest of all."""
        return self._told("")

    @property
    def text(self) -> str:
        """The same, with the other joints named."""
        return self._told(f" (and of {listed(self.joints[1:])})" if len(self.joints) > 1 else "")

    def _told(self, others: str) -> str:
        first = self.members[0]
        text = first.text.replace(NUMBER, _span([f.size for f in self.members if f.size is not None]))
        return text if first.joint is None else f"{joint_column(first.joint, first.channel)}{others} {text}"


def groups_of(findings: Iterable[Finding]) -> list[Group]:
    """What was found, each thing once, in the order in which it was found first; joints of other files by themselves."""
    found: dict[tuple[str, str | None, str], dict[str | None, list[Finding]]] = {}
    for finding in findings:
        of_joint = found.setdefault((finding.kind, finding.channel, finding.text), {})
        of_joint.setdefault(finding.joint, []).append(finding)
    groups = []
    for of_joint in found.values():
        by_files: dict[frozenset[str], list[Finding]] = {}
        for members in of_joint.values():
            by_files.setdefault(frozenset(finding.file for finding in members), []).extend(members)
        groups += [Group(tuple(members)) for members in by_files.values()]
    return groups


def grouped(findings: Iterable[Finding], files: Sequence[str]) -> list[str]:
    """A line for each group, with the trials in which it was found.

    Args:
        findings: of any checks. files: every file that they could have been found in.
    """
    return [f"{in_trials(group.files, files)}: {group.text}" for group in groups_of(findings)]


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


def _span(sizes: list[float]) -> str:
    """One figure, or from the least to the greatest."""
    if not sizes:
        return ""
    low, high = (f"{size:.4g}" for size in (min(sizes), max(sizes)))
    return low if low == high else f"{low} … {high}"
