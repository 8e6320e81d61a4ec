"""Ways in which a file can be damaged, or be another file than its name says, for the tests of every reader."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hqpipe.errors import HqpipeError

Damage = Callable[[Path], None]
FLIPS = 50  # positions of one flipped bit, evenly over a file


def _made_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _cut(share: float) -> Damage:
    return lambda path: path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


def _filled(content: bytes) -> Damage:
    return lambda path: path.write_bytes(content)


def _linked_to_itself(path: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


ANY_FILE: dict[str, Damage] = {
    "missing": Path.unlink,
    "empty": _filled(b""),
    "a folder": _made_folder,
    "a link to itself": _linked_to_itself,
    "one byte": _filled(b"\x00"),
    "random bytes": _filled(np.random.default_rng(0).bytes(3000)),
    **{f"cut at {share}": _cut(share) for share in (0.01, 0.1, 0.5, 0.9)},
}
"""Whatever the format."""

TEXT_FILE: dict[str, Damage] = {
    "blank": _filled(b" \n \n"),
    "not UTF-8": lambda path: path.write_bytes(path.read_bytes()[:40] + b"\xff\xfe" + path.read_bytes()[40:]),
    "UTF-16": lambda path: path.write_bytes(path.read_text("utf-8").encode("utf-16")),
    "NUL": lambda path: path.write_bytes(b"\x00" * 2000),
}

JSON_FILE: dict[str, Damage] = {
    **TEXT_FILE,
    "null": _filled(b"null"),
    "a number": _filled(b"1"),
    "text": _filled(b'"text"'),
    "a list": _filled(b"[]"),
    "an empty object": _filled(b"{}"),
    "an unknown field": _filled(b'{"surprise": 1}'),
    "deep lists": _filled(b"[" * 10_000),
    "deep closed lists": _filled(b"[" * 10_000 + b"]" * 10_000),
    "deep objects": _filled(b'{"a":' * 10_000),
    "400 digits": _filled(b'{"a": 1' + b"0" * 400 + b"}"),
    "5000 digits": _filled(b'{"a": 1' + b"0" * 5000 + b"}"),
    "NaN": _filled(b'{"a": NaN}'),
    "infinity": _filled(b'{"a": -Infinity}'),
    "1e999": _filled(b'{"a": 1e999}'),
    "half a character": _filled(b'{"a": "\\ud800"}'),
    "a field twice": _filled(b'{"a": 1, "a": 2}'),
    "two documents": _filled(b"{} {}"),
}

YAML_FILE: dict[str, Damage] = {
    **TEXT_FILE,
    "null": _filled(b"null"),
    "a list": _filled(b"- 1\n- 2\n"),
    "text": _filled(b"just text"),
    "an empty mapping": _filled(b"{}"),
    "an unknown field": _filled(b"surprise: 1"),
    "unclosed bracket": _filled(b"joints: [LFR, LFP"),
    "a tab": _filled(b"a:\n\tb: 1"),
    "integer keys": _filled(b"1: 2\n3: 4\n"),
    "keys that are lists": _filled(b"? [a, b]\n: 1\n"),
    "null key": _filled(b"~: 1\n"),
    "deep lists": _filled(b"a: " + b"[" * 10_000),
    "deep closed lists": _filled(b"a: " + b"[" * 10_000 + b"]" * 10_000),
    "deep mappings": _filled(b"{a: " * 10_000),
    "5000 digits": _filled(b"a: 1" + b"0" * 5000),
    "not a number": _filled(b"a: .nan"),
    "a date": _filled(b"a: 2001-01-01"),
    "no date": _filled(b"a: 2001-99-99"),
    "a Python object": _filled(b"a: !!python/object/apply:os.system [id]"),
    "binary": _filled(b"a: !!binary aGVsbG8="),
    "a set": _filled(b"a: !!set {b, c}"),
    "no integer": _filled(b'a: !!int ""'),
    "no truth": _filled(b"a: !!bool maybe"),
    "a field twice": _filled(b"a: 1\na: 2\n"),
    "two documents": _filled(b"a: 1\n---\nb: 2\n"),
    "unknown alias": _filled(b"a: *b"),
    "an alias in itself": _filled(b"a: &x [*x]"),
    "billion laughs": _filled(
        b"a: &a [l, l, l, l, l, l, l, l, l, l]\n"
        + b"".join(
            f"{name}: &{name} [{', '.join([f'*{above}'] * 10)}]\n".encode()
            for above, name in zip("abcdefgh", "bcdefghi", strict=True)
        )
    ),
    "billion merges": _filled(
        b"a: &a {k: 1}\n"
        + b"".join(
            f"{name}: &{name} {{<<: [{', '.join([f'*{above}'] * 10)}]}}\n".encode()
            for above, name in zip("abcdefgh", "bcdefghi", strict=True)
        )
    ),
}

WRONG_VALUES: tuple[Any, ...] = (
    None,
    [],
    {},
    "text",
    "",
    True,
    -1,
    0,
    1e300,
    -1e300,
    10**400,
    float("nan"),
    float("inf"),
)
"""Put in the place of each field in turn; which of them a field may hold is for its reader to say."""


def field_damages(content: Any, most_items: int = 1) -> Iterator[tuple[str, Any]]:
    """(name, content with one field replaced, missing or misspelt), for every field of nested mappings and lists.

    Args:
        most_items: of a list that are damaged.
    """
    for path in _paths(content, most_items):
        name = ".".join(map(str, path))
        for value in WRONG_VALUES:
            yield f"{name} = {str(value)[:12]!r}", _changed(content, path, value)
        yield f"{name} missing", _without(content, path)
        yield f"{name} misspelt", _renamed(content, path)


def _paths(node: Any, most_items: int, above: tuple = ()) -> Iterator[tuple]:
    members = node.items() if isinstance(node, dict) else enumerate(node[:most_items]) if isinstance(node, list) else ()
    for key, value in members:
        yield (*above, key)
        yield from _paths(value, most_items, (*above, key))


def _changed(content: Any, path: tuple, value: Any) -> Any:
    made = copy.deepcopy(content)
    _parent(made, path)[path[-1]] = value
    return made


def _without(content: Any, path: tuple) -> Any:
    made = copy.deepcopy(content)
    del _parent(made, path)[path[-1]]
    return made


def _renamed(content: Any, path: tuple) -> Any:
    made = copy.deepcopy(content)
    parent = _parent(made, path)
    if isinstance(parent, dict):
        parent[f"{path[-1]}x"] = parent.pop(path[-1])
    else:
        parent.append(parent[-1])
    return made


def _parent(node: Any, path: tuple) -> Any:
    for key in path[:-1]:
        node = node[key]
    return node


def flips(path: Path, count: int = FLIPS) -> Iterator[tuple[str, bytes]]:
    """(name, content with one bit flipped) at `count` places."""
    content = path.read_bytes()
    for position in np.linspace(0, len(content) - 1, count).astype(int):
        made = bytearray(content)
        made[position] ^= 1 << (position % 8)
        yield f"bit {position % 8} of byte {position}", bytes(made)


def write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content), encoding="utf-8")


def write_yaml(path: Path, content: Any) -> None:
    path.write_text(yaml.safe_dump(content, allow_unicode=True), encoding="utf-8")


def refused(read: Callable[[], Any], file: Path, exit_code: int = 2) -> HqpipeError:
    """The error of `read`, which must be one of hqpipe's, with file and remedy, and end with `exit_code`."""
    with pytest.raises(HqpipeError) as caught:
        read()
    return checked(caught.value, file, exit_code)


def checked(error: HqpipeError, file: Path, exit_code: int = 2, beside: bool = False) -> HqpipeError:
    """`error`, which must name file and remedy in one line that fits on a screen; with `beside` a file beside it will do."""
    assert error.exit_code == exit_code, error
    assert error.file is not None, error
    named = Path(error.file)
    assert named == file or (beside and named.parent == file.parent), error
    assert error.fix and error.fix in str(error), error
    assert named.name in str(error) and "\n" not in str(error) and len(str(error)) < 1000, str(error)[:1000]
    return error


def refused_or_read(read: Callable[[], Any], file: Path, exit_code: int = 2) -> bool:
    """Whether `read` refused, as `refused` wants it; a damage that leaves a sound file may be read."""
    try:
        read()
    except HqpipeError as error:
        checked(error, file, exit_code, beside=True)
        return True
    return False


def refuses_every(damages: dict[str, Damage], read: Callable[[], Any], file: Path, exit_code: int = 2) -> None:
    """Check that `read` refuses `file` under each of `damages`; the file is restored after each."""
    kept = file.read_bytes()
    for name, damage in damages.items():
        damage(file)
        try:
            refused(read, file, exit_code)
        except BaseException as error:
            raise AssertionError(f"{name}: {type(error).__name__}: {str(error)[:500]}") from error
        finally:
            if file.is_dir() and not file.is_symlink():
                shutil.rmtree(file)
            file.unlink(missing_ok=True)
            file.write_bytes(kept)


def survives_flips(read: Callable[[], Any], file: Path, exit_code: int = 2) -> None:
    """Check that a flipped bit is either refused as it should be or leaves a file that can be read."""
    kept = file.read_bytes()
    for name, content in flips(file):
        file.write_bytes(content)
        try:
            refused_or_read(read, file, exit_code)
        except BaseException as error:
            raise AssertionError(f"{name}: {type(error).__name__}: {str(error)[:500]}") from error
    file.write_bytes(kept)


def survives_fields(
    content: Any, write: Callable[[Path, Any], None], read: Callable[[], Any], file: Path, exit_code: int = 2
) -> set[str]:
    """Check each of `field_damages`; returns the names of those that were read all the same."""
    kept, passed = file.read_bytes(), set()
    for name, damaged in field_damages(content):
        write(file, damaged)
        try:
            if not refused_or_read(read, file, exit_code):
                passed.add(name)
        except BaseException as error:
            raise AssertionError(f"{name}: {type(error).__name__}: {str(error)[:500]}") from error
    file.write_bytes(kept)
    return passed
