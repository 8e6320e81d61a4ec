"""A joint whose torque is linear in its numbers, with correlated noise of known strength."""

from __future__ import annotations

import numpy as np

from hqpipe.identify.model import Effect, Parameter, Samples, all_parameters

DT = 0.005


class ToyJoint:
    """Torque of inertia and offset, with friction, a spring and two generic shapes as candidates.

    Args:
        truth: parameter or effect → number; those that are not named are neutral. unknown: size of an effect that no candidate
            describes. correlation: of neighbouring noise samples, 0 … 1.
    """

    unit, dt, notes = "N·m", DT, ()
    base = (Parameter("inertia", "kg·m²", 1.0, np.inf, 0.0), Parameter("offset", "N·m", 0.0, np.inf))
    effects = (
        Effect("coulomb_friction", (Parameter("friction_nm", "N·m", 0.0, 0.5, 0.0),)),
        Effect("viscous_friction", (Parameter("nm_s_per_rad", "N·m·s/rad", 0.0, 0.5, 0.0),)),
        Effect("spring", (Parameter("nm_per_rad", "N·m/rad", 0.0, 0.5),)),
        Effect("cubic", (Parameter("size", "1", 0.0, 0.5),), named=False, signal="position"),
        Effect("quadratic", (Parameter("size", "1", 0.0, 0.5),), named=False, signal="velocity"),
    )

    def __init__(self, joint="hip", truth=None, noise=0.1, correlation=0.0, seed=0, unknown=0.0, seconds=20.0):
        self.joint = joint
        rng = np.random.default_rng(seed)
        self.fit, self._fit = self._part(("a", "b"), truth or {}, noise, correlation, unknown, seconds, rng)
        self.heldout, self._heldout = self._part(("c",), truth or {}, noise, correlation, unknown, seconds, rng)
        self.noise = (noise, noise)

    def _part(self, files, truth, noise, correlation, unknown, seconds, rng):
        time = np.arange(0.0, seconds, DT)
        parts = []
        for k in range(len(files)):
            a, b = rng.uniform(0.3, 0.6), rng.uniform(1.0, 1.6)
            phase = rng.uniform(0.0, 6.0, 2)
            angle = 2 * np.pi * np.array([[a], [b]]) * time + phase[:, None]
            speed = 2 * np.pi * np.array([[a], [b]])
            q = (np.array([[0.8], [0.3]]) * np.sin(angle)).sum(axis=0)
            v = (np.array([[0.8], [0.3]]) * speed * np.cos(angle)).sum(axis=0)
            acceleration = -(np.array([[0.8], [0.3]]) * speed**2 * np.sin(angle)).sum(axis=0)
            parts.append((np.full(len(time), k), time, q, v, acceleration))
        trial, clock, q, v, acceleration = (np.concatenate(column) for column in zip(*parts, strict=True))
        regressors = np.stack([acceleration, np.ones_like(q), np.sign(v), v, q, q**3, v * np.abs(v)])
        names = [p.name for p in ToyJoint.base] + [e.name for e in ToyJoint.effects]
        numbers = np.array([truth.get(name, 1.0 if name == "inertia" else 0.0) for name in names])
        white = rng.normal(0.0, noise * np.sqrt(1.0 - correlation**2), len(q))
        for k in range(1, len(white)):
            white[k] += correlation * white[k - 1]
        output = numbers @ regressors + white + unknown * np.sin(9.0 * q)
        return Samples(tuple(files), trial, clock, q, v, output, np.roll(output, 20)), regressors

    def error(self, values, heldout=False):
        part, regressors = (self.heldout, self._heldout) if heldout else (self.fit, self._fit)
        return values @ regressors - part.output

    @property
    def size(self):
        return len(all_parameters(self))
