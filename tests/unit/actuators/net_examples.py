"""Neural actuator models with random weights, for the tests."""

from __future__ import annotations

import numpy as np

from hqpipe.actuators import ACTUATOR_MODELS
from hqpipe.actuators.net import NetActuator

NETS = ("mlp", "lstm", "gru")
SPREADS = (100.0, 0.2, 0.2, 2.0)  # of torque, target, position and velocity


def random_net(kind, joints, *, hidden=8, seed=0, size=1.0, effort_limit=np.inf, **options) -> NetActuator:
    """Every tensor drawn; outputs of about `size` times 100 N·m, or 10 N·m a sample where they are changes of torque."""
    model, rng = ACTUATOR_MODELS[kind], np.random.default_rng(seed)
    count, taps, per_joint = len(joints), options.get("taps", (0,)), options.get("per_joint", False)
    shapes = model.shapes(count, hidden, len(taps), per_joint)
    tensors = {name: rng.normal(size=shape) for name, shape in shapes.items()}
    for name in ("input_weight", "recurrent_weight", "output_weight"):
        if name in tensors:
            tensors[name] /= np.sqrt(tensors[name].shape[-1])
    spread = np.tile(SPREADS, (count, 1)) if per_joint else np.repeat(SPREADS, count)
    tensors["input_mean"] *= 0.1 * spread
    tensors["input_spread"] = spread * rng.uniform(0.8, 1.2, spread.shape)
    scale = size * (10.0 if options.get("delta") else 100.0)
    tensors["output_mean"] *= 0.1 * scale
    tensors["output_spread"] = scale * rng.uniform(0.8, 1.2, shapes["output_spread"])
    return model.build(joints, dt=1e-3, effort_limit=effort_limit, tensors=tensors, **options)


def driven(model, samples=40, seed=1):
    """(T, J) torque, target, position, velocity as a log would hold them."""
    rng = np.random.default_rng(seed)
    return tuple(spread * rng.normal(size=(samples, len(model.joints))) for spread in SPREADS)
