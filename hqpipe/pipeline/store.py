"""The content-addressed store under ``artifacts/`` and the links that a person types.

artifacts/<name>              link to the current result of one stage
artifacts/store/<key>/        committed results, never changed
artifacts/store/.tmp-…/       a result being written or removed; left over only by a killed process
artifacts/scratch/<key>/      checkpoints of an unfinished stage
artifacts/tasks/<key>/        parts of a stage's work that several results share, see `hqpipe.pipeline.tasks`
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path

from hqpipe.errors import HqpipeError, IntegrityError, UsageError
from hqpipe.pipeline.hashing import SHORT, file_hash, list_files
from hqpipe.pipeline.manifest import KEY, MAKE_AGAIN, MANIFEST, Manifest, is_artifact, read_manifest
from hqpipe.system import durable
from hqpipe.system.failures import reported


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

    def problems(self) -> list[IntegrityError]:
        """Hash every file again; one error for each that was changed, is missing or does not belong."""
        try:
            with reported(self.path):
                present = set(list_files(self.path)) - {MANIFEST}
                return self._differences(present)
        except HqpipeError as error:
            return [IntegrityError(error.message, file=error.file, fix=error.fix)]
        except FileNotFoundError as error:
            # Another process replaced or removed the result meanwhile.
            return [IntegrityError(f"{error.filename} is missing", file=error.filename, fix=MAKE_AGAIN)]

    def _differences(self, present: set[str]) -> list[IntegrityError]:
        """Errors for the files that are not as recorded; `present` are those that there are."""
        found = []

        def differs(name: str, how: str) -> None:
            found.append(IntegrityError(f"{self.shown / name} {how}", file=self.shown / name, fix=MAKE_AGAIN))

        for name, expected in self.manifest.outputs.items():
            actual = file_hash(self.path / name) if name in present else None
            if actual is None:
                differs(name, "is missing")
            elif actual != expected:
                differs(name, f"was changed (expected sha256 {expected[:SHORT]}…, found {actual[:SHORT]}…)")
        for name in sorted(present - set(self.manifest.outputs)):
            differs(name, "was added")
        return found

    def check_stage(self, stage: str) -> None:
        """Raise IntegrityError if this is no result of `stage`."""
        made_by = self.manifest.recipe.stage
        if made_by != stage:
            message = f"{self.shown} is a result of {made_by}, expected one of {stage}"
            raise IntegrityError(message, file=self.shown, fix=MAKE_AGAIN)

    def verify(self) -> None:
        """Raise IntegrityError that names the first damaged file, if there is one."""
        if found := self.problems():
            if len(found) > 1:
                found[0].message += f" (and {len(found) - 1} more)"
            raise found[0]


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

    @property
    def tasks_folder(self) -> Path:
        return self.folder / "tasks"

    def check_folders(self) -> None:
        """Raise IntegrityError if the folder of results, scratch or tasks is a link, or no folder."""
        for path in (self.entries_folder, self.scratch(""), self.tasks_folder):
            _check_folder(path, "put the folder itself there")

    def get(self, key: str) -> Entry | None:
        """The result with this key, None if it was never made.

        Raises:
            IntegrityError: it is a link or no folder, the result of another key, or as in `read_manifest`.
        """
        path = self.path(key)
        if not _check_folder(path, MAKE_AGAIN):
            return None
        entry = read_entry(path)
        if entry.manifest.key != key:
            message = f"{path} holds another result, {entry.manifest.key[:SHORT]}…"
            raise IntegrityError(message, file=path, fix=MAKE_AGAIN)
        return entry

    def check_link(self, name: str) -> None:
        """Raise UsageError if a file or folder stands where the link ``artifacts/<name>`` belongs."""
        link = self.link(name)
        if os.path.lexists(link) and not link.is_symlink():
            raise UsageError(f"{link} is not a link into the store", file=link, fix="move it away, then run again")

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
            raise IntegrityError(f"{link} points to {target}, not into the store", file=link, fix=MAKE_AGAIN)
        return target.name

    def current(self, name: str) -> Entry | None:
        """What ``artifacts/<name>`` points to, if anything; errors as in `current_key`, `read_manifest`."""
        key = self.current_key(name)
        entry = self.get(key) if key else None
        return entry and replace(entry, shown=self.shown(name))

    def make_current(self, name: str, key: str) -> None:
        """Point ``artifacts/<name>`` to the result `key`, in one step."""
        temporary = self.folder / f"{durable.TEMPORARY}{name}-{os.getpid()}"
        durable.remove(temporary)
        temporary.symlink_to(Path("store") / key)
        os.replace(temporary, self.link(name))
        durable.sync(self.folder)

    def begin(self, key: str) -> Path:
        """A new empty folder for the result `key`; `commit` or `discard` it."""
        return durable.new_folder(self.path(key))

    def commit(self, folder: Path, manifest: Manifest) -> Entry:
        """Write the record into `folder` and make it the result of its key, replacing one of the same key."""
        manifest.write(folder)
        path = self.path(manifest.key)
        durable.move_into_place(folder, path)
        durable.sync(self.folder)
        return Entry(path, manifest, path)

    def discard(self, folder: Path) -> None:
        """Remove a folder from `begin` that is not to become a result."""
        durable.remove(folder)

    def keys(self) -> list[str]:
        """Keys of all committed results, sorted."""
        if not self.entries_folder.is_dir():
            return []
        return sorted(path.name for path in self.entries_folder.iterdir() if KEY.fullmatch(path.name))

    def remove_leftovers(self) -> list[Path]:
        """Remove what killed processes left half-written. Only for the holder of the lock."""
        places = (self.folder, self.entries_folder, self.scratch(""), self.tasks_folder)
        return [path for place in places for path in durable.remove_leftovers(place)]

    def find(self, name: str) -> Entry:
        """The result meant by an artifact's name, a folder, or the first digits (6 or more) of a key.

        Raises:
            UsageError: nothing, or more than one result, is meant.
            IntegrityError: it is damaged or gone.
        """
        if self.link(name).is_symlink():
            entry = self.current(name)
            if entry is None:
                raise self.gone(name)
            return entry
        folder = Path(name)
        if is_artifact(folder):
            return read_entry(folder)
        matches = [key for key in self.keys() if len(name) >= 6 and key.startswith(name)]
        if len(matches) == 1:
            return self.get(matches[0])
        problem = "means more than one result" if matches else "is no artifact, result folder or key"
        fix = f"give a name under {self.folder}, a folder, or 6 or more digits of a key"
        raise UsageError(f"'{name}' {problem}", file=name, fix=fix)

    def gone(self, name: str) -> IntegrityError:
        """The error for a link ``artifacts/<name>`` whose result is not in the store."""
        message = f"{self.shown(name)} points to a result that is gone"
        return IntegrityError(message, file=self.link(name), fix="make it again")


def _check_folder(path: Path, fix: str) -> bool:
    """Whether there is a folder; raise IntegrityError if something else has its name."""
    if path.is_symlink():
        raise IntegrityError(f"{path} is a symbolic link to {os.readlink(path)}", file=path, fix=fix)
    if not os.path.lexists(path):
        return False
    if not path.is_dir():
        raise IntegrityError(f"{path} is not a folder", file=path, fix=fix)
    return True
