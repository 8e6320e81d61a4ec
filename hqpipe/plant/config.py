"""PlantConfig: what sets this machine apart from robot.yaml, checked against the schema."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.documents import read_yaml_mapping
from hqpipe.errors import ConfigError, near_match
from hqpipe.plant.schema import BY_PATH
from hqpipe.robots import RobotSpec
from hqpipe.sim.body_changes import BodyChanges, Ground, LinkChange, Payload

EFFORT_SOURCES = ("pressure", "load_cell")
JOINT_KINDS = {"roll": "R", "pitch": "P", "knee": "K"}
_SECTIONS = tuple(dict.fromkeys(path.split(".")[0] for path in BY_PATH))
_TOP_LEVEL = (*_SECTIONS, "effort_source", "joints", "spans", "body")
_LISTS = ("spans", "payloads")  # joined when two configurations are merged
_BODY_KEYS = ("ground", "payloads", "links")
_BODY_BOUNDS = {
    "friction": (0.0, 10.0),
    "stiffness": (1e3, 1e8),  # N/m: softer than a mattress, stiffer than steel on rock
    "damping_ratio": (0.0, 100.0),
    "slope": (-1.5, 1.5),  # rad: below a wall
    "slope_heading": (-100.0, 100.0),
    "roughness": (0.0, 1.0),  # m
    "roughness_seed": (0, 2**63 - 1),
    "mass": (1e-6, 1e5),  # kg: of a payload, up to a hundred times a heavy legged robot
    "mass_scale": (1e-3, 1e3),
    "inertia_scale": (1e-3, 1e3),
    "com": (-100.0, 100.0),  # m
    "com_offset": (-100.0, 100.0),
}
"""What a ground, a payload or a changed link can have; beyond it MuJoCo's numbers are no longer finite or sensible."""


@dataclass(frozen=True)
class Setting:
    """One number for some joints (None: the whole machine) over [start, stop) s of the trial."""

    path: str
    value: float
    joints: tuple[int, ...] | None = None
    start: float = -np.inf
    stop: float = np.inf


@dataclass(frozen=True)
class PlantConfig:
    """Overrides of robot.yaml's hydraulics and of the effects in `hqpipe.plant.schema`.

    `overrides` is a nested mapping in the layout of robot.yaml, which holds for every joint, and besides::

        effort_source: pressure | load_cell          # how torque is measured
        joints: {LFK: {valve: {overlap: 0.03}}}      # a joint, a leg (LF) or a kind (roll, pitch, knee)
        spans:                                       # only within a span of the trial, s; `joints` optional
          - {time: [5.0, 8.0], joints: [LFK], supply: {pump_flow: 5.0e-4}}
        body: {ground: {friction: 0.5}, payloads: [{link: trunk, mass: 30, com: [0, 0, 0.2]}],
               links: {LF_shank: {mass_scale: 1.2}}}

    Later entries win: all joints, then kinds, legs, single joints, then spans.
    """

    overrides: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def from_yaml(cls, path: str | Path) -> PlantConfig:
        """Read the overrides from a YAML file.

        Raises:
            ConfigError: the file does not hold a mapping.
        """
        return cls(read_yaml_mapping(Path(path), "give a YAML file with sections of the plant such as valve or joints"))

    def merged(self, other: PlantConfig) -> PlantConfig:
        """Both sets of overrides; `other` wins where they meet, lists are joined."""
        return PlantConfig(_merge(self.overrides, other.overrides))

    @property
    def effort_source(self) -> str:
        """ "pressure" or "load_cell"."""
        source = self.overrides.get("effort_source", EFFORT_SOURCES[0])
        if source not in EFFORT_SOURCES:
            hint = near_match(str(source), EFFORT_SOURCES)
            raise _wrong("plant.effort_source", f"expected one of {', '.join(EFFORT_SOURCES)}, got '{source}'{hint}")
        return source

    def settings(self, robot: RobotSpec) -> list[Setting]:
        """Every overridden number in order of rising precedence.

        Raises:
            ConfigError: unknown field, joint or section, a value out of range or not a number.
        """
        _check_keys(self.overrides, _TOP_LEVEL, "plant")
        everywhere = {key: self.overrides[key] for key in _SECTIONS if key in self.overrides}
        found = list(_flatten(everywhere, "plant", None, robot))
        selectors = _mapping(self.overrides.get("joints", {}), "plant.joints")
        for name in sorted(selectors, key=lambda name: _breadth(name, robot)):
            section = _mapping(selectors[name], f"plant.joints.{name}")
            _check_keys(section, _SECTIONS, f"plant.joints.{name}")
            found += _flatten(section, f"plant.joints.{name}", select_joints(name, robot), robot)
        for number, span in enumerate(_list(self.overrides.get("spans", ()), "plant.spans")):
            found += _span_settings(_mapping(span, f"plant.spans[{number}]"), f"plant.spans[{number}]", robot)
        return found

    def body_changes(self) -> BodyChanges:
        """The floor, payloads and link errors.

        Raises:
            ConfigError: unknown field.
        """
        raw = _mapping(self.overrides.get("body", {}), "plant.body")
        _check_keys(raw, _BODY_KEYS, "plant.body")
        links = _mapping(raw.get("links", {}), "plant.body.links")
        return BodyChanges(
            ground=_build(Ground, raw.get("ground", {}), "plant.body.ground"),
            payloads=tuple(
                _build(Payload, entry, f"plant.body.payloads[{number}]")
                for number, entry in enumerate(_list(raw.get("payloads", ()), "plant.body.payloads"))
            ),
            links={str(name): _build(LinkChange, entry, f"plant.body.links.{name}") for name, entry in links.items()},
        )


def select_joints(selector: str | list[str], robot: RobotSpec) -> tuple[int, ...]:
    """Joint indices of "all", a joint, a leg or a kind of joint, or of a list of those."""
    if isinstance(selector, (list, tuple)):
        return tuple(sorted({index for part in selector for index in select_joints(part, robot)}))
    if not isinstance(selector, str):
        raise _wrong("plant.joints", f"expected a name or a list of names, got {selector!r:.80}")
    if selector == "all":
        return tuple(range(len(robot.joints)))
    if selector in robot.joints:
        return (robot.joints.index(selector),)
    if selector in robot.feet:
        return tuple(i for i, name in enumerate(robot.joints) if name.startswith(selector))
    if selector in JOINT_KINDS:
        return tuple(i for i, name in enumerate(robot.joints) if name.endswith(JOINT_KINDS[selector]))
    known = ("all", *robot.joints, *robot.feet, *JOINT_KINDS)
    raise _wrong(
        "plant.joints", f"no joint '{selector!s:.80}'{near_match(str(selector), known)} (known: {', '.join(known)})"
    )


def _breadth(selector: str, robot: RobotSpec) -> int:
    """Kinds before legs before single joints, so that the narrower setting wins."""
    return 2 if selector in robot.joints else 1 if selector in robot.feet else 0


def _span_settings(span: Mapping[str, Any], where: str, robot: RobotSpec) -> Iterator[Setting]:
    _check_keys(span, (*_SECTIONS, "time", "joints"), where)
    bounds = span.get("time")
    numbers = isinstance(bounds, (list, tuple)) and len(bounds) == 2 and all(_is_number(bound) for bound in bounds)
    if not (numbers and bounds[0] < bounds[1]):
        raise _wrong(f"{where}.time", f"expected [start, stop] in s with start < stop, got {bounds!r:.80}")
    joints = select_joints(span["joints"], robot) if "joints" in span else None
    section = {key: span[key] for key in _SECTIONS if key in span}
    return _flatten(section, where, joints, robot, float(bounds[0]), float(bounds[1]))


def _flatten(
    node: Mapping[str, Any],
    where: str,
    joints: tuple[int, ...] | None,
    robot: RobotSpec,
    start: float = -np.inf,
    stop: float = np.inf,
    prefix: str = "",
) -> Iterator[Setting]:
    for key, value in node.items():
        path, name = f"{prefix}{key}", f"{where}.{key}"
        if isinstance(value, Mapping):
            yield from _flatten(value, name, joints, robot, start, stop, f"{path}.")
            continue
        scope = _checked(path, value, name)
        if scope == "machine" and joints is not None:
            raise _wrong(name, "belongs to the whole machine, expected outside `joints`")
        selected = tuple(range(len(robot.joints))) if joints is None else joints
        yield Setting(path, float(value), selected if scope == "joint" else None, start, stop)


def _checked(path: str, value: Any, where: str) -> str:
    """Check one number against the schema and return its scope."""
    if path not in BY_PATH:
        hint = near_match(path, BY_PATH)
        raise _wrong(where, f"unknown field '{path}'{hint}")
    known = BY_PATH[path]
    if not _is_number(value):
        raise _wrong(where, f"expected a number in {known.unit}, got {value!r:.80} (YAML: 1.0e+6, not 1.0e6)")
    if not known.lower <= value <= known.upper:
        raise _wrong(where, f"expected {known.lower:g} to {known.upper:g} {known.unit}, got {value:g}")
    return known.scope


def check_base(hydraulics: Mapping[str, Any], robot: RobotSpec) -> list[Setting]:
    """The settings of robot.yaml itself, complete.

    Raises:
        ConfigError: a field without a default is missing, or one is wrong.
    """
    where = "hydraulics"
    try:
        _check_keys(hydraulics, _SECTIONS, where)
        found = list(_flatten(hydraulics, where, None, robot))
        given = {setting.path for setting in found}
        for known in BY_PATH.values():
            if known.default is None and known.path not in given:
                raise _wrong(where, f"missing field '{known.path}' ({known.unit}: {known.meaning})")
    except ConfigError as error:
        raise error.in_file(robot.folder / "robot.yaml", ConfigError) from error
    return found


def _check_keys(node: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in node:
        if key not in known:
            raise _wrong(where, f"unknown field '{key!s:.80}'{near_match(str(key), known)} (known: {', '.join(known)})")


def _mapping(node: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(node, Mapping):
        raise _wrong(where, f"expected a mapping, got {type(node).__name__}")
    return node


def _list(node: Any, where: str) -> Sequence[Any]:
    if not isinstance(node, (list, tuple)):
        raise _wrong(where, f"expected a list, got {type(node).__name__}")
    return node


def _is_number(value: Any) -> bool:
    """Whether it is a finite number that an array of floats can hold."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _wrong(where: str, problem: str) -> ConfigError:
    return ConfigError(f"{where}: {problem}", field=where, fix="correct it, see hqpipe/plant/schema.py")


def _build(kind: type, raw: Any, where: str) -> Any:
    """A dataclass from a mapping whose keys are its fields."""
    node = _mapping(raw, where)
    _check_keys(node, tuple(entry.name for entry in fields(kind)), where)
    values = {}
    for entry in fields(kind):
        if entry.name not in node:
            if entry.default is MISSING:
                raise _wrong(where, f"missing field '{entry.name}'")
            continue
        values[entry.name] = _body_value(node[entry.name], entry.type, f"{where}.{entry.name}")
    return kind(**values)


def _body_value(value: Any, kind: str, where: str) -> Any:
    """Check one value of the body section; `kind` is the annotation of its field."""
    if kind.startswith("tuple"):
        if not (isinstance(value, (list, tuple)) and len(value) == 3 and all(_is_number(v) for v in value)):
            raise _wrong(where, f"expected three numbers in m, got {value!r:.80}")
        return tuple(float(_within(v, where)) for v in value)
    if kind == "str":
        if not isinstance(value, str):
            raise _wrong(where, f"expected a name, got {value!r:.80}")
        return value
    if not _is_number(value) or (kind == "int" and not isinstance(value, int)):
        raise _wrong(where, f"expected a {'whole ' if kind == 'int' else ''}number, got {value!r:.80}")
    return _within(value, where)


def _within(value: float, where: str) -> float:
    """A number of the body section, within the bounds of its name."""
    lower, upper = _BODY_BOUNDS[where.rpartition(".")[2]]
    if not lower <= value <= upper:
        raise _wrong(where, f"expected {lower:g} to {upper:g}, got {value:g}")
    return value


def _merge(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(first)
    for key, value in second.items():
        if key in _LISTS:
            merged[key] = [*_list(merged.get(key, ()), key), *_list(value, key)]
        elif isinstance(value, Mapping) and isinstance(merged.get(key), Mapping):
            merged[key] = _merge(merged[key], value)
        else:
            merged[key] = value
    return merged
