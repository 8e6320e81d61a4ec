"""What was tried, what went wrong, and which messages lacked a file or a remedy."""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

FAILURES = {
    "loss": "a result lost, a half result taken for whole, damage believed, or other bytes than undisturbed",
    "blocked": "the same command does not finish after the fault has gone",
    "leftover": "something half-written still there after the same command finished",
    "orphan": "a process of the run still there 3 s after its end",
    "hang": "no end within the limit",
    "traceback": "an exception that is no HqpipeError, a Python traceback, or a death that nobody ordered",
}
LONGEST = 400  # characters of a message that are kept


_PLACES = re.compile(r"/\S*/torture-[^/\s]+/|[0-9a-f]{64}|\b[0-9a-f]{12}…")


def _general(text: str) -> str:
    """A message without the folders and hashes of this trial, so that the same ones are counted together."""
    return _PLACES.sub("…", " ".join(text.split()))[:LONGEST]


def _kind_of(problem: dict[str, Any]) -> str:
    """What problems with the same cause have in common: no numbers, and only the beginning."""
    detail = re.sub(r"\d+", "#", _general(problem["detail"]))
    place = detail.rpartition(" (")[2] if problem["kind"] == "odd files" else ""
    return f"{problem['failure']}: {problem['kind']}, {problem['where']}: {detail[:150]} {place[:80]}"


@dataclass
class Tally:
    """Counts of one run, or of several added up.

    Args:
        seeds: of the runs.
        counts: kind of trial → stage or file → how many.
        seconds: part → time spent in it.
        problems: one record per failure, with what repeats it.
        told: how many messages were looked at. unhelpful: message without file or fix → how often.
    """

    seeds: list[int] = field(default_factory=list)
    counts: dict[str, Counter] = field(default_factory=dict)
    seconds: Counter = field(default_factory=Counter)
    problems: list[dict[str, Any]] = field(default_factory=list)
    told: int = 0
    unhelpful: Counter = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    def count(self, kind: str, where: str) -> None:
        self.counts.setdefault(kind, Counter())[where] += 1

    def problem(self, failure: str, kind: str, where: str, detail: str, repeat: Any = None) -> None:
        """Record a failure; `repeat` is whatever makes the trial again."""
        assert failure in FAILURES
        record = {"failure": failure, "kind": kind, "where": where, "detail": detail[-4 * LONGEST :], "repeat": repeat}
        self.problems.append(record)

    def message(self, error: dict[str, Any] | None, text: str, place: str = "file") -> None:
        """Look at one error as scripts get it (`HqpipeError.to_json`, or None where they get nothing).

        Args:
            place: what it must name beside the fix: "file", or "field" of what is typed and stands in no file.
        """
        self.told += 1
        if lacks := [name for name in (place, "fix") if not (error or {}).get(name)]:
            self.unhelpful[f"no {' and no '.join(lacks)}: {_general(text)}"] += 1

    def note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)

    def add(self, other: Tally) -> None:
        self.seeds += other.seeds
        for kind, counter in other.counts.items():
            self.counts.setdefault(kind, Counter()).update(counter)
        self.seconds.update(other.seconds)
        self.problems += other.problems
        self.told += other.told
        self.unhelpful.update(other.unhelpful)
        for text in other.notes:
            self.note(text)

    @property
    def failures(self) -> Counter:
        return Counter({name: 0 for name in FAILURES}) + Counter(p["failure"] for p in self.problems)

    def save(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        data = {
            "seeds": self.seeds,
            "counts": self.counts,
            "seconds": {part: round(value, 1) for part, value in self.seconds.items()},
            "failures": {name: self.failures[name] for name in FAILURES},
            "problems": self.problems,
            "messages": {"told": self.told, "unhelpful": dict(self.unhelpful.most_common())},
            "notes": self.notes,
        }
        path.write_text(json.dumps(data, indent=1, ensure_ascii=True) + "\n")

    @classmethod
    def load(cls, path: Path) -> Tally:
        data = json.loads(path.read_text())
        return cls(
            seeds=data["seeds"],
            counts={kind: Counter(counter) for kind, counter in data["counts"].items()},
            seconds=Counter(data["seconds"]),
            problems=data["problems"],
            told=data["messages"]["told"],
            unhelpful=Counter(data["messages"]["unhelpful"]),
            notes=data["notes"],
        )

    def table(self) -> str:
        """The tally as Markdown."""
        seeds = ", ".join(str(seed) for seed in sorted(set(self.seeds)))
        lines = [f"Seeds {seeds}.", "", "| tried | how often | where |", "|---|---|---|"]
        for kind, counter in sorted(self.counts.items()):
            where = ", ".join(f"{name} {number:,}" for name, number in sorted(counter.items()))
            lines.append(f"| {kind} | {counter.total():,} | {where} |")
        lines += ["", "| failure | how often | meaning |", "|---|---|---|"]
        lines += [f"| {name} | {self.failures[name]} | {meaning} |" for name, meaning in FAILURES.items()]
        lacking = self.unhelpful.total()
        share = 100.0 * lacking / max(1, self.told)
        lines += ["", f"{self.told:,} messages, {lacking:,} ({share:.2f} %) without file or fix."]
        lines += [f"- {number} × {text}" for text, number in self.unhelpful.most_common(25)]
        return "\n".join([*lines, *(f"\nNote: {text}" for text in self.notes)])

    def listing(self, most: int = 30) -> str:
        """The failures, one a line."""
        groups = Counter(_kind_of(problem) for problem in self.problems)
        return "\n".join(f"{number} × {text}" for text, number in groups.most_common(most))
