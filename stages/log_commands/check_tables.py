"""The tables of ``hqpipe logs check``, on standard output."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from hqpipe.logs.survey.channel import ChannelVerdict
from hqpipe.logs.survey.clock import TrialVerdict
from hqpipe.logs.survey.layers import Layer
from hqpipe.logs.survey.survey import NOT_DIAGNOSABLE, REFUSED, USABLE, Survey

WIDTH = 120  # columns in a file or in continuous integration
_SHOWN = 4  # names of a group
_ROWS = 24  # of the table of trials; trials that differ in length or rate share a row beyond
_NAME = 18  # characters of a file that are shown beside the channels; longer names are counted


def print_survey(result: Survey) -> None:
    """Print verdict, trials, channels, motion, layers and findings."""
    console = Console(file=sys.stdout, width=None if sys.stdout.isatty() else WIDTH, highlight=False)
    files = list(dict.fromkeys(trial.file for trial in result.trials))
    console.print(Text(_headline(result), style="bold"), soft_wrap=True)
    console.print()
    print_table(console, ("trials", "split", "each", "rate", "clock", "missing", "verdict"), _trial_rows(result.trials))
    print_table(
        console,
        ("channel", "joints", "trials", "range", "step", "noise", "unit", "verdict"),
        _channel_rows(result.channels, files),
    )
    if result.other_columns:
        console.print(Text(f"also recorded: {', '.join(_by_first_word(result.other_columns))}"), "", sep="\n")
    print_table(console, _MOTION, _motion_rows(result))
    print_table(console, ("layer of the diagnosis", "", "why"), (_layer_row(layer) for layer in result.layers))
    for trial in result.trials:
        if trial.error:
            console.print(Text(f"refused: {trial.error}", style="red"), soft_wrap=True)
    for finding in result.findings:
        kind, style = ("note", "") if finding.is_note else ("finding", "yellow")
        console.print(Text(f"{kind}: {finding.line(len(files))}", style=style), soft_wrap=True)


def _headline(result: Survey) -> str:
    count = len(result.defects)
    findings = f"{count} finding{'s' if count > 1 else ''}"
    path, log_set = result.reading.folder, result.reading.log_set
    if result.verdict == REFUSED:
        broken = len(result.reading.errors)
        files = f"; {broken} of {len({t.file for t in result.trials})} files cannot be read" if broken else ""
        return f"{path}: cannot be used as it is{files}"
    words = {USABLE: "usable", NOT_DIAGNOSABLE: "can be read, but not diagnosed"}
    verdict = words.get(result.verdict, f"usable, with {findings}")
    mode = f"{log_set.control_mode} control" if log_set.control_mode else "no command recorded"
    source = f", effort from {log_set.effort_source.replace('_', ' ')}" if log_set.effort_source else ""
    return f"{path}: {verdict}; {_plural(len(log_set.joints), 'joint')}, {mode}{source}"


def _trial_rows(trials: Iterable[TrialVerdict]) -> Iterable[tuple[str, ...]]:
    def row(t: TrialVerdict) -> tuple[str, ...]:
        if t.verdict == "refused":
            return t.split, "", "", "", "", "refused, see below"
        missing = f"{t.missing:.2%}" if t.missing else "none"
        return t.split or "?", f"{t.seconds:.1f} s", f"{t.rate_hz:.4g} Hz", _clock(t), missing, t.verdict

    rows = groups(trials, row)
    if len(rows) <= _ROWS:
        return [(few([t.file for t in members]), *cells) for cells, members in rows]
    kinds = groups(trials, lambda t: (t.split or "?", t.clock, bool(t.missing), t.verdict))
    return [
        (
            few([t.file for t in members]),
            split,
            f"{_span([t.seconds for t in members])} s",
            f"{_span([t.rate_hz for t in members])} Hz",
            clock,
            _span([t.missing for t in members]) if missing else "none",
            verdict,
        )
        for (split, clock, missing, verdict), members in kinds
    ]


def _clock(t: TrialVerdict) -> str:
    if t.clock == "gaps":
        return f"{_plural(t.gaps, 'gap')}, jitter {_percent(t.jitter_rms)}"
    return t.clock if t.clock == "uniform" else f"jitter {_percent(t.jitter_rms)}"


def _percent(share: float) -> str:
    return f"{share:.1%}" if share < 0.1 else f"{share:.0%}"


def _channel_rows(channels: Sequence[ChannelVerdict], files: Sequence[str]) -> Iterable[tuple[str, ...]]:
    """One line per channel and verdict; joints with the same verdicts share it, and what differs is given as a range."""
    joints = list(dict.fromkeys(c.joint for c in channels))
    order = list(dict.fromkeys(c.channel for c in channels))
    ordered = sorted(channels, key=lambda c: order.index(c.channel))
    for (channel, flags), members in groups(ordered, lambda c: (c.channel, c.flags)):
        own = list(dict.fromkeys(c.joint for c in members))
        where = list(dict.fromkeys(c.file for c in members))
        verdict = ", ".join(flags) or "ok"
        held = [c.held_samples for c in members if c.held_samples]
        limits = [abs(c.limit) for c in members if c.limit is not None]
        verdict += f" for {_span(held)} samples" if held else ""
        verdict += f" at ±{_span(limits)}" if limits else ""
        yield (
            channel,
            "all" if len(own) == len(joints) > 1 else few(own, 2),
            _where(where, files),
            f"{min(c.low for c in members):.4g} … {max(c.high for c in members):.4g}",
            _span([c.resolution for c in members]),
            _span([c.noise for c in members]),
            _UNITS.get(members[0].unit, members[0].unit),
            verdict,
        )


_UNITS = {"rad": "rad|m", "rad/s": "rad/s|m/s", "N·m": "N·m|N", "1": ""}
"""What people read for the unit of a channel: the format has metres and newtons for a joint that slides."""

_WHOLE = ("channel", "unit", "verdict", "each", "rate", "clock")  # columns that are not broken

_MOTION = (
    "motion of",
    "travel rad|m",
    "reversals",
    "speed rms rad/s|m/s",
    "95 %",
    "at rest",
    "bandwidth of the command",
)


def _motion_rows(result: Survey) -> Iterable[tuple[str, ...]]:
    for e in result.excitation:
        what = "" if e.command.endswith("command") else " (of the position)"
        yield (
            e.joint,
            f"{e.travel:.3g}",
            str(e.reversals),
            f"{e.speed_rms:.3g}",
            f"{e.speed_95:.3g}",
            f"{e.rest_share:.0%}",
            "–" if e.bandwidth_hz is None else f"{e.bandwidth_hz:.2g} Hz{what}",
        )


def _layer_row(layer: Layer) -> tuple[str, ...]:
    name = f"{layer.layer.replace('_', ' ')}{f', {layer.mode} control' if layer.mode else ''}"
    word = "yes" if layer.evaluated else "possible" if layer.possible else "no"
    why = f"missing {', '.join(layer.missing)}" if layer.missing else layer.note
    return name, word, why


def groups(items: Iterable[Any], key: Callable[[Any], Any]) -> list[tuple[Any, list[Any]]]:
    """Items of the same key together, in the order of the first of each."""
    found: dict[Any, list[Any]] = {}
    for item in items:
        found.setdefault(key(item), []).append(item)
    return list(found.items())


def _span(values: Iterable[float | None]) -> str:
    """The range of those values that are known."""
    known = sorted(value for value in values if value is not None)
    if not known:
        return "–"
    low, high = f"{known[0]:.2g}", f"{known[-1]:.2g}"
    return low if low == high else f"{low} … {high}"


def _by_first_word(names: Sequence[str], most: int = 3) -> list[str]:
    """Column names, those with the same first word as one where they are many."""
    found = []
    for word, members in groups(names, lambda name: name.partition("/")[0]):
        found += members if len(members) <= most else [f"{word}/… ({len(members)} columns)"]
    return found


def few(names: Sequence[str], most: int = _SHOWN) -> str:
    """The first names, then how many more."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _where(files: Sequence[str], known: Sequence[str]) -> str:
    """The trials of a row of channels, as short as can be."""
    if len(files) == len(known):
        return "all"
    return files[0] if len(files) == 1 and len(files[0]) <= _NAME else f"{len(files)} of {len(known)}"


def _plural(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def print_table(
    console: Console, columns: Sequence[str], rows: Iterable[tuple[str, ...]], whole: Collection[str] = _WHOLE
) -> None:
    """Print a table without borders; cells are plain text. whole: columns that are not broken."""
    rows = list(rows)
    if not rows:
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        table.add_column(column, overflow="fold", no_wrap=column in whole)
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    console.print(table, "", sep="\n")
