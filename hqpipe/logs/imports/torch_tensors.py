"""Tensors in a file of torch.save, without unpickling it.

Such a file is a zip archive: `data.pkl`, a pickle program that describes the tensors, and `data/0`, `data/1`, …, their bytes. A
pickle may call any function when it is loaded. Here its instructions are read one by one, and only those that describe
tensors have a meaning; nothing that the file names is ever imported or called.
"""

from __future__ import annotations

import math
import pickletools
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.errors import shown
from hqpipe.logs.imports.decoding import decoding
from hqpipe.logs.imports.pickled_arrays import PickledArray, PickledType, bytes_of, type_of
from hqpipe.logs.imports.recording import ImportLogError

_FIX = "save it again with torch.save({'name': tensor, …}), tensors and nothing else"
_LARGEST_PROGRAM = 2**20  # bytes; a few tensors take some hundred
_DIMENSIONS = 2  # of a tensor: samples, and components
_TYPES = {
    "FloatStorage": "f4",
    "DoubleStorage": "f8",
    "HalfStorage": "f2",
    "LongStorage": "i8",
    "IntStorage": "i4",
    "ShortStorage": "i2",
    "CharStorage": "i1",
    "ByteStorage": "u1",
    "BoolStorage": "?",
}
_KEY = re.compile(r"\d{1,9}")
_MARK = object()


@dataclass(frozen=True)
class _Name:
    """A class or function that the program names; it stays a name."""

    text: str


@dataclass(frozen=True)
class _Storage:
    """Bytes in the archive: number type, entry under data/, and number of elements."""

    dtype: str
    key: str
    count: int


@dataclass(frozen=True)
class _Tensor:
    """A view of a storage, in elements."""

    storage: _Storage
    offset: int
    size: tuple[int, ...]
    stride: tuple[int, ...]


_REBUILD, _ORDERED = _Name("torch._utils _rebuild_tensor_v2"), _Name("collections OrderedDict")
_STORAGES = {_Name(f"torch {name}"): dtype for name, dtype in _TYPES.items()}
_RECONSTRUCT = {_Name(f"numpy.{core}.multiarray _reconstruct") for core in ("core", "_core")}
_NDARRAY, _DTYPE, _ENCODE = _Name("numpy ndarray"), _Name("numpy dtype"), _Name("_codecs encode")
_KNOWN = {_REBUILD, _ORDERED, *_STORAGES, *_RECONSTRUCT, _NDARRAY, _DTYPE, _ENCODE}


def read_tensors(path: Path) -> dict[str, np.ndarray]:
    """Name → array of each tensor and NumPy array in the dictionary that the file holds; other values are passed over.

    Raises:
        ImportLogError: no file of torch.save, damaged, or with anything in it that is no tensor, array, number or text.
    """
    with decoding(path, "a file of torch.save", _FIX), zipfile.ZipFile(path) as archive:
        entries = {entry.filename: entry for entry in archive.infolist()}
        programs = [name for name in entries if name.endswith("/data.pkl")]
        if len(programs) != 1:
            raise ImportLogError(f"{path}: no data.pkl in the archive", file=path, fix=_FIX)
        folder = programs[0].removesuffix("data.pkl")
        for entry in entries.values():
            if entry.file_size > path.stat().st_size or entry.compress_type != zipfile.ZIP_STORED:
                what = f"{path}: {shown(entry.filename)} is compressed, which torch.save never does"
                raise ImportLogError(what, file=path, fix=_FIX)
        if entries[programs[0]].file_size > _LARGEST_PROGRAM:
            raise ImportLogError(f"{path}: its description of tensors is too long", file=path, fix=_FIX)
        order = archive.read(f"{folder}byteorder") if f"{folder}byteorder" in entries else b"little"
        described = _Program(path).run(archive.read(programs[0]))
        sign = ">" if order == b"big" else "<"
        found = {}
        for name, value in described.items():
            if isinstance(value, _Tensor):
                found[name] = _array(path, value, archive, folder, sign)
            elif isinstance(value, PickledArray) and value.values is not None:
                found[name] = value.values
        return found


def _array(path: Path, tensor: _Tensor, archive: zipfile.ZipFile, folder: str, order: str) -> np.ndarray:
    storage = tensor.storage
    content = archive.read(f"{folder}data/{storage.key}")  # its checksum is verified
    dtype = np.dtype(order + storage.dtype)
    if len(content) != storage.count * dtype.itemsize:
        what = f"{path}: data/{storage.key} has {len(content)} bytes, expected {storage.count} × {dtype.itemsize}"
        raise ImportLogError(what, file=path, fix=_FIX)
    count = math.prod(tensor.size)
    last = tensor.offset + sum((n - 1) * step for n, step in zip(tensor.size, tensor.stride, strict=True))
    if count and (last >= storage.count or count > storage.count):
        raise ImportLogError(f"{path}: a tensor reaches beyond data/{storage.key}", file=path, fix=_FIX)
    flat = np.frombuffer(content, dtype)
    rows = np.indices(tensor.size).reshape(len(tensor.size), -1)
    places = tensor.offset + np.tensordot(np.array(tensor.stride, np.int64), rows, axes=1)
    return flat[places].reshape(tensor.size).astype(np.float64)


class _Program:
    """The instructions of a pickle that may describe tensors, on a stack and a memo of their own."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stack: list[Any] = []
        self._memo: dict[int, Any] = {}

    def run(self, program: bytes) -> dict[str, Any]:
        """What the program describes: a dictionary of text to tensors and other values.

        Raises:
            ImportLogError: an instruction or a name that has no place in such a description.
        """
        for opcode, argument, _ in pickletools.genops(program):
            if opcode.name == "STOP":
                break
            if opcode.name in ("GLOBAL", "STACK_GLOBAL"):
                self._name(argument)
            elif step := _STEPS.get(opcode.name):
                step(self, argument)
            else:
                raise self._refused(f"the instruction {opcode.name}")
        found = self._stack.pop() if len(self._stack) == 1 else None
        if not isinstance(found, dict):
            raise self._refused("something else than a dictionary of tensors")
        return found

    def _refused(self, what: str) -> ImportLogError:
        return ImportLogError(f"{self._path}: holds {what}; only tensors are read from it", file=self._path, fix=_FIX)

    def _name(self, argument: str | None) -> None:
        if argument is None:
            last, first = self._stack.pop(), self._stack.pop()
            argument = f"{first} {last}"
        name = _Name(argument)
        if name not in _KNOWN:
            raise self._refused(f"{shown(argument)}")
        self._stack.append(name)

    def push(self, value: Any) -> None:
        self._stack.append(value)

    def remember(self, place: int | None) -> None:
        self._memo[len(self._memo) if place is None else place] = self._stack[-1]

    def recall(self, place: int) -> None:
        self._stack.append(self._memo[place])

    def last(self, count: int) -> list[Any]:
        values = self._stack[len(self._stack) - count :]
        del self._stack[len(self._stack) - count :]
        return values

    def since_mark(self) -> list[Any]:
        place = max(i for i, value in enumerate(self._stack) if value is _MARK)
        values = self._stack[place + 1 :]
        del self._stack[place:]
        return values

    def set_items(self, pairs: list[Any]) -> None:
        target = self._stack[-1]
        keys = pairs[::2]
        if not isinstance(target, dict) or len(pairs) % 2 or not all(isinstance(key, str) for key in keys):
            raise self._refused("a dictionary whose keys are no text")
        target.update(zip(keys, pairs[1::2], strict=True))

    def storage(self) -> None:
        """A persistent id: ('storage', type, key, device, number of elements)."""
        match self._stack.pop():
            case ("storage", _Name() as kind, str() as key, str(), int() as count):
                if kind in _STORAGES and _KEY.fullmatch(key) and count >= 0:
                    self._stack.append(_Storage(_STORAGES[kind], key, count))
                    return
        raise self._refused("a storage of an unknown form")

    def reduce(self) -> None:
        """A call; those that describe tensors and arrays are understood, and none is made."""
        arguments, function = self._stack.pop(), self._stack.pop()
        if function in _RECONSTRUCT and isinstance(arguments, tuple) and arguments[:1] == (_NDARRAY,):
            self._stack.append(PickledArray())
            return
        made = type_of(arguments) if function == _DTYPE else bytes_of(arguments) if function == _ENCODE else None
        if made is not None:
            self._stack.append(made)
            return
        if function == _ORDERED and arguments == ():
            self._stack.append({})
            return
        if function == _REBUILD:
            match arguments:
                case (_Storage() as storage, int() as offset, tuple() as size, tuple() as stride, bool(), dict(), *_):
                    numbers = (offset, *size, *stride)
                    if len(size) == len(stride) <= _DIMENSIONS and all(type(n) is int and n >= 0 for n in numbers):
                        self._stack.append(_Tensor(storage, offset, size, stride))
                        return
        raise self._refused("a call that makes no tensor of at most two dimensions")

    def build(self) -> None:
        """The state of an array or of its type."""
        state, target = self._stack.pop(), self._stack[-1]
        if not isinstance(target, PickledArray | PickledType) or not target.set_state(state):
            raise self._refused("an array of another form than numbers in at most two dimensions")


_Step = Callable[[_Program, Any], None]
_STEPS: dict[str, _Step] = {
    "PROTO": lambda program, _: None,
    "FRAME": lambda program, _: None,
    "EMPTY_DICT": lambda program, _: program.push({}),
    "EMPTY_TUPLE": lambda program, _: program.push(()),
    "MARK": lambda program, _: program.push(_MARK),
    "NONE": lambda program, _: program.push(None),
    "NEWTRUE": lambda program, _: program.push(True),
    "NEWFALSE": lambda program, _: program.push(False),
    **dict.fromkeys(("BINUNICODE", "SHORT_BINUNICODE"), _Program.push),
    **dict.fromkeys(("BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT"), _Program.push),
    **dict.fromkeys(("BINPUT", "LONG_BINPUT", "MEMOIZE"), _Program.remember),
    **dict.fromkeys(("BINGET", "LONG_BINGET"), _Program.recall),
    "TUPLE": lambda program, _: program.push(tuple(program.since_mark())),
    "TUPLE1": lambda program, _: program.push(tuple(program.last(1))),
    "TUPLE2": lambda program, _: program.push(tuple(program.last(2))),
    "TUPLE3": lambda program, _: program.push(tuple(program.last(3))),
    "SETITEM": lambda program, _: program.set_items(program.last(2)),
    "SETITEMS": lambda program, _: program.set_items(program.since_mark()),
    **dict.fromkeys(("BINBYTES", "SHORT_BINBYTES"), _Program.push),
    "BUILD": lambda program, _: program.build(),
    "BINPERSID": lambda program, _: program.storage(),
    "REDUCE": lambda program, _: program.reduce(),
}
