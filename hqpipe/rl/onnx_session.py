"""ONNX Runtime as it is used here, on one thread: its agreement with torch, and its speed."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import onnxruntime


def open_session(path: Path) -> onnxruntime.InferenceSession:
    """An ONNX Runtime session on one thread, as on the machine's computer."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])


def parity(path: Path, observations: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference between the graph's actions for `observations` (B, n) and `expected` (B, J), rad."""
    (actual,) = open_session(path).run(["actions"], {"obs": observations})
    return float(np.abs(actual - expected).max())


def latency(path: Path, repeats: int = 2000) -> dict[str, float]:
    """Time of one call with a batch of one: median and 99th percentile, µs."""
    session = open_session(path)
    seen = np.zeros((1, session.get_inputs()[0].shape[1]), dtype=np.float32)
    for _ in range(repeats // 10):
        session.run(["actions"], {"obs": seen})
    times = np.empty(repeats)
    for i in range(repeats):
        began = time.perf_counter()
        session.run(["actions"], {"obs": seen})
        times[i] = time.perf_counter() - began
    return {"median_us": float(np.median(times)) * 1e6, "p99_us": float(np.quantile(times, 0.99)) * 1e6}
