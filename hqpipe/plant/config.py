"""PlantConfig: what sets this machine apart from robot.yaml, checked against the schema."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from hqpipe.errors import ConfigError, near_match, shown
from hqpipe.files.documents import read_yaml_mapping
from hqpipe.plant.schema import BY_PATH
from hqpipe.robots import RobotSpec
from hqpipe.sim.body_changes import BodyChanges, Ground, LinkChange, Payload

EFFORT_SOURCES = ("pressure", "load_cell")
JOINT_KINDS = {"roll": "R", "pitch": "P", "knee": "K"}
_SECTIONS = tuple(dict.fromkeys(path.split(".")[0] for path in BY_PATH))
_TOP_LEVEL = (*_SECTIONS, "effort_source", "joints", "spans", "body")
_LISTS = ("spans", "payloads")  # joined when two configurations are merged
_BODY_KEYS = ("ground", "payloads", "links")
LARGEST = 1e6  # s of a span; no trial lasts eleven days

# Lowest and highest value of the fields under body: beyond them the contacts of feet cannot be integrated, or no robot stands.
BODY_LIMITS: dict[str, tuple[float, float]] = {
    "friction": (0.0, 10.0),
    "stiffness": (1e3, 1e7),
    "damping_ratio": (0.01, 10.0),
    "slope": (-1.0, 1.0),
    "slope_heading": (-7.0, 7.0),
    "roughness": (0.0, 1.0),
    "roughness_seed": (0, 2**63),
    "mass": (0.0, 1e4),
    "com": (-10.0, 10.0),
    "mass_scale": (0.01, 100.0),
    "inertia_scale": (0.01, 100.0),
    "com_offset": (-1.0, 1.0),
}


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
        self.check_effort_source()
        return self.overrides.get("effort_source", EFFORT_SOURCES[0])

    def check_effort_source(self) -> None:
        """Raise ConfigError unless `effort_source` is known."""
        source = self.overrides.get("effort_source", EFFORT_SOURCES[0])
        if source not in EFFORT_SOURCES:
            hint = near_match(shown(source), EFFORT_SOURCES)
            text = f"expected one of {', '.join(EFFORT_SOURCES)}, got {shown(source)}{hint}"
            raise _wrong("plant.effort_source", text, "name one of these")

    def settings(self, robot: RobotSpec) -> list[Setting]:
        """Every overridden number in order of rising precedence.

        Raises:
            ConfigError: unknown field, joint or section, a value out of range or not a number.
        """
        _check_keys(_mapping(self.overrides, "plant"), _TOP_LEVEL, "plant")
        everywhere = {key: self.overrides[key] for key in _SECTIONS if key in self.overrides}
        found = list(_flatten(everywhere, "plant", None, robot))
        selectors = _mapping(self.overrides.get("joints", {}), "plant.joints")
        for name in sorted(selectors, key=lambda name: _breadth(name, robot)):
            section = _mapping(selectors[name], f"plant.joints.{name}")
            _check_keys(section, _SECTIONS, f"plant.joints.{name}")
            joints = select_joints(name, robot, f"plant.joints.{name}")
            found += _flatten(section, f"plant.joints.{name}", joints, robot)
        for number, span in enumerate(_list(self.overrides.get("spans", ()), "plant.spans")):
            found += _span_settings(_mapping(span, f"plant.spans[{number}]"), f"plant.spans[{number}]", robot)
        return found

    def body_changes(self, robot: RobotSpec | None = None) -> BodyChanges:
        """The floor, payloads and link errors; with a robot the names of its links are checked.

        Raises:
            ConfigError: unknown field or link, or a value out of range.
        """
        raw = _mapping(self.overrides.get("body", {}), "plant.body")
        _check_keys(raw, _BODY_KEYS, "plant.body")
        links = _mapping(raw.get("links", {}), "plant.body.links")
        payloads = _list(raw.get("payloads", ()), "plant.body.payloads")
        changes = BodyChanges(
            ground=_build(Ground, raw.get("ground", {}), "plant.body.ground"),
            payloads=tuple(
                _build(Payload, entry, f"plant.body.payloads[{number}]") for number, entry in enumerate(payloads)
            ),
            links={name: _build(LinkChange, entry, f"plant.body.links.{name}") for name, entry in links.items()},
        )
        if robot is not None and (changes.payloads or changes.links):
            known = link_names(robot)
            named = {f"plant.body.payloads[{i}].link": each.link for i, each in enumerate(changes.payloads)}
            for where, name in (named | {f"plant.body.links.{name}": name for name in changes.links}).items():
                if name not in known:
                    text = f"no link '{name[:80]}'{near_match(name[:80], known)} (known: {', '.join(known)})"
                    raise _wrong(where, text, "name one of these")
        return changes


def link_names(robot: RobotSpec) -> tuple[str, ...]:
    """Names of the links in the robot's URDF."""
    root = ElementTree.parse(robot.urdf).getroot()
    return tuple(link.get("name", "") for link in root.iter("link"))


def select_joints(selector: str | list[str], robot: RobotSpec, where: str = "plant") -> tuple[int, ...]:
    """Joint indices of "all", a joint, a leg or a kind of joint, or of a list of those; `where` is for errors."""
    if isinstance(selector, (list, tuple)):
        return tuple(sorted({index for part in selector for index in select_joints(part, robot, where)}))
    if not isinstance(selector, str):
        raise _wrong(where, f"expected the name of a joint, got {shown(selector)}", "name joints, legs or kinds")
    if selector == "all":
        return tuple(range(len(robot.joints)))
    if selector in robot.joints:
        return (robot.joints.index(selector),)
    if selector in robot.feet:
        return tuple(i for i, name in enumerate(robot.joints) if name.startswith(selector))
    if selector in JOINT_KINDS:
        return tuple(i for i, name in enumerate(robot.joints) if name.endswith(JOINT_KINDS[selector]))
    known = ("all", *robot.joints, *robot.feet, *JOINT_KINDS)
    text = f"no joint '{selector[:80]}'{near_match(selector[:80], known)} (known: {', '.join(known)})"
    raise _wrong(where, text, "name one of these")


def _breadth(selector: str, robot: RobotSpec) -> int:
    """Kinds before legs before single joints, so that the narrower setting wins."""
    return 2 if selector in robot.joints else 1 if selector in robot.feet else 0


def _span_settings(span: Mapping[str, Any], where: str, robot: RobotSpec) -> Iterator[Setting]:
    _check_keys(span, (*_SECTIONS, "time", "joints"), where)
    bounds = span.get("time")
    if not (_numbers(bounds, 2) and bounds[0] < bounds[1]):
        text = f"expected [start, stop] in s with start < stop, got {shown(bounds)}"
        raise _wrong(f"{where}.time", text, "write e.g. time: [5.0, 8.0]")
    joints = select_joints(span["joints"], robot, f"{where}.joints") if "joints" in span else None
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
            raise _wrong(name, "belongs to the whole machine, expected outside `joints`", "move it out of `joints`")
        selected = tuple(range(len(robot.joints))) if joints is None else joints
        yield Setting(path, float(value), selected if scope == "joint" else None, start, stop)


def _checked(path: str, value: Any, where: str) -> str:
    """Check one number against the schema and return its scope."""
    if path not in BY_PATH:
        if any(known.startswith(f"{path}.") for known in BY_PATH):
            raise _wrong(where, f"expected a mapping of fields, got {shown(value)}", "write {field: value}")
        raise _wrong(where, f"unknown field '{path[:80]}'{near_match(path[:80], BY_PATH)}", "rename or remove it")
    known = BY_PATH[path]
    told = "write a number within that"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        text = f"expected a number in {known.unit}, got {shown(value)} (YAML: 1.0e+6, not 1.0e6)"
        raise _wrong(where, text, told)
    if not known.lower <= value <= known.upper:
        found = f"{value:g}" if isinstance(value, float) else shown(value)
        raise _wrong(where, f"expected {known.lower:g} to {known.upper:g} {known.unit}, got {found}", told)
    return known.scope


def check_base(hydraulics: Mapping[str, Any], robot: RobotSpec) -> list[Setting]:
    """The settings of robot.yaml itself, complete.

    Raises:
        ConfigError: a field without a default is missing, or one is wrong.
    """
    where = f"{robot.folder / 'robot.yaml'}: hydraulics"
    _check_keys(hydraulics, _SECTIONS, where)
    found = list(_flatten(hydraulics, where, None, robot))
    given = {setting.path for setting in found}
    for known in BY_PATH.values():
        if known.default is None and known.path not in given:
            text = f"{where}: missing field '{known.path}' ({known.unit}: {known.meaning})"
            path = robot.folder / "robot.yaml"
            raise ConfigError(text, file=path, field=f"hydraulics.{known.path}", fix=f"add {known.path}")
    return found


def _wrong(where: str, problem: str, fix: str) -> ConfigError:
    """The error of the field `where`; one of robot.yaml names the file."""
    file, colon, field = where.partition(": ")
    if colon:
        return ConfigError(f"{where}: {problem}", file=file, field=field, fix=fix)
    return ConfigError(f"{where}: {problem}", field=where, fix=fix)


def _check_keys(node: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in node:
        if key not in known:
            name = str(key)[:80]
            text = f"unknown field '{name}'{near_match(name, known)} (known: {', '.join(known)})"
            raise _wrong(f"{where}.{name}", text, "rename or remove it")


def _mapping(node: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(node, Mapping):
        raise _wrong(where, f"expected a mapping, got {type(node).__name__}", "write {field: value}")
    return node


def _list(node: Any, where: str) -> list[Any] | tuple[Any, ...]:
    if not isinstance(node, (list, tuple)):
        raise _wrong(where, f"expected a list, got {shown(node)}", "write a list, each entry after a dash")
    return node


def _numbers(node: Any, count: int) -> bool:
    """Whether it is a list of so many finite numbers."""
    return (
        isinstance(node, (list, tuple))
        and len(node) == count
        and all(isinstance(v, (int, float)) and not isinstance(v, bool) and abs(v) <= LARGEST for v in node)
    )


def _build(kind: type, raw: Any, where: str) -> Any:
    """A dataclass from a mapping whose keys are its fields."""
    node = _mapping(raw, where)
    _check_keys(node, tuple(entry.name for entry in fields(kind)), where)
    values = {}
    for entry in fields(kind):
        if entry.name not in node:
            if entry.default is MISSING:
                raise _wrong(where, f"missing field '{entry.name}'", f"add {entry.name}")
            continue
        values[entry.name] = _body_value(node[entry.name], entry.type, f"{where}.{entry.name}")
    return kind(**values)


def _body_value(value: Any, kind: str, where: str) -> Any:
    """Check one value of the body section; `kind` is the annotation of its field."""
    name = where.rsplit(".", 1)[1]
    if kind == "str":
        if not isinstance(value, str):
            raise _wrong(where, f"expected a name, got {shown(value)}", "name a link of the robot")
        return value
    lower, upper = BODY_LIMITS[name]
    if kind.startswith("tuple"):
        if not (_numbers(value, 3) and all(lower <= v <= upper for v in value)):
            text = f"expected three numbers in m within ±{upper:g}, got {shown(value)}"
            raise _wrong(where, text, "write e.g. [0.0, 0.0, 0.2]")
        return tuple(float(v) for v in value)
    expected = int if kind == "int" else (int, float)
    if not isinstance(value, expected) or isinstance(value, bool):
        what = "whole number" if kind == "int" else "number"
        raise _wrong(where, f"expected a {what}, got {shown(value)}", f"write a number from {lower:g} to {upper:g}")
    if not lower <= value <= upper:
        text = f"expected {lower:g} to {upper:g}, got {shown(value)}"
        raise _wrong(where, text, "write a number within that")
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
