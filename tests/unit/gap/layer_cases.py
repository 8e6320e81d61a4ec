"""Joints of a made-up layer, and the logs that they are of."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from hqpipe.identify.found import Fitted, JointCause, JointFound, LayerFound, Number
from hqpipe.identify.model import LayerJoints
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

sys.path.insert(0, str(Path(__file__).parents[1] / "identify"))
from identify.toy_joint import ToyJoint

WINDOW_S = 0.5


def held(joint):
    """The joint with the output at the start of each window as its persistence."""
    for part in (joint.fit, joint.heldout):
        start = np.flatnonzero(np.append(True, np.diff(np.floor(part.time / WINDOW_S)) != 0))
        part.held[:] = part.output[start[np.searchsorted(start, np.arange(len(part.time)), side="right") - 1]]
    return joint


def toy(joint, seed, seconds=20.0, noise=0.1, **truth):
    made = ToyJoint(joint, truth, noise=noise, seed=seed, seconds=seconds)
    for name in ("fit", "heldout"):
        setattr(made, name, replace(getattr(made, name), held=getattr(made, name).output.copy()))
    return held(made)


def layer_joints(models, layer="joint_motion", metric="inverse_dynamics_rmse", **more) -> LayerJoints:
    return LayerJoints(layer, metric, WINDOW_S, "as given", tuple(models), **more)


def log_set(models, heldout=True) -> LogSet:
    """The logs that the joints are of: position, velocity and torque."""
    trials = []
    for split in ("fit", "heldout") if heldout else ("fit",):
        parts = [getattr(model, split) for model in models]
        for i, file in enumerate(parts[0].files):
            rows = parts[0].trial == i
            columns = {
                name: np.stack([getattr(p, source)[rows] for p in parts], axis=1)
                for name, source in (("position", "position"), ("velocity", "velocity"), ("effort", "output"))
            }
            names = tuple(model.joint for model in models)
            trials.append(Trial(file, split, None, Trajectory(parts[0].time[rows], names, **columns), "fixed"))
    names = tuple(model.joint for model in models)
    rest = ("hqpipe-log/1", None, "fixed", None, "current", 200.0, names, tuple(trials))
    return LogSet(Path("toy"), "0" * 64, *rest)


def number(name, value, half, unit="N·m", reference=None) -> Number:
    return Number(name, unit, value, (value - half, value + half), reference)


def cause(effect, *numbers, probability=0.9, rivals=()) -> JointCause:
    return JointCause(effect, probability, tuple(numbers), tuple(rivals))


def made_up(model, base, named, full=None, causes=(), without=None, shapes=None) -> JointFound:
    """A joint whose errors are noise of these sizes, equal in shape."""
    parts = len(model.fit.time), len(model.heldout.time)
    shape = [np.random.default_rng(5).standard_normal(n) for n in parts]

    def fitted(size) -> Fitted:
        return Fitted((), np.zeros(0), size * shape[0], size * shape[1])

    without = {name: fitted(size) for name, size in (without or {}).items()}
    full = named if full is None else full
    gains = {"spring": -3.0}
    return JointFound(
        model, fitted(base), fitted(named), fitted(full), fitted(full), tuple(causes), without, {}, gains, shapes or {}
    )


def layer_found(*joints, **more) -> LayerFound:
    return LayerFound(layer_joints([joint.model for joint in joints], **more), tuple(joints))
