"""Joints with a position loop on a valve: from the commanded position to the torque, see docs/theory/actuator-layer.md."""

from __future__ import annotations

from hqpipe.layers.actuator.layer import Actuator

__all__ = ["Actuator"]
