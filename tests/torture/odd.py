"""Odd values, and changes of one place in a valid document (hypothesis strategies). Every change is plain JSON."""

from __future__ import annotations

import copy
from typing import Any

from hypothesis import strategies as st

Place = list[Any]

LONGEST_TEXT = 2**21  # characters or members; twice what a YAML file may have, which PyYAML writes in a second or two
DEEP = "<nested 10000 deep>"  # stands for a list that json could not write
_NUMBERS = [0, -1, 1, 2**31, 2**63, -(2**63) - 1, 10**400, 0.0, -0.0, 1e-320, 1e300, -1e300, 1e308]
_TEXTS = [
    "", " ", "nan", ".nan", "inf", "1e5", "true", "null", "~", "\u202eabc", "\udc80", "a\0b", "../../etc/passwd", "/", "ä",
    "$x^", "a" * 300, "!!python/object/apply:os.system ['false']", "&a [*a]", "%", "{}", "\\", "é" * 90,
]  # fmt: skip

numbers = st.one_of(
    st.sampled_from([*_NUMBERS, float("nan"), float("inf"), float("-inf")]),
    st.integers(-(10**20), 10**20),
    st.floats(allow_nan=True, allow_infinity=True),
)
texts = st.one_of(st.sampled_from(_TEXTS), st.text(max_size=20))
values = st.one_of(
    numbers,
    texts,
    st.none(),
    st.booleans(),
    st.lists(numbers, max_size=4),
    st.lists(texts, max_size=3),
    st.dictionaries(texts, numbers, max_size=3),
    st.just(DEEP),
)


def places(document: Any, above: Place | None = None) -> list[Place]:
    """The path of every value in a document of mappings and lists."""
    above = above or []
    items = document.items() if isinstance(document, dict) else enumerate(document)
    found = []
    for key, value in items:
        found.append([*above, key])
        if isinstance(value, dict | list):
            found += places(value, [*above, key])
    return found


def tree_changes(document: Any) -> st.SearchStrategy[dict[str, Any]]:
    """One change of a valid document: another value, another name, a length, something missing or twice."""
    place = st.sampled_from(places(document))
    return st.one_of(
        st.fixed_dictionaries({"do": st.just("set"), "at": place, "value": values}),
        st.fixed_dictionaries({"do": st.just("set"), "at": place, "value": values}),
        st.fixed_dictionaries({"do": st.just("scale"), "at": place, "value": numbers}),
        st.fixed_dictionaries({"do": st.just("drop"), "at": place}),
        st.fixed_dictionaries({"do": st.just("rename"), "at": place, "value": texts}),
        st.fixed_dictionaries({"do": st.just("misspell"), "at": place}),
        st.fixed_dictionaries({"do": st.just("repeat"), "at": place, "value": st.sampled_from([1, 2, 1000])}),
        st.fixed_dictionaries({"do": st.just("wrap"), "at": place}),
    )


def change_tree(document: Any, change: dict[str, Any]) -> Any:
    """A copy of `document` with one change of `tree_changes`; unchanged where an earlier change took the place away."""
    document = copy.deepcopy(document)
    *path, last = change["at"]
    holder = document
    try:
        for key in path:
            holder = holder[key]
        _change(holder, last, change)
    except (KeyError, IndexError, TypeError, OverflowError):
        pass
    return document


def _change(holder: Any, key: Any, change: dict[str, Any]) -> None:
    kind, value = change["do"], change.get("value")
    if kind == "set":
        holder[key] = _deep() if value == DEEP else value
    elif kind == "scale" and isinstance(holder[key], int | float):  # a text or list would fill the memory here already
        holder[key] = holder[key] * value
    elif kind == "drop":
        del holder[key]
    elif kind in ("rename", "misspell") and isinstance(holder, dict):
        holder[value if kind == "rename" else f"{str(key)[:-1]}{str(key)[-1:] * 2}"] = holder.pop(key)
    elif kind == "repeat" and isinstance(holder[key], list | str):
        holder[key] = (holder[key] * (value + 1))[:LONGEST_TEXT]
    elif kind == "repeat" and isinstance(holder, list):
        holder.extend([holder[key]] * value)
    elif kind == "wrap":
        holder[key] = [holder[key]]


def _deep() -> list:
    nested: list = []
    for _ in range(300):  # the writers of YAML and JSON recurse as well; deeper nesting is a change of the text
        nested = [nested]
    return nested


text_changes = st.one_of(
    st.fixed_dictionaries({"do": st.just("cut"), "where": st.floats(0.0, 1.0)}),
    st.fixed_dictionaries({"do": st.just("flip"), "where": st.floats(0.0, 1.0), "bit": st.integers(0, 7)}),
    st.fixed_dictionaries(
        {
            "do": st.just("insert"),
            "where": st.floats(0.0, 1.0),
            "hex": st.one_of(
                st.binary(max_size=20),
                st.sampled_from([b"\xff\xfe", b"\xef\xbb\xbf", b"\0", b"[" * 10000, b"{" * 5000, b"- " * 5000, b"\t"]),
                st.sampled_from(
                    [b"9" * 5000, b"1" * 400, b"&a [*a, *a]", b"<<: *b", b"!!python/name:os.system ", b"\r"]
                ),
            ).map(bytes.hex),
        }
    ),
    st.fixed_dictionaries({"do": st.sampled_from(["empty", "twice", "utf-16"])}),
)
"""One change of a file's bytes."""


def change_bytes(data: bytes, change: dict[str, Any]) -> bytes:
    """`data` with one change of `text_changes`."""
    at = int(change.get("where", 0.0) * max(0, len(data) - 1))
    kind = change["do"]
    if kind == "cut":
        return data[:at]
    if kind == "flip" and data:
        return data[:at] + bytes([data[at] ^ (1 << change["bit"])]) + data[at + 1 :]
    if kind == "insert":
        return data[:at] + bytes.fromhex(change["hex"]) + data[at:]
    if kind == "utf-16":
        return data.decode(errors="replace").encode("utf-16")
    return {"empty": b"", "twice": data * 2}.get(kind, data)
