"""Optional packages that only some formats need."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

from hqpipe.logs.imports.recording import ImportLogError


def needed(module: str, extra: str, path: Path) -> ModuleType:
    """Import an optional package.

    Args:
        module: its import name. extra: the pip extra of hqpipe that brings it. path: the file that needs it.

    Raises:
        ImportLogError: it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise ImportLogError(
            f"{path}: reading it needs the package {module.partition('.')[0]}, which is not installed",
            file=path,
            fix=f"pip install 'hqpipe[{extra}]'",
        ) from error
