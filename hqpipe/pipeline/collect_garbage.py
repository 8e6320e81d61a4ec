"""Removes results that neither an artifact in use nor a profile's last run was made from."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from hqpipe.pipeline.manifest import read_manifest
from hqpipe.pipeline.stage import StageTable
from hqpipe.pipeline.store import Store


@dataclass(frozen=True)
class Garbage:
    """One folder that may go, what it holds in words, and its size in bytes."""

    path: Path
    content: str
    size: int


def reachable(store: Store, table: StageTable) -> set[str]:
    """Keys of the current artifacts, of each profile's newest ones, and of everything they were made from.

    Raises:
        IntegrityError: a record is damaged, so that its sources are unknown.
    """
    current = [key for name in table.artifacts if (key := store.current_key(name))]
    pending = [*current, *_newest(store, set(current))]
    found: set[str] = set()
    while pending:
        key = pending.pop()
        if key in found or not store.path(key).is_dir():
            continue
        found.add(key)
        sources = read_manifest(store.path(key)).sources.values()
        pending += [source["key"] for source in sources if source["key"]]
    return found


def _newest(store: Store, current: set[str]) -> list[str]:
    """The last result of every stage in every profile, so that a quick run never costs a long one its results."""
    newest: dict[tuple[str, str], tuple[str, bool, str]] = {}
    for key in store.keys():
        manifest = read_manifest(store.path(key))
        made = (manifest.provenance["created"], key in current, key)
        group = (manifest.recipe.stage, manifest.provenance["profile"])
        newest[group] = max(newest.get(group, made), made)
    return [key for _, _, key in newest.values()]


def find_garbage(store: Store, table: StageTable, *, scratch: bool) -> list[Garbage]:
    """What `reachable` leaves, and with `scratch` also the checkpoints of unfinished stages."""
    kept = reachable(store, table)
    found = [_garbage(store.path(key)) for key in store.keys() if key not in kept]
    if scratch and store.scratch("").is_dir():
        found += [Garbage(folder, "checkpoint", _size(folder)) for folder in sorted(store.scratch("").iterdir())]
    return found


def _garbage(folder: Path) -> Garbage:
    manifest = read_manifest(folder)
    made = manifest.provenance
    return Garbage(folder, f"{manifest.recipe.stage}, profile {made['profile']}, {made['created']}", _size(folder))


def remove(garbage: list[Garbage]) -> None:
    """Remove it from the disk. Only for the holder of the lock."""
    for item in garbage:
        shutil.rmtree(item.path)


def _size(folder: Path) -> int:
    return sum(path.lstat().st_size for path in folder.rglob("*") if not path.is_dir())
