"""SIGKILL before every single file operation of whole commands, on toy stages."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random

from .launch.sitecustomize import Operations
from .tally import Tally
from .toy import copy, fork, leftovers, make_toy, results, toy

KIND = "kills at file operations (toy stages)"


@dataclass(frozen=True)
class Situation:
    """A project before the kill, the command that is killed, and what it gives undisturbed.

    Args:
        kept: artifacts that must be as before after the kill, because the command makes the same bytes again.
    """

    name: str
    before: Path
    command: tuple[str, ...]
    operations: int
    after: dict
    kept: dict


_CASES = {
    "first run": ((), ("run", "all")),
    "run --force": ((("run", "all"),), ("run", "all", "--force")),
    "stage --force": ((("run", "all"),), ("square-up", "--force")),
    "last stage --force": ((("run", "all"),), ("report", "--force")),
    "new parameter": ((("run", "all"),), ("report", "--set", "limit=20")),
    "restore": ((("run", "all"), ("report", "--set", "limit=20")), ("report",)),
    "gc": ((("run", "all"), ("report", "--set", "limit=20"), ("report", "--set", "limit=30"), ("report",)), ("gc",)),
}


def situations(folder: Path) -> list[Situation]:
    """Every case, made once."""
    return [_situation(folder / name.replace(" ", "_"), name, *case) for name, case in _CASES.items()]


def _situation(folder: Path, name: str, setup: tuple, command: tuple[str, ...]) -> Situation:
    before = make_toy(folder / "before")
    for arguments in setup:
        assert toy(before, *arguments).code == 0
    undisturbed = copy(before, folder / "after")
    count = folder / "count"
    ended = toy(undisturbed, *command, prepare=lambda: _count(count))
    assert ended.code == 0, ended.err
    kept = {} if not setup or "new" in name or name == "restore" else results(before)
    return Situation(name, before, command, int(count.read_text()), results(undisturbed), kept)


def _count(file: Path) -> None:
    operations = Operations()
    leave: Callable[[int], None] = os._exit

    def write(code: int) -> None:
        file.write_text(str(operations.seen))
        leave(code)

    os._exit = write


def kill_toy(situation: Situation, folder: Path, random: Random, tally: Tally) -> None:
    """Kill before one operation, perhaps the next run too, and let the same command finish."""
    project = copy(situation.before, folder / "project")
    done = []
    for _ in range(random.randint(1, 2)):
        at = random.randint(1, situation.operations)
        ended = fork(project, situation.command, lambda at=at: Operations(at)).wait()
        if ended.code == 0:
            break
        done.append(at)
        tally.count(KIND, situation.name)
        _judge(situation, project, ended, f"{' '.join(situation.command)} killed at {done}", tally)
    ended = toy(project, *situation.command, "--json")
    repeat = f"{' '.join(situation.command)} killed at {done}"
    if ended.code != 0:
        tally.problem("blocked", KIND, situation.name, f"exit {ended.code}: {ended.err}", repeat)
    elif results(project) != situation.after:
        tally.problem("loss", KIND, situation.name, "other bytes than undisturbed", repeat)
    elif left := leftovers(project):
        tally.problem("leftover", KIND, situation.name, f"{[path.name for path in left]}", repeat)


def _judge(situation: Situation, project: Path, ended, repeat: str, tally: Tally) -> None:
    if ended.code != -9:
        failure = "hang" if ended.code is None else "traceback"
        tally.problem(failure, KIND, situation.name, f"exit {ended.code}: {ended.err}", repeat)
    now = results(project)
    for artifact, expected in situation.kept.items():
        if now[artifact] != expected:
            tally.problem("loss", KIND, situation.name, f"{artifact} is not what it was before the kill", repeat)
    check = toy(project, "verify", "--json")
    if check.code != 0:
        tally.problem("loss", KIND, situation.name, f"verify exits {check.code}: {check.err}", repeat)
