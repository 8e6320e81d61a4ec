"""The reference machine: hydraulics, firmware and sensors of its own, on a MuJoCo body."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hqpipe.registry import load

if TYPE_CHECKING:
    from hqpipe.plant.config import PlantConfig
    from hqpipe.plant.disturbance import Grip, Push
    from hqpipe.plant.excitation import Excitation
    from hqpipe.plant.plant import Plant, SensorFrame
    from hqpipe.plant.trial import PlantTrial

__all__ = ["Excitation", "Grip", "Plant", "PlantConfig", "PlantTrial", "Push", "SensorFrame"]

_HOMES = {
    "Excitation": "excitation",
    "Grip": "disturbance",
    "Push": "disturbance",
    "Plant": "plant",
    "SensorFrame": "plant",
    "PlantConfig": "config",
    "PlantTrial": "trial",
}


def __getattr__(name: str) -> Any:
    """Import on first use: MuJoCo and numba are slow to load."""
    if name not in _HOMES:
        raise AttributeError(f"module 'hqpipe.plant' has no attribute '{name}'")
    return load(f"hqpipe.plant.{_HOMES[name]}:{name}")
