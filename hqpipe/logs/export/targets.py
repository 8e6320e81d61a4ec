"""Where exported files go: inside the target, whole or not at all, and never in place of others unasked."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path, PurePosixPath

from hqpipe.errors import UsageError
from hqpipe.logs.export import EXPORTERS
from hqpipe.system.durable import new_folder, remove, sync, sync_tree

Write = Callable[[Path, int], None]
"""Writes the trial of this index to a path."""


def targets(out: Path, files: Sequence[str], ending: str) -> list[Path]:
    """The file of each trial.

    Args:
        out: a folder, or a file that has the ending, for a lone trial. files: of the trials.
        ending: of the format, with its dot.

    Raises:
        UsageError: several trials are to go into one file, or the file has the ending of another format.
    """
    other = next((f".{kind}" for kind in EXPORTERS if out.suffix == f".{kind}" != ending), None)
    if other and not out.is_dir():
        what = f"{out} ends in {other}, expected a folder or a file that ends in {ending}"
        raise UsageError(
            what, file=out, field="--out", fix=f"name it {out.with_suffix(ending).name}, or add --format {other[1:]}"
        )
    if out.suffix != ending or out.is_dir():
        paths = [out / PurePosixPath(file).with_suffix(ending) for file in files]
        if len(set(paths)) < len(paths):
            twice = next(path for path in paths if paths.count(path) > 1)
            raise UsageError(
                f"{twice} would hold two trials",
                file=twice,
                field="--trial",
                fix="export one of them at a time, with --trial",
            )
        return paths
    if len(files) != 1:
        raise UsageError(
            f"{out} is one file, expected a folder for {len(files)} trials",
            file=out,
            field="--out",
            fix="name a folder, or one trial with --trial",
        )
    return [out]


def write_all(out: Path, paths: Sequence[Path], write: Write, *, force: bool = False) -> None:
    """Write every file under a temporary name, then give them their names.

    A folder that is new appears in one step with everything in it. In one that is there, files take their names one after the
    other when all of them are complete; files that are not exported stay as they are.

    Args:
        out: a folder, or the only one of `paths`. paths: of the files. write: writes one of them. force: replace files.

    Raises:
        UsageError: a file is there already, or its folder leads out of `out`.
    """
    for path in paths:
        _check(out, path, force)
    alone = list(paths) == [out]
    home = out.parent if alone else out
    if not alone and not os.path.lexists(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        staged = new_folder(out)
    else:
        home.mkdir(parents=True, exist_ok=True)
        staged = new_folder(home / "export")
    try:
        parts = [staged / (path.name if alone else path.relative_to(out)) for path in paths]
        for index, part in enumerate(parts):
            part.parent.mkdir(parents=True, exist_ok=True)
            write(part, index)
        sync_tree(staged)
        if not alone and not os.path.lexists(out):
            os.rename(staged, out)
            sync(out.parent)
            return
        for part, path in zip(parts, paths, strict=True):
            path.parent.mkdir(parents=True, exist_ok=True)
            os.replace(part, path)
            sync(path.parent)
    finally:
        remove(staged)


def _check(out: Path, path: Path, force: bool) -> None:
    root = out.parent if path == out else out
    if not path.parent.resolve().is_relative_to(root.resolve()):
        raise UsageError(
            f"{path}: a link in it leads out of {out}", file=path, field="--out", fix="export into another folder"
        )
    if path.is_dir():
        raise UsageError(f"{path} is a folder, expected a file", file=path, field="--out", fix="name another place")
    if os.path.lexists(path) and not force:
        raise UsageError(f"{path} is there already", file=path, field="--out", fix="name another place, or add --force")
