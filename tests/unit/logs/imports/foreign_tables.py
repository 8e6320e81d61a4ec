"""One known machine's log, written as other programs would write it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

JOINTS = ("hip", "knee")
RATE = 200.0  # Hz
MAP = {
    "format": "hqpipe-log-map/1",
    "base": "fixed",
    "control_mode": "position",
    "effort_source": "pressure",
    "clock": {"field": "t", "unit": "ms"},
    "joints": {
        joint: {
            "position": {"field": f"q[{j}]", "unit": "deg"},
            "position_command": {"field": f"q_des[{j}]", "unit": "deg"},
            "effort": {"field": f"tau[{j}]", "unit": "kNm", "sign": -1},
            "pressure_a": {"field": f"pa[{j}]", "unit": "bar"},
        }
        for j, joint in enumerate(JOINTS)
    },
    "shared": {"supply/pressure": {"field": "ps", "unit": "MPa"}},
}


def machine(samples: int = 1000, seed: int = 0) -> dict[str, np.ndarray]:
    """Full column name → (T,) in SI."""
    rng = np.random.default_rng(seed)
    time = np.arange(samples) / RATE
    columns = {"time": time, "supply/pressure": 2.0e7 + 1e5 * rng.normal(size=samples)}
    for j, joint in enumerate(JOINTS):
        phase = 2 * np.pi * (1.0 + 0.4 * j) * time + seed
        columns[f"joint/{joint}/position"] = 0.8 * np.sin(phase - 0.2) + 1e-4 * rng.normal(size=samples)
        columns[f"joint/{joint}/position_command"] = 0.8 * np.sin(phase)
        columns[f"joint/{joint}/effort"] = 900.0 * np.cos(phase) + rng.normal(size=samples)
        columns[f"joint/{joint}/pressure_a"] = 9e6 + 5e6 * np.sin(phase)
    return columns


def as_recorded(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same in the recorder's units: name → (T,) or (T, 2)."""

    def both(channel: str, factor: float) -> np.ndarray:
        return np.column_stack([columns[f"joint/{joint}/{channel}"] for joint in JOINTS]) * factor

    return {
        "t": columns["time"] * 1e3,
        "q": both("position", 180.0 / np.pi),
        "q_des": both("position_command", 180.0 / np.pi),
        "tau": both("effort", -1e-3),
        "pa": both("pressure_a", 1e-5),
        "ps": columns["supply/pressure"] * 1e-6,
    }


def flat(recorded: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A column per component, `q[0]`, `q[1]`."""
    found = {}
    for name, values in recorded.items():
        found |= {name: values} if values.ndim == 1 else {f"{name}[{i}]": part for i, part in enumerate(values.T)}
    return found


def write_csv(path: Path, recorded: dict[str, np.ndarray], delimiter: str = ",", decimal: str = ".") -> None:
    columns = flat(recorded)
    lines = [delimiter.join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(delimiter.join(repr(float(value)).replace(".", decimal) for value in row))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_npz(path: Path, recorded: dict[str, np.ndarray]) -> None:
    np.savez(path, **recorded, mass=np.float64(3.0))


def write_mat5(path: Path, recorded: dict[str, np.ndarray]) -> None:
    from scipy.io import savemat

    savemat(path, {**recorded, "t": recorded["t"][:, None], "kp": 160.0})


def write_mat73(path: Path, recorded: dict[str, np.ndarray]) -> None:
    """As MATLAB 7.3 lays it out: HDF5 with the dimensions reversed."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in recorded.items():
            data = file.create_dataset(name, data=np.atleast_2d(values) if values.ndim == 1 else values.T)
            data.attrs["MATLAB_class"] = np.bytes_("double")
        text = file.create_dataset("note", data=np.array([[72, 105]], np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")


def write_hdf5(path: Path, recorded: dict[str, np.ndarray]) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in recorded.items():
            file[name] = values
        file["camera"] = np.zeros((4, 8, 8), np.uint8)


def write_parquet(path: Path, recorded: dict[str, np.ndarray]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = {n: v if v.ndim == 1 else pa.array(v.tolist(), pa.list_(pa.float64())) for n, v in recorded.items()}
    pq.write_table(pa.table({**columns, "label": ["x"] * len(recorded["t"])}), path)


WRITERS = {
    "a.csv": write_csv,
    "a.npz": write_npz,
    "a.mat": write_mat5,
    "b.mat": write_mat73,
    "a.h5": write_hdf5,
    "a.parquet": write_parquet,
}


def write_map(path: Path, content: dict = MAP) -> Path:
    path.write_text(yaml.safe_dump(content, allow_unicode=True, sort_keys=False), encoding="utf-8")
    return path
