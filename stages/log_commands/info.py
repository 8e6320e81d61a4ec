"""``hqpipe logs info``: what is in a log set, with a sparkline per signal."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from hqpipe.pipeline.answer import answer
from hqpipe.pipeline.options import Folder, json_option, traceback_option, with_options
from hqpipe.stages.log_commands.chosen import chosen_joints, chosen_trials

_WIDTH = 100  # columns, of which every terminal has as many
_SPARK, _RANGE, _JOINT = 15, 12, 12  # characters of a sparkline, of the range beside it, of a joint's name
_SIGNALS = {"position": "position", "command": None, "effort": "effort"}
"""Title → channel; the command is that of the control mode."""


@with_options(json_option(), traceback_option())
@click.command()
@click.argument("folder", metavar="DIR", type=Folder())
@click.option("--joint", "joints", multiple=True, metavar="NAME", help="Show only this joint; repeatable.")
@click.option("--trial", "files", multiple=True, metavar="FILE", help="Show only this trial; repeatable.")
def info(folder: Path, joints: tuple[str, ...], files: tuple[str, ...], as_json: bool) -> None:
    """Show what is in the log set DIR: its header, its trials, and position, command and effort of each joint.

    Position and command of a joint have one scale. Exit 1 when no command can use the set as it is.
    """
    from hqpipe.logs.audit import audit
    from hqpipe.logs.survey.reading import read

    reading = read(folder)
    trials = chosen_trials(folder, reading.trials, files)
    if as_json and reading.log_set is not None:
        answer(**_filtered(audit(reading.log_set), {trial.file for trial in trials}, joints))
    if not as_json:
        print("\n".join(_header(reading)))
        for trial in trials:
            print(
                "\n".join(
                    _trial_lines(trial, chosen_joints(folder, trial.trajectory.joints, joints), reading.control_mode)
                )
            )
    if reading.refused is not None:
        raise reading.refused


def _filtered(summary: dict[str, Any], files: set[str], joints: Sequence[str]) -> dict[str, Any]:
    """The summary of the trials and joints that were asked for."""
    trials = [trial for trial in summary["trials"] if trial["file"] in files]
    ranges = {joint: each for joint, each in summary["ranges"].items() if not joints or joint in joints}
    return summary | {"trials": trials, "ranges": ranges}


def _header(reading: Any) -> list[str]:
    log_set = reading.log_set
    if log_set is None:
        return [f"{reading.folder}: cannot be used as it is; {len(reading.trials)} files that can be read"]
    seconds = {
        split: sum(t.trajectory.duration for t in log_set.trials if t.split == split) for split in ("fit", "heldout")
    }
    fields = {
        "joints": f"{len(log_set.joints)}: {', '.join(log_set.joints)}",
        "channels": ", ".join(log_set.trials[0].trajectory.channels()),
        "velocity": log_set.trials[0].trajectory.velocity_source,
        "control mode": log_set.control_mode or "none: no command recorded",
        "effort source": log_set.effort_source or "not stated",
        "rate": f"{log_set.rate_hz:g} Hz",
        "base": log_set.base or "not stated",
        "robot": log_set.robot or "not stated",
        "trials": f"{len(log_set.trials)}, {seconds['fit']:.1f} s to fit and {seconds['heldout']:.1f} s held out",
        "sha256": log_set.sha256,
    }
    return [str(log_set.path), *(_wrapped(f"{key:<14}{value}") for key, value in fields.items())]


def _wrapped(line: str) -> str:
    import textwrap

    return textwrap.fill(line, _WIDTH, subsequent_indent=" " * 14, break_on_hyphens=False)


def _trial_lines(trial: Any, joints: Sequence[str], mode: str | None) -> list[str]:
    """A heading, and a line per joint with as many sparklines as there are signals."""
    from hqpipe.logs.survey.layers import COMMAND_OF
    from hqpipe.logs.survey.sparkline import levels_for

    t = trial.trajectory
    command = "".join(f" {name}={value:g}" for name, value in (trial.command or {}).items())
    split = f", {trial.split}" if trial.split else ""
    head = f"{trial.file}: {t.whole:.1f} s at {1 / t.dt:.4g} Hz{split}{command}"
    signals = {title: channel or COMMAND_OF.get(mode or "", "") for title, channel in _SIGNALS.items()}
    recorded = {title: values for title, name in signals.items() if (values := getattr(t, name, None)) is not None}
    cell = _SPARK + 1 + _RANGE
    titles = "".join(f" {title:<{cell}}" for title in recorded)
    lines = ["", head[:_WIDTH], f"{'':<{_JOINT}}{titles}".rstrip()]
    levels = levels_for(sys.stdout.encoding)
    for joint in joints:
        j = t.joint(joint)
        cells = _cells({title: values[:, j] for title, values in recorded.items()}, mode, levels)
        lines.append(f"{joint[:_JOINT]:<{_JOINT}}" + "".join(f" {text:<{cell}}" for text in cells))
    return [line.rstrip()[:_WIDTH] for line in lines]


def _cells(signals: dict[str, Any], mode: str | None, levels: str) -> list[str]:
    """Sparkline and range of each signal; position and its command on one scale."""
    from hqpipe.logs.survey.sparkline import sparkline

    own = {title: (float(values.min()), float(values.max())) for title, values in signals.items()}
    scale = dict(own)
    if mode == "position" and "command" in own:
        both = (min(own["position"][0], own["command"][0]), max(own["position"][1], own["command"][1]))
        scale |= {"position": both, "command": both}
    return [
        f"{sparkline(values, *scale[title], _SPARK, levels):<{_SPARK}} {_short_range(*own[title]):<{_RANGE}}"
        for title, values in signals.items()
    ]


def _short_range(low: float, high: float) -> str:
    """One or two numbers, in twelve characters where they are of common size."""
    return _short(low) if low == high else f"{_short(low)}:{_short(high)}"


def _short(value: float) -> str:
    return (
        f"{value:.0f}" if 100.0 <= abs(value) < 1e5 else f"{value + 0.0:.2g}".replace("e+0", "e").replace("e-0", "e-")
    )
