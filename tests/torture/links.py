"""Damage to what holds the store together: links, result folders, the lock and its record."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from random import Random

from .chain import ARTIFACTS, Chain
from .flips import command, verify
from .processes import shows_fault
from .tally import Tally

LINKS, LOCKS = "damaged links and folders", "damaged locks"


def dangling(project: Path, artifact: str, random: Random) -> None:
    _point(project, artifact, f"store/{random.randbytes(32).hex()}")


def outside(project: Path, artifact: str, random: Random) -> None:
    _point(project, artifact, random.choice(["/etc", "../pipeline.yaml", "..", "store", "store/../store"]))


def result_of_another_stage(project: Path, artifact: str, random: Random) -> None:
    other = random.choice([name for name in ARTIFACTS if name != artifact])
    _point(project, artifact, os.readlink(project / "artifacts" / other))


def itself(project: Path, artifact: str, random: Random) -> None:
    _point(project, artifact, artifact)


def copied_folder(project: Path, artifact: str, random: Random) -> None:
    link = project / "artifacts" / artifact
    target = link.resolve()
    link.unlink()
    shutil.copytree(target, link)


def linked_result(project: Path, artifact: str, random: Random) -> None:
    folder = (project / "artifacts" / artifact).resolve()
    folder.rename(project / "elsewhere")
    folder.symlink_to(project / "elsewhere")


def swapped_results(project: Path, artifact: str, random: Random) -> None:
    mine = (project / "artifacts" / artifact).resolve()
    other = (project / "artifacts" / random.choice([name for name in ARTIFACTS if name != artifact])).resolve()
    mine.rename(project / "third")
    other.rename(mine)
    (project / "third").rename(other)


def empty_result(project: Path, artifact: str, random: Random) -> None:
    folder = (project / "artifacts" / artifact).resolve()
    shutil.rmtree(folder)
    folder.mkdir()


def result_as_file(project: Path, artifact: str, random: Random) -> None:
    folder = (project / "artifacts" / artifact).resolve()
    shutil.rmtree(folder)
    folder.write_text("")


DAMAGES: tuple[Callable[[Path, str, Random], None], ...] = (
    dangling, outside, result_of_another_stage, itself, copied_folder, linked_result, swapped_results, empty_result,
    result_as_file,
)  # fmt: skip


def damage_link(chain: Chain, folder: Path, random: Random, tally: Tally) -> None:
    """`verify` must find it, the stage that reads it must refuse, and status must say something in words."""
    project, artifact, how = chain.copy(folder / "project"), random.choice(ARTIFACTS), random.choice(DAMAGES)
    how(project, artifact, random)
    repeat = f"{artifact}: {how.__name__}"
    tally.count(LINKS, how.__name__.replace("_", " "))
    try:
        if not verify(project)[artifact]:
            tally.problem("loss", LINKS, artifact, f"verify finds nothing ({how.__name__})", repeat)
    except Exception as error:
        tally.problem("traceback", LINKS, artifact, f"verify: {type(error).__name__}: {error}", repeat)
    for arguments in (("status", "--json"), ("run", "all", "--json", "--from", "export")):
        code, _, err = command(project, *arguments)
        if code is not None and shows_fault(err):  # None: a stage was started to make it again
            tally.problem("traceback", LINKS, artifact, f"{arguments[0]}: {err}", repeat)


def damage_lock(chain: Chain, folder: Path, random: Random, tally: Tally) -> None:
    """Whatever lies in the lock's place, the next command works or says in words what is in the way."""
    project = chain.copy(folder / "project")
    precious = folder / "precious"
    precious.write_text("precious")
    path = project / "artifacts" / ".lock"
    path.unlink(missing_ok=True)
    how = random.choice(["bytes", "link", "folder", "json", "read-only"])
    if how == "bytes":
        path.write_bytes(random.randbytes(random.randint(0, 300)))
    elif how == "link":
        path.symlink_to(precious)
    elif how == "folder":
        path.mkdir()
    elif how == "json":
        path.write_text(
            random.choice(["[]", "{}", '{"pid": "x", "command": 1}', '{"pid": -1}', '{"pid": 1e400}', "null"])
        )
    else:
        path.write_text("")
        path.chmod(0)
    tally.count(LOCKS, f"{path.name}: {how}")
    repeat = f"{path.name}: {how}"
    code, out, err = command(project, "gc", "--json")
    if shows_fault(err):
        tally.problem("traceback", LOCKS, path.name, err, repeat)
    elif code != 0 and how != "folder" and how != "link":
        tally.problem("blocked", LOCKS, path.name, f"exit {code}: {err}", repeat)
    if precious.read_text() != "precious":
        tally.problem("loss", LOCKS, path.name, "a file that a link points to was overwritten", repeat)


def _point(project: Path, artifact: str, target: str) -> None:
    link = project / "artifacts" / artifact
    link.unlink()
    link.symlink_to(target)
