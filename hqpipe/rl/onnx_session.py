"""ONNX Runtime as it is used here, on one thread: opening a policy's graph, its agreement with torch, and its speed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime

from hqpipe.errors import ConfigError
from hqpipe.files.documents import read_bytes
from hqpipe.rl.controller import ACTIONS, ESTIMATE, INPUT

LARGEST = 2**29  # bytes; a policy of hqpipe has 0.5 MB
_FIX = "run hqpipe export again, or give a graph that maps float32 obs (B, n) to actions (B, J)"
_FLOAT = "tensor(float)"


def open_session(path: Path) -> onnxruntime.InferenceSession:
    """An ONNX Runtime session on one thread, as on the machine's computer.

    Raises:
        ConfigError: the file is missing, no ONNX model, one that reads other files, or not a graph from obs to actions.
    """
    content = read_bytes(path, _FIX, LARGEST)
    _check_self_contained(content, path)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what it would print to the terminal is in the error
    try:
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime has a dozen kinds without a common base
        raise _wrong(path, f"ONNX Runtime cannot load it ({_line(error)})") from error
    _check_ends(session, path)
    return session


def _check_self_contained(content: bytes, path: Path) -> None:
    """Refuse a model that keeps tensors in other files: these could lie anywhere, and no hash covers them."""
    import onnx
    from google.protobuf.message import DecodeError

    try:
        model = onnx.load_model_from_string(content)
    except (DecodeError, ValueError, RecursionError) as error:
        raise _wrong(path, f"not an ONNX model ({_line(error)})") from error
    for tensor in _tensors(model):
        if tensor.data_location == onnx.TensorProto.EXTERNAL or tensor.external_data:
            raise _wrong(path, f"tensor '{tensor.name[:80]}' lies in another file", field=tensor.name[:80])


def _tensors(model: Any) -> Iterator[Any]:
    """Every tensor of a model, those inside of nodes, nested graphs and functions too."""
    waiting = [model.graph]
    nodes = [node for function in model.functions for node in function.node]
    while waiting or nodes:
        if waiting:
            graph = waiting.pop()
            yield from graph.initializer
            for sparse in graph.sparse_initializer:
                yield from (sparse.values, sparse.indices)
            nodes += graph.node
            continue
        for attribute in nodes.pop().attribute:
            yield from (attribute.t, *attribute.tensors)
            for sparse in (attribute.sparse_tensor, *attribute.sparse_tensors):
                yield from (sparse.values, sparse.indices)
            waiting += [graph for graph in (attribute.g, *attribute.graphs) if graph.ByteSize()]


def _check_ends(session: onnxruntime.InferenceSession, path: Path) -> None:
    inputs, outputs = session.get_inputs(), {end.name: end for end in session.get_outputs()}
    if [end.name for end in inputs] != [INPUT]:
        raise _wrong(path, f"inputs are {_names(inputs)}, expected {INPUT}", field=INPUT)
    if ACTIONS not in outputs:
        raise _wrong(path, f"outputs are {_names(session.get_outputs())}, expected {ACTIONS}", field=ACTIONS)
    for end in (inputs[0], *(outputs[name] for name in (ACTIONS, ESTIMATE) if name in outputs)):
        if end.type != _FLOAT:
            raise _wrong(path, f"{end.name} is {end.type}, expected {_FLOAT}", field=end.name)
        if len(end.shape) != 2:
            raise _wrong(path, f"{end.name} has shape {end.shape}, expected (B, n)", field=end.name)
    if not isinstance(inputs[0].shape[1], int) or inputs[0].shape[1] < 1:
        raise _wrong(path, f"{INPUT} has shape {inputs[0].shape}, expected (B, n) with a known n", field=INPUT)
    if isinstance(inputs[0].shape[0], int) and inputs[0].shape[0] != 1:
        raise _wrong(path, f"{INPUT} has shape {inputs[0].shape}, expected any number of rows, or one", field=INPUT)


def run(
    session: onnxruntime.InferenceSession, outputs: list[str], observations: np.ndarray, path: Path
) -> list[np.ndarray]:
    """`outputs` of a graph of `open_session` for `observations` (B, n).

    Raises:
        ConfigError: the graph takes observations of another size, or fails on these.
    """
    wanted = session.get_inputs()[0].shape[1]
    if observations.shape[1] != wanted:
        raise _wrong(path, f"{INPUT} has {wanted} numbers, expected {observations.shape[1]}", field=INPUT)
    try:
        return session.run(outputs, {INPUT: observations})
    except Exception as error:  # as in open_session
        raise _wrong(path, f"ONNX Runtime cannot run it ({_line(error)})") from error


def parity(path: Path, observations: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference between the graph's actions for `observations` (B, n) and `expected` (B, J), rad."""
    (actual,) = run(open_session(path), [ACTIONS], observations, path)
    if actual.shape != expected.shape:
        raise _wrong(path, f"{ACTIONS} have shape {actual.shape}, expected {expected.shape}", field=ACTIONS)
    return float(np.abs(actual - expected).max())


def latency(path: Path, repeats: int = 2000) -> dict[str, float]:
    """Time of one call with a batch of one: median and 99th percentile, µs."""
    session = open_session(path)
    seen = np.zeros((1, session.get_inputs()[0].shape[1]), dtype=np.float32)
    run(session, [ACTIONS], seen, path)
    for _ in range(repeats // 10):
        session.run([ACTIONS], {INPUT: seen})
    times = np.empty(repeats)
    for i in range(repeats):
        began = time.perf_counter()
        session.run([ACTIONS], {INPUT: seen})
        times[i] = time.perf_counter() - began
    return {"median_us": float(np.median(times)) * 1e6, "p99_us": float(np.quantile(times, 0.99)) * 1e6}


def _names(ends: Any) -> str:
    return ", ".join(end.name for end in ends)[:200] or "none"


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def _wrong(path: Path, problem: str, field: str | None = None) -> ConfigError:
    return ConfigError(f"{path}: {problem}", file=path, field=field, fix=_FIX)
