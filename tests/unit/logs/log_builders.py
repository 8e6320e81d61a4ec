"""Build a small two-joint log set as a user's own tool would write it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

JOINTS = ("hip", "knee")


def make_columns(samples: int = 2000, rate: float = 1000.0, seed: int = 0) -> dict[str, np.ndarray]:
    """Two joints under position control; the effort follows the position error."""
    rng = np.random.default_rng(seed)
    time = np.arange(samples) / rate
    columns = {"time": time}
    for j, joint in enumerate(JOINTS):
        rate_j = 2 * np.pi * (1.3 + 0.9 * j)
        command = 0.4 * np.sin(rate_j * time + j + seed)
        position = 0.4 * np.sin(rate_j * time + j + seed - 0.2) + 1e-5 * rng.normal(size=samples)
        columns[f"joint/{joint}/position"] = position
        columns[f"joint/{joint}/velocity"] = 0.4 * rate_j * np.cos(rate_j * time + j + seed - 0.2)
        columns[f"joint/{joint}/effort"] = 3000.0 * (command - position) + rng.normal(size=samples)
        columns[f"joint/{joint}/position_command"] = command
    return columns


def put(folder: Path, file: str, columns: dict[str, np.ndarray]) -> Path:
    folder.mkdir(exist_ok=True)
    pq.write_table(pa.table(columns), folder / file)
    return folder / file
