"""The posterior of a diagnosed model: numbers as sure as their intervals, and sets that may stand in the place of those found.

A cause that the logs do not tell from another effect gives its joints an alternative: the same joints with the other effect and
with numbers fitted beside that. At most one cause of a joint is exchanged at a time. Joints that have an exchange in common,
directly or by way of other joints, draw together.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.actuators.augmented import OF_THE_LOG, Augmented
from hqpipe.actuators.posterior import Alternative, Choice, Group, Posterior
from hqpipe.gap.fitted_joints import FittedJoints
from hqpipe.gap.left_joints import PlainJoint
from hqpipe.identify.found import Exchange, JointFound, LayerFound, SetNumbers
from hqpipe.identify.passing import modelled
from hqpipe.identify.set_numbers import base_numbers
from hqpipe.layers.actuator.joint import ActuatorJoint
from hqpipe.machine.layout import FIELDS, slots

AS_FOUND = "as diagnosed"
_NAMES = tuple(Augmented.FIELDS)


@dataclass(frozen=True, eq=False)
class RowNumbers:
    """How sure a row of the loops is.

    Attributes:
        row: (WIDTH,) see `hqpipe.machine.layout`. covariance: (WIDTH, WIDTH). lower, upper: (WIDTH,), those of a column that
            does not vary are its value. trials: that the numbers were fitted to.
    """

    row: np.ndarray
    covariance: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    trials: int


def row_numbers(row: np.ndarray, columns: np.ndarray, numbers: SetNumbers | None, trials: int) -> RowNumbers:
    """A row of a simulator's model with what is known of its numbers; None where nothing is, so that they stay.

    Args:
        columns: (P,) of the row, for each parameter of the joint's model; −1 for none.
    """
    width = len(row)
    covariance, lower, upper = np.zeros((width, width)), row.copy(), row.copy()
    if numbers is not None:
        at = columns[numbers.free]
        of_the_log = [column for name in OF_THE_LOG for column in slots(name)]
        kept = (at >= 0) & (np.diag(numbers.covariance) > 0.0) & ~np.isin(at, of_the_log)
        covariance[np.ix_(at[kept], at[kept])] = numbers.covariance[np.ix_(kept, kept)]
        lower[at[kept]] = np.minimum(numbers.low[kept], row[at[kept]])
        upper[at[kept]] = np.maximum(numbers.high[kept], row[at[kept]])
    return RowNumbers(row, covariance, lower, upper, trials)


def diagnosed_posterior(
    found: LayerFound, left: Mapping[str, PlainJoint], actuator: Augmented, listed: Collection[tuple[str, str]]
) -> Posterior | None:
    """The posterior of all joints of a model; None where nothing is known of any number.

    Args:
        found: by a search with `covariances`. left: joints that were not searched. actuator: the model.
        listed: each cause of the report with each effect that it is confused with; other channels may have settled what the
            torque alone does not tell.
    """
    joints = [
        replace(joint, exchanges=tuple(e for e in joint.exchanges if (e.leaves, e.joins) in listed))
        for joint in found.found
    ]
    rows = dict(zip(actuator.joints, actuator.parameters, strict=True))
    own = {name: _numbers(plain.model, base_numbers(plain.model), rows[name]) for name, plain in left.items()}
    own |= {j.model.joint: _numbers(j.model, j.numbers, rows[j.model.joint]) for j in joints}
    batches = [_alternatives(batch, joints, own) for batch in _together(joints)]
    every = [sure for batch in batches for _, _, numbers in batch for sure in numbers.values()] + list(own.values())
    columns = _varying(every, own, batches)
    if not columns:
        return None
    chosen = {name for batch in batches for name in batch[0][2]}
    groups = tuple(_group(name, own[name], columns) for name in actuator.joints if name not in chosen)
    choices = tuple(
        Choice(
            tuple(
                Alternative(name, odds / sum(odds for _, odds, _ in batch), _groups(numbers, columns, actuator.joints))
                for name, odds, numbers in batch
            )
        )
        for batch in batches
    )
    return Posterior(actuator.NAME, tuple(_NAMES[column] for column in columns), groups, choices)


_Weighed = tuple[str, float, dict[str, RowNumbers]]
"""Name, odds against the sets that were found, and joint → its numbers."""


def _numbers(model: ActuatorJoint, numbers: SetNumbers | None, row: np.ndarray) -> RowNumbers:
    return row_numbers(row, model.columns, numbers, len(np.unique(model.fit.trial)))


def _together(found: Sequence[JointFound]) -> list[list[JointFound]]:
    """Joints that have exchanges in common."""
    batches: list[tuple[set[tuple[str, str]], list[JointFound]]] = []
    for joint in found:
        own = {(exchange.leaves, exchange.joins) for exchange in joint.exchanges}
        if not own:
            continue
        near = [batch for batch in batches if batch[0] & own]
        batches = [batch for batch in batches if not batch[0] & own]
        batches.append((own.union(*(steps for steps, _ in near)), [j for _, js in near for j in js] + [joint]))
    order = {id(joint): k for k, joint in enumerate(found)}
    return sorted((sorted(js, key=lambda j: order[id(j)]) for _, js in batches), key=lambda js: order[id(js[0])])


def _alternatives(
    batch: Sequence[JointFound], found: Sequence[JointFound], own: Mapping[str, RowNumbers]
) -> list[_Weighed]:
    """What was found, and each exchange in all joints of a batch that can make it."""
    exchanges: dict[tuple[str, str], dict[str, Exchange]] = {}
    for joint in batch:
        for exchange in joint.exchanges:
            exchanges.setdefault((exchange.leaves, exchange.joins), {})[joint.model.joint] = exchange
    alternatives = [(AS_FOUND, 1.0, {joint.model.joint: own[joint.model.joint] for joint in batch})]
    for (leaves, joins), members in sorted(exchanges.items()):
        # The flow from the supply is one for all joints, so that those which keep their set belong to the rows.
        values = [
            members[j.model.joint].numbers.values if j.model.joint in members else modelled(j).values for j in found
        ]
        rows = FittedJoints.of([joint.model for joint in found], values).actuator().parameters
        numbers = {
            joint.model.joint: _numbers(joint.model, members[joint.model.joint].numbers, row)
            if joint.model.joint in members
            else own[joint.model.joint]
            for joint, row in zip(found, rows, strict=True)
            if joint in batch
        }
        odds = next(iter(members.values())).odds
        alternatives.append((f"{joins} in place of {leaves}", odds, numbers))
    return alternatives


def _varying(
    every: Sequence[RowNumbers], own: Mapping[str, RowNumbers], batches: Sequence[Sequence[_Weighed]]
) -> list[int]:
    """Columns that vary, or that differ between the alternatives of a joint."""
    varies = np.zeros(len(FIELDS), dtype=bool)
    for sure in every:
        varies |= np.diag(sure.covariance) > 0.0
    for batch in batches:
        for _, _, numbers in batch:
            for joint, sure in numbers.items():
                varies |= sure.row != own[joint].row
    return np.flatnonzero(varies).tolist()


def _groups(numbers: Mapping[str, RowNumbers], columns: list[int], order: Sequence[str]) -> tuple[Group, ...]:
    return tuple(_group(name, numbers[name], columns) for name in order if name in numbers)


def _group(joint: str, sure: RowNumbers, columns: list[int]) -> Group:
    return Group(
        (joint,),
        sure.row[columns],
        sure.covariance[np.ix_(columns, columns)],
        None,
        sure.trials,
        sure.lower[columns],
        sure.upper[columns],
    )
