"""What a fit knows of a model's parameters: a distribution from which a randomisation draws whole sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hqpipe.actuators.base import ActuatorModel, ParameterField
from hqpipe.errors import ConfigError, UsageError, near_match

_TRIES = (
    1000  # draws of one set; four means on their bounds need 16 on average, more where their deviations are opposed
)


@dataclass(frozen=True)
class Range:
    """Uniform range of a parameter that the logs do not determine, and the reason for it."""

    low: float
    high: float
    reason: str


@dataclass(frozen=True, eq=False)
class Group:
    """Joints that were fitted together; F parameters.

    Attributes:
        joints: their names.
        mean: (F,) the estimate, which is what the model holds.
        scatter: (F, F) covariance of the estimate, as it would come out of other trials.
        between: (F, F) covariance of what a joint is in another section of the logs, and, where several joints share an
            estimate, of what each of them is; None where there were no two sections to compare.
        sections: of these joints that could be judged.
        lower, upper: (F,) physical bounds.
        ranges: parameter → range, for those that the logs do not determine; their rows of the covariances are 0.
    """

    joints: tuple[str, ...]
    mean: np.ndarray
    scatter: np.ndarray
    between: np.ndarray | None
    sections: int
    lower: np.ndarray
    upper: np.ndarray
    ranges: Mapping[str, Range] = field(default_factory=dict)

    @property
    def covariance(self) -> np.ndarray:
        """(F, F) of one joint, scatter and what lies between sections together."""
        return self.scatter if self.between is None else self.scatter + self.between


@dataclass(frozen=True, eq=False)
class Posterior:
    """Normal within the physical bounds, group by group.

    Attributes:
        model: name of the actuator model. fields: the F parameters, columns of its table.
        groups: every joint of the model is in one of them.
    """

    model: str
    fields: tuple[str, ...]
    groups: tuple[Group, ...]

    def draw(self, actuator: ActuatorModel, count: int, rng: np.random.Generator, scale: float = 1.0) -> np.ndarray:
        """(count, J, P) tables of `actuator`, each a whole set of parameters with its correlations.

        The error of the estimate is drawn once for all joints of a group, what lies between sections once for each of them.
        Sets out of bounds are drawn again: the distribution is truncated, not heaped on the bounds.

        Args:
            scale: factor on every deviation from the mean; 1 as it was estimated.

        Raises:
            UsageError: the model is another one, or has a joint that is not in here.
            ConfigError: hardly a draw lies within the bounds.
        """
        if actuator.NAME != self.model:
            raise UsageError(f"the posterior is one of the model {self.model}, the actuator is {actuator.NAME}")
        columns = [list(actuator.FIELDS).index(name) for name in self.fields]
        table = np.tile(actuator.parameters, (count, 1, 1))
        known = [joint for group in self.groups for joint in group.joints]
        for joint in actuator.joints:
            if joint not in known:
                raise UsageError(f"the posterior has no joint '{joint}'{near_match(joint, known)}")
        for group in self.groups:
            common = _truncated(np.tile(group.mean, (count, 1)), scale**2 * group.scatter, rng, group)
            for joint in group.joints:
                drawn = common
                if group.between is not None:
                    drawn = _truncated(common, scale**2 * group.between, rng, group)
                drawn = drawn.copy()
                for name, span in group.ranges.items():
                    at = self.fields.index(name)
                    offset = rng.uniform(span.low, span.high, count) - group.mean[at]
                    drawn[:, at] = np.clip(group.mean[at] + scale * offset, group.lower[at], group.upper[at])
                if joint in actuator.joints:
                    table[:, actuator.joints.index(joint), columns] = drawn
        return table


def factor(covariance: np.ndarray) -> np.ndarray:
    """(F, F) matrix A with A Aᵀ the covariance; rounding may have left it slightly indefinite."""
    unit = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(unit > 0.0, unit, 1.0)  # parameters differ by many powers of ten
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    return unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def check_fields(names: tuple[str, ...], fields: Mapping[str, ParameterField]) -> None:
    """Refuse names that are no uncertain parameters of a model.

    Raises:
        UsageError: the message names the first one.
    """
    for name in names:
        if name not in fields or fields[name].certain:
            raise UsageError(f"'{name[:80]}' is no fitted parameter{near_match(name[:80], fields)}", field="fields")


def _truncated(centre: np.ndarray, covariance: np.ndarray, rng: np.random.Generator, group: Group) -> np.ndarray:
    """(N, F) draws round `centre` (N, F), each within the bounds of the group."""
    spread = factor(covariance).T
    drawn, outside = centre.copy(), np.arange(len(centre))
    for _ in range(_TRIES):
        drawn[outside] = centre[outside] + rng.normal(size=(len(outside), centre.shape[1])) @ spread
        outside = outside[((drawn[outside] < group.lower) | (drawn[outside] > group.upper)).any(axis=1)]
        if not len(outside):
            return drawn
    raise ConfigError(
        f"posterior of {', '.join(group.joints)}: hardly a draw lies within the physical bounds",
        file="posterior.json",
        field="randomisation.actuator.scale",
        fix="lower randomisation.actuator.scale, or set randomisation.actuator.mode to half_range",
    )
