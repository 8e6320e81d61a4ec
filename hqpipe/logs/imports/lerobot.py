"""Data sets of LeRobot, versions 2.0 to 3: a folder with meta/info.json and Parquet files under data/."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.files.documents import read_json
from hqpipe.logs.imports.arrays import listed
from hqpipe.logs.imports.messages import MOST_COMPONENTS
from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream
from hqpipe.logs.parquet_file import opened

_INFO = Path("meta", "info.json")
_CLOCK, _EPISODE, _FRAME = "timestamp", "episode_index", "frame_index"
_FIX = "download the data set again"
_NUMBERS = ("float16", "float32", "float64", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "bool")
_NOMINAL = 1e-4  # s; timestamps are float32, which is 6e-5 s at ten minutes


class LerobotReader:
    """State, action and other vectors of numbers; images and videos are not read."""

    suffixes = ()
    extra = None

    @staticmethod
    def claims_folder(folder: Path) -> bool:
        """Whether a folder is a data set of LeRobot."""
        return (folder / _INFO).is_file() and (folder / "data").is_dir()

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """One recording per episode, named `episode_000003`; components are named as meta/info.json names them.

        Raises:
            ImportLogError: meta/info.json or a Parquet file is missing, damaged or not as LeRobot writes them.
        """
        info = read_json(path / _INFO, _FIX, ImportLogError)
        features, rate = _features(path, info)
        fields, left = _fields(features)
        files = sorted((path / "data").glob("chunk-*/*.parquet"))
        if not files:
            raise ImportLogError(f"{path}: no Parquet file under data/", file=path, fix=_FIX)
        episodes: dict[int, list[dict[str, np.ndarray]]] = {}
        for file in files:
            for episode, part in _parts(file, fields):
                episodes.setdefault(episode, []).append(part)
        notes = (f"left out {listed(left)} (images, text, or more than {MOST_COMPONENTS} components)",) if left else ()
        return [_recording(path, episode, episodes[episode], rate, notes) for episode in sorted(episodes)]


def _features(path: Path, info: Any) -> tuple[dict[str, dict], float | None]:
    """Column → its description, and frames per second."""
    features = info.get("features") if isinstance(info, dict) else None
    if not isinstance(features, dict) or not all(isinstance(each, dict) for each in features.values()):
        what = f"{path / _INFO}: features: expected a mapping of columns to their type and shape"
        raise ImportLogError(what, file=path / _INFO, field="features", fix=_FIX)
    for name in (_CLOCK, _EPISODE):
        if name not in features:
            what = f"{path / _INFO}: features: no '{name}', which every data set has"
            raise ImportLogError(what, file=path / _INFO, field=f"features.{name}", fix=_FIX)
    rate = info.get("fps")
    return features, float(rate) if isinstance(rate, (int, float)) and rate > 0 else None


def _fields(features: dict[str, dict]) -> tuple[dict[str, list[str]], list[str]]:
    """Column → names of its components, and the columns that are left out."""
    kept, left = {}, []
    for name, feature in features.items():
        shape = feature.get("shape")
        whole = isinstance(shape, list) and len(shape) == 1 and isinstance(shape[0], int)
        if feature.get("dtype") not in _NUMBERS or not whole or not 1 <= shape[0] <= MOST_COMPONENTS:
            left.append(name)
        else:
            kept[name] = _component_names(name, shape[0], feature.get("names"))
    return kept, left


def _component_names(name: str, count: int, given: Any) -> list[str]:
    """Names of the components; a mapping such as {motors: […]} is how earlier versions wrote them."""
    if isinstance(given, dict) and len(given) == 1:
        given = next(iter(given.values()))
    if isinstance(given, list) and len(given) == count and count > 1 and len(set(map(str, given))) == count:
        return [f"{name}/{each}" for each in given]
    return [name] if count == 1 else [f"{name}[{index}]" for index in range(count)]


def _parts(file: Path, fields: dict[str, list[str]]) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    """(episode, field → (T,)) for each run of rows of one episode, of one file."""
    with opened(file) as parquet:
        columns = [name for name in fields if name in parquet.schema_arrow.names]
        for name in (_CLOCK, _EPISODE):
            if name not in columns:
                raise ImportLogError(f"{file}: no column '{name}'", file=file, field=name, fix=_FIX)
        for batch in parquet.iter_batches(columns=columns):
            rows: dict[str, np.ndarray] = {}
            for name in columns:
                rows |= _components(file, name, batch.column(name), fields[name])
            episodes = rows.pop(_EPISODE)
            if not np.all(np.isfinite(episodes)):
                raise ImportLogError(f"{file}: {_EPISODE} is missing in some rows", file=file, field=_EPISODE, fix=_FIX)
            for episode in dict.fromkeys(episodes.tolist()):
                yield int(episode), {name: values[episodes == episode] for name, values in rows.items()}


def _components(file: Path, name: str, column: Any, names: list[str]) -> dict[str, np.ndarray]:
    """Component → (T,) float64 of one column of scalars or lists."""
    import pyarrow as pa

    rows = len(column)
    if pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type) or pa.types.is_large_list(column.type):
        column = column.flatten()
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type) or pa.types.is_boolean(column.type)):
        what = f"{file}: column '{name}' holds {column.type}, expected numbers as meta/info.json says"
        raise ImportLogError(what, file=file, field=name, fix=_FIX)
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8())
    values = np.asarray(column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False), np.float64)
    if len(values) != rows * len(names):
        what = f"{file}: column '{name}' has rows of another length than {len(names)}, which meta/info.json says"
        raise ImportLogError(what, file=file, field=name, fix=_FIX)
    return dict(zip(names, values.reshape(-1, len(names)).T, strict=True))


def _recording(
    path: Path, episode: int, parts: list[dict[str, np.ndarray]], rate: float | None, notes: tuple[str, ...]
) -> Recording:
    names = [name for name in parts[0] if all(name in part for part in parts)]
    fields = {name: np.concatenate([part[name] for part in parts]) for name in names}
    order = np.argsort(fields[_CLOCK], kind="stable")
    fields = {name: values[order] for name, values in fields.items()}
    time = fields.pop(_CLOCK)
    frames = fields.get(_FRAME)
    if rate and frames is not None and np.allclose(time, frames / rate, rtol=0, atol=_NOMINAL):
        notes = (
            *notes,
            f"{_CLOCK} is {_FRAME} / {rate:g}: nominal, not measured, so that delays and jitter are not known",
        )
    stream = Stream("", fields, time=time - time[0], time_name=_CLOCK)
    return Recording(path, (stream,), name=f"episode_{episode:06d}", notes=notes)
