"""Joints with a force loop: from the commanded torque to the measured one, see docs/theory/torque-mode.md."""

from __future__ import annotations

from hqpipe.layers.torque.layer import Torque

__all__ = ["Torque"]
