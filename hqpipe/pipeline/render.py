"""Tables for people. Imports rich, so only commands that print a table import this."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from hqpipe.pipeline.audit import CURRENT, Check, Status
from hqpipe.pipeline.doctor import Finding
from hqpipe.pipeline.executor import DONE, Outcome
from hqpipe.pipeline.hashing import SHORT
from hqpipe.pipeline.plan import Decision

# Wide enough for a reason beside a headline where there is no terminal to ask.
PLAIN_WIDTH = 140


def _print(columns: Iterable[str], rows: Iterable[Iterable[str]], file: TextIO) -> None:
    """Print a table without borders; cells are plain text."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    Console(file=file, width=None if file.isatty() else PLAIN_WIDTH, highlight=False).print(table)


def print_plan(decisions: list[Decision]) -> None:
    """What would be done, on standard output."""
    _print(("stage", "would", "why"), ((d.stage.name, d.action, d.why) for d in decisions), sys.stdout)


def print_outcomes(outcomes: list[Outcome]) -> None:
    """What was done, on standard error."""
    rows = (
        (o.decision.stage.name, DONE[o.decision.action], o.decision.why, f"{o.wall_time_s:.1f} s", o.headline)
        for o in outcomes
    )
    _print(("stage", "", "why", "time", "result"), rows, sys.stderr)


def print_status(statuses: list[Status]) -> None:
    """The artifacts against the configuration, on standard output."""
    _print(("artifact", "state", "key", "profile", "made", "why"), map(_status_row, statuses), sys.stdout)


def _status_row(status: Status) -> tuple[str, ...]:
    made = status.manifest
    artifact = status.decision.stage.artifact
    why = "" if status.state == CURRENT else status.decision.why
    if made is None:
        return artifact, status.state, "", "", "", why
    gate = "; ".join(f"gate missed: {failure}" for failure in made.gate_failures)
    note = "; ".join(part for part in (why, gate) if part)
    created = made.provenance["created"].replace("T", " ")[:16]
    return artifact, status.state, made.key[:SHORT], status.profile or "", created, note


def print_checks(checks: list[Check]) -> None:
    """What `verify` found, on standard output."""
    rows = (
        (
            check.artifact,
            "FAILED" if check.problems else "ok" if check.files else "–",
            str(check.files),
            "; ".join(map(str, (*check.problems, *check.notes))),
        )
        for check in checks
    )
    _print(("artifact", "", "files", ""), rows, sys.stdout)


def print_findings(findings: list[Finding]) -> None:
    """What `doctor` found, on standard output."""
    _print(("check", "", ""), ((f.name, "ok" if f.ok else "FAILED", f.detail) for f in findings), sys.stdout)


def print_explanations(statuses: list[Status]) -> None:
    """Every reason of every artifact that is not current, one a line, on standard output."""
    for status in statuses:
        if status.state != CURRENT:
            print(f"{status.decision.stage.artifact}: {status.state}")
            for reason in status.decision.reasons:
                print(f"  {reason.text}")
