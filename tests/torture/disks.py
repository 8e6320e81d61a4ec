"""Full and read-only disks, and limits on the size of a file: said in words, nothing lost, and on with space again."""

from __future__ import annotations

import os
import resource
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

from .chain import ARTIFACTS, NAMES, Chain, forget_from, whole
from .processes import Ended, hqpipe
from .tally import Tally
from .toy import make_toy, results, toy

KIND, GC, READ_ONLY = "full disks", "gc on a full disk", "read-only disks"
_ROOMY_KIB = 1 << 17
_ROOM_KIB = (1, 4, 16, 64, 256, 600, 1500)  # left for a stage, whose results have 50 kB to 5 MB
_TOY_ROOM_KIB = (1, 4, 8, 12, 16, 20, 30, 40)  # a page each for a dozen files
_FILE_KIB = (16, 64, 256, 600)  # standard error lies in a file as well and needs some


def can_mount(folder: Path, tally: Tally) -> bool:
    """Whether this user may mount a disk of a given size; the tally says so where not."""
    try:
        with _disk(folder / "probe", 1024):
            return True
    except (subprocess.CalledProcessError, OSError):
        tally.note(
            "mounting is not permitted here: full and read-only disks were skipped, limits of file size were not"
        )
        return False


def fill_under_stage(chain: Chain, stage: str, folder: Path, random: Random, tally: Tally) -> None:
    """Too little room for one real stage, by a full disk or a limit on files, then room for the same command."""
    artifact = ARTIFACTS[NAMES.index(stage)]
    limited = random.random() < 0.3
    with _disk(folder / "project", _ROOMY_KIB) as project:
        chain.copy(project)
        forget_from(project, stage)
        room = random.choice(_FILE_KIB if limited else _ROOM_KIB)
        if limited:
            size = room << 10
            ended = hqpipe(
                project, stage, "--json", prepare=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
            )
        else:
            _resize(project, _used_kib(project) + room)
            ended = hqpipe(project, stage, "--json")
        repeat = f"{stage} with {room} KiB {'a file' if limited else 'left'}"
        tally.count(KIND, stage)
        _judge(ended, KIND, stage, repeat, tally)
        for before in ARTIFACTS[: NAMES.index(stage)]:
            if whole(project, before) != chain.outputs(before):
                tally.problem("loss", KIND, stage, f"{before} is not what it was", repeat)
        _resize(project, _ROOMY_KIB)
        again = hqpipe(project, stage, "--json")
        if again.code != 0:
            tally.problem("blocked", KIND, stage, f"exit {again.code}: {again.err}", repeat)
        elif whole(project, artifact) != chain.outputs(artifact):
            tally.problem("loss", KIND, stage, "other bytes than undisturbed", repeat)


def fill_under_toy(folder: Path, random: Random, tally: Tally) -> None:
    """The same on toy stages, which take a tenth of a second, and with --force over an old result."""
    with _disk(folder / "project", _ROOMY_KIB) as project:
        make_toy(project)
        forced = random.random() < 0.5
        command = ("run", "all", "--json", *(["--force"] if forced else []))
        if forced:
            toy(project, "run", "all")
        before = results(project)
        room = random.choice(_TOY_ROOM_KIB)
        _resize(project, _used_kib(project) + room)
        repeat = f"toy {' '.join(command)} with {room} KiB left"
        tally.count(KIND, "toy stages")
        ended = toy(project, *command)
        _judge(ended, KIND, "toy stages", repeat, tally)
        if forced and results(project) != before:
            tally.problem("loss", KIND, "toy stages", "an old result is not what it was", repeat)
        _resize(project, _ROOMY_KIB)
        again = toy(project, *command)
        if again.code != 0:
            tally.problem("blocked", KIND, "toy stages", f"exit {again.code}: {again.err}", repeat)


def collect_on_full_disk(folder: Path, random: Random, tally: Tally) -> None:
    """`gc` must free space when there is none."""
    with _disk(folder / "project", _ROOMY_KIB) as project:
        make_toy(project)
        for limit in ("20", "30", "40"):
            toy(project, "run", "all", "--set", f"report.limit={limit}")
        toy(project, "run", "all")
        _resize(project, _used_kib(project))
        _fill(project)
        command = random.choice([("gc", "--json"), ("gc", "--all", "--json"), ("gc", "--dry-run", "--json")])
        tally.count(GC, " ".join(command[:-1]))
        ended = toy(project, *command)
        _judge(ended, GC, "gc", " ".join(command), tally)
        if ended.code != 0:
            tally.problem("blocked", GC, "gc", f"exit {ended.code}: {ended.err}", " ".join(command))
        if None in results(project).values():
            tally.problem("loss", GC, "gc", "a current result is gone", " ".join(command))


def look_at_read_only_disk(folder: Path, random: Random, tally: Tally) -> None:
    """What only looks works; what writes says that it cannot."""
    with _disk(folder / "project", _ROOMY_KIB) as project:
        make_toy(project)
        toy(project, "run", "all")
        _mount("-o", "remount,ro", str(project))
        looks = random.random() < 0.5
        if looks:
            command = random.choice(
                [("status",), ("verify",), ("dag",), ("run", "all", "--dry-run"), ("gc", "--dry-run")]
            )
        else:
            command = random.choice(
                [("run", "all", "--force"), ("numbers", "--set", "count=9"), ("gc",), ("run", "all")]
            )
        ended = toy(project, *command, "--json")
        _mount("-o", "remount,rw", str(project))
        tally.count(READ_ONLY, " ".join(command))
        _judge(ended, READ_ONLY, command[0], " ".join(command), tally)
        if looks and ended.code != 0:
            tally.problem("blocked", READ_ONLY, command[0], f"exit {ended.code}: {ended.err}", " ".join(command))


def _judge(ended: Ended, kind: str, where: str, repeat: str, tally: Tally) -> None:
    if ended.code is None:
        tally.problem("hang", kind, where, ended.err, repeat)
    elif ended.code not in (0, 1, 2, 3, 4, 5) or ended.unforeseen:
        tally.problem("traceback", kind, where, f"exit {ended.code}: {ended.err}", repeat)
    elif ended.code:
        tally.message(ended.error, ended.err)
    for process in ended.orphans:
        tally.problem("orphan", kind, where, process, repeat)


@contextmanager
def _disk(folder: Path, kib: int) -> Iterator[Path]:
    """A disk in memory, mounted at `folder`."""
    folder.mkdir()
    _mount("-t", "tmpfs", "-o", f"size={kib}k", "torture", str(folder))
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True, capture_output=True)


def _mount(*arguments: str) -> None:
    subprocess.run(["mount", *arguments], check=True, capture_output=True)


def _resize(folder: Path, kib: int) -> None:
    _mount("-o", f"remount,size={kib}k", str(folder))


def _used_kib(folder: Path) -> int:
    disk = os.statvfs(folder)
    return (disk.f_blocks - disk.f_bfree) * disk.f_frsize >> 10


def _fill(folder: Path) -> None:
    """Leave not one byte."""
    try:
        with (folder / "filler").open("wb", buffering=0) as stream:
            while True:
                stream.write(bytes(4096))
    except OSError:
        pass
