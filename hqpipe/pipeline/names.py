"""Names of files, folders and fields as a user may write them."""

from __future__ import annotations

import os

from hqpipe.errors import shown

# Linux: longest name in a folder, and longest path with the final NUL.
MAX_NAME, MAX_PATH = 255, 4095


def path_problem(text: str) -> str | None:
    """Why no file can be called `text`; None if one can."""
    if not text:
        return "expected a path, got nothing"
    if not text.replace("\t", " ").isprintable() and any(ord(letter) < 32 for letter in text):
        return f"expected a path without control characters, got {shown(text)}"
    longest = max(len(os.fsencode(name)) for name in text.split("/"))
    if longest > MAX_NAME:
        return f"expected names of at most {MAX_NAME} bytes between slashes, got {longest}: {shown(text)}"
    if len(os.fsencode(text)) > MAX_PATH:
        return f"expected a path of at most {MAX_PATH} bytes, got {len(os.fsencode(text))}: {shown(text)}"
    return None
