"""Damage to every file of every artifact: found by `verify` or by the stage that reads it, and named; never believed."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

from hqpipe.cli import run_cli
from hqpipe.errors import IntegrityError
from hqpipe.pipeline import audit
from hqpipe.pipeline.project import open_project
from hqpipe.pipeline.stage import Stage
from hqpipe.stages import STAGES

from .chain import ARTIFACTS, Chain
from .processes import hqpipe
from .tally import Tally

KIND = "damaged files"
MANIFEST = "manifest.json"


class Believed(Exception):
    """A stage was started on damaged input."""


def one_bit(path: Path, random: Random, others: list[Path]) -> None:
    data = bytearray(path.read_bytes())
    data[random.randrange(len(data))] ^= 1 << random.randrange(8)
    path.write_bytes(bytes(data))


def some_bytes(path: Path, random: Random, others: list[Path]) -> None:
    data = bytearray(path.read_bytes())
    start = random.randrange(len(data))
    data[start : start + random.randint(1, 64)] = random.randbytes(random.randint(1, 64))
    path.write_bytes(bytes(data))


def cut(path: Path, random: Random, others: list[Path]) -> None:
    os.truncate(path, random.randrange(path.stat().st_size))


def extend(path: Path, random: Random, others: list[Path]) -> None:
    with path.open("ab") as stream:
        stream.write(random.randbytes(random.randint(1, 4096)))


def zeros(path: Path, random: Random, others: list[Path]) -> None:
    path.write_bytes(bytes(path.stat().st_size))


def delete(path: Path, random: Random, others: list[Path]) -> None:
    path.unlink()


def replace_by_another(path: Path, random: Random, others: list[Path]) -> None:
    path.write_bytes(random.choice(others).read_bytes())


def swap(path: Path, random: Random, others: list[Path]) -> None:
    other = random.choice(others)
    mine, theirs = path.read_bytes(), other.read_bytes()
    path.write_bytes(theirs)
    other.write_bytes(mine)


def become_link(path: Path, random: Random, others: list[Path]) -> None:
    target = random.choice(others)
    path.unlink()
    path.symlink_to(target)


def become_folder(path: Path, random: Random, others: list[Path]) -> None:
    path.unlink()
    path.mkdir()


DAMAGES: tuple[Callable[[Path, Random, list[Path]], None], ...] = (
    one_bit, one_bit, one_bit, some_bytes, some_bytes, cut, extend, zeros,
    delete, replace_by_another, swap, become_link, become_folder,
)  # fmt: skip


class Flips:
    """One project that is damaged and put right again, over and over."""

    def __init__(self, chain: Chain, folder: Path) -> None:
        self.chain = chain
        self.project = chain.copy(folder / "flipped")

    def damage(self, random: Random, tally: Tally) -> None:
        """Damage one file of one artifact, look whether that is found, and put it right."""
        artifact = random.choice(ARTIFACTS)
        folder = (self.project / "artifacts" / artifact).resolve()
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        path = folder / MANIFEST if random.random() < 0.15 else random.choice(files)
        others = [other for other in files if other != path] or [self.project / "pipeline.yaml"]
        how = random.choice(DAMAGES)
        with _put_right(folder):
            before = {each: each.read_bytes() for each in files}
            how(path, random, others)
            damaged = [each.relative_to(folder).as_posix() for each in files if not _same(each, before[each])]
            if damaged:
                tally.count(KIND, artifact)
                tally.count("damage by", how.__name__.replace("_", " "))
                self._judge(artifact, damaged, how.__name__, random, tally)

    def _judge(self, artifact: str, damaged: list[str], how: str, random: Random, tally: Tally) -> None:
        repeat = f"{artifact}: {how} of {', '.join(damaged)}"
        try:
            problems = verify(self.project)
        except Exception as error:
            tally.problem("traceback", KIND, artifact, f"verify: {type(error).__name__}: {error}", repeat)
            return
        if not _named(damaged, "".join(problems.get(artifact, []))):
            tally.problem("loss", KIND, artifact, f"verify does not name {damaged}: {problems}", repeat)
        for stage in STAGES.values():
            for needed in stage.inputs:
                read = needed.artifact == artifact and not needed.optional
                if read and (not needed.files or {MANIFEST, *needed.files} & set(damaged)):
                    self._consume(stage, damaged, repeat, tally)
        if random.random() < 0.02:
            ended = hqpipe(self.project, "verify", "--json")
            if ended.code != IntegrityError.exit_code or not _named(damaged, ended.out + ended.err):
                tally.problem("loss", KIND, artifact, f"the command verify exits {ended.code}: {ended.err}", repeat)

    def _consume(self, stage: Stage, damaged: list[str], repeat: str, tally: Tally) -> None:
        """The stage that reads the files must refuse, and name one."""
        code, out, err = command(self.project, stage.name, "--force", "--json")
        if code != IntegrityError.exit_code:
            failure = "loss" if code in (0, None) else "traceback"
            tally.problem(failure, KIND, stage.name, f"exits {code} on damaged input: {err}", repeat)
        elif not _named(damaged, err + out):
            tally.problem("loss", KIND, stage.name, f"does not name {damaged}: {err}", repeat)
        else:
            tally.message(_error(out), err)


def verify(project: Path) -> dict[str, list[str]]:
    """Artifact → what `hqpipe verify` says about it, without a new process."""
    return {
        check.artifact: [str(each) for each in check.problems] for check in audit.verify(open_project(STAGES, project))
    }


def command(project: Path, *arguments: str) -> tuple[int | None, str, str]:
    """Exit code, output and errors of a command in this process; None if it went as far as starting a stage."""

    def refuse(stage: Stage):
        raise Believed(stage.name)

    load, here = Stage.load_run, Path.cwd()
    out, err = io.StringIO(), io.StringIO()
    os.chdir(project)
    Stage.load_run = refuse
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = run_cli(STAGES, arguments)
    finally:
        Stage.load_run = load
        os.chdir(here)
    believed = "Believed" in err.getvalue() + out.getvalue()
    return (None if believed else code), out.getvalue(), err.getvalue()


def _named(damaged: list[str], text: str) -> bool:
    return any(name in text for name in damaged)


def _error(out: str) -> dict | None:
    try:
        return json.loads(out).get("error")
    except ValueError:
        return None


def _same(path: Path, before: bytes) -> bool:
    """Whether nothing that anybody reads has changed: the same bytes, or a record with the same content."""
    if path.is_symlink() or not path.is_file():
        return False
    after = path.read_bytes()
    if path.name != MANIFEST:
        return after == before
    try:
        return json.dumps(json.loads(after)) == json.dumps(json.loads(before))
    except ValueError:
        return False


@contextlib.contextmanager
def _put_right(folder: Path) -> Iterator[None]:
    saved = folder.with_name("saved")
    shutil.copytree(folder, saved, symlinks=True)
    try:
        yield
    finally:
        shutil.rmtree(folder)
        saved.rename(folder)
