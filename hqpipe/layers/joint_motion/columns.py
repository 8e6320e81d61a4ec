"""Regressors: what the torque of a joint is linear in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hqpipe.layers.joint_motion.coupling import Angle, Coupling
from hqpipe.layers.joint_motion.hysteresis import slipping_spring
from hqpipe.layers.joint_motion.motion import Motion

SLIPS = (0.1, 0.3, 1.0)  # of the travel; assumption: shorter ways look like dry friction, longer ones like a spring
STRIBECK_SPEEDS = 10  # of the table over which the speed of the Stribeck friction is interpolated


@dataclass(frozen=True, eq=False)
class View:
    """What the columns of one joint are made of.

    Attributes:
        x: (T,) position less its mean over the fit trials. own: its motion.
        others: of the joints before and after it, in the order of the chain.
    """

    x: np.ndarray
    own: Motion
    others: tuple[Angle, ...] = ()


Column = Callable[[View], np.ndarray]


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a joint by group.

    Attributes:
        groups: name → indices. functions: of the joint's own columns. speeds: (S,) of the Stribeck table, rad/s.
        coupling: what the other joints do, whose terms follow as the group "coupling"; None for a joint by itself.
    """

    groups: dict[str, tuple[int, ...]]
    functions: tuple[Column, ...]
    speeds: np.ndarray
    coupling: Coupling | None = None

    @property
    def own(self) -> int:
        """Number of the joint's own columns, which come first."""
        return len(self.functions)

    def __getitem__(self, name: str) -> tuple[int, ...]:
        return self.groups.get(name, ())

    def one(self, name: str) -> int:
        """Index of a group of one column."""
        return self.groups[name][0]

    def of(self, view: View) -> np.ndarray:
        """(K, T)"""
        found = np.array([np.broadcast_to(function(view), view.x.shape) for function in self.functions])
        if self.coupling is None:
            return found
        at = self.coupling.own
        chain = (*view.others[:at], (view.x, view.own, self.coupling.turns[at]), *view.others[at:])
        return np.concatenate([found, self.coupling.rows(chain)])


def columns_of(turns: bool, bends: bool, coupling: Coupling | None, travel: float, speeds: np.ndarray) -> Columns:
    """All columns of a joint.

    Args:
        turns: revolute, so that gravity goes with the sine and cosine of the position. bends: whether the cosine counts.
        coupling: what the other joints do; None for a joint by itself.
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
    found["stribeck"] = [_stribeck(speed) for speed in speeds]
    groups, functions = {}, []
    for name, part in found.items():
        groups[name] = tuple(range(len(functions), len(functions) + len(part)))
        functions += part
    if coupling is not None:
        groups["coupling"] = tuple(range(len(functions), len(functions) + coupling.count()))
    return Columns(groups, tuple(functions), speeds, coupling)


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


def _stribeck(speed: float) -> Column:
    return lambda w: w.own.direction * np.exp(-((w.own.velocity / speed) ** 2))
