"""Which files an import reads, and with which reader."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from hqpipe.errors import UsageError, near_match
from hqpipe.logs.imports import FOREIGN_READERS
from hqpipe.logs.imports.recording import ForeignReader

NOT_LOGS = ("readme.txt", "license.txt", "requirements.txt", "notes.txt")


@dataclass(frozen=True)
class SourceFile:
    """A file, or a folder that is one recording, and its reader."""

    path: Path
    reader: type[ForeignReader] | ForeignReader


@dataclass(frozen=True)
class Found:
    """What the sources of an import hold.

    Attributes:
        files: to be read, in the order of their names within each source.
        copies: files with the same bytes as an earlier one → that one.
        unknown: files that no reader reads. folders: that were not looked into.
        given: as named. unmatched: files that the pattern of a join leaves out.
    """

    files: tuple[SourceFile, ...]
    copies: dict[Path, Path]
    unknown: tuple[Path, ...]
    folders: tuple[Path, ...]
    given: tuple[Path, ...] = ()
    unmatched: tuple[Path, ...] = ()


def find_sources(given: Iterable[Path]) -> Found:
    """Files as they are, and of folders the files directly in them; folders inside are only read where they are a recording.

    Raises:
        UsageError: a path does not exist, or a file is of no known format.
    """
    given = tuple(given)
    readers = dict(FOREIGN_READERS.items())
    files: list[SourceFile] = []
    unknown: list[Path] = []
    folders: list[Path] = []
    for path in given:
        if not path.exists():
            siblings = [p.name for p in path.parent.glob("*")] if path.parent.is_dir() else []
            what = f"{path}: no such file or folder{near_match(path.name, siblings)}"
            raise UsageError(what, file=path, fix="name files or folders of logs")
        if reader := _reader_of(path, readers):
            files.append(SourceFile(path, reader))
        elif not path.is_dir():
            raise _unread(path, readers)
        else:
            for inner in sorted(path.iterdir()):
                if _passed_over(inner):
                    continue
                if reader := _reader_of(inner, readers):
                    files.append(SourceFile(inner, reader))
                else:
                    (folders if inner.is_dir() else unknown).append(inner)
    files = list({file.path.resolve(): file for file in files}.values())
    copies = _copies([file.path for file in files])
    return Found(tuple(f for f in files if f.path not in copies), copies, tuple(unknown), tuple(folders), given)


def candidates(given: Iterable[Path], levels: int) -> list[Path]:
    """Files as they are, and of folders the files in them and in folders inside, down to `levels` levels in all."""
    found: list[Path] = []
    for path in given:
        if not path.is_dir():
            found.append(path)
            continue
        for level in range(levels):
            found += sorted(p for p in path.glob("*/" * level + "*") if p.is_file() and not _passed_over(p))
    return list({path.resolve(): path for path in found}.values())


def reader_of(path: Path) -> type[ForeignReader] | None:
    """The reader of a file, or of a folder that is one recording; None where there is none."""
    return _reader_of(path, dict(FOREIGN_READERS.items()))


def _passed_over(path: Path) -> bool:
    """Whether a file or folder in a folder is none of its logs by its name."""
    return path.name.startswith(".") or path.name.casefold() in NOT_LOGS


def _reader_of(path: Path, readers: dict[str, type[ForeignReader]]) -> type[ForeignReader] | None:
    if path.is_dir():
        return next((r for r in readers.values() if hasattr(r, "claims_folder") and r.claims_folder(path)), None)
    suffix = path.suffix.casefold()
    having = [reader for reader in readers.values() if suffix in reader.suffixes]
    return next((r for r in having if not hasattr(r, "claims_file") or r.claims_file(path)), None)


def _unread(path: Path, readers: dict[str, type[ForeignReader]]) -> UsageError:
    """Why no reader reads a file: nobody knows its suffix, or those who do know other content."""
    suffix = path.suffix.casefold()
    picky = [name for name, reader in readers.items() if suffix in reader.suffixes]
    suffixes = sorted({each for reader in readers.values() for each in reader.suffixes} - {suffix})
    what = f"no reader for '{path.suffix or path.name}'"
    what += f" but that of {' and '.join(picky)}, which does not know what is in it" if picky else ""
    return UsageError(f"{path}: {what}", file=path, fix=f"export it to one of {', '.join(suffixes)}")


def _copies(paths: list[Path]) -> dict[Path, Path]:
    """Files with the same bytes as an earlier one; empty files are left to their reader."""
    by_size: dict[int, list[Path]] = {}
    for path in paths:
        if path.is_file() and path.stat().st_size:
            by_size.setdefault(path.stat().st_size, []).append(path)
    found: dict[Path, Path] = {}
    for alike in (each for each in by_size.values() if len(each) > 1):
        first: dict[bytes, Path] = {}
        for path in alike:
            with path.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").digest()
            if first.setdefault(digest, path) != path:
                found[path] = first[digest]
    return found
