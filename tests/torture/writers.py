"""Two writers at a time, and readers beside a writer and `gc`, on toy stages."""

from __future__ import annotations

import time
from pathlib import Path
from random import Random

from .processes import Ended
from .tally import Tally
from .toy import fork, make_toy, results, toy

WRITERS, READERS = "second writers", "readers beside writers and gc"
_LOCKED = 5
_STEPS = 40  # of 50 ms: the first writer is at work for two seconds


def write_twice(folder: Path, random: Random, tally: Tally) -> None:
    """While one command writes, another is refused with exit 5 and the first one's number; then it works."""
    project = make_toy(folder / "project")
    toy(project, "run", "all")
    first = ("run", "all", "--set", f"square_up.steps={_STEPS}", "--set", "square_up.offset=1")
    others = [("run", "all"), ("numbers", "--force"), ("report", "--force"), ("gc",), ("gc", "--all"), first]
    second = (*random.choice(others), "--json")
    running = fork(project, (*first, "--json"))
    deadline = time.monotonic() + 20.0
    while not list((project / "artifacts").glob("store/.tmp-*/half.txt")) and time.monotonic() < deadline:
        time.sleep(0.01)
    refused = toy(project, *second)
    ended = running.wait()
    repeat = f"{' '.join(second)} beside {' '.join(first)}"
    tally.count(WRITERS, second[0])
    _judge(refused, WRITERS, second[0], repeat, tally)
    if refused.code != _LOCKED or f"process {running.pid}" not in refused.err:
        tally.problem("loss", WRITERS, second[0], f"not refused: exit {refused.code}: {refused.err}", repeat)
    if ended.code != 0:
        tally.problem("loss", WRITERS, second[0], f"the first writer: exit {ended.code}: {ended.err}", repeat)
    after = toy(project, *second)
    if after.code != 0:
        tally.problem("blocked", WRITERS, second[0], f"exit {after.code}: {after.err}", repeat)


def read_beside(folder: Path, random: Random, tally: Tally) -> None:
    """Readers see whole results at every moment in which a writer replaces, restores and removes them."""
    project = make_toy(folder / "project")
    toy(project, "run", "all")
    expected = results(project)
    writes = [
        ("report", "--set", f"limit={random.randint(100, 999)}"),
        ("gc",),
        ("run", "all"),
        ("run", "all", "--force"),
    ]
    for arguments in random.sample(writes, len(writes)):
        running = fork(project, arguments)
        reads = ("verify", "--json"), ("status", "--json"), ("diff", "numbers", "squares", "--json")
        for _ in range(3):
            reading = random.choice(reads)
            ended = toy(project, *reading)
            repeat = f"{' '.join(reading)} beside {' '.join(arguments)}"
            tally.count(READERS, reading[0])
            _judge(ended, READERS, reading[0], repeat, tally)
            # A report with another limit is stale to status, and nothing else is.
            if ended.code != 0 and not (reading[0] == "status" and ended.code == 3 and "damaged" not in ended.out):
                tally.problem("loss", READERS, reading[0], f"exit {ended.code}: {ended.err}", repeat)
        ended = running.wait()
        if ended.code != 0:
            tally.problem("loss", READERS, arguments[0], f"the writer: exit {ended.code}: {ended.err}", repeat)
    if toy(project, "run", "all").code != 0 or results(project) != expected:
        tally.problem("loss", READERS, "run all", "other bytes than before", "run all in the end")


def _judge(ended: Ended, kind: str, where: str, repeat: str, tally: Tally) -> None:
    if ended.code is None:
        tally.problem("hang", kind, where, ended.err, repeat)
    elif ended.unforeseen:
        tally.problem("traceback", kind, where, f"exit {ended.code}: {ended.err}", repeat)
    elif ended.told and kind == WRITERS:
        tally.message(ended.error, ended.err)
