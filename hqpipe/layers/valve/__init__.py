"""Joints moved by a valve: from the valve command to the motion, see docs/theory/valve-mode.md."""

from __future__ import annotations

from hqpipe.layers.valve.layer import Valve

__all__ = ["Valve"]
