"""RobotSpec: what the science half knows about a robot, read from robot/<name>/robot.yaml."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hqpipe.errors import ConfigError, near_match

_FIELDS = frozenset(
    "name urdf base_link joints feet nominal_height nominal_position joint_limits sprocket_radius "
    "stiff_pd torque_pd hydraulics".split()
)
_KINDS = {"R": "roll", "P": "pitch", "K": "knee"}


@dataclass(frozen=True)
class Gains:
    """Proportional and derivative gain of a joint-space PD law, N·m/rad and N·m·s/rad."""

    kp: float
    kd: float


@dataclass(frozen=True)
class RobotSpec:
    """A robot in SI units; joint arrays have shape (J,) in the order of `joints`.

    Attributes:
        nominal_position: standing joint angles, rad.
        nominal_height: base frame above flat ground when standing, m.
        position_lower, position_upper: joint limits, rad.
        velocity_limit: rad/s.
        effort_limit: N·m.
        sprocket_radius: R of the paper's eq. (7), m.
        stiff_pd: position control as it is simulated without an actuator model.
        torque_pd: turns a joint target into a torque target in torque control.
        hydraulics: parameters of the reference plant, as written in robot.yaml.
        hash: SHA-256 over the files of the folder.
    """

    name: str
    folder: Path
    urdf: Path
    base_link: str
    joints: tuple[str, ...]
    feet: tuple[str, ...]
    nominal_height: float
    nominal_position: np.ndarray
    position_lower: np.ndarray
    position_upper: np.ndarray
    velocity_limit: np.ndarray
    effort_limit: np.ndarray
    sprocket_radius: np.ndarray
    stiff_pd: Gains
    torque_pd: Gains
    hydraulics: Mapping[str, Any]
    hash: str

    @property
    def foot_links(self) -> tuple[str, ...]:
        return tuple(f"{leg}_foot" for leg in self.feet)

    @property
    def shank_links(self) -> tuple[str, ...]:
        return tuple(f"{leg}_shank" for leg in self.feet)


def folder_hash(folder: Path) -> str:
    """SHA-256 over the relative paths and bytes of the robot's files."""
    digest = hashlib.sha256()
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def robot_folder(name_or_path: str | Path) -> Path:
    """Find a robot by the name of a packaged folder, or by path.

    Raises:
        ConfigError: no such robot.
    """
    packaged = Path(str(files("hqpipe.robot")))
    for candidate in (Path(name_or_path), packaged / str(name_or_path)):
        if (candidate / "robot.yaml").is_file():
            return candidate.resolve()
    known = sorted(p.parent.name for p in packaged.glob("*/robot.yaml"))
    raise ConfigError(
        f"no robot '{name_or_path}'{near_match(str(name_or_path), known)}: expected one of {', '.join(known)} "
        "or a folder that holds robot.yaml"
    )


def load_robot(name_or_path: str | Path) -> RobotSpec:
    """Read and check robot.yaml.

    Raises:
        ConfigError: a field is missing, unknown or of the wrong kind; the message names file and field.
    """
    folder = robot_folder(name_or_path)
    path = folder / "robot.yaml"
    raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    if not isinstance(raw, dict):
        raise ConfigError(f"{path}: expected a mapping of fields, got {type(raw).__name__}")
    for field in raw:
        if field not in _FIELDS:
            raise ConfigError(f"{path}: unknown field '{field}'{near_match(field, _FIELDS)}")
    if missing := sorted(_FIELDS - raw.keys()):
        raise ConfigError(f"{path}: missing field '{missing[0]}' – every robot states it, see docs/how-to/robot.md")
    if text := next(_number_texts(raw["hydraulics"], "hydraulics"), None):
        raise ConfigError(f"{path}: {text} is text, expected a number (YAML wants a sign in the exponent: 1.0e+6)")
    try:
        return _build(raw, folder)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(
            f"{path}: {type(error).__name__}: {error}; expected the layout of the packaged robots"
        ) from error


def _number_texts(node: Any, name: str) -> Iterator[str]:
    """Yield the fields that YAML read as text although they spell a number, e.g. ``7.0e6``."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _number_texts(value, f"{name}.{key}")
    elif isinstance(node, str):
        try:
            float(node)
        except ValueError:
            return
        yield f"{name}: '{node}'"


def _build(raw: dict[str, Any], folder: Path) -> RobotSpec:
    joints = tuple(raw["joints"])
    limits = raw["joint_limits"]

    def per_joint(table: Mapping[str, Any], key: str | None = None) -> np.ndarray:
        """Look a joint up by name, else by its kind (roll, pitch, knee)."""
        rows = [table[joint] if joint in table else table[_KINDS[joint[-1]]] for joint in joints]
        return np.array([row if key is None else row[key] for row in rows], dtype=float)

    urdf = folder / raw["urdf"]
    if not urdf.is_file():
        raise ValueError(f"urdf: no file {urdf}")
    lower, upper = per_joint(limits, "lower"), per_joint(limits, "upper")
    if not (lower < upper).all():
        raise ValueError("joint_limits: lower must be below upper")
    return RobotSpec(
        name=raw["name"],
        folder=folder,
        urdf=urdf,
        base_link=raw["base_link"],
        joints=joints,
        feet=tuple(raw["feet"]),
        nominal_height=float(raw["nominal_height"]),
        nominal_position=per_joint(raw["nominal_position"]),
        position_lower=lower,
        position_upper=upper,
        velocity_limit=per_joint(limits, "velocity"),
        effort_limit=per_joint(limits, "effort"),
        sprocket_radius=np.full(len(joints), float(raw["sprocket_radius"])),
        stiff_pd=Gains(**raw["stiff_pd"]),
        torque_pd=Gains(**raw["torque_pd"]),
        hydraulics=raw["hydraulics"],
        hash=folder_hash(folder),
    )
