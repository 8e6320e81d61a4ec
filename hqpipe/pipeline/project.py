"""The project root, the configuration in it, and the robot that it names."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path

from hqpipe.errors import ConfigError, UsageError, near_match
from hqpipe.pipeline.config import FILE, Configuration
from hqpipe.pipeline.hashing import tree_hash
from hqpipe.pipeline.stage import StageTable
from hqpipe.pipeline.store import Store

PACKAGED_ROBOTS = "hqpipe.robot"
NO_CONTENT = frozenset({"__pycache__"})
"""Folder names that say nothing about a robot."""


@dataclass(frozen=True)
class Project:
    """One folder with a ``pipeline.yaml``, opened.

    Args:
        root: that folder.
        table: the stages.
        configuration: the checked file.
        store: the artifacts of this project.
    """

    root: Path
    table: StageTable
    configuration: Configuration
    store: Store

    def robot_folder(self) -> Path:
        """Folder of the robot that the configuration names.

        Looked up as a path (if it has a slash), then under ``robot/`` of the project, then among the robots
        that come with hqpipe.

        Raises:
            ConfigError: there is no such folder with a ``robot.yaml``.
        """
        name = self.configuration.file.robot
        if "/" in name:
            folder = self.root / name
            if not (folder / "robot.yaml").is_file():
                raise ConfigError(
                    f"{FILE}: robot: {folder / 'robot.yaml'} does not exist",
                    file=self.root / FILE,
                    field="robot",
                    fix="give the path of the robot's folder, relative to the project",
                )
            return folder
        known: dict[str, Path] = {}
        for place in (*_packaged_robots(), self.root / "robot"):
            known |= {path.parent.name: path.parent for path in sorted(place.glob("*/robot.yaml"))}
        if name not in known:
            names = ", ".join(sorted(known))
            raise ConfigError(
                f"{FILE}: robot: unknown robot '{name}'{near_match(name, known)} (known: {names})",
                file=self.root / FILE,
                field="robot",
                fix="name one of these, or the path of a robot's folder",
            )
        return known[name]

    def robot_hash(self) -> str:
        """Hash of all files in the robot's folder; errors as in `robot_folder`."""
        return tree_hash(self.robot_folder(), ignore=NO_CONTENT)


def _packaged_robots() -> list[Path]:
    spec = importlib.util.find_spec(PACKAGED_ROBOTS)
    return [Path(place) for place in spec.submodule_search_locations] if spec else []


def find_root(start: Path) -> Path:
    """The nearest folder with a ``pipeline.yaml``, from `start` upwards."""
    start = start.resolve()
    for folder in (start, *start.parents):
        path = folder / FILE
        if path.is_file():
            return folder
        if path.exists():
            raise UsageError(f"{path} is no file", file=path, fix="move it away, then make one with `hqpipe init DIR`")
    message = f"no {FILE} in {start} or a folder above it"
    raise UsageError(message, file=start, fix="make a project with `hqpipe init DIR`")


def open_project(table: StageTable, start: Path | None = None) -> Project:
    """Open the project around `start` (default: the working directory).

    Raises:
        UsageError: no ``pipeline.yaml`` there or above.
        ConfigError: the file is wrong.
        IntegrityError: the store is a link.
    """
    root = find_root(Path.cwd() if start is None else start)
    configuration = Configuration(root / FILE, table)
    store = Store(_artifacts_folder(root, configuration.file.artifacts))
    store.check_folders()
    return Project(root, table, configuration, store)


def _artifacts_folder(root: Path, name: str) -> Path:
    """The folder `artifacts` of the configuration, which must lie below the project `root`.

    Raises:
        ConfigError: it leads outside, is the project itself, or is a file.
    """
    path, where = root / name, f"{FILE}: artifacts: '{name}'"
    told = {"file": root / FILE, "field": "artifacts"}
    try:
        inside = root in path.resolve().parents
    except (OSError, RuntimeError, ValueError):  # a loop of links, a name that is too long or has a NUL
        inside = False
    if not inside:
        fix = "name a folder inside the project, e.g. `artifacts: artifacts`"
        raise ConfigError(f"{where} is no folder inside the project {root}", fix=fix, **told)
    if path.exists() and not path.is_dir():
        raise ConfigError(f"{where}: {path} is a file, expected a folder", fix="move the file away", **told)
    return path
