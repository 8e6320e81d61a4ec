"""Kills of the seven real stages: at random moments and at file operations, by SIGKILL and by what can be caught."""

from __future__ import annotations

import signal
import time
from contextlib import suppress
from pathlib import Path
from random import Random

from .chain import ARTIFACTS, NAMES, Chain, forget_from, whole
from .flips import verify
from .processes import Ended, Run, hqpipe, kill_at
from .tally import Tally

CAUGHT = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
_MOST_KILLS = 12  # of one run, before it may finish
# Trainings come twice: most of what can be lost is theirs.
TURNS = ("retrain", "export", "bootstrap", "collect", "validate", "fit-actuator", "retrain", "diagnose", "bootstrap")


def kill_stage(chain: Chain, stage: str, folder: Path, random: Random, tally: Tally) -> None:
    """Kill one stage a few times, then let the same command finish.

    Half of the trials make the stage's result for the first time, half make it again with ``--force``.
    """
    project = chain.copy(folder / "project")
    forced = random.random() < 0.5
    if not forced:
        forget_from(project, stage)
    command = [stage, "--json", *(["--force"] if forced else [])]
    intact = ARTIFACTS if forced else ARTIFACTS[: NAMES.index(stage)]
    done: list[str] = []
    for _ in range(random.randint(1, _MOST_KILLS)):
        how, ended = _kill(chain, project, command, stage, random)
        if ended.code == 0:
            break  # it was faster than the kill
        done.append(how)
        tally.count("kills of real stages", stage)
        tally.count("kills by", how.split()[0])
        _judge(ended, project, intact, chain, stage, f"{' '.join(command)}: {', '.join(done)}", tally)
    if done:
        _finish(chain, project, command, stage, f"{' '.join(command)}: {', '.join(done)}", tally)


def _kill(chain: Chain, project: Path, command: list[str], stage: str, random: Random) -> tuple[str, Ended]:
    """Start, kill, and say how."""
    if random.random() < 0.5:
        operation = random.randint(1, chain.operations[stage])
        return f"SIGKILL at file operation {operation}", Run(project, command, environment=kill_at(operation)).wait()
    moment = random.uniform(0.3, 1.1 * chain.seconds[stage])
    number = signal.SIGKILL if random.random() < 0.6 else random.choice(CAUGHT)
    group = number != signal.SIGKILL and random.random() < 0.5
    run = Run(project, command)
    if number != signal.SIGKILL:
        _await_work(run, project)
    deadline = time.monotonic() + moment
    while time.monotonic() < deadline and run.process.poll() is None:
        time.sleep(0.02)
    run.signal(number, group)
    who = " to the group" if group else ""
    return f"{signal.Signals(number).name}{who} after {moment:.2f} s", run.wait(limit=60.0)


def _await_work(run: Run, project: Path) -> None:
    """Wait until the command holds the lock: while Python itself starts, no program can answer a signal in words."""
    while run.process.poll() is None:
        for record in (project / "artifacts").glob(".lock*"):
            with suppress(FileNotFoundError):  # it has just been removed
                if str(run.process.pid) in record.read_text(errors="replace"):
                    return
        time.sleep(0.02)


def _judge(
    ended: Ended, project: Path, intact: tuple[str, ...], chain: Chain, stage: str, repeat: str, tally: Tally
) -> None:
    """What must hold right after a kill."""
    kind = "kills of real stages"
    for process in ended.orphans:
        tally.problem("orphan", kind, stage, process, repeat)
    if ended.code is None:
        tally.problem("hang", kind, stage, "it went on for 60 s after the signal", repeat)
    if ended.unforeseen:
        tally.problem("traceback", kind, stage, ended.err, repeat)
    for artifact in intact:
        if whole(project, artifact) != chain.outputs(artifact):
            tally.problem("loss", kind, stage, f"{artifact} is not what it was before the kill", repeat)
    if found := {name: each for name, each in verify(project).items() if each}:
        tally.problem("loss", kind, stage, f"verify after the kill: {found}", repeat)


def _finish(chain: Chain, project: Path, command: list[str], stage: str, repeat: str, tally: Tally) -> None:
    """The same command must finish, with the bytes of an undisturbed run and nothing left over."""
    kind, artifact = "kills of real stages", ARTIFACTS[NAMES.index(stage)]
    started = time.monotonic()
    ended = hqpipe(project, *command)
    # How long a stage takes hangs on what else the machine does; kills are to fall into the middle of it.
    chain.seconds[stage] = 0.5 * (chain.seconds[stage] + time.monotonic() - started)
    if ended.code != 0:
        tally.problem("blocked", kind, stage, f"exit {ended.code}: {ended.err}", repeat)
        return
    found, expected = whole(project, artifact), chain.outputs(artifact)
    if found != expected:
        differ = sorted(name for name in expected if (found or {}).get(name) != expected[name])
        tally.problem("loss", kind, stage, f"other bytes than undisturbed in {', '.join(differ)}", repeat)
    check = hqpipe(project, "verify", "--json")
    if check.code != 0:
        tally.problem("loss", kind, stage, f"verify exits {check.code} in the end: {check.err}", repeat)
    if left := list((project / "artifacts").glob("**/.tmp-*")):
        tally.problem("leftover", kind, stage, f"{[path.name for path in left]}", repeat)
