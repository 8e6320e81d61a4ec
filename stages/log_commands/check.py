"""``hqpipe logs check``: what a log set is good for, and what is wrong with it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hqpipe.errors import IdentificationError, LogError
from hqpipe.pipeline.answer import answer
from hqpipe.pipeline.options import Folder, json_option, traceback_option, with_options

if TYPE_CHECKING:
    from hqpipe.logs.trajectory import LogSet


@with_options(json_option(), traceback_option())
@click.command()
@click.argument("folder", metavar="DIR", type=Folder())
@click.option(
    "--effects",
    is_flag=True,
    help="Fit the base model: which effects the logs could show, and which they cannot tell apart.",
)
@click.option("--strict", is_flag=True, help="Exit 1 when anything is found.")
def check(folder: Path, effects: bool, strict: bool, as_json: bool) -> None:
    """Say what the log set DIR is good for, and what is wrong with it; a model is fitted only with --effects.

    One verdict per trial, channel and joint, how each joint was moved, and what can be diagnosed. Exit 1 when no command can
    use the set as it is.
    """
    from hqpipe.logs.survey.reading import read
    from hqpipe.logs.survey.survey import survey
    from hqpipe.stages.log_commands.check_tables import print_survey

    reading = read(folder)
    result = survey(reading, _diagnosis_warnings(reading.log_set) if reading.log_set else ())
    if as_json:
        answer(**result.to_json())
    else:
        print_survey(result)
    if effects:
        _report_effects(reading.log_set, as_json)
    if reading.refused is not None:
        raise reading.refused
    if strict and result.defects:
        raise LogError(
            f"{folder}: {len(result.defects)} finding{'s' if len(result.defects) > 1 else ''}, expected none with --strict",
            file=folder,
            fix="correct the logs, or leave --strict out",
        )


def _report_effects(log_set: LogSet | None, as_json: bool) -> None:
    """Print or answer which effects the logs could show, or why nothing can be said; log_set: None where it is refused."""
    from hqpipe.stages.log_commands.effect_tables import effects_json, print_effects

    found, reason = [], "the log set is refused"
    if log_set is not None:
        from hqpipe.gap.effects_shown import effects_shown

        try:
            found, reason = effects_shown(log_set, len(os.sched_getaffinity(0))), None
        except IdentificationError as error:
            reason = str(error)
    if as_json:
        answer(**effects_json(found, reason))
    else:
        print_effects(found, reason)


def _diagnosis_warnings(log_set: LogSet) -> list[str]:
    """What `hqpipe diagnose` checks in the channels beyond what reading them does."""
    from hqpipe.gap.checks.sanity import too_short
    from hqpipe.gap.checks.sanity_values import value_defects
    from hqpipe.gap.checks.sensing import channel_warnings

    mismatched = [d for d in value_defects(log_set, set()) if d.kind == "velocity_mismatch"]
    found = channel_warnings([trial.trajectory for trial in log_set.trials])
    return [*found, *(defect.message for defect in (*mismatched, *too_short(log_set)))]
