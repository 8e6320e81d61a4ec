"""One verdict per joint, channel and trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.logs.columns import CHANNELS
from hqpipe.logs.survey.signal import held, noise, resolution
from hqpipe.logs.trajectory import Trajectory
from hqpipe.logs.wiring import saturation_limit

COMMANDS = ("position_command", "effort_command", "valve_command")
LIMITED = ("effort", "velocity", "valve_command", "pressure_a", "pressure_b")
LEVELS = (
    100  # steps within ±2 standard deviations; assumption: with fewer the steps show in a fit (as gap.checks.sensing)
)


@dataclass(frozen=True)
class ChannelVerdict:
    """What one channel of one joint in one trial holds.

    Attributes:
        unit: of a revolute joint. low, high: smallest and largest value.
        resolution: one step of the sensor. noise: standard deviation. held_samples: for how many each value is kept.
            None where it cannot be told, or does not apply.
        limit: where it saturates, or None.
        flags: what is odd about it, the gravest first; empty for a sound one.
    """

    joint: str
    channel: str
    file: str
    unit: str
    low: float
    high: float
    resolution: float | None = None
    noise: float | None = None
    held_samples: int | None = None
    limit: float | None = None
    flags: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        return self.flags[0] if self.flags else "ok"

    def at_end_stop(self) -> ChannelVerdict:
        """The same channel of a joint that was found at its end stop."""
        return replace(self, flags=("end stop", *self.flags))


def channel_verdicts(file: str, parts: Sequence[Trajectory]) -> list[ChannelVerdict]:
    """Judge every recorded channel of every joint of one trial."""
    found = []
    for name in parts[0].channels():
        if name == "velocity" and parts[0].velocity_source != "measured":
            continue
        values = np.concatenate([getattr(part, name) for part in parts])
        for j, joint in enumerate(parts[0].joints):
            found.append(_verdict(joint, name, file, values[:, j]))
    return found


def _verdict(joint: str, channel: str, file: str, values: np.ndarray) -> ChannelVerdict:
    values = values[np.isfinite(values)]
    if not len(values):
        return ChannelVerdict(joint, channel, file, CHANNELS[channel], np.nan, np.nan, flags=("empty",))
    low, high = float(values.min()), float(values.max())
    result = ChannelVerdict(joint, channel, file, CHANNELS[channel], low, high)
    if low == high:
        return replace(result, flags=("constant",))
    command = channel in COMMANDS  # is computed: it has neither noise nor the steps of a sensor
    step = resolution(values)
    kept = held(values, None if command else step)
    limit = saturation_limit(values) if channel in LIMITED else None
    coarse = not command and step is not None and 4.0 * values.std() < LEVELS * step
    flags = {"saturated": limit is not None, "held": kept is not None, "coarse": coarse}
    return replace(
        result,
        resolution=step if kept or not command else None,
        noise=None if kept or command else noise(values, step),
        held_samples=kept,
        limit=limit,
        flags=tuple(name for name, raised in flags.items() if raised),
    )
