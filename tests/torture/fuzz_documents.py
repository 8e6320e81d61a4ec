"""JSON, YAML and URDF from outside, with one or two places of a valid example changed, or bytes of it."""

from __future__ import annotations

import json
import shutil
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from hypothesis import strategies as st

from hqpipe.actuators.files import load_actuator
from hqpipe.actuators.posterior_file import load_posterior
from hqpipe.gap.answer.schema import read_diagnosis
from hqpipe.pipeline.store import read_entry
from hqpipe.rl.controller import read_wiring
from hqpipe.rl.policy_io import load_policy
from hqpipe.robots import load_robot
from hqpipe.sim.engine import robot_setup
from hqpipe.sim.mujoco_model import robot_spec
from hqpipe.stages import STAGES

from .chain import Chain
from .flips import command
from .fuzz import Refused, Target
from .odd import change_bytes, change_tree, numbers, text_changes, texts, tree_changes, values
from .processes import ROOT


def document_targets(chain: Chain, folder: Path) -> list[Target]:
    """Targets with their examples under `folder`."""
    artifacts = chain.folder / "artifacts"
    robot = _example(folder / "robot", ROOT / "robot" / "hydraulic_quadruped", "robot.yaml", "robot.urdf")
    actuator = _example(folder / "actuator", artifacts / "actuator", "actuator.json", "posterior.json")
    policy = _example(folder / "policy", artifacts / "policy", "policy.json", "policy.safetensors")
    onnx = _example(folder / "onnx", artifacts / "onnx", "policy.onnx", "deploy.yaml")
    result = _example(folder / "result", artifacts / "policy", "*")
    diagnosis = _example(folder / "diagnosis", artifacts / "diagnosis", "diagnosis.json")
    project = _example(folder / "project", ROOT, "pipeline.yaml")
    return [
        _document("pipeline.yaml", project, "pipeline.yaml", _plan),
        Target("--set", project, _settings(), _write_arguments, _plan, place="field"),
        _document("robot.yaml", robot, "robot.yaml", _robot),
        Target("robot.urdf", robot, _urdf_changes(robot / "robot.urdf"), _change_urdf, _robot),
        _document("actuator.json", actuator, "actuator.json", _actuator),
        _document("posterior.json", actuator, "posterior.json", _actuator),
        _document("policy.json", policy, "policy.json", load_policy),
        _document("deploy.yaml", onnx, "deploy.yaml", read_wiring),
        _document("manifest.json", result, "manifest.json", lambda place: read_entry(place).verify()),
        _document(
            "diagnosis.json", diagnosis, "diagnosis.json", lambda place: read_diagnosis(place / "diagnosis.json")
        ),
    ]


def _example(target: Path, source: Path, *patterns: str) -> Path:
    target.mkdir(parents=True)
    for pattern in patterns:
        for path in source.glob(pattern):
            shutil.copy(path, target)
    return target


def _document(name: str, base: Path, file: str, read: Callable[[Path], Any]) -> Target:
    changes = st.fixed_dictionaries(
        {
            "tree": st.lists(tree_changes(load(base / file)), max_size=2),
            "text": st.one_of(st.none(), st.none(), text_changes),
        }
    )

    def apply(folder: Path, change: dict[str, Any]) -> None:
        data = load(folder / file)
        for each in change["tree"]:
            data = change_tree(data, each)
        if change["tree"]:
            (folder / file).write_bytes(dump(data, file))
        change_file(folder / file, change["text"])

    return Target(name, base, changes, apply, read)


def change_file(path: Path, change: dict[str, Any] | None) -> None:
    """One change of a file's bytes, or none."""
    if change:
        path.write_bytes(change_bytes(path.read_bytes(), change))


def load(path: Path) -> Any:
    text = path.read_text(encoding="utf-8")
    return yaml.safe_load(text) if path.suffix == ".yaml" else json.loads(text)


def dump(data: Any, file: str) -> bytes:
    if file.endswith(".yaml"):
        return yaml.safe_dump(data, sort_keys=False).encode(errors="surrogatepass")
    return json.dumps(data, ensure_ascii=False).encode(errors="surrogatepass")


def _plan(folder: Path) -> None:
    """Plan the whole chain, which reads the configuration and runs nothing."""
    file = folder / "arguments.json"
    more = json.loads(file.read_text()) if file.is_file() else []
    code, out, err = command(folder, "run", "all", "--dry-run", "--json", *more)
    if code != 0:
        try:
            error = json.loads(out).get("error")
        except (ValueError, AttributeError):
            error = None
        raise Refused(code if code is not None else 1, error, err)


def _settings() -> st.SearchStrategy[Any]:
    """Overrides of any parameter of any stage by anything."""
    keys = []
    for stage in STAGES.values():
        keys += [f"{stage.section}.{name}" for name in _flat(stage.load_params()().model_dump(mode="json"))]
    odd = st.one_of(values.map(lambda value: json.dumps(value, ensure_ascii=True)), texts, numbers.map(str))
    one = st.builds(
        lambda key, spoiled, value: f"{key}{spoiled}={value}",
        st.sampled_from(keys),
        st.sampled_from(["", "", "", "", "x", ".nope", ".0"]),
        odd,
    )
    words = st.one_of(one, one, one, texts)
    return st.lists(words, min_size=1, max_size=2)


def _flat(params: dict[str, Any], above: str = "") -> list[str]:
    found = []
    for key, value in params.items():
        found.append(f"{above}{key}")
        if isinstance(value, dict):
            found += _flat(value, f"{above}{key}.")
    return found


def _write_arguments(folder: Path, change: list[str]) -> None:
    arguments = [word for text in change for word in ("--set", text)]
    (folder / "arguments.json").write_text(json.dumps(arguments))


def _robot(folder: Path) -> None:
    robot = load_robot(folder)
    setup = robot_setup(robot)
    robot_spec(setup, setup.variants[0]).compile()


def _actuator(folder: Path) -> None:
    load_posterior(folder, load_actuator(folder))


def _urdf_changes(urdf: Path) -> st.SearchStrategy[Any]:
    elements = list(ElementTree.parse(urdf).iter())
    attributes = [[number, name] for number, element in enumerate(elements) for name in element.attrib]
    number = st.integers(1, len(elements) - 1)
    odd = st.one_of(texts, numbers.map(str), st.lists(numbers.map(str), min_size=3, max_size=3).map(" ".join))
    one = st.one_of(
        st.fixed_dictionaries({"do": st.just("set"), "at": st.sampled_from(attributes), "value": odd}),
        st.fixed_dictionaries({"do": st.just("set"), "at": st.sampled_from(attributes), "value": odd}),
        st.fixed_dictionaries({"do": st.just("unset"), "at": st.sampled_from(attributes)}),
        st.fixed_dictionaries(
            {"do": st.just("tag"), "at": number, "value": st.sampled_from(["link", "joint", "mesh"])}
        ),
        st.fixed_dictionaries({"do": st.sampled_from(["empty", "double", "remove"]), "at": number}),
    )
    text = st.one_of(st.none(), st.none(), text_changes)
    return st.fixed_dictionaries({"tree": st.lists(one, max_size=2), "text": text})


def _change_urdf(folder: Path, change: dict[str, Any]) -> None:
    path = folder / "robot.urdf"
    tree = ElementTree.parse(path)
    for each in change["tree"]:
        _change_element(tree, each)
    if change["tree"]:
        # ElementTree writes what XML forbids as well; a text that no encoding takes is left as it was.
        data = ElementTree.tostring(tree.getroot(), encoding="unicode").encode(errors="surrogatepass")
        path.write_bytes(data)
    change_file(path, change["text"])


def _change_element(tree: ElementTree.ElementTree, change: dict[str, Any]) -> None:
    elements = list(tree.iter())
    parents = {child: parent for parent in elements for child in parent}
    number, *name = change["at"] if isinstance(change["at"], list) else [change["at"]]
    element = elements[min(number, len(elements) - 1)]
    kind = change["do"]
    if kind == "set":
        element.set(name[0], change["value"])
    elif kind == "unset":
        element.attrib.pop(name[0], None)
    elif kind == "tag":
        element.tag = change["value"]
    elif kind == "empty":
        element.clear()
    elif element in parents:
        parents[element].append(element) if kind == "double" else parents[element].remove(element)
