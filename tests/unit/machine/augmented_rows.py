"""Rows of parameters and windows of the planted data, for the tests of the augmented kernels."""

from __future__ import annotations

import sys
from functools import lru_cache
from pathlib import Path

import numpy as np

from hqpipe.logs.trajectory import Trajectory
from hqpipe.machine import EFFECTS
from hqpipe.machine.layout import neutral_row, slot

sys.path.insert(0, str(Path(__file__).parents[2] / "recovery"))
import planted_effects as planted
from machine.signal_windows import windows_of

DIRECT = ("supply_droop",)  # its column holds the loss per speed itself
ALONE = tuple(name for name in planted.TYPICAL if name != "supply_droop")  # the supply is shared: data of its own
STEPS = 100
EXACT = 1e-7  # N·m, on torques of 400


def row(effects: dict[str, dict[str, float]], middle: float = 0.0, **base: float) -> np.ndarray:
    """The row of a joint with the gains of the planted data and some effects, in the effects' own units."""
    p = neutral_row()
    for name, value in (planted.GAINS | base).items():
        p[slot("base", name)] = value
    for effect, values in effects.items():
        for parameter in EFFECTS[effect].parameters:
            if parameter.name in values:
                value = values[parameter.name]
                inverse = parameter.inverse and effect not in DIRECT
                square = parameter.squared and (inverse or not parameter.inverse)
                p[slot(effect, parameter.name)] = value ** ((2.0 if square else 1.0) * (-1.0 if inverse else 1.0))
    p[slot("setting", "middle")] = middle
    p[slot("setting", "clear")] = 150.0
    return p


@lru_cache
def trial(noise: float = 0.0, seconds: float = 4.0, seed: int = 1) -> Trajectory:
    """Every effect in a joint of its own, then a sound joint."""
    effects = [{name: planted.TYPICAL[name]} for name in ALONE]
    return planted.trajectory(planted.simulate(seconds, [*effects, {}], noise, seed))


@lru_cache
def drooping(noise: float = 0.0, seconds: float = 4.0) -> Trajectory:
    """Three joints on one sagging supply."""
    effects = [{"supply_droop": planted.TYPICAL["supply_droop"]}] * 3
    return planted.trajectory(planted.simulate(seconds, effects, noise, 2))


def signals_of(effect: str | None, noise: float = 0.0, seconds: float = 4.0):
    """Windows of the joint with one planted effect (None: the sound one)."""
    if effect == "supply_droop":
        return windows_of([drooping(noise, seconds)], 0, STEPS, logged_speed=True)
    j = len(ALONE) if effect is None else ALONE.index(effect)
    return windows_of([trial(noise, seconds)], j, STEPS, logged_speed=True)
