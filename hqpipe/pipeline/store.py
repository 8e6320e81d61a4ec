"""The content-addressed store under ``artifacts/`` and the links that a person types.

artifacts/<name>              link to the current result of one stage
artifacts/store/<key>/        committed results, never changed
artifacts/store/.tmp-…/       a result being written; left over only by a killed process
artifacts/scratch/<key>/      checkpoints of an unfinished stage
"""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path

from hqpipe.errors import IntegrityError, UsageError
from hqpipe.pipeline.hashing import SHORT, file_hash, list_files
from hqpipe.pipeline.manifest import MANIFEST, Manifest, is_artifact, read_manifest

KEY = re.compile(r"[0-9a-f]{64}")
TEMPORARY = ".tmp-"


@dataclass(frozen=True)
class Entry:
    """One committed result.

    Args:
        path: its folder.
        manifest: its record.
        shown: what messages call the folder, e.g. ``artifacts/rollouts``.
    """

    path: Path
    manifest: Manifest
    shown: Path = field(compare=False)

    def problems(self) -> list[str]:
        """Hash every file again; one sentence for each that was changed, is missing or does not belong."""
        try:
            present = set(list_files(self.path)) - {MANIFEST}
        except UsageError as error:
            return [str(error)]
        found = []
        for name, expected in self.manifest.outputs.items():
            if name not in present:
                found.append(f"{self.shown / name} is missing")
            elif (actual := file_hash(self.path / name)) != expected:
                hashes = f"expected sha256 {expected[:SHORT]}…, found {actual[:SHORT]}…"
                found.append(f"{self.shown / name} was changed: {hashes}")
        found += [f"{self.shown / name} was added" for name in sorted(present - set(self.manifest.outputs))]
        return found

    def verify(self) -> None:
        """Raise IntegrityError that names the first damaged file, if there is one."""
        if found := self.problems():
            more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
            raise IntegrityError(f"{found[0]}{more}")


def read_entry(folder: Path) -> Entry:
    """The result in `folder`, which may lie outside a store; errors as in `read_manifest`."""
    return Entry(folder, read_manifest(folder), folder)


class Store:
    """Reads and writes one artifacts folder.

    Args:
        folder: ``artifacts/`` of a project; made on the first write.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.entries_folder = folder / "store"

    def path(self, key: str) -> Path:
        return self.entries_folder / key

    def link(self, name: str) -> Path:
        return self.folder / name

    def shown(self, name: str) -> Path:
        """``artifacts/<name>``, relative to the project."""
        return Path(self.folder.name) / name

    def scratch(self, key: str) -> Path:
        return self.folder / "scratch" / key

    def get(self, key: str) -> Entry | None:
        """The result with this key, None if it was never made; errors as in `read_manifest`."""
        path = self.path(key)
        return read_entry(path) if path.is_dir() else None

    def check_link(self, name: str) -> None:
        """Raise UsageError if a file or folder stands where the link ``artifacts/<name>`` belongs."""
        link = self.link(name)
        if link.exists() and not link.is_symlink():
            raise UsageError(f"{link} is not a link into the store: move it away, then run again")

    def current_key(self, name: str) -> str | None:
        """Key that ``artifacts/<name>`` points to, None if there is no such link.

        Raises:
            UsageError: a file or folder of that name is in the way.
            IntegrityError: the link leads somewhere else than into the store.
        """
        self.check_link(name)
        link = self.link(name)
        if not link.is_symlink():
            return None
        target = Path(os.readlink(link))
        if target.parent != Path("store") or not KEY.fullmatch(target.name):
            raise IntegrityError(f"{link} points to {target}, not into the store")
        return target.name

    def current(self, name: str) -> Entry | None:
        """What ``artifacts/<name>`` points to, if anything; errors as in `current_key`, `read_manifest`."""
        key = self.current_key(name)
        entry = self.get(key) if key else None
        return entry and replace(entry, shown=self.shown(name))

    def make_current(self, name: str, key: str) -> None:
        """Point ``artifacts/<name>`` to the result `key`, in one step."""
        temporary = self.folder / f"{TEMPORARY}{name}-{os.getpid()}"
        temporary.unlink(missing_ok=True)
        temporary.symlink_to(Path("store") / key)
        os.replace(temporary, self.link(name))
        _sync(self.folder)

    def begin(self, key: str) -> Path:
        """A new empty folder for the result `key`; `commit` or `discard` it."""
        folder = self.entries_folder / f"{TEMPORARY}{key[:SHORT]}-{os.getpid()}"
        if folder.exists():
            shutil.rmtree(folder)
        folder.mkdir(parents=True)
        return folder

    def commit(self, folder: Path, manifest: Manifest) -> Entry:
        """Write the record into `folder` and make it the result of its key, replacing one of the same key."""
        manifest.write(folder)
        _sync_tree(folder)
        path = self.path(manifest.key)
        if path.exists():
            replaced = self.entries_folder / f"{TEMPORARY}old-{manifest.key[:SHORT]}-{os.getpid()}"
            os.rename(path, replaced)
            os.rename(folder, path)
            shutil.rmtree(replaced)
        else:
            os.rename(folder, path)
        _sync(self.entries_folder)
        return Entry(path, manifest, path)

    def discard(self, folder: Path) -> None:
        """Remove a folder from `begin` that is not to become a result."""
        shutil.rmtree(folder, ignore_errors=True)

    def keys(self) -> list[str]:
        """Keys of all committed results, sorted."""
        if not self.entries_folder.is_dir():
            return []
        return sorted(path.name for path in self.entries_folder.iterdir() if KEY.fullmatch(path.name))

    def remove_leftovers(self) -> list[Path]:
        """Remove what killed processes left half-written. Only for the holder of the lock."""
        places = (self.folder, self.entries_folder)
        leftovers = [path for place in places for path in sorted(place.glob(f"{TEMPORARY}*"))]
        for path in leftovers:
            if path.is_symlink():
                path.unlink()
            else:
                shutil.rmtree(path)
        return leftovers

    def find(self, name: str) -> Entry:
        """The result meant by an artifact's name, a folder, or the first digits (6 or more) of a key.

        Raises:
            UsageError: nothing, or more than one result, is meant.
        """
        if self.link(name).is_symlink():
            entry = self.current(name)
            if entry is None:
                raise UsageError(f"{self.link(name)} points to a result that is gone")
            return entry
        folder = Path(name)
        if is_artifact(folder):
            return read_entry(folder)
        matches = [key for key in self.keys() if len(name) >= 6 and key.startswith(name)]
        if len(matches) == 1:
            return read_entry(self.path(matches[0]))
        problem = "means more than one result" if matches else "is no artifact, result folder or key"
        raise UsageError(f"'{name}' {problem}: expected a name under {self.folder}, a folder, or 6+ digits of a key")


def _sync(path: Path) -> None:
    """Flush a file or a folder's list of names to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _sync_tree(folder: Path) -> None:
    for parent, _, files in os.walk(folder):
        for name in files:
            _sync(Path(parent) / name)
        _sync(Path(parent))
