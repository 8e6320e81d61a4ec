"""What the samples of a field say of its unit, with the reason in words."""

from __future__ import annotations

import numpy as np

from hqpipe.logs.imports.units import UNITS
from hqpipe.logs.turns import encoder_range, jumps

_RADIANS = 7.0  # just above a full turn, as in `hqpipe.logs.units`
_DEGREES = 400.0  # just above a full turn
_LEAST_TURN = 350.0  # just below a full turn in degrees; assumption: the range of an encoder is a turn or more
_BAR, _PSI = 1.0e3, 1.0e4  # hydraulic supplies are below 700 bar (10,000 psi)
_MEGAPASCAL = 60.0  # assumption: hydraulics of machines stay below 60 MPa, and rarely run below 60 bar
_AMPERES = 200.0  # assumption: drives of single joints stay below
_EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))  # the year 1973 in ns, µs and ms; seconds since 1970 are 1.7e9
_STEPS = (
    (0.5, "s"),
    (50.0, "ms"),
    (5.0e4, "us"),
    (np.inf, "ns"),
)  # largest step; 20 Hz to 20 kHz, the rates of controllers
_SPEED_UNITS = ("rad/s", "deg/s", "rpm", "turn/s", "m/s", "mm/s", "cm/s")
_SLOPE = 0.15  # assumption: a recorded speed is within 15 % of the derivative of the position
_SMOOTHER = 0.9  # assumption: sums of steps closer than this do not tell which of two signals is a target
_CORRELATED = 0.8  # as in `hqpipe.logs.units`
Guess = tuple[str, str]
"""A unit and the reason for it."""


def size(values: np.ndarray) -> float:
    """Largest magnitude of nearly all samples."""
    present = values[np.isfinite(values)]
    return float(np.quantile(np.abs(present), 0.999)) if len(present) else np.nan


def is_clock(values: np.ndarray) -> bool:
    """Whether nearly all samples increase."""
    present = values[np.isfinite(values)]
    return len(present) > 1 and float(np.mean(np.diff(present) > 0)) > 0.9


def clock_unit(values: np.ndarray) -> Guess | None:
    """Unit of a clock; None if it counts samples."""
    present = values[np.isfinite(values)]
    top, steps = float(present.max()), np.diff(present)
    step = float(np.median(steps[steps > 0]))
    for limit, unit in _EPOCHS:
        if top > limit:
            return unit, f"{top:.4g} is today in {unit} since 1970"
    if step == 1.0 and (steps == 1.0).mean() > 0.99:
        return None
    unit = next(unit for limit, unit in _STEPS if step < limit)
    rate = 1.0 / (step * UNITS[unit].factor)
    return unit, f"steps by {step:.4g}: {unit} make {rate:.4g} Hz of it"


def position_unit(fields: list[np.ndarray], slides: bool) -> Guess | None:
    """Unit of positions; None for counts, whose number per turn only a person knows."""
    top = max(size(values) for values in fields)
    if slides:
        unit = "m" if top <= 2.0 else "cm" if top <= 20.0 else "mm"
        return unit, f"reaches {top:.4g}: {unit} of a joint that slides"
    if top <= _RADIANS:
        return "rad", f"reaches {top:.3g}: radians; metres if the joint slides"
    ranges = [found for values in fields if (found := encoder_range(np.arange(len(values)), values))]
    if ranges and max(ranges) < _LEAST_TURN:
        return (
            "rad",
            f"CHECK: starts again after {max(ranges):.4g}: more than a turn in radians, less than one in degrees",
        )
    if top <= _DEGREES:
        return "deg", f"CHECK: reaches {top:.4g}: degrees; cm or mm if the joint slides"
    whole = all(np.all(values[np.isfinite(values)] % 1 == 0) for values in fields)
    return None if whole else ("deg", f"CHECK: reaches {top:.4g}: degrees over several turns; mm if the joint slides")


def pressure_unit(fields: list[np.ndarray]) -> Guess:
    """Unit of pressures."""
    top = max(size(values) for values in fields)
    unit = "bar" if top < _BAR else "psi" if top < _PSI else "Pa"
    doubt = top < _MEGAPASCAL
    return unit, f"CHECK: reaches {top:.4g}: bar; MPa of a strong supply" if doubt else f"reaches {top:.4g}: {unit}"


def current_unit(fields: list[np.ndarray]) -> Guess:
    """Unit of currents."""
    top = max(size(values) for values in fields)
    unit = "A" if top < _AMPERES else "mA"
    return unit, f"reaches {top:.4g}: {unit}"


def velocity_unit(time: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> Guess | None:
    """Unit of a velocity that its slope against the derivative of the position gives away.

    Args:
        time: (T,) s. position: (T,) SI. velocity: (T,) as stored.
    """
    if size := encoder_range(time, position, velocity):
        position = position + size * jumps(position, size)
    slope = slope_of(velocity, derivative(time, position))
    if slope is None:
        return None
    for unit in _SPEED_UNITS:
        if abs(slope * UNITS[unit].factor - 1.0) < _SLOPE:
            return unit, f"{slope:.3g} times the derivative of the position"
    return None


def derivative(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(T,) of the slope over a few samples; NaN at the ends."""
    reach = 3  # samples to either side: a coarse sensor's steps average out
    found = np.full(len(values), np.nan)
    if len(values) > 2 * reach:
        with np.errstate(divide="ignore", invalid="ignore"):
            found[reach:-reach] = (values[2 * reach :] - values[: -2 * reach]) / (
                time[2 * reach :] - time[: -2 * reach]
            )
    return found


def slope_of(first: np.ndarray, second: np.ndarray) -> float | None:
    """Slope of `first` (T,) over `second` (T,); None where they are hardly correlated."""
    present = np.isfinite(first) & np.isfinite(second)
    if present.sum() < 10:
        return None
    x, y = second[present] - second[present].mean(), first[present] - first[present].mean()
    scale = np.sqrt((x @ x) * (y @ y))
    if scale == 0 or abs(x @ y) < _CORRELATED * scale:
        return None
    return float((x @ y) / (x @ x))


def error_sign(position: np.ndarray, error: np.ndarray) -> tuple[int, str]:
    """Sign with which an error (T,) is added to the position (T,) to give the target, and the reason: a target is smoother."""
    plus, minus = (float(np.nansum(np.abs(np.diff(position + sign * error)))) for sign in (1, -1))
    if min(plus, minus) > _SMOOTHER * max(plus, minus):
        return 1, "CHECK: position + error, if the error is target − position"
    if plus < minus:
        return 1, "CHECK: position + error, which is smoother than position − error"
    return -1, "CHECK: position − error, which is smoother than position + error"


def valve_scaling(values: np.ndarray) -> tuple[dict[str, float | str], str]:
    """Unit, zero and scale that bring a valve command to −1…1, and the reason."""
    top = size(values)
    present = values[np.isfinite(values)]
    low, high = float(present.min()), float(present.max())
    if top <= 1.05:
        return {"unit": "1"}, f"{low:.3g} … {high:.3g}: already −1…1"
    if low < 0.0 < high and top <= 105.0:
        return {"unit": "%"}, f"{low:.4g} … {high:.4g}: per cent"
    rest, counts = np.unique(present, return_counts=True)
    zero = float(rest[np.argmax(counts)])
    reach = max(high - zero, zero - low)
    reason = f"{low:.5g} … {high:.5g}, most often {zero:.5g}: that is taken for closed, the largest deviation for full opening"
    return {"zero": zero, "scale": float(f"{1.0 / reach:.5g}") if reach else 1.0}, reason
