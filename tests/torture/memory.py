"""Limits of memory: a line and an exit code or a death, but no hang, no half result, and on with memory again."""

from __future__ import annotations

import resource
from pathlib import Path
from random import Random

from .chain import ARTIFACTS, NAMES, Chain, forget_from, whole
from .processes import hqpipe
from .tally import Tally

KIND = "limits of memory"
_LIMIT_S = 120.0  # the longest stage takes 30 s on an idle machine
_MIB = (300, 500, 700, 900, 1200, 1600, 2000, 2500, 3000, 4000)  # of address space; torch alone maps over 1 GiB


def starve_stage(chain: Chain, stage: str, folder: Path, random: Random, tally: Tally) -> None:
    """Run one stage in too little address space, then in enough.

    Libraries in C may abort where memory ends; that is counted, and it must cost nothing but the run.
    """
    project = chain.copy(folder / "project")
    forget_from(project, stage)
    size = random.choice(_MIB) << 20
    ended = hqpipe(
        project,
        stage,
        "--json",
        limit=_LIMIT_S,
        prepare=lambda: resource.setrlimit(resource.RLIMIT_AS, (size, size)),
    )
    repeat = f"{stage} in {size >> 20} MiB"
    tally.count(KIND, stage)
    ends = "in words" if ended.told else "finished" if ended.code == 0 else "killed by a library"
    tally.count("ends under a limit of memory", ends if ended.code is not None else "hung")
    if ended.code is None:
        tally.problem("hang", KIND, stage, ended.err, repeat)
    if ended.unforeseen:
        tally.problem("traceback", KIND, stage, f"exit {ended.code}: {ended.err}", repeat)
    elif ended.told:
        tally.message(ended.error, ended.err)
    for process in ended.orphans:
        tally.problem("orphan", KIND, stage, process, repeat)
    for before in ARTIFACTS[: NAMES.index(stage)]:
        if whole(project, before) != chain.outputs(before):
            tally.problem("loss", KIND, stage, f"{before} is not what it was", repeat)
    again = hqpipe(project, stage, "--json")
    artifact = ARTIFACTS[NAMES.index(stage)]
    if again.code != 0:
        tally.problem("blocked", KIND, stage, f"exit {again.code}: {again.err}", repeat)
    elif whole(project, artifact) != chain.outputs(artifact):
        tally.problem("loss", KIND, stage, "other bytes than undisturbed", repeat)
