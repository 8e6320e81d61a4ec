"""RobotSpec: what the science half knows about a robot, read from robot/<name>/robot.yaml."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.errors import ConfigError, near_match
from hqpipe.files.documents import read_yaml_mapping
from hqpipe.files.entries import Entry
from hqpipe.urdf import LARGEST_LIMIT, MOVING, Urdf, read_urdf

FILE = "robot.yaml"
_FIELDS = (
    "name urdf base_link joints feet nominal_height nominal_position joint_limits sprocket_radius "
    "stiff_pd torque_pd hydraulics".split()
)
_KINDS = {"R": "roll", "P": "pitch", "K": "knee"}
_LIMITS = ("lower", "upper", "velocity", "effort")
_FIX = "correct it, see docs/how-to/robot.md"
SMALLEST = 1e-6  # of what must be above 0: heights and radii in m, limits in rad/s and N·m
HIGHEST = 100.0  # m, of a standing robot's base, and of a sprocket's radius
TURN = 100.0  # rad, of a joint's angle: sixteen turns
STIFFEST = 1e9  # N·m/rad and N·m·s/rad, four orders above any joint of a legged robot
MOST_JOINTS = 200  # arrays and figures have a row per joint


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
        if (candidate / FILE).is_file():
            return candidate.resolve()
    known = sorted(p.parent.name for p in packaged.glob(f"*/{FILE}"))
    raise ConfigError(
        f"no robot '{name_or_path}'{near_match(str(name_or_path), known)}",
        file=Path(name_or_path),
        field="robot",
        fix=f"expected one of {', '.join(known)} or a folder that holds robot.yaml",
    )


def load_robot(name_or_path: str | Path) -> RobotSpec:
    """Read and check robot.yaml and the URDF that it names.

    Raises:
        ConfigError: a field is missing, unknown, of the wrong kind or without physical sense, or the two files do not fit
            together; the message names file and field.
    """
    folder = robot_folder(name_or_path)
    path = folder / FILE
    raw = read_yaml_mapping(path, _FIX)
    fields = Entry(raw, path, _FIX).mapping(_FIELDS)
    if found := next(_number_texts(raw["hydraulics"], "hydraulics"), None):
        name, text = found
        raise fields["hydraulics"].kind(
            f"{path}: {name}: '{text}' is text, expected a number",
            file=path,
            field=name,
            fix="write the exponent with a sign, as YAML wants it: 1.0e+6",
        )
    spec = _build(fields, folder)
    _check_links(spec, fields, read_urdf(spec.urdf))
    return spec


def _number_texts(node: Any, name: str) -> Iterator[tuple[str, str]]:
    """Yield the fields that YAML read as text although they spell a number, e.g. ``7.0e6``."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _number_texts(value, f"{name}.{key}")
    elif isinstance(node, str):
        try:
            float(node)
        except ValueError:
            return
        yield name, node


def _build(fields: Mapping[str, Entry], folder: Path) -> RobotSpec:
    name, base_link = fields["name"].name(), fields["base_link"].name()
    joints, feet = fields["joints"].names(MOST_JOINTS), fields["feet"].names(MOST_JOINTS)
    limits = {key: [] for key in _LIMITS}
    for entry in _per_joint(fields["joint_limits"], joints):
        for key, value in _limits(entry).items():
            limits[key].append(value)
    nominal = _per_joint(fields["nominal_position"], joints)
    for joint, entry, lower, upper in zip(joints, nominal, limits["lower"], limits["upper"], strict=True):
        if not lower <= entry.number(-TURN, TURN, unit="rad") <= upper:
            raise entry.error(f"is {entry.value:g} rad, expected {joint} within its limits, {lower:g} to {upper:g}")
    hydraulics = {key: entry.value for key, entry in fields["hydraulics"].table().items()}
    return RobotSpec(
        name=name,
        folder=folder,
        urdf=_urdf_path(fields["urdf"], folder),
        base_link=base_link,
        joints=joints,
        feet=feet,
        nominal_height=fields["nominal_height"].number(SMALLEST, HIGHEST, unit="m"),
        nominal_position=np.array([entry.value for entry in nominal], dtype=float),
        position_lower=np.array(limits["lower"]),
        position_upper=np.array(limits["upper"]),
        velocity_limit=np.array(limits["velocity"]),
        effort_limit=np.array(limits["effort"]),
        sprocket_radius=np.full(len(joints), fields["sprocket_radius"].number(SMALLEST, HIGHEST, unit="m")),
        stiff_pd=_gains(fields["stiff_pd"]),
        torque_pd=_gains(fields["torque_pd"]),
        hydraulics=hydraulics,
        hash=folder_hash(folder),
    )


def _per_joint(entry: Entry, joints: tuple[str, ...]) -> list[Entry]:
    """What a table says of every joint: under its name, else under its kind (roll, pitch, knee)."""
    table = entry.table()
    known = (*joints, *_KINDS.values())
    for key in table:
        if key not in known:
            raise table[key].error(f"unknown joint or kind '{key}'{near_match(key, known)}")
    found = []
    for joint in joints:
        kind = _KINDS.get(joint[-1], "")
        key = joint if joint in table else kind
        if key not in table:
            raise entry.error(f"says nothing of joint {joint}", f"add '{joint}'{f' or {kind!r}' if kind else ''}")
        found.append(table[key])
    return found


def _limits(entry: Entry) -> dict[str, float]:
    given = entry.mapping(_LIMITS)
    lower, upper = (given[key].number(-TURN, TURN, unit="rad") for key in ("lower", "upper"))
    if not lower < upper:
        raise entry.error(f"lower is {lower:g} and upper {upper:g}, expected lower below upper")
    velocity = given["velocity"].number(SMALLEST, LARGEST_LIMIT, unit="rad/s")
    return {
        "lower": lower,
        "upper": upper,
        "velocity": velocity,
        "effort": given["effort"].number(SMALLEST, LARGEST_LIMIT, unit="N·m"),
    }


def _gains(entry: Entry) -> Gains:
    given = entry.mapping(("kp", "kd"))
    return Gains(
        kp=given["kp"].number(0.0, STIFFEST, unit="N·m/rad"), kd=given["kd"].number(0.0, STIFFEST, unit="N·m·s/rad")
    )


def _urdf_path(entry: Entry, folder: Path) -> Path:
    """The URDF in the robot's own folder: its hash covers the files that are there."""
    name = entry.text()
    present = {
        path.name for path in folder.iterdir() if path.is_file()
    }  # the name may be longer than any file system takes
    if name not in present:
        raise entry.error(f"no file '{name[:100]}' in {folder}", "name the URDF that lies beside robot.yaml")
    return folder / name


def _check_links(spec: RobotSpec, fields: Mapping[str, Entry], urdf: Urdf) -> None:
    """Refuse names of robot.yaml that the URDF lacks, and moving joints of the URDF that robot.yaml leaves out."""
    if spec.base_link not in urdf.links:
        raise fields["base_link"].error(_unknown("link", spec.base_link, urdf.links, spec.urdf))
    if spec.base_link != urdf.root:
        raise fields["base_link"].error(f"is '{spec.base_link}', expected the root of {spec.urdf.name}, '{urdf.root}'")
    for entry in fields["joints"].items():
        if entry.value not in urdf.joints:
            raise entry.error(_unknown("joint", entry.value, urdf.joints, spec.urdf))
        kind = urdf.joints[entry.value].kind
        if kind not in ("revolute", "continuous"):
            raise entry.error(f"'{entry.value}' is {kind} in {spec.urdf.name}, expected revolute or continuous")
    for joint in urdf.joints.values():
        if joint.kind in MOVING and joint.name not in spec.joints:
            raise fields["joints"].error(
                f"'{joint.name}' is missing, which moves in {spec.urdf.name}", "list it, or make it fixed in the URDF"
            )
    for entry, foot, shank in zip(fields["feet"].items(), spec.foot_links, spec.shank_links, strict=True):
        for link in (foot, shank):
            if link not in urdf.links:
                raise entry.error(_unknown("link", link, urdf.links, spec.urdf))


def _unknown(kind: str, name: str, known: Any, urdf: Path) -> str:
    return f"no {kind} '{name}' in {urdf.name}{near_match(name, known)}"
