"""Removes results that nothing current was made from."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from hqpipe.pipeline.manifest import read_manifest
from hqpipe.pipeline.stage import StageTable
from hqpipe.pipeline.store import Store


@dataclass(frozen=True)
class Garbage:
    """One folder that may go, and its size in bytes."""

    path: Path
    size: int


def reachable(store: Store, table: StageTable) -> set[str]:
    """Keys of the current artifacts and of everything in the store that they were made from.

    Raises:
        IntegrityError: a current artifact's record is damaged, so that its sources are unknown.
    """
    pending = [key for name in table.artifacts if (key := store.current_key(name))]
    found: set[str] = set()
    while pending:
        key = pending.pop()
        if key in found or not store.path(key).is_dir():
            continue
        found.add(key)
        sources = read_manifest(store.path(key)).sources.values()
        pending += [source["key"] for source in sources if source["key"]]
    return found


def find_garbage(store: Store, table: StageTable, *, scratch: bool) -> list[Garbage]:
    """What `reachable` leaves, and with `scratch` also the checkpoints of unfinished stages."""
    kept = reachable(store, table)
    folders = [store.path(key) for key in store.keys() if key not in kept]
    if scratch and store.scratch("").is_dir():
        folders += sorted(store.scratch("").iterdir())
    return [Garbage(folder, _size(folder)) for folder in folders]


def remove(garbage: list[Garbage]) -> None:
    """Remove it from the disk. Only for the holder of the lock."""
    for item in garbage:
        shutil.rmtree(item.path)


def _size(folder: Path) -> int:
    return sum(path.lstat().st_size for path in folder.rglob("*") if not path.is_dir())
