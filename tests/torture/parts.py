"""The parts of the torture: what each does in trial number n, and its share of the time."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import Random

from .chain import CACHE, NAMES, small_chain
from .tally import Tally

INPUTS = CACHE / "inputs"
Trial = Callable[[int, Path, Random], None]
"""Called with the trial's number, an empty folder and its random numbers."""


@dataclass(frozen=True)
class Part:
    """One kind of torture.

    Args:
        share: of the time of all processes.
        prepare: makes what its trials share in a folder, and gives the trial.
    """

    share: float
    prepare: Callable[[Path, Tally], Trial]


def _kills(folder: Path, tally: Tally) -> Trial:
    from .kills import TURNS, kill_stage

    chain = small_chain()
    return lambda n, place, random: kill_stage(chain, random.choice(TURNS), place, random, tally)


def _toy_kills(folder: Path, tally: Tally) -> Trial:
    from .toy_kills import kill_toy, situations

    known = situations(folder)
    return lambda n, place, random: kill_toy(known[n % len(known)], place, random, tally)


def _checkpoints(folder: Path, tally: Tally) -> Trial:
    from .checkpoints import damage_checkpoint

    chain = small_chain()
    stages = ("retrain", "retrain", "bootstrap")
    return lambda n, place, random: damage_checkpoint(chain, stages[n % len(stages)], place, random, tally)


def _flips(folder: Path, tally: Tally) -> Trial:
    from .flips import Flips
    from .links import damage_link, damage_lock

    chain = small_chain()
    flips = Flips(chain, folder)

    def trial(n: int, place: Path, random: Random) -> None:
        for _ in range(10):
            flips.damage(random, tally)
        (damage_lock if n % 3 == 2 else damage_link)(chain, place, random, tally)

    return trial


def _disks(folder: Path, tally: Tally) -> Trial:
    from . import disks

    chain = small_chain()
    if not disks.can_mount(folder, tally):
        return lambda n, place, random: None
    stages = ("export", "validate", *NAMES)

    def trial(n: int, place: Path, random: Random) -> None:
        if n % 6 == 5:
            disks.fill_under_stage(chain, random.choice(stages), place, random, tally)
        elif n % 3 == 0:
            disks.collect_on_full_disk(place, random, tally)
        elif n % 3 == 1:
            disks.look_at_read_only_disk(place, random, tally)
        else:
            disks.fill_under_toy(place, random, tally)

    return trial


def _memory(folder: Path, tally: Tally) -> Trial:
    from .memory import starve_stage

    chain = small_chain()
    return lambda n, place, random: starve_stage(chain, random.choice(NAMES), place, random, tally)


def _writers(folder: Path, tally: Tally) -> Trial:
    from .writers import read_beside, write_twice

    return lambda n, place, random: (write_twice if n % 3 == 0 else read_beside)(place, random, tally)


def _fuzz(folder: Path, tally: Tally) -> Trial:
    from .fuzz import fuzz

    known = targets(folder)
    for target in known:  # what is loaded and compiled once is in the workers too
        valid = Path(shutil.copytree(target.base, folder / "valid"))
        target.read(valid)
        shutil.rmtree(valid)
    return lambda n, place, random: fuzz(
        known[n % len(known)], random.getrandbits(32), place / "case", tally, INPUTS, cases=25
    )


def targets(folder: Path) -> list:
    """Everything that is fuzzed; log sets twice, because most files from outside are theirs."""
    from .fuzz_arrays import array_targets
    from .fuzz_documents import document_targets
    from .fuzz_logs import log_targets

    chain = small_chain()
    logs = log_targets(chain, folder / "logs")
    return [*logs, *document_targets(chain, folder / "documents"), *array_targets(chain, folder / "arrays"), *logs]


PARTS = {
    "kills": Part(0.44, _kills),
    "toy_kills": Part(0.08, _toy_kills),
    "checkpoints": Part(0.08, _checkpoints),
    "flips": Part(0.10, _flips),
    "disks": Part(0.10, _disks),
    "memory": Part(0.08, _memory),
    "writers": Part(0.02, _writers),
    "fuzz": Part(0.10, _fuzz),
}


@contextmanager
def workplace():
    """An empty folder, in memory where there is room: the torture writes some 100 MB a minute."""
    memory = Path("/dev/shm")
    roomy = memory.is_dir() and shutil.disk_usage(memory).free > 2 << 30
    folder = Path(tempfile.mkdtemp(prefix="torture-", dir=memory if roomy else None))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def run_part(name: str, seed: int, tally: Tally, go_on: Callable[[int], bool], first: int = 0) -> None:
    """Trials of one part from number `first` on, as long as ``go_on(number of trials done)``."""
    with workplace() as folder:
        (folder / "shared").mkdir()
        trial = PARTS[name].prepare(folder / "shared", tally)
        number = first
        while go_on(number - first):
            place = folder / "trial"
            place.mkdir()
            try:
                trial(number, place, Random(f"{seed}/{name}/{number}"))
            except Exception as error:
                raise RuntimeError(f"seed {seed}, part {name}, trial {number}") from error
            shutil.rmtree(place, ignore_errors=True)
            number += 1
