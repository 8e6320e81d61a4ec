"""Generic shapes of what may drive the torque beside the law, for what no effect of the library describes.

Each adds to the rate of the torque what one signal, or a product of two, gives, and fades with the torque's own leakage. As
the law is nearly linear in small changes of the torque, what it adds to a free run is that signal, summed with what the base
model leaves of a change at the logged torque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hqpipe.identify.model import Effect, Parameter
from hqpipe.layers.actuator.record import Record
from hqpipe.layers.actuator.sizes import Sizes
from hqpipe.machine import effect as scales

SHAPES = (
    ("position_load", "position", 2),
    ("speed_law", "velocity", 2),
    ("speed_by_position", "position", 2),
    ("linkage", "position", 2),
    ("flow_curve", "command", 2),
    ("leak_curve", "effort", 2),
    ("offset_drift", "time", 1),
    ("drag", "direction", 1),
)
"""Name, the signal that it depends on, and its number of columns, in the order of `_columns`."""
USUAL = 0.1  # of the usual torque, that a shape gives; assumption: as a small effect
TURNING = 0.02  # of the usual speed, over which a drag changes its sign; assumption: seals creep before they slide


def shapes_of(size: Sizes, unit: str) -> tuple[Effect, ...]:
    """The shapes as candidates without a name."""
    usual = USUAL * size.of[scales.EFFORT]

    def columns(name: str, count: int) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{name}_{k + 1}", unit, 0.0, usual) for k in range(count))

    return tuple(Effect(name, columns(name, count), named=False, signal=signal) for name, signal, count in SHAPES)


def free_run_shapes(
    records: tuple[Record, Record], size: Sizes, first: Mapping[str, float]
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """What each shape adds to the torque in a free run.

    Args:
        first: see `summed`.

    Returns:
        (C, N) of the fit and the held-out samples, of mean square 1 in the fit; and (C,) what they were divided by for that.
    """
    whole = max(float(records[0].signals.time.max(initial=0.0)), np.finfo(float).tiny)
    fit, heldout = (summed(record, _columns(record, size, whole), first) for record in records)
    scale = np.sqrt(np.mean(fit**2, axis=1, keepdims=True))
    scale[scale == 0.0] = 1.0
    return (fit / scale, heldout / scale), scale[:, 0]


def opening_of(record: Record, size: Sizes) -> np.ndarray:
    """(T,) of the valve, in usual ones."""
    return (record.signals.command - record.signals.position) / size.of[scales.COMMAND]


def _columns(record: Record, size: Sizes, whole: float) -> list[np.ndarray]:
    """(T,) what each shape adds to the rate of the torque; whole: s, length of the longest fit trial."""
    s = record.signals
    z = (s.position - size.middle) / size.of[scales.ANGLE]
    v, e = s.velocity / size.of[scales.VELOCITY], opening_of(record, size)
    f = s.effort / size.of[scales.EFFORT]
    by_speed = [v * np.abs(v), v**3]
    return [
        *(z, z**2),
        *by_speed,
        *(z * v, z**2 * v),
        *(z * e, z**2 * e),
        *(e * np.abs(e), e**3),
        *(f * np.abs(f), f**2),
        s.time / whole - 0.5,
        v / np.sqrt(v**2 + TURNING**2),
    ]


def _kept(record: Record, first: Mapping[str, float]) -> np.ndarray:
    """(T,) share of a small change of torque that is left after one sample: impacts take from one against the opening."""
    s = record.signals
    error = s.command - s.position
    return np.maximum(1.0 - first["k2"] - np.where(s.effort * error < 0.0, first["k4"] * np.abs(error), 0.0), 0.0)


def summed(record: Record, rates: Sequence[np.ndarray], first: Mapping[str, float]) -> np.ndarray:
    """(C, N) what rates (T,) add to the torque in a free run.

    Args:
        first: coefficient → value, of which those of leakage and impacts count.
    """
    s, found, keep = record.signals, [], _kept(record, first)
    for column in rates:
        rows, total = np.empty((s.steps, record.windows)), np.zeros(record.windows)
        for k in range(s.steps):
            total = keep[s.first + k] * total + column[s.first + k]
            rows[k] = total
        found.append(record.picked(rows))
    return np.array(found)
