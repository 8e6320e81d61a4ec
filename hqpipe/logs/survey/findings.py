"""Warnings as findings: those that say the same of several files or joints are one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

_NOTES = ("no logset.yaml:", "no velocity recorded:")
"""Beginnings of warnings of `read_log_set` that say how a sound set was read."""
_NUMBER = re.compile(r"(?<![\w/])[-+−]?\d+(\.\d+)?(e[-+]?\d+)?")
_COLUMN = re.compile(r"joint/([^/]+)/")


@dataclass(frozen=True)
class Finding:
    """Something about a log set that its owner should know.

    Attributes:
        text: one line, as said of the first file and joint. files: where it holds; empty where it concerns the set.
        joints: that it holds of; empty where the text names them, or it concerns no joint.
        is_note: whether it is no defect.
    """

    text: str
    files: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    is_note: bool = False

    def line(self, trials: int) -> str:
        """The text with the files and further joints, for people; `trials` is how many there are."""
        more = [f"also {_few(self.joints[1:])}"] if len(self.joints) > 1 else []
        if self.files and len(self.files) < trials:
            more.append(f"in {_few(self.files)}" if len(self.files) < 3 else f"in {len(self.files)} of {trials} files")
        elif self.files:
            more.append(f"in all {trials} files" if trials > 1 else f"in {self.files[0]}")
        return f"{self.text} ({'; '.join(more)})" if more else self.text


def grouped(warnings: Iterable[str], files: Sequence[str]) -> list[Finding]:
    """Warnings that differ only in file, joint and figures become one finding, which has the words of the first.

    Args:
        warnings: with "<file>: " in front where they concern one file. files: of the log set.
    """
    found: dict[str, list[tuple[str, str | None, str | None]]] = {}
    for warning in warnings:
        file = next((name for name in files if warning.startswith(f"{name}: ")), None)
        text = warning if file is None else warning[len(file) + 2 :]
        column = _COLUMN.search(text)
        key = _NUMBER.sub("#", _COLUMN.sub("joint/*/", text))
        found.setdefault(key, []).append((text, file, column.group(1) if column else None))
    return [_finding(members) for members in found.values()]


def _finding(members: Sequence[tuple[str, str | None, str | None]]) -> Finding:
    text = members[0][0]
    files = tuple(dict.fromkeys(file for _, file, _ in members if file))
    joints = tuple(dict.fromkeys(joint for _, _, joint in members if joint))
    return Finding(text, files, joints, text.startswith(_NOTES))


def _few(names: Sequence[str], most: int = 4) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
