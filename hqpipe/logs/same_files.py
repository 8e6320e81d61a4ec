"""Trials that are one and the same file, whatever it is called."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from hqpipe.errors import LogError


def check_distinct(folder: Path, files: Sequence[str]) -> None:
    """Refuse a file that is there twice: by another spelling of its path, through a link, or in another case.

    Args:
        folder: of the log set. files: paths in it, which exist.

    Raises:
        LogError: names both.
    """
    seen: dict[tuple[int, int], str] = {}
    for file in files:
        status = (folder / file).stat()
        other = seen.setdefault((status.st_dev, status.st_ino), file)
        if other is not file:
            raise LogError(
                f"{folder}: '{file}' is the same file as '{other}'; a trial belongs to one split and counts once",
                file=folder / file,
                field="trials",
                fix="list it once in logset.yaml, or remove the link",
            )


def digests_of(folder: Path, files: Sequence[str]) -> dict[str, bytes]:
    """File → SHA-256 of its bytes."""
    found = {}
    for file in files:
        with (folder / file).open("rb") as stream:
            found[file] = hashlib.file_digest(stream, "sha256").digest()
    return found


def check_copies(folder: Path, digests: Mapping[str, bytes], splits: Mapping[str, str]) -> list[str]:
    """Refuse copies of a file in both splits.

    Args:
        folder: of the log set. digests: from `digests_of`. splits: file → "fit" or "heldout".

    Returns:
        Warnings about copies within a split: they count twice, but nothing that is held out is fitted.

    Raises:
        LogError: names both.
    """
    first: dict[bytes, str] = {}
    warnings = []
    for file, split in splits.items():
        other = first.setdefault(digests[file], file)
        if other == file:
            continue
        if splits[other] != split:
            raise LogError(
                f"{folder / file}: has the same bytes as {other}: one is a held-out trial, the other one a fit trial, and "
                "no fit may see what is held out",
                file=folder / file,
                field="trials",
                fix="leave one of them out, or hold out another trial",
            )
        warnings.append(f"{file} has the same bytes as {other}: the same trial counts twice")
    return warnings
