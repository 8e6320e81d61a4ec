"""Message types of ROS 1 and ROS 2, as the file defines them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_BLOBS = (
    "uint8",
    "int8",
    "byte",
    "char",
    "octet",
)  # a list of these without a bound is an image, a cloud or a packed file
_TEXT = ("string", "wstring")
_IDL_LINE = "=" * 80 + "\n"  # between the definitions in an IDL schema, as rosbag2 writes it


def typestore_of(definition: str, name: str, idl: bool = False) -> tuple[Any, str]:
    """Types from a definition that includes those it uses.

    Args:
        definition: text in the msg or IDL language. name: of the type, e.g. `sensor_msgs/msg/JointState`.
        idl: whether the language is IDL.

    Returns:
        rosbags typestore, and the name of the type in it.
    """
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
    from rosbags.typesys.msg import normalize_msgtype

    if not idl:
        types = get_types_from_msg(definition, name)
    elif definition.startswith(f"{_IDL_LINE}IDL: "):
        types = {}
        for part in definition.split(_IDL_LINE)[1:]:
            types |= get_types_from_idl(part.partition("\n")[2])
    else:
        types = get_types_from_idl(definition)
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return store, normalize_msgtype(name)


def refusal(store: Any, name: str) -> str | None:
    """Why messages of a type are not decoded: there is no number in them, or a blob; None if they are."""
    numbers, blobs = _look(store, name, set())
    if blobs:
        return "images, clouds and other lists of bytes are not read"
    return None if numbers else "no number in its messages"


def _look(store: Any, name: str, seen: set[str]) -> tuple[bool, bool]:
    """(whether there is a number, whether there is a blob) in a type and those that it uses."""
    from rosbags.interfaces import Nodetype

    seen.add(name)
    numbers = blobs = False
    for field, (kind, inner) in store.fielddefs[name][1]:
        if field == "header":
            continue
        is_list = kind in (Nodetype.ARRAY, Nodetype.SEQUENCE)
        (leaf, what), bound = inner if is_list else ((kind, inner), 0)
        if leaf == Nodetype.NAME:
            found = (False, False) if what in seen else _look(store, what, seen)
            numbers, blobs = numbers | found[0], blobs | found[1]
        else:
            blobs |= kind == Nodetype.SEQUENCE and not bound and what[0] in _BLOBS
            numbers |= what[0] not in _TEXT
    return numbers, blobs


def decoder(store: Any, name: str, ros1: bool) -> Callable[[bytes], Any]:
    """Bytes → message, in the serialisation of ROS 1, or of ROS 2 (CDR)."""
    decode = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    return lambda data: decode(data, name)
