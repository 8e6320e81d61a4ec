"""Text tables: CSV, TSV and their relatives."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.logs.imports.arrays import listed
from hqpipe.logs.imports.csv_layout import BLANKS, COMMENT, MISSING, Layout, find_layout
from hqpipe.logs.imports.decoding import decoding
from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream

_SAMPLE = 1 << 17  # bytes in which header and first rows are looked for
_HEAD = 512  # bytes; binary formats have zeros in their headers
_UNICODE = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}
_ROW_ENDS = (b";", b",")
_MOST_BAD = 0.1  # assumption: a table with more rows of another length has been misread


class CsvReader:
    """Tables with a delimiter of any kind; columns of text are left out."""

    suffixes = (".csv", ".tsv", ".txt", ".dat", ".log")
    extra = None

    @staticmethod
    def claims_file(path: Path) -> bool:
        """Whether it is text: .dat and .log are suffixes of binary formats too."""
        if path.suffix.casefold() in CsvReader.suffixes[:3]:
            return True
        with path.open("rb") as stream:
            head = stream.read(_HEAD)
        return b"\0" not in head or head[:2] in _UNICODE

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """One recording with one stream. Missing cells are NaN; rows of another length than most are dropped with a note.

        Raises:
            ImportLogError: empty, no text, no row of numbers, or a header or rows of other lengths than most rows.
        """
        with decoding(path, "a table"):
            text, ends = _without_row_ends(_text(path))
            sample = text[:_SAMPLE]
            lines = sample.decode("utf-8", "replace").splitlines()
            layout = find_layout(lines[:-1] if len(text) > _SAMPLE else lines)
            if layout is None:
                raise ImportLogError(f"{path}: no row of numbers in it", file=path, fix="leave it out")
            if layout.unclear:  # a header of another program version; names would stand at the wrong columns
                raise ImportLogError(f"{path}: {layout.unclear}", file=path, fix="correct the header")
            fields, notes = _columns(path, text, layout)
            _drop_empty_end(fields, layout)
        if not fields:
            raise ImportLogError(f"{path}: no column of numbers in it", file=path, fix="leave it out")
        units = {name: unit for name, unit in zip(layout.names, layout.units, strict=True) if unit and name in fields}
        dates = [n for n, kind in zip(layout.names, layout.kinds, strict=True) if kind == "date"]
        units |= {name: "s" for name in dates if name in fields}
        return [Recording(path, (Stream("", fields, units),), notes=(*ends, *layout.notes, *notes))]


def _text(path: Path) -> bytes:
    """The content in UTF-8 with plain line ends."""
    content = path.read_bytes()
    encoding = next((name for mark, name in _UNICODE.items() if content.startswith(mark)), None)
    if encoding:
        content = content.decode(encoding, "replace").encode("utf-8")
    elif b"\0" in content[:_SAMPLE]:
        raise ImportLogError(f"{path}: not text (holds zero bytes)", file=path, fix="export it as CSV")
    else:
        try:
            content.decode("utf-8")
        except UnicodeDecodeError:  # degree signs of older Windows programs
            content = content.decode("cp1252", "replace").encode("utf-8")
    return content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def _without_row_ends(text: bytes) -> tuple[bytes, list[str]]:
    """The text without a sign that ends every row and separates nothing, as in `0.1,0.2;`, and a note on it."""
    lines = [line.rstrip() for line in text[:_SAMPLE].split(b"\n")[: -1 if len(text) > _SAMPLE else None]]
    lines = [line for line in lines if line and not COMMENT.match(line.decode("utf-8", "replace"))]
    for sign in _ROW_ENDS:
        rows = [line for line in lines if line[:1].isdigit() or line[:1] in b"+-."]
        between = any(sign in line[:-1] for line in lines)
        if len(rows) > 1 and not between and all(line.endswith(sign) for line in rows):
            return re.sub(rb"(?m)" + re.escape(sign) + rb"[ \t]*$", b"", text), [
                f"'{sign.decode()}' at the end of rows skipped"
            ]
    return text, []


def _drop_empty_end(fields: dict[str, np.ndarray], layout: Layout) -> None:
    """Leave out the empty column without a name that a delimiter at the end of rows makes."""
    last = f"column{len(layout.names) - 1}"
    if len(fields) > 1 and layout.names[-1] == last and last in fields and np.isnan(fields[last]).all():
        del fields[last]


def _columns(path: Path, text: bytes, layout: Layout) -> tuple[dict[str, np.ndarray], list[str]]:
    """Name → (T,) float64, and notes."""
    import pyarrow as pa

    body = text.split(b"\n", layout.first)[layout.first]
    delimiter = layout.delimiter
    if delimiter == BLANKS:
        body, delimiter = re.sub(rb"(?m)^\t+|\t+$", b"", re.sub(rb"[ \t]+", b"\t", body)), "\t"
    wanted = [n for n, kind in zip(layout.names, layout.kinds, strict=True) if kind != "text"]
    texts = [n for n in layout.names if n not in wanted]
    notes = [f"columns of text left out: {listed(texts)}"] if texts else []
    numbers = {n for n, kind in zip(layout.names, layout.kinds, strict=True) if kind == "number"}
    try:
        table, bad = _parsed(body, delimiter, layout, wanted, {n: pa.float64() for n in numbers})
    except pa.ArrowInvalid:  # a cell that is no number: everything as text, then cell by cell
        table, bad = _parsed(body, delimiter, layout, wanted, {})
    if bad:
        if len(bad) > _MOST_BAD * (table.num_rows + len(bad)):
            what = f"{path}: {len(bad)} of {table.num_rows + len(bad)} rows have not {len(layout.names)} cells"
            raise ImportLogError(what, file=path, fix="export it again, one table a file")
        notes.append(f"{len(bad)} rows dropped that have not {len(layout.names)} cells")
    fields = {}
    for name, kind in zip(layout.names, layout.kinds, strict=True):
        if name in wanted:
            fields[name], lost = _numbers(table.column(name), kind, layout.decimal)
            notes += [f"column '{name}': {lost} cells are no {kind}"] if lost else []
    return fields, notes


def _parsed(
    body: bytes, delimiter: str, layout: Layout, wanted: list[str], types: dict[str, Any]
) -> tuple[Any, list[int]]:
    """The rows of a table, columns without a type as text, and the lengths of the rows that do not fit."""
    import pyarrow as pa
    from pyarrow import csv

    bad: list[int] = []

    def skip(row: Any) -> str:
        bad.append(row.actual_columns)
        return "skip"

    table = csv.read_csv(
        pa.BufferReader(body),
        read_options=csv.ReadOptions(column_names=list(layout.names)),
        parse_options=csv.ParseOptions(delimiter=delimiter, invalid_row_handler=skip, ignore_empty_lines=True),
        convert_options=csv.ConvertOptions(
            column_types={n: types.get(n, pa.string()) for n in wanted},
            include_columns=wanted,
            null_values=[word for each in MISSING for word in {each, each.upper(), each.capitalize()}] + ["NaN"],
            strings_can_be_null=True,
            decimal_point=layout.decimal,
        ),
    )
    return table, bad


def _numbers(column: Any, kind: str, decimal: str) -> tuple[np.ndarray, int]:
    """(T,) float64, NaN where no value is, and how many cells hold something else."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_floating(column.type):
        return np.asarray(column.to_numpy(), np.float64), 0
    column = pc.utf8_trim_whitespace(column)
    present = len(column) - column.null_count
    if kind == "truth":
        lower = pc.utf8_lower(column)
        column = pc.if_else(pc.equal(lower, "true"), 1.0, pc.if_else(pc.equal(lower, "false"), 0.0, None))
    elif kind == "date":
        fits = pc.match_substring_regex(
            column, r"^\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d{1,9})?)?(Z|[+-]\d\d:?\d\d)?$"
        )
        column = _dates(pc.if_else(fits, column, None))
    else:
        if decimal == ",":
            column = pc.replace_substring(column, ",", ".")
        pattern = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|^[+-]?[iI]nf(inity)?$"
        column = pc.replace_substring_regex(column, r"^\+", "")
        column = pc.if_else(pc.match_substring_regex(column, pattern), column, None)
    values = np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False), np.float64)
    return values, present - int(np.isfinite(values).sum()) if kind != "number" else present - int(
        (~np.isnan(values)).sum()
    )


def _dates(column: Any) -> Any:
    """Seconds since 1970."""
    import pyarrow as pa
    import pyarrow.compute as pc

    zoned = bool(pc.any(pc.match_substring_regex(column, r"(Z|[+-]\d\d:?\d\d)$")).as_py())
    times = column.cast(pa.timestamp("ns", tz="UTC") if zoned else pa.timestamp("ns"))
    return pc.divide(times.cast(pa.int64()).cast(pa.float64(), safe=False), 1e9)
