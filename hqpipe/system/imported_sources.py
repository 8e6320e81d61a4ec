"""The source files of the package that a module rests on, itself among them."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PACKAGE = __name__.split(".")[0]
_ROOT = Path(__file__).resolve().parents[1]
_ADDED: dict[Path, list[Path]] = {}


@cache
def digest_of_sources(module: Path) -> str:
    """Hash of a module of the package and of all modules of it that the module imports, directly or through others.

    Args:
        module: its file.
    """
    seen: set[Path] = set()
    waiting = [module.resolve()]
    while waiting:
        path = waiting.pop()
        if path not in seen:
            seen.add(path)
            waiting += _read(path)[1]
    return hashlib.sha256("".join(_read(path)[0] for path in sorted(seen)).encode()).hexdigest()


def add_import(module: Path, other: Path) -> None:
    """Count a file among those that a module imports, though its text does not say so."""
    _ADDED.setdefault(module.resolve(), []).append(other.resolve())
    _read.cache_clear()
    digest_of_sources.cache_clear()


@cache
def _read(path: Path) -> tuple[str, tuple[Path, ...]]:
    """Hash of a file, and the files of the package that it imports."""
    content = path.read_bytes()
    imported = (*_imported(ast.parse(content)), *_ADDED.get(path, ()))
    return hashlib.sha256(content).hexdigest(), tuple(dict.fromkeys(imported))


def _imported(tree: ast.Module) -> Iterator[Path]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            names = [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        for parts in (name.split(".") for name in names):
            if parts[0] == PACKAGE:
                place = _ROOT.joinpath(*parts[1:])
                yield from (path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file())
