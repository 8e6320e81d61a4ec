"""Regressors: what the torque of a joint is linear in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hqpipe.layers.joint_motion.hysteresis import slipping_spring
from hqpipe.layers.joint_motion.motion import Motion

NEIGHBOURS = 2  # joints before and after a joint whose motion is offered as a shape; assumption: the links next to it
SLIPS = (0.1, 0.3, 1.0)  # of the travel; assumption: shorter ways look like dry friction, longer ones like a spring
STRIBECK_SPEEDS = 10  # of the table over which the speed of the Stribeck friction is interpolated


@dataclass(frozen=True, eq=False)
class View:
    """What the columns of one joint are made of.

    Attributes:
        x: (T,) position less its mean over the fit trials. own: its motion.
        others: (x, motion, whether it turns) of the neighbouring joints.
    """

    x: np.ndarray
    own: Motion
    others: tuple[tuple[np.ndarray, Motion, bool], ...]


Column = Callable[[View], np.ndarray]


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a joint by group.

    Attributes:
        groups: name → indices. functions: of all columns.
        speeds: (S,) of the Stribeck table, rad/s.
    """

    groups: dict[str, tuple[int, ...]]
    functions: tuple[Column, ...]
    speeds: np.ndarray

    def __getitem__(self, name: str) -> tuple[int, ...]:
        return self.groups.get(name, ())

    def one(self, name: str) -> int:
        """Index of a group of one column."""
        return self.groups[name][0]

    def of(self, view: View) -> np.ndarray:
        """(K, T)"""
        return np.array([np.broadcast_to(function(view), view.x.shape) for function in self.functions])


def columns_of(
    turns: bool, bends: bool, others: tuple[bool, ...], adjacent: tuple[int, ...], travel: float, speeds: np.ndarray
) -> Columns:
    """All columns of a joint.

    Args:
        turns: revolute, so that gravity goes with the sine and cosine of the position. bends: whether the cosine counts.
        others: as `turns`, of its neighbours. adjacent: which of them are the next ones.
        travel: standard deviation of the position, rad or m.
        speeds: (S,) of the Stribeck table, rad/s.
    """
    found: dict[str, list[Column]] = {"inertia": [lambda w: w.own.acceleration], "offset": [lambda w: np.ones(1)]}
    if turns:
        found["gravity"] = [lambda w: np.sin(w.x), lambda w: np.cos(w.x) - 1.0][: 2 if bends else 1]
    found |= {
        "coulomb": [lambda w: w.own.direction],
        "viscous": [lambda w: w.own.velocity],
        "speed": [lambda w: np.abs(w.own.velocity)],
        "spring": [lambda w: w.x],
        "position": _position(turns, bends),
        "velocity": [lambda w: w.own.velocity * np.abs(w.own.velocity), lambda w: w.own.velocity**3],
        "acceleration": _varying_inertia(turns),
    }
    found["hysteresis"] = [_hysteresis(share * travel) for share in SLIPS]
    if others:
        found["other motion"] = [c for k in range(len(others)) for c in _other_motion(k)]
        found["other posture"] = [c for k, both in enumerate(others) for c in _other_posture(k, both and turns)]
    linked = [c for k in adjacent for c in _link_coupling(k, turns, others[k])]
    if linked:
        found["linked"] = linked
    found["stribeck"] = [_stribeck(speed) for speed in speeds]
    groups, functions = {}, []
    for name, part in found.items():
        groups[name] = tuple(range(len(functions), len(functions) + len(part)))
        functions += part
    return Columns(groups, tuple(functions), speeds)


def _position(turns: bool, bends: bool) -> list[Column]:
    """Second harmonics of the position, less what gravity's own columns hold of them; or a parabola and a cubic."""
    if not turns:
        return [lambda w: w.x**2, lambda w: w.x**3]
    odd = [lambda w: np.sin(w.x) * (1.0 - np.cos(w.x))]
    return [*odd, lambda w: (1.0 - np.cos(w.x)) ** 2] if bends else [lambda w: 1.0 - np.cos(w.x), *odd]


def _hysteresis(slip: float) -> Column:
    return lambda w: slipping_spring(np.ascontiguousarray(w.x), slip)


def _varying_inertia(turns: bool) -> list[Column]:
    """J(q)·a + ½ J'(q)·v² (Lagrange) for the first terms of J."""
    if turns:
        return [
            lambda w: np.sin(w.x) * w.own.acceleration + 0.5 * np.cos(w.x) * w.own.velocity**2,
            lambda w: (np.cos(w.x) - 1.0) * w.own.acceleration - 0.5 * np.sin(w.x) * w.own.velocity**2,
        ]
    return [lambda w: w.x * w.own.acceleration + 0.5 * w.own.velocity**2]


def _other_motion(k: int) -> list[Column]:
    return [
        lambda w: w.others[k][1].acceleration,
        lambda w: w.others[k][1].velocity,
        lambda w: w.others[k][1].velocity ** 2,
    ]


def _other_posture(k: int, turn: bool) -> list[Column]:
    """Gravity of a link goes with the sum of the angles on the way to it: the sine and cosine of x + y, less those of x."""
    if not turn:
        return [lambda w: w.others[k][0], lambda w: w.x * w.others[k][0]]
    return [
        lambda w: np.cos(w.x) * np.sin(w.others[k][0]),
        lambda w: np.sin(w.x) * np.sin(w.others[k][0]),
        lambda w: np.cos(w.x) * (np.cos(w.others[k][0]) - 1.0),
        lambda w: np.sin(w.x) * (np.cos(w.others[k][0]) - 1.0),
    ]


def _link_coupling(k: int, turns: bool, other_turns: bool) -> list[Column]:
    """Inertia between two links: it goes with the sine and cosine of the joint further out, which is either of the two.

    The terms of the Lagrangian of a two-link arm, of an unknown phase.
    """
    found: list[Column] = []
    if turns:
        found += [
            lambda w: w.others[k][1].acceleration * (np.cos(w.x) - 1.0),
            lambda w: w.others[k][1].acceleration * np.sin(w.x),
            lambda w: w.others[k][1].velocity ** 2 * (np.cos(w.x) - 1.0),
            lambda w: w.others[k][1].velocity ** 2 * np.sin(w.x),
        ]
    if other_turns:
        found += [
            lambda w: w.others[k][1].acceleration * (np.cos(w.others[k][0]) - 1.0),
            lambda w: w.others[k][1].acceleration * np.sin(w.others[k][0]),
            lambda w: w.own.acceleration * (np.cos(w.others[k][0]) - 1.0),
            lambda w: w.own.acceleration * np.sin(w.others[k][0]),
            lambda w: w.others[k][1].velocity ** 2 * (np.cos(w.others[k][0]) - 1.0),
            lambda w: w.others[k][1].velocity ** 2 * np.sin(w.others[k][0]),
            lambda w: w.own.velocity * w.others[k][1].velocity * np.cos(w.others[k][0]),
            lambda w: w.own.velocity * w.others[k][1].velocity * np.sin(w.others[k][0]),
        ]
    return found


def _stribeck(speed: float) -> Column:
    return lambda w: w.own.direction * np.exp(-((w.own.velocity / speed) ** 2))
