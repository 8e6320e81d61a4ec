"""What a fit knows of a model's parameters: a distribution from which a randomisation draws whole sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hqpipe.actuators.base import ActuatorModel, ParameterField
from hqpipe.errors import ConfigError, UsageError, near_match

_TRIES = (
    20_000  # draws of one set; ten means on their bounds need 1000 on average, more where their deviations are opposed
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
        mean: (F,) the estimate; that of the posterior's groups and of the first alternatives is what the model holds.
        scatter: (F, F) covariance of the estimate, as it would come out of other trials.
        between: (F, F) covariance of what a joint is in another section of the logs, and, where several joints share an
            estimate, of what each of them is; None where there were no two sections to compare.
        sections: of these joints, or trials, that could be judged.
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
class Alternative:
    """One law that some joints may have.

    Attributes:
        name: what it is. weight: its probability. groups: all of these joints.
    """

    name: str
    weight: float
    groups: tuple[Group, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(joint for group in self.groups for joint in group.joints)


@dataclass(frozen=True, eq=False)
class Choice:
    """Laws of some joints, of which a machine has one in all of them.

    Attributes:
        alternatives: of the same joints, their weights adding up to 1; the first is what the model holds.
    """

    alternatives: tuple[Alternative, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        return self.alternatives[0].joints

    @property
    def weights(self) -> np.ndarray:
        return np.array([alternative.weight for alternative in self.alternatives])


@dataclass(frozen=True, eq=False)
class Posterior:
    """Normal within the physical bounds, group by group; a mixture of such distributions in joints that may have several laws.

    Attributes:
        model: name of the actuator model. fields: the F parameters, columns of its table.
        groups, choices: every joint of the model is in one of them.
    """

    model: str
    fields: tuple[str, ...]
    groups: tuple[Group, ...]
    choices: tuple[Choice, ...] = ()

    @property
    def held(self) -> tuple[Group, ...]:
        """Groups of all joints with what the model holds."""
        return self.groups + tuple(group for choice in self.choices for group in choice.alternatives[0].groups)

    def chosen(self, count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """For each choice, (count,) numbers of the alternatives that `draw` takes with a generator in the same state."""
        return [rng.choice(len(c.alternatives), size=count, p=c.weights / c.weights.sum()) for c in self.choices]

    def draw(self, actuator: ActuatorModel, count: int, rng: np.random.Generator, scale: float = 1.0) -> np.ndarray:
        """(count, J, P) tables of `actuator`, each a whole set of parameters with its correlations.

        The alternative of each choice is drawn once for all of its joints, the error of the estimate once for all joints of a
        group, what lies between sections once for each of them.
        Sets out of bounds are drawn again: the distribution is truncated, not heaped on the bounds.

        Args:
            scale: factor on every deviation from the mean; 1 as it was estimated.

        Raises:
            UsageError: the model is another one, or has a joint that is not in here.
            ConfigError: hardly a draw lies within the bounds.
        """
        if actuator.NAME != self.model:
            raise UsageError(f"the posterior is one of the model {self.model}, the actuator is {actuator.NAME}")
        known = [joint for group in self.held for joint in group.joints]
        for joint in actuator.joints:
            if joint not in known:
                raise UsageError(f"the posterior has no joint '{joint}'{near_match(joint, known)}")
        table = np.tile(actuator.parameters, (count, 1, 1))
        chosen = self.chosen(count, rng)
        for group in self.groups:
            self._fill(table, np.arange(count), actuator, group, rng, scale)
        for choice, picked in zip(self.choices, chosen, strict=True):
            for number, alternative in enumerate(choice.alternatives):
                for group in alternative.groups:
                    self._fill(table, np.flatnonzero(picked == number), actuator, group, rng, scale)
        return table

    def _fill(
        self,
        table: np.ndarray,
        robots: np.ndarray,
        actuator: ActuatorModel,
        group: Group,
        rng: np.random.Generator,
        scale: float,
    ) -> None:
        """Draw the joints of a group for some robots (N,), into `table` (count, J, P) of the actuator."""
        columns = [list(actuator.FIELDS).index(name) for name in self.fields]
        count = len(robots)
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
                table[robots[:, None], actuator.joints.index(joint), columns] = drawn


def factor(covariance: np.ndarray) -> np.ndarray:
    """(F, F) matrix A with A Aᵀ the covariance; rounding may have left it slightly indefinite."""
    unit = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(unit > 0.0, unit, 1.0)  # parameters differ by many powers of ten
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    return unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def check_fields(names: tuple[str, ...], fields: Mapping[str, ParameterField], settings: bool = False) -> None:
    """Refuse names that are no uncertain parameters of a model.

    Args:
        settings: whether they may be certain ones, which differ between alternatives.

    Raises:
        UsageError: the message names the first one.
    """
    for name in names:
        if name not in fields or (fields[name].certain and not settings):
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
