"""The gap of withheld-effect cases in the layers of `hqpipe.layers`, and the effects that such logs are asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from hqpipe.benchmark.score.truth import QUADRUPED, Answer, Gap
from hqpipe.errors import IdentificationError, LogError
from hqpipe.gap.residuals.joint_scale import joint_scale, pooled
from hqpipe.gap.routing import ACTUATOR, route
from hqpipe.identify.base_solution import base_solution
from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import JointModel, LayerJoints, Samples
from hqpipe.layers import LAYERS
from hqpipe.logs.log_set import read_log_set
from hqpipe.registry import load

OF_MACHINE = {
    "servo": ("servo",),
    "arm": ("joint_motion", "servo"),
    "cylinder": ("valve",),
    "torque_cylinder": ("torque",),
}
"""Machine → layers in which its effects can show: an arm without a torque or current in its logs has the layer of a servo."""


def layers_of(answer: Answer) -> tuple[str, ...]:
    """Layers in which the gap of a case may be measured, of which the first counts that its logs allow.

    Those that its effects name, then those of its machine. None where it is the error of the paper's four coefficients, see
    `hqpipe.benchmark.score.truth.base_gap`.
    """
    if answer.machine == QUADRUPED:
        return ()
    named = [effect.layer for effect in answer.effects if effect.layer in LAYERS]
    return tuple(dict.fromkeys((*named, *OF_MACHINE.get(answer.machine, LAYERS))))


def layer_joints(folder: Path, layers: Sequence[str], window_s: float | None = None) -> LayerJoints:
    """The joints of a log set in the first of the layers that it allows.

    Args:
        window_s: length of a free run, s; None for what suits the logs.

    Raises:
        LogError: the logs lack what each of the layers needs.
    """
    log_set, lacking = read_log_set(folder), {}
    for name in layers:
        layer = load(LAYERS[name])()
        lacking[name] = layer.lacking(log_set)
        if not lacking[name]:
            return layer.joints(log_set, window_s, ())
    needs = "; ".join(f"layer {name} needs {', '.join(what)}" for name, what in lacking.items())
    raise LogError(f"{folder}: {needs}", file=folder, fix="make the cases again with this version")


def library_of(folder: Path) -> tuple[str, ...]:
    """Names of the effects that a diagnosis of a log set asks for: those of every layer that can judge a joint of it."""
    log_set, names = read_log_set(folder), {}
    for key, target in LAYERS.items():
        if key == ACTUATOR and not route(log_set).actuator:  # its channels are there, but no such law is asked for
            continue
        layer = load(target)()
        if layer.lacking(log_set):
            continue
        try:
            models = layer.joints(log_set, None, ()).models
        except IdentificationError:  # no joint can be judged in this layer, so that no effect of it is asked for
            continue
        names |= dict.fromkeys(effect.name for model in models for effect in model.effects if effect.named)
        names |= dict.fromkeys(name for model in models for name in getattr(model, "implies", ()))
    return tuple(names)


def layer_gaps(folders: Mapping[str, Path], layers: Sequence[str]) -> dict[str, Gap]:
    """Base gap of a case and of its machines without effects, all in the layer, the windows and over the scales of the case.

    Args:
        folders: name of a set → log set; that of the case is "with". layers: of `layers_of`.

    Returns:
        Name of the set → joint → held-out RMSE of the base model in the unit of the joint's output, and over "all" joints,
        each over its scale. Joints that one of the sets cannot judge are left out of all.

    Raises:
        LogError: a log set lacks what the layers need. IdentificationError: no joint can be judged in all sets, as where the
            held-out trials run with gains that no fit trial has.
    """
    case = layer_joints(folders["with"], layers)
    own = [name for name in layers if load(LAYERS[name]).NAME == case.layer]
    scale = {model.joint: samples_scale(model.fit) for model in case.models}
    errors = {}
    for name, folder in folders.items():
        joints = case if name == "with" else layer_joints(folder, own, case.window_s)
        found = {model.joint: heldout_error(model) for model in joints.models if len(model.heldout.output)}
        errors[name] = {joint: error for joint, error in found.items() if np.isfinite(error)}
    judged = [joint for joint in scale if all(joint in found for found in errors.values())]
    if not judged:
        raise IdentificationError(f"{folders['with']}: no joint has held-out samples in all of its log sets")
    weights = np.array([scale[joint] for joint in judged])
    return {
        name: {"all": pooled(np.array([found[j] for j in judged]), weights), **{j: found[j] ** 0.5 for j in judged}}
        for name, found in errors.items()
    }


def samples_scale(samples: Samples) -> float:
    """What errors of a joint count against, in the unit of its output, see `hqpipe.gap.residuals.joint_scale`."""
    return joint_scale([samples.output[samples.trial == index] for index in np.unique(samples.trial)])


def heldout_error(model: JointModel) -> float:
    """Mean squared held-out error of the base model, fitted to the fit samples, in the squared unit of the output."""
    return float(np.mean(model.error(base_solution(Fitter(model)).values, heldout=True) ** 2))
