"""Parts of a stage's work that are worth keeping by themselves, such as one training of several.

A task is known by what decides its result and not by the run that needs it: a run with other parameters finds what an
earlier one has made, and a killed run goes on task by task.

artifacts/tasks/<key>/files/      what the task made, with checksums
artifacts/tasks/<key>/scratch/    checkpoints of a task that is not finished
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hqpipe.pipeline.hashing import data_hash
from hqpipe.system import durable


@dataclass(frozen=True)
class Task:
    """One task and its place.

    Attributes:
        key: SHA-256 over what decides the result. folder: of the task.
    """

    key: str
    folder: Path

    @property
    def files(self) -> Path:
        """What the task made; there once it is finished."""
        return self.folder / "files"

    @property
    def scratch(self) -> Path:
        """For checkpoints; removed when the task is finished."""
        return self.folder / "scratch"

    def is_done(self) -> bool:
        """Whether its files are there and intact; a warning says that damaged ones are made again."""
        durable.remove_leftovers(self.folder)
        wrong = durable.damage(self.files)
        if wrong and self.files.exists():
            print(f"warning: {self.files} is damaged ({wrong}): made again", file=sys.stderr, flush=True)
        return not wrong

    def begin(self) -> Path:
        """A new empty folder for the files; `finish` it."""
        return durable.new_folder(self.files)

    def finish(self, folder: Path) -> None:
        """Make a folder of `begin` the files of the task."""
        durable.write_checksums(folder)
        durable.move_into_place(folder, self.files)
        durable.remove(self.scratch)


class Tasks:
    """The tasks of one stage.

    Args:
        folder: of the tasks of all stages.
        common: what decides the result of each, beside what `find` is given: the stage, its version and the robot.
        fresh: whether everything is to be made anew.
    """

    def __init__(self, folder: Path, common: Mapping[str, Any], *, fresh: bool = False) -> None:
        self._folder, self._common, self._fresh = folder, dict(common), fresh
        self._used: set[str] = set()

    @property
    def used(self) -> list[str]:
        """Keys of the tasks that were asked for, sorted."""
        return sorted(self._used)

    def find(self, **content: Any) -> Task:
        """The task that is decided by `content`, plain data; made or not."""
        key = data_hash({**self._common, "content": content})
        task = Task(key, self._folder / key)
        if self._fresh and key not in self._used:
            durable.remove(task.folder)
        self._used.add(key)
        return task
