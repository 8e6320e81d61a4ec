"""Numbers that parameters of several stages may have, each with the reason, which the message gives to who exceeds them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from pydantic import AfterValidator


def within(lower: float, upper: float, reason: str) -> AfterValidator:
    """Accept `lower` to `upper`, both included."""

    def check(value: float) -> float:
        if not lower <= value <= upper:
            shown = f"{value:g}" if isinstance(value, float) else str(value)[:80]
            raise ValueError(f"expected {lower:g} to {upper:g} ({reason}), got {shown}")
        return value

    return AfterValidator(check)


def each_once(what: str) -> AfterValidator:
    """Accept a list in which nothing stands twice."""

    def check(names: list[str]) -> list[str]:
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"expected each of the {what} once, got {', '.join(twice)} more than once")
        return names

    return AfterValidator(check)


def zero_or(number: type, lower: float, upper: float, reason: str) -> object:
    """Annotation of a number that is 0 or from `lower` to `upper`."""
    check: Callable[[float], float] = within(lower, upper, f"{reason}; or 0").func
    return Annotated[number, AfterValidator(lambda value: value if value == 0 else check(value))]


_TRIAL = "s; a trial is logged at 1 kHz, and ten minutes of it take 1.2 GB of memory"
TrialSeconds = Annotated[float, within(1.0, 600.0, _TRIAL)]
StressSeconds = zero_or(float, 1.0, 600.0, _TRIAL)
WindowSeconds = Annotated[
    float, within(1e-3, 10.0, "s; from a sample at 1 kHz to a window in which any model drifts off")
]
WindowChoice = WindowSeconds | None
"""None for windows that suit the logs."""
Walks = Annotated[int, within(1, 1000, "each takes seconds on the plant")]
Iterations = Annotated[int, within(1, 1_000_000, "of a training of nets, 1000 times the paper's")]
Threshold = Annotated[float, within(1e-12, 1e6, "a threshold, above any value that passes or fails a policy")]
Speed = Annotated[float, within(-10.0, 10.0, "m/s or rad/s; beyond any legged machine")]
