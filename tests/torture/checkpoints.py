"""Damage to the checkpoint of a killed training: it must not keep the training from finishing with the same bytes."""

from __future__ import annotations

import shutil
from pathlib import Path
from random import Random

from .chain import ARTIFACTS, NAMES, Chain, forget_from, whole
from .flips import DAMAGES
from .processes import Run, hqpipe, kill_at
from .tally import Tally

KIND = "damaged checkpoints"
_MOST_TRIES = 8


def damage_checkpoint(chain: Chain, stage: str, folder: Path, random: Random, tally: Tally) -> None:
    """Kill a training after its first checkpoint, damage one file of it, run the same command."""
    project = chain.copy(folder / "project")
    forget_from(project, stage)
    files = _interrupted(chain, project, stage, random)
    if not files:
        tally.note(f"no kill of {stage} left a checkpoint in {_MOST_TRIES} tries")
        return
    path, how = random.choice(files), random.choice(DAMAGES)
    others = [other for other in files if other != path] or [project / "pipeline.yaml"]
    how(path, random, others)
    tally.count(KIND, stage)
    repeat = f"{stage}: {path.name}: {how.__name__}"
    ended = hqpipe(project, stage, "--json")
    if ended.unforeseen:
        tally.problem("traceback", KIND, stage, ended.err, repeat)
    if ended.code != 0:
        tally.problem("blocked", KIND, stage, f"exit {ended.code}: {ended.err}", repeat)
    elif whole(project, artifact := ARTIFACTS[NAMES.index(stage)]) != chain.outputs(artifact):
        tally.problem("loss", KIND, stage, "other bytes than undisturbed", repeat)


def _interrupted(chain: Chain, project: Path, stage: str, random: Random) -> list[Path]:
    """Files of the checkpoint that a kill left."""
    for _ in range(_MOST_TRIES):
        at = random.randint(chain.operations[stage] // 4, chain.operations[stage])
        ended = Run(project, [stage], environment=kill_at(at)).wait()
        files = sorted(path for path in (project / "artifacts" / "scratch").rglob("*") if path.is_file())
        if ended.code == 0:
            shutil.rmtree(project)
            chain.copy(project)
            forget_from(project, stage)
        elif files:
            return files
    return []
