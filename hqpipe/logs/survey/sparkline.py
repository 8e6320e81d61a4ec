"""A signal in a few characters."""

from __future__ import annotations

import numpy as np

BLOCKS = "▁▂▃▄▅▆▇█"
ASCII = "_.-~=+*#"
"""The same in encodings that lack blocks, from low to high."""


def levels_for(encoding: str | None) -> str:
    """The characters that an encoding has; ASCII for one that is not known."""
    try:
        BLOCKS.encode(encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return ASCII
    return BLOCKS


def sparkline(values: np.ndarray, low: float, high: float, width: int, levels: str = BLOCKS) -> str:
    """A signal (T,) as `width` characters at most.

    Each character shows the sample in the middle of its part: means would hide oscillations that are faster than a character.

    Args:
        values: (T,). low, high: what the lowest and the highest character stand for. width: characters.
        levels: characters from low to high.

    Returns:
        The line; a space where the sample is not finite.
    """
    count = min(width, len(values))
    shown = values[((np.arange(count) + 0.5) * len(values) / max(count, 1)).astype(int)]
    share = (shown - low) / (high - low) if high > low else np.where(np.isfinite(shown), 0.5, np.nan)
    at = np.clip(np.nan_to_num(share) * len(levels), 0, len(levels) - 1).astype(int)
    return "".join(levels[i] if np.isfinite(s) else " " for i, s in zip(at, share, strict=True))
