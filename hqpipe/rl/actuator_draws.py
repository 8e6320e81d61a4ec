"""The actuators of the robots in a training: whole parameter sets from the fit's posterior, or factors within a half-range."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.posterior import Posterior
from hqpipe.errors import ConfigError
from hqpipe.rl.config import ActuatorRandomisationConfig

_QUANTILES = (0.025, 0.975)
_TO_COMPARE = 2  # sections or trials, without which nothing tells how a joint differs from one to the next


def actuator_mode(actuator: ActuatorModel, sizes: ActuatorRandomisationConfig, posterior: Posterior | None) -> str:
    """posterior, half_range or none; a net has no coefficient that could be scaled.

    Raises:
        ConfigError: the mode is posterior and there is none.
    """
    if sizes.mode == "posterior" and posterior is None:
        raise ConfigError(
            "randomisation.actuator.mode is posterior, but the actuator model has no posterior.json beside it: run "
            "hqpipe fit-actuator or diagnose on more data, or set randomisation.actuator.mode to half_range"
        )
    mode = sizes.mode if sizes.mode != "auto" else "half_range" if posterior is None else "posterior"
    size = {"posterior": sizes.scale, "half_range": sizes.half_range, "none": 0.0}[mode]
    if mode == "half_range" and all(field.certain for field in actuator.FIELDS.values()):
        return "none"
    return mode if size > 0.0 else "none"


def drawn_parameters(
    actuator: ActuatorModel,
    count: int,
    sizes: ActuatorRandomisationConfig,
    posterior: Posterior | None,
    seed: int | Sequence[int],
) -> np.ndarray | None:
    """(count, J, P) tables of `actuator`; None where all robots have its own. The same seed gives the same tables."""
    mode, rng = actuator_mode(actuator, sizes, posterior), np.random.default_rng(seed)
    if mode == "posterior":
        return posterior.draw(actuator, count, rng, sizes.scale)
    return scattered_parameters(actuator, count, sizes.half_range, rng) if mode == "half_range" else None


def scattered_parameters(
    actuator: ActuatorModel, count: int, half_range: float, rng: np.random.Generator
) -> np.ndarray:
    """(count, J, P) coefficients, each scaled by its own factor within 1 ± half_range and kept within its bounds.

    Certain columns, as geometry and limits, stay; a shared column has one factor per robot.
    """
    joints, fields = actuator.parameters.shape
    factor = rng.uniform(1.0 - half_range, 1.0 + half_range, size=(count, joints, fields))
    for column, field in enumerate(actuator.FIELDS.values()):
        if field.certain:
            factor[..., column] = 1.0
        elif field.shared:
            factor[..., column] = factor[:, :1, column]
    lower = [field.lower for field in actuator.FIELDS.values()]
    upper = [field.upper for field in actuator.FIELDS.values()]
    return np.clip(actuator.parameters * factor, lower, upper)


def draws_report(
    actuator: ActuatorModel,
    sizes: ActuatorRandomisationConfig,
    posterior: Posterior | None,
    table: np.ndarray | None,
    seed: int | Sequence[int],
) -> dict[str, Any]:
    """JSON-able: how the actuators of a training differ, and what was drawn of each coefficient of each joint.

    Args:
        table: of `drawn_parameters`, with the same `seed`.
    """
    mode = actuator_mode(actuator, sizes, posterior)
    report: dict[str, Any] = {"mode": mode, "robots": 0 if table is None else len(table)}
    if mode == "posterior":
        report["scale"] = sizes.scale
        groups = [g for g in posterior.held if set(g.joints) & set(actuator.joints)]
        report["without_sections"] = [
            joint for g in groups if g.between is None and g.sections < _TO_COMPARE for joint in g.joints
        ]
        report["not_identified"] = {
            joint: {name: {"low": r.low, "high": r.high, "reason": r.reason} for name, r in group.ranges.items()}
            for group in groups
            if group.ranges
            for joint in group.joints
        }
        if posterior.choices:
            report["alternatives"] = _alternatives(posterior, len(table), np.random.default_rng(seed))
    elif mode == "half_range":
        report["half_range"] = sizes.half_range
    if table is not None:
        names = posterior.fields if mode == "posterior" else actuator.FIELDS
        report["joints"] = {joint: _drawn(actuator, names, j, table[:, j]) for j, joint in enumerate(actuator.joints)}
    return report


def _alternatives(posterior: Posterior, count: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Of each choice its joints, and how many of `count` robots had which alternative."""
    return [
        {
            "joints": list(choice.joints),
            "drawn": [
                {"name": alternative.name, "probability": alternative.weight, "robots": int(np.sum(picked == number))}
                for number, alternative in enumerate(choice.alternatives)
            ],
        }
        for choice, picked in zip(posterior.choices, posterior.chosen(count, rng), strict=True)
    ]


def _drawn(actuator: ActuatorModel, names: Collection[str], joint: int, table: np.ndarray) -> dict[str, Any]:
    """Coefficient, of `names`, → the model's value, and the range of 95 % of its draws (N, P)."""
    found = {}
    for column, (name, field) in enumerate(actuator.FIELDS.items()):
        if name in names and not field.certain:
            low, high = np.quantile(table[:, column], _QUANTILES)
            value = float(actuator.parameters[joint, column])
            found[name] = {"unit": field.unit, "model": value, "low": float(low), "high": float(high)}
    return found
