"""robot.urdf: what is checked of it before a simulator sees it, and its links and joints as plain data."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

import numpy as np

from hqpipe.errors import ConfigError, near_match
from hqpipe.files.documents import read_text
from hqpipe.files.entries import NAME

LARGEST = 4 * 2**20  # bytes; the largest public URDFs have some 100 kB
DEEPEST = 32  # levels of elements; a URDF has six
MOST_ELEMENTS = 50_000  # a humanoid with hands has some 2,000
HEAVIEST = 1e6  # kg, a thousand times a heavy legged robot; keeps the physics engines' numbers finite
LIGHTEST = 1e-6  # kg; MuJoCo refuses a moving body without mass, pybullet gives a link without one 1 kg
FARTHEST = 1e3  # m, of an origin, and of the size of a shape
LARGEST_LIMIT = 1e6  # rad, m, rad/s, N·m or N of a joint's limit
LEAST_INERTIA = 1e-12  # kg·m², a milligram at a millimetre; MuJoCo takes smaller ones for none
LARGEST_INERTIA = 1e9  # kg·m², of HEAVIEST at some 30 m
TRIANGLE = 0.02  # of the largest principal inertia: what the triangle inequality may miss by, as rounded tables do
MOVING = ("revolute", "continuous", "prismatic")
TYPES = (*MOVING, "fixed")
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_SIZES = {
    "box": ("size", 3),
    "sphere": ("radius", 1),
    "cylinder": ("radius length", 1),
    "capsule": ("radius length", 1),
}
_FIX = "correct it, see docs/how-to/robot.md"


@dataclass(frozen=True)
class Joint:
    """A joint of a URDF: its type, and the links that it connects."""

    name: str
    kind: str
    parent: str
    child: str


@dataclass(frozen=True)
class Urdf:
    """A checked URDF.

    Attributes:
        root: name of the link above all others.
        links: names. joints: by name.
    """

    root: str
    links: tuple[str, ...]
    joints: dict[str, Joint]


class _Place:
    """Where in the file a check is; makes its errors."""

    def __init__(self, path: Path, field: str = "") -> None:
        self.path, self.field = path, field

    def at(self, field: str) -> _Place:
        return _Place(self.path, f"{self.field}: {field}" if self.field else field)

    def error(self, problem: str, fix: str = _FIX) -> ConfigError:
        where = f"{self.path}: {self.field}: " if self.field else f"{self.path}: "
        return ConfigError(f"{where}{problem}", file=self.path, field=self.field or None, fix=fix)


def read_urdf(path: Path) -> Urdf:
    """Read and check a URDF: names, tree, masses, inertias, origins, axes, limits and shapes.

    Raises:
        ConfigError: it is not XML, holds a DTD, or an element is missing, misplaced or without physical sense; the message
            names file, link or joint, what was found and what was expected.
    """
    root = _parse(path)
    place = _Place(path)
    if root.tag != "robot":
        raise place.error(f"the outermost element is <{root.tag[:60]}>, expected <robot>")
    links = _named(root, "link", place)
    joints = _named(root, "joint", place)
    if not links:
        raise place.error("no <link>, expected the links and joints of a robot")
    for name, link in links.items():
        _check_link(link, place.at(f"link {name}"))
    found = {name: _joint(joint, links, place.at(f"joint {name}")) for name, joint in joints.items()}
    return Urdf(_root_link(tuple(links), found, place), tuple(links), found)


def _parse(path: Path) -> ElementTree.Element:
    text = read_text(path, "give a URDF file of links and joints", LARGEST)
    _scan(path, text)
    return ElementTree.fromstring(text)


def _scan(path: Path, text: str) -> None:
    """Refuse XML that is broken, deeper or longer than a robot, or that declares entities, which can grow without bound."""
    parser = expat.ParserCreate(encoding="utf-8")
    place, depth, count = _Place(path), 0, 0

    def opened(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > DEEPEST or count > MOST_ELEMENTS:
            raise place.error(
                f"line {parser.CurrentLineNumber}: more than {DEEPEST} levels or {MOST_ELEMENTS} elements, by far more than a "
                "robot has"
            )

    def closed(name: str) -> None:
        nonlocal depth
        depth -= 1

    def doctype(*declaration: object) -> None:
        raise place.error("holds a DOCTYPE, which no URDF needs", "remove it")

    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        problem = f"line {error.lineno}: not XML ({expat.ErrorString(error.code)})"
        raise place.error(problem, "give a URDF file of links and joints") from error


def _named(root: ElementTree.Element, kind: str, place: _Place) -> dict[str, ElementTree.Element]:
    """The elements of a kind by their name."""
    found: dict[str, ElementTree.Element] = {}
    for number, element in enumerate(root.findall(kind), start=1):
        name = element.get("name", "")
        if not NAME.fullmatch(name):
            raise place.at(f"{kind} {number}").error(
                f"name is {name[:60]!r}, expected a letter, then letters, digits, '.', '-' or '_', at most 64"
            )
        if name in found:
            raise place.at(f"{kind} {name}").error(f"stands twice, expected one {kind} of that name")
        found[name] = element
    return found


def _check_link(link: ElementTree.Element, place: _Place) -> None:
    inertial = link.find("inertial")
    if inertial is None:
        raise place.error(
            "no <inertial>: pybullet would give it 1 kg, MuJoCo nothing",
            "give it a mass and an inertia, those of a frame may be small, or remove it",
        )
    _check_origin(inertial, place.at("inertial"))
    mass = _child(inertial, "mass", place)
    _numbers(mass, "value", 1, place.at("mass"), LIGHTEST, HEAVIEST, "kg")
    _check_inertia(_child(inertial, "inertia", place), place.at("inertia"))
    for kind in ("visual", "collision"):
        for part in link.findall(kind):
            _check_origin(part, place.at(kind))
            _check_shape(part, place.at(kind))


def _check_inertia(element: ElementTree.Element, place: _Place) -> None:
    """Refuse what no body has: principal moments above 0, none larger than the other two together."""
    ixx, ixy, ixz, iyy, iyz, izz = (
        _numbers(element, name, 1, place, -LARGEST_INERTIA, LARGEST_INERTIA, "kg·m²")[0] for name in _INERTIA
    )
    least, middle, most = np.linalg.eigvalsh(np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]))
    shown = f"principal moments {least:.4g}, {middle:.4g} and {most:.4g} kg·m²"
    if not least >= LEAST_INERTIA:
        raise place.error(f"{shown}, expected all of at least {LEAST_INERTIA:g}")
    if least + middle < (1.0 - TRIANGLE) * most:
        raise place.error(f"{shown}, expected none larger than the other two together, as for every body")


def _check_shape(part: ElementTree.Element, place: _Place) -> None:
    shapes = list(_child(part, "geometry", place))
    if len(shapes) != 1:
        raise place.at("geometry").error(f"expected one shape, got {len(shapes)}")
    (shape,) = shapes
    if shape.tag == "mesh":
        raise place.at("mesh").error(
            f"'{shape.get('filename', '')[:80]}', but the simulators get the URDF alone, without other files",
            f"replace it by {', '.join(_SIZES)}",
        )
    if shape.tag not in _SIZES:
        known = ", ".join(_SIZES)
        raise place.at("geometry").error(
            f"<{shape.tag[:60]}>{near_match(shape.tag[:60], _SIZES)}, expected one of {known}"
        )
    names, count = _SIZES[shape.tag]
    for name in names.split():
        _numbers(shape, name, count, place.at(shape.tag), 1e-6, FARTHEST, "m")


def _joint(element: ElementTree.Element, links: dict[str, ElementTree.Element], place: _Place) -> Joint:
    kind = element.get("type", "")
    if kind not in TYPES:
        raise place.error(f"type is '{kind[:60]}'{near_match(kind[:60], TYPES)}, expected one of {', '.join(TYPES)}")
    ends = []
    for end in ("parent", "child"):
        name = _child(element, end, place).get("link", "")
        if name not in links:
            raise place.at(end).error(f"no link '{name[:60]}'{near_match(name[:60], links)}")
        ends.append(name)
    _check_origin(element, place)
    if kind in MOVING:
        axis = element.find("axis")
        if axis is not None and not any(_numbers(axis, "xyz", 3, place.at("axis"), -FARTHEST, FARTHEST, "")):
            raise place.at("axis").error("is zero, expected a direction")
    if kind in MOVING:
        _check_limit(element, kind, place)
    return Joint(element.get("name", ""), kind, *ends)


def _check_limit(element: ElementTree.Element, kind: str, place: _Place) -> None:
    limit = element.find("limit")
    if limit is None:
        if kind == "continuous":
            return
        raise place.error(f"no <limit>, which a {kind} joint needs")
    place = place.at("limit")
    for name in ("effort", "velocity"):
        _numbers(limit, name, 1, place, np.nextafter(0.0, 1.0), LARGEST_LIMIT, "", "a number above 0")
    if kind != "continuous":
        lower, upper = (
            _numbers(limit, name, 1, place, -LARGEST_LIMIT, LARGEST_LIMIT, "")[0] for name in ("lower", "upper")
        )
        if not lower < upper:
            raise place.error(f"lower is {lower:g} and upper {upper:g}, expected lower below upper")


def _root_link(links: tuple[str, ...], joints: dict[str, Joint], place: _Place) -> str:
    """The one link above all others.

    Raises:
        ConfigError: a link has two parents, or the links are not one tree.
    """
    above: dict[str, Joint] = {}
    for joint in joints.values():
        if joint.child in above:
            raise place.at(f"link {joint.child}").error(
                f"is the child of two joints, {above[joint.child].name} and {joint.name}, expected a tree"
            )
        above[joint.child] = joint
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        raise place.error(
            f"{len(roots)} links without a parent ({', '.join(roots[:5])}), expected one tree", "join them"
        )
    below: dict[str, list[str]] = {}
    for joint in joints.values():
        below.setdefault(joint.parent, []).append(joint.child)
    reached, waiting = set(), list(roots)
    while waiting:
        reached.add(waiting[-1])
        waiting += below.get(waiting.pop(), [])
    if lost := [link for link in links if link not in reached]:
        joint = above[lost[0]].name
        raise place.at(f"joint {joint}").error(f"is part of a loop at link {lost[0]}, expected a tree")
    return roots[0]


def _child(element: ElementTree.Element, tag: str, place: _Place) -> ElementTree.Element:
    found = element.find(tag)
    if found is None:
        raise place.error(f"no <{tag}>")
    return found


def _check_origin(element: ElementTree.Element, place: _Place) -> None:
    origin = element.find("origin")
    if origin is None:
        return
    for name, most, unit in (("xyz", FARTHEST, "m"), ("rpy", 100.0, "rad")):
        if origin.get(name) is not None:
            _numbers(origin, name, 3, place.at("origin"), -most, most, unit)


def _numbers(
    element: ElementTree.Element,
    name: str,
    count: int,
    place: _Place,
    lower: float,
    upper: float,
    unit: str,
    expected: str = "",
) -> list[float]:
    """The numbers of an attribute, each from `lower` to `upper`."""
    text = element.get(name)
    if text is None:
        raise place.error(f"no {name}")
    found = list(_floats(text)) if len(text) < 1000 else []
    if len(found) != count or not all(math.isfinite(value) and lower <= value <= upper for value in found):
        many = "a number" if count == 1 else f"{count} numbers"
        wanted = expected or f"{many} from {lower:g} to {upper:g}{f' {unit}' if unit else ''}"
        raise place.error(f"{name} is '{text[:60]}', expected {wanted}")
    return found


def _floats(text: str) -> Iterator[float]:
    for part in text.split():
        try:
            yield float(part)
        except ValueError:
            yield math.nan
