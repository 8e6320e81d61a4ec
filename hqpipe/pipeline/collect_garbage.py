"""Removes results that neither an artifact in use nor a profile's last run was made from."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from hqpipe.pipeline.stage import StageTable
from hqpipe.pipeline.store import Entry, Store
from hqpipe.system import durable


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
        if key in found or (entry := store.get(key)) is None:
            continue
        found.add(key)
        pending += [source["key"] for source in entry.manifest.sources.values() if source["key"]]
    return found


def _newest(store: Store, current: set[str]) -> list[str]:
    """The last result of every stage in every profile, so that a quick run never costs a long one its results."""
    newest: dict[tuple[str, str], tuple[str, bool, str]] = {}
    for key in store.keys():
        if (entry := store.get(key)) is None:
            continue
        manifest = entry.manifest
        made = (manifest.provenance["created"], key in current, key)
        group = (manifest.recipe.stage, manifest.provenance["profile"])
        newest[group] = max(newest.get(group, made), made)
    return [key for _, _, key in newest.values()]


def find_garbage(store: Store, table: StageTable, *, scratch: bool) -> list[Garbage]:
    """What `reachable` leaves, and with `scratch` also the checkpoints and tasks of unfinished stages."""
    kept = reachable(store, table)
    entries = [store.get(key) for key in store.keys() if key not in kept]
    # Tasks first: a result that is gone would no longer say which were its own.
    found = [*_tasks(store, kept, scratch), *(_garbage(entry) for entry in entries if entry is not None)]
    if scratch and store.scratch("").is_dir():
        found += [Garbage(path, "checkpoint", _size(path)) for path in sorted(store.scratch("").iterdir())]
    return found


def _tasks(store: Store, kept: set[str], unfinished: bool) -> list[Garbage]:
    """Tasks of results that go and of none that stays; those of no result belong to unfinished stages."""
    if not store.tasks_folder.is_dir():
        return []
    needed, known = set(), set()
    for key in store.keys():
        if (entry := store.get(key)) is not None:
            own = set(entry.manifest.provenance.get("tasks", ()))
            known |= own
            needed |= own if key in kept else set()
    paths = [path for path in sorted(store.tasks_folder.iterdir()) if path.name not in needed]
    return [Garbage(path, "task", _size(path)) for path in paths if unfinished or path.name in known]


def _garbage(entry: Entry) -> Garbage:
    stage, made = entry.manifest.recipe.stage, entry.manifest.provenance
    return Garbage(entry.path, f"{stage}, profile {made['profile']}, {made['created']}", _size(entry.path))


def remove(garbage: list[Garbage]) -> None:
    """Remove it from the disk. Only for the holder of the lock."""
    for item in garbage:
        durable.remove(item.path)


def _size(path: Path) -> int:
    """Bytes of a file or of all files in a folder; 0 for what another process removes meanwhile."""
    if path.is_symlink() or not path.is_dir():
        return _file_size(path)
    return sum(_file_size(Path(parent) / name) for parent, _, files in os.walk(path) for name in files)


def _file_size(path: Path) -> int:
    try:
        return path.lstat().st_size
    except FileNotFoundError:
        return 0
