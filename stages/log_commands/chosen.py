"""The joints and trials that options of the commands name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hqpipe.errors import UsageError, near_match


def chosen_trials(folder: Path, trials: Sequence[Any], names: Sequence[str]) -> list[Any]:
    """The trials with these file names, with or without their endings; all of them if none is named.

    Raises:
        UsageError: there is no such trial.
    """
    known = {trial.file for trial in trials}
    for name in names:
        if not any(_is(file, name) for file in known):
            raise UsageError(
                f"{folder} has no trial '{name[:80]}'{near_match(name[:80], known)}",
                file=folder,
                field="--trial",
                fix="`hqpipe logs info DIR` lists them",
            )
    return [trial for trial in trials if not names or any(_is(trial.file, name) for name in names)]


def chosen_joints(folder: Path, joints: Sequence[str], names: Sequence[str]) -> list[str]:
    """These joints in the order of the log set; all of them if none is named.

    Raises:
        UsageError: there is no such joint.
    """
    for name in names:
        if name not in joints:
            raise UsageError(
                f"{folder} has no joint '{name[:80]}'{near_match(name[:80], joints)} (has {', '.join(joints)})",
                file=folder,
                field="--joint",
                fix="name one of these joints",
            )
    return [joint for joint in joints if not names or joint in names]


def _is(file: str, name: str) -> bool:
    return name in (file, str(Path(file).with_suffix("")))
