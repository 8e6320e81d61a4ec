"""A gain that is another one from some moment of each trial on: a generic shape, which no effect of the library describes.

The loops know it as a drift of the gain over a time that steps from 0 to 1, so that it acts where a drift does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hqpipe.identify.least_squares import Solution
from hqpipe.identify.model import Effect, Parameter
from hqpipe.layers.actuator.record import Record
from hqpipe.layers.actuator.shapes import opening_of, summed
from hqpipe.layers.actuator.sizes import Sizes
from hqpipe.machine import EFFECTS
from hqpipe.machine.gain_drift import EFFECT as DRIFT
from hqpipe.machine.layout import slot

NAME = "sudden_change"
SLOT = slot(DRIFT.name, DRIFT.parameters[0].name)  # of the loops' row, that holds the relative change of the gain
MOMENTS = np.linspace(0.1, 0.9, 33)
"""Shares of the longest trial at which the gain may change; assumption. A step between two of them leaves at most a twentieth
of its square, a drift at least a quarter."""
TIMED = frozenset(name for name, effect in EFFECTS.items() if effect.reads("time"))  # beside these it does nothing
_RUNNING = 1e-6  # 1/s by which a time that steps grows besides: the loops take 0 for the start of a trial
# As in the other layers (`hqpipe.layers.valve.parameters`).
_STEP = Parameter("gain_step", "1", 0.0, 0.1, -0.95, 0.95)


def with_sudden_change(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects of the loops and the shape, which have one time together: it stands in no set with what changes in time."""
    change = Effect(NAME, (_STEP,), named=False, signal="time", excludes=TIMED, settled=1)
    beside = (replace(e, excludes=e.excludes | {NAME}) if e.name in TIMED else e for e in effects)
    return (*beside, change)


def stepped_time(record: Record, moment: float) -> np.ndarray:
    """(T,) time of a record that steps from 0 to 1 at a moment, s after the start of each trial."""
    time = record.signals.time
    return np.where(time > moment, 1.0, 0.0) + _RUNNING * time


def moment_of_change(
    record: Record, size: Sizes, first: Mapping[str, float], law: Solution, shapes: np.ndarray
) -> float:
    """The moment of a trial, s, at which a change of the gain describes most of what the law and the other shapes leave
    (Quandt 1958).

    Args:
        record: of the fit trials. first: see `summed`. law: its fit without effects. shapes: (C, N) of `free_run_shapes`.
    """
    time, opening = record.signals.time, opening_of(record, size)
    moments = MOMENTS * float(time.max(initial=0.0))
    if not np.isfinite(law.square):  # a law that runs away by itself says nothing of a moment
        return float(np.median(moments))
    changes = summed(record, [opening * (time > moment) for moment in moments], first)
    span = np.linalg.qr(np.column_stack([law.jacobian, *shapes]))[0]
    changes -= (changes @ span) @ span.T
    squares = np.sum(changes**2, axis=1)
    described = np.divide((changes @ law.error) ** 2, squares, out=np.zeros(len(moments)), where=squares > 0.0)
    return float(moments[np.argmax(described)])
