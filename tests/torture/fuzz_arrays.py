"""Networks and arrays from outside: safetensors, ONNX and NPZ, with their structure changed, or their bytes."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import onnx
from hypothesis import strategies as st

from hqpipe.actuators.files import load_actuator
from hqpipe.rl.controller import onnx_controller
from hqpipe.rl.policy_io import load_policy
from hqpipe.stages import validate

from .chain import Chain
from .fuzz import Target
from .fuzz_documents import _example, change_file
from .odd import change_tree, numbers, text_changes, texts, tree_changes


def array_targets(chain: Chain, folder: Path) -> list[Target]:
    """Targets with their examples under `folder`."""
    artifacts = chain.folder / "artifacts"
    policy = _example(folder / "policy", artifacts / "policy", "policy.json", "policy.safetensors")
    net = _example(folder / "net", artifacts / "actuator" / "rivals" / "mlp", "actuator.json", "weights.safetensors")
    exported = _example(folder / "onnx", artifacts / "onnx", "policy.onnx", "deploy.yaml", "parity.npz")
    return [
        _safetensors("policy.safetensors", policy, "policy.safetensors", load_policy),
        _safetensors("weights.safetensors", net, "weights.safetensors", load_actuator),
        Target("policy.onnx", exported, _graph_changes(exported / "policy.onnx"), _change_graph, _read_exported),
        Target("parity.npz", exported, _npz_changes(), _change_npz, _read_exported),
    ]


def _read_exported(folder: Path) -> None:
    """As validate does: the controller, one step of it, and its agreement with the reference."""
    onnx_controller(folder)
    validate._parity(SimpleNamespace(inputs={"onnx": folder}))


def _safetensors(name: str, base: Path, file: str, read: Any) -> Target:
    header, _ = _split(base / file)
    tree = st.lists(tree_changes(header), max_size=2)
    length = st.one_of(st.none(), st.none(), st.integers(0, 2**64 - 1), st.integers(-64, 64))
    content = st.one_of(st.none(), st.none(), st.sampled_from(["nan", "inf", "zero", "none", "half"]))
    text = st.one_of(st.none(), st.none(), text_changes)
    changes = st.fixed_dictionaries({"tree": tree, "length": length, "content": content, "text": text})

    def apply(folder: Path, change: dict[str, Any]) -> None:
        header, data = _split(folder / file)
        for each in change["tree"]:
            header = change_tree(header, each)
        written = json.dumps(header).encode()
        size = len(written) if change["length"] is None else (len(written) + change["length"]) % 2**64
        data = {"nan": b"\xff" * len(data), "inf": b"\0\0\x80\x7f" * (len(data) // 4), "zero": bytes(len(data))}.get(
            change["content"], {"none": b"", "half": data[: len(data) // 2]}.get(change["content"], data)
        )
        (folder / file).write_bytes(size.to_bytes(8, "little") + written + data)
        change_file(folder / file, change["text"])

    return Target(name, base, changes, apply, read)


def _split(path: Path) -> tuple[dict[str, Any], bytes]:
    """The header and the data of a safetensors file (github.com/huggingface/safetensors, Format)."""
    content = path.read_bytes()
    size = int.from_bytes(content[:8], "little")
    return json.loads(content[8 : 8 + size]), content[8 + size :]


_GRAPH = (
    "drop node", "operator", "rename input", "rename output", "dimension", "type", "opset", "version", "drop weight",
    "weight dimension", "weight value", "external", "double node", "drop output", "new input",
)  # fmt: skip


def _graph_changes(path: Path) -> st.SearchStrategy[Any]:
    one = st.fixed_dictionaries(
        {"do": st.sampled_from(_GRAPH), "at": st.integers(0, 50), "text": texts, "number": numbers}
    )
    text = st.one_of(st.none(), st.none(), text_changes)
    return st.fixed_dictionaries({"tree": st.lists(one, max_size=2), "text": text})


def _change_graph(folder: Path, change: dict[str, Any]) -> None:
    path = folder / "policy.onnx"
    model = onnx.load(path)
    for each in change["tree"]:
        try:
            _change_model(model, each)
        except (ValueError, TypeError, IndexError, OverflowError):
            continue  # the format has no place for this value
    if change["tree"]:
        path.write_bytes(model.SerializeToString())
    change_file(path, change["text"])


def _change_model(model: Any, change: dict[str, Any]) -> None:
    graph, kind, at = model.graph, change["do"], change["at"]
    node = graph.node[at % len(graph.node)]
    weight = graph.initializer[at % len(graph.initializer)]
    if kind == "drop node":
        graph.node.remove(node)
    elif kind == "double node":
        graph.node.append(node)
    elif kind == "operator":
        node.op_type = ["Relu", "MatMul", "Loop", "Identity", change["text"]][at % 5]
    elif kind == "rename input":
        graph.input[0].name = change["text"]
    elif kind == "rename output":
        graph.output[at % len(graph.output)].name = change["text"]
    elif kind == "drop output":
        del graph.output[at % len(graph.output)]
    elif kind == "new input":
        graph.input.append(onnx.helper.make_tensor_value_info(change["text"], 1, [1, 3]))
    elif kind == "dimension":
        graph.input[0].type.tensor_type.shape.dim[at % 2].dim_value = int(change["number"])
    elif kind == "type":
        graph.input[0].type.tensor_type.elem_type = at % 20
    elif kind == "opset":
        model.opset_import[0].version = int(change["number"])
    elif kind == "version":
        model.ir_version = int(change["number"])
    elif kind == "drop weight":
        graph.initializer.remove(weight)
    elif kind == "weight dimension":
        weight.dims[0] = int(change["number"])
    elif kind == "weight value":
        weight.raw_data = np.full(len(weight.raw_data) // 4, change["number"], np.float32).tobytes()
    elif kind == "external":
        weight.data_location = onnx.TensorProto.EXTERNAL
        weight.external_data.add(key="location", value="../../../etc/passwd")


_ARRAYS = ("drop", "dtype", "shape", "fill", "object", "empty", "rename", "scalar", "extra")
_TYPES = ("float64", "int8", "bool", "complex64", "U4", "M8[s]", "float16", "V3")


def _npz_changes() -> st.SearchStrategy[Any]:
    one = st.fixed_dictionaries(
        {
            "do": st.sampled_from(_ARRAYS),
            "array": st.sampled_from(["observations", "actions"]),
            "type": st.sampled_from(_TYPES),
            "shape": st.lists(st.integers(0, 50), max_size=4),
            "number": numbers,
        }
    )
    text = st.one_of(st.none(), st.none(), text_changes)
    return st.fixed_dictionaries({"tree": st.lists(one, max_size=2), "text": text})


def _change_npz(folder: Path, change: dict[str, Any]) -> None:
    path = folder / "parity.npz"
    with np.load(path) as stored:
        arrays = dict(stored)
    for each in change["tree"]:
        try:
            _change_array(arrays, each)
        except (KeyError, ValueError, TypeError, OverflowError):
            continue
    if change["tree"]:
        np.savez(path, **arrays)
    change_file(path, change["text"])


def _change_array(arrays: dict[str, Any], change: dict[str, Any]) -> None:
    name, kind = change["array"], change["do"]
    if kind == "drop":
        del arrays[name]
    elif kind == "rename":
        arrays[name.upper()] = arrays.pop(name)
    elif kind == "dtype":
        arrays[name] = arrays[name].astype(change["type"])
    elif kind == "shape":
        arrays[name] = np.resize(arrays[name], change["shape"])
    elif kind == "fill":
        arrays[name] = np.full_like(arrays[name], change["number"])
    elif kind == "object":
        arrays[name] = np.array([{"a": 1}], dtype=object)
    elif kind == "empty":
        arrays[name] = arrays[name][:0]
    elif kind == "scalar":
        arrays[name] = np.float64(change["number"])
    else:
        arrays["extra"] = np.zeros(3)
