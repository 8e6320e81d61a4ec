"""Log sets from outside: Parquet with odd types, values, names and clocks, and logset.yaml."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from hypothesis import strategies as st

from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.units import unit_findings  # noqa: F401 – loaded before the workers fork

from .chain import Chain
from .fuzz import Target
from .fuzz_documents import _document, change_file
from .odd import numbers, text_changes, texts, values

_TRIALS = {"walk_04_fit.parquet": "fit", "walk_04.parquet": "heldout"}
_JOINTS = ("LFR", "LFP")
_ROWS = 1000  # one second, the shortest that a fit accepts with room to spare
_COLUMN = (
    "drop", "rename", "misspell", "type", "value", "value", "value", "rows", "constant", "scale", "null", "noise", "copy",
)  # fmt: skip
_TABLE = ("no rows", "one row", "cut rows", "twice the rows", "double column", "no metadata", "metadata", "nested")
_CLOCK = ("backwards", "jump", "jitter", "equal", "nan", "negative", "milliseconds", "late", "integer")
_TYPES = (
    "string", "int8", "int64", "bool", "float16", "float64", "timestamp", "decimal", "dictionary", "list", "binary",
    "duration", "null",
)  # fmt: skip


def log_targets(chain: Chain, folder: Path) -> list[Target]:
    """Targets with a log set of two short trials as their example; what is read is fitted too."""
    base = folder / "logs"
    base.mkdir(parents=True)
    source = chain.folder / "artifacts" / "rollouts"
    for file in _TRIALS:
        table = pq.read_table(source / file).slice(0, _ROWS)
        names = [n for n in table.column_names if not n.startswith("joint/") or n.split("/")[1] in _JOINTS]
        metadata = {**table.schema.metadata, b"joints": ",".join(_JOINTS).encode()}
        pq.write_table(table.select(names).replace_schema_metadata(metadata), base / file)
    text = "".join(f"- {{file: {file}, split: {split}}}\n" for file, split in _TRIALS.items())
    (base / "logset.yaml").write_text(f"format: hqpipe-log/1\nrate_hz: 1000\ntrials:\n{text}")
    columns = pq.read_schema(base / "walk_04.parquet").names
    return [
        Target("logs: parquet", base, _changes(columns), _apply, _read),
        _document("logs: logset.yaml", base, "logset.yaml", _read),
        Target("logs: folder", base, _folder_changes(), _change_folder, _read),
    ]


def _read(folder: Path) -> None:
    """As fit-actuator does, without rivals and figures."""
    fit_actuator(read_log_set(folder), scope="shared")


def _changes(columns: list[str]) -> st.SearchStrategy[Any]:
    joints = [name for name in columns if name.startswith("joint/")]
    column = st.one_of(st.sampled_from(joints), st.sampled_from(columns))
    one = st.one_of(
        st.fixed_dictionaries(
            {
                "do": st.sampled_from(_COLUMN),
                "column": column,
                "other": column,
                "row": st.integers(0, _ROWS - 1),
                "type": st.sampled_from(_TYPES),
                "number": numbers,
                "text": texts,
            }
        ),
        st.fixed_dictionaries({"do": st.sampled_from(_TABLE), "row": st.integers(0, _ROWS - 1), "value": values}),
        st.fixed_dictionaries({"do": st.sampled_from(_CLOCK), "row": st.integers(1, _ROWS - 1), "number": numbers}),
    )
    return st.fixed_dictionaries(
        {
            "file": st.sampled_from(sorted(_TRIALS)),
            "table": st.lists(one, max_size=2),
            "text": st.one_of(st.none(), st.none(), st.none(), text_changes),
        }
    )


def _apply(folder: Path, change: dict[str, Any]) -> None:
    path = folder / change["file"]
    table = pq.read_table(path)
    for each in change["table"]:
        try:
            table = _change_table(table, each)
        except (pa.ArrowException, KeyError, ValueError, OverflowError, TypeError, IndexError):
            continue  # Parquet has no place for it
    if change["table"]:
        try:
            pq.write_table(table, path)
        except (pa.ArrowException, UnicodeError):
            pass
    change_file(path, change["text"])


def _change_table(table: pa.Table, change: dict[str, Any]) -> pa.Table:
    kind = change["do"]
    if kind in _CLOCK:
        return _change_clock(table, kind, change)
    if kind in _TABLE:
        return _change_shape(table, kind, change)
    name = change["column"]
    at = table.column_names.index(name)
    if kind == "drop":
        return table.drop_columns([name])
    if kind in ("rename", "misspell"):
        new = change["text"] if kind == "rename" else name[:-1]
        return table.rename_columns([new if n == name else n for n in table.column_names])
    if kind == "type":
        return table.set_column(at, name, _typed(table[name], change["type"]))
    return table.set_column(at, name, pa.array(_column(table, kind, change)))


def _column(table: pa.Table, kind: str, change: dict[str, Any]) -> Any:
    column = table[change["column"]].to_numpy().astype(np.float64)
    row, number = change["row"], float(change["number"])
    if kind == "null":
        return [None if i == row else float(value) for i, value in enumerate(column)]
    if kind == "value":
        column[row] = number
    elif kind == "rows":
        column[row:] = number
    elif kind == "constant":
        column[:] = column[row]
    elif kind == "scale":
        column = column * number
    elif kind == "noise":
        column = column + number * np.random.default_rng(row).standard_normal(len(column))
    elif kind == "copy":
        column = table[change["other"]].to_numpy()
    return column


def _change_clock(table: pa.Table, kind: str, change: dict[str, Any]) -> pa.Table:
    time, row = table["time"].to_numpy().copy(), change["row"]
    if kind == "backwards":
        time = time[::-1].copy()
    elif kind == "jump":
        time[row:] += float(change["number"])
    elif kind == "jitter":
        time += 1e-3 * np.random.default_rng(row).random(len(time))
    elif kind == "equal":
        time[row] = time[row - 1]
    elif kind == "nan":
        time[row] = np.nan
    elif kind == "negative":
        time -= 1e3
    elif kind == "milliseconds":
        time *= 1e3
    elif kind == "late":
        time += 1.7e9
    column = pa.array((1e9 * time).astype(np.int64)) if kind == "integer" else pa.array(time)
    return table.set_column(table.column_names.index("time"), "time", column)


def _change_shape(table: pa.Table, kind: str, change: dict[str, Any]) -> pa.Table:
    if kind in ("no rows", "one row", "cut rows"):
        return table.slice(0, {"no rows": 0, "one row": 1}.get(kind, change["row"]))
    if kind == "twice the rows":
        return pa.concat_tables([table, table])
    if kind == "double column":
        return table.append_column(table.column_names[change["row"] % table.num_columns], table.column(0))
    if kind == "nested":
        return table.append_column("extra", pa.array([{"a": [1.0]}] * len(table)))
    if kind == "no metadata":
        return table.replace_schema_metadata(None)
    keys = sorted(table.schema.metadata)
    odd = json.dumps(change["value"]).encode()
    return table.replace_schema_metadata({**table.schema.metadata, keys[change["row"] % len(keys)]: odd})


def _typed(column: pa.ChunkedArray, name: str) -> Any:
    if name == "list":
        return pa.array([[value] for value in column.to_pylist()])
    if name == "dictionary":
        return column.cast(pa.string()).dictionary_encode()
    types = {
        "timestamp": pa.timestamp("us"), "decimal": pa.decimal128(30, 9), "duration": pa.duration("us"),
        "binary": pa.binary(), "bool": pa.bool_(), "float16": pa.float16(), "null": pa.null(),
    }  # fmt: skip
    if name in ("timestamp", "duration"):
        return column.cast(pa.int64(), safe=False).cast(types[name])
    if name == "binary":
        return column.cast(pa.string()).cast(pa.binary())
    if name == "null":
        return pa.nulls(len(column))
    return column.cast(types.get(name, pa.type_for_alias(name) if name not in types else None), safe=False)


def _folder_changes() -> st.SearchStrategy[Any]:
    kinds = [
        "no logset.yaml",
        "only held out",
        "copy as held out",
        "folder as file",
        "link",
        "loop",
        "csv",
        "extra",
        "none",
    ]
    return st.fixed_dictionaries(
        {
            "do": st.sampled_from(kinds),
            "file": st.sampled_from(sorted(_TRIALS)),
            "name": texts,
            "hex": st.binary().map(bytes.hex),
        }
    )


def _change_folder(folder: Path, change: dict[str, Any]) -> None:
    path, kind = folder / change["file"], change["do"]
    manifest = folder / "logset.yaml"
    if kind == "no logset.yaml":
        manifest.unlink()
    elif kind == "only held out":
        manifest.write_text(manifest.read_text().replace("split: fit", "split: heldout"))
    elif kind == "copy as held out":
        shutil.copy(folder / "walk_04_fit.parquet", folder / "walk_04.parquet")
    elif kind == "folder as file":
        path.unlink()
        path.mkdir()
    elif kind in ("link", "loop"):
        path.unlink()
        path.symlink_to("/etc/hostname" if kind == "link" else path.name)
    elif kind == "csv":
        path.write_bytes(bytes.fromhex(change["hex"]))
    elif kind == "none":
        shutil.rmtree(folder)
        folder.mkdir()
    elif kind == "extra":
        try:
            (folder / f"{change['name']}.parquet").write_bytes(path.read_bytes())
        except (OSError, ValueError):
            pass  # no file can have this name
        manifest.unlink()
