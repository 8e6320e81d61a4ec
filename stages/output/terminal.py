"""What a stage tells the person at the terminal, on standard error."""

from __future__ import annotations

import sys
from typing import Any

WIDTH = 120  # columns in a file or in continuous integration


def show(*parts: Any) -> None:
    """Print tables and lines of text."""
    from rich.console import Console

    console = Console(stderr=True, width=None if sys.stderr.isatty() else WIDTH)
    for part in parts:
        console.print(part, highlight=False, markup=not isinstance(part, str))  # names in brackets are no markup
