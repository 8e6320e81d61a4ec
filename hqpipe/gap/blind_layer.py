"""The gap of withheld-effect cases in the layers of `hqpipe.layers`, and the effects that such logs are asked for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from hqpipe.errors import IdentificationError, LogError
from hqpipe.gap.blind_truth import QUADRUPED, Answer, Gap
from hqpipe.gap.joint_scale import joint_scale, pooled
from hqpipe.identify.model import JointModel, LayerJoints, Samples, all_parameters, positions
from hqpipe.layers import LAYERS
from hqpipe.logs.log_set import read_log_set
from hqpipe.registry import load

OF_MACHINE = {"servo": "servo", "arm": "joint_motion", "cylinder": "valve"}
"""Machine → layer in which its effects show, by what such logs hold: a command and a position; a torque or current and a
position; a valve command and a speed."""
MOST_STEPS = 200  # of a fit; a base model has a handful of parameters, and a fit that needs more wanders along a valley


def layer_of(answer: Answer) -> str | None:
    """Layer in which the gap of a case is measured: that of its machine, else the first one that its effects name.

    None where it is the error of the paper's four coefficients, see `hqpipe.gap.blind_truth.base_gap`.

    Raises:
        LogError: neither tells the layer.
    """
    if answer.machine == QUADRUPED:
        return None
    named = [effect.layer for effect in answer.effects if effect.layer in LAYERS]
    layer = OF_MACHINE.get(answer.machine) or next(iter(named), None)
    if layer is None:
        text = f"{answer.case}: no layer is known for machine '{answer.machine}' (known: {', '.join(OF_MACHINE)})"
        raise LogError(text, field="machine", fix="make the cases again with this version")
    return layer


def layer_joints(folder: Path, layer: str, window_s: float | None = None) -> LayerJoints:
    """The joints of a log set in a layer.

    Args:
        window_s: length of a free run, s; None for what suits the logs.

    Raises:
        LogError: the logs lack what the layer needs.
    """
    log_set, model = read_log_set(folder), load(LAYERS[layer])()
    if lacking := model.lacking(log_set):
        text = f"{folder}: layer {layer} lacks {', '.join(lacking)}"
        raise LogError(text, file=folder, fix="make the cases again with this version")
    return model.joints(log_set, window_s, ())


def library_of(folder: Path) -> tuple[str, ...]:
    """Names of the effects that a diagnosis of a log set asks for: those of every layer that can judge a joint of it."""
    log_set, names = read_log_set(folder), {}
    for target in LAYERS.values():
        layer = load(target)()
        if layer.lacking(log_set):
            continue
        try:
            models = layer.joints(log_set, None, ()).models
        except IdentificationError:  # no joint can be judged in this layer, so that no effect of it is asked for
            continue
        names |= dict.fromkeys(effect.name for model in models for effect in model.effects if effect.named)
    return tuple(names)


def layer_gaps(folders: Mapping[str, Path], layer: str) -> dict[str, Gap]:
    """Base gap of a case and of its machines without effects, all in the windows and over the scales of the case.

    Args:
        folders: name of a set → log set; that of the case is "with".

    Returns:
        Name of the set → joint → held-out RMSE of the base model in the unit of the joint's output, and over "all" joints,
        each over its scale. Joints that one of the sets cannot judge are left out of all.

    Raises:
        LogError: no joint can be judged in all sets.
    """
    case = layer_joints(folders["with"], layer)
    scale = {model.joint: samples_scale(model.fit) for model in case.models}
    errors = {}
    for name, folder in folders.items():
        joints = case if name == "with" else layer_joints(folder, layer, case.window_s)
        errors[name] = {model.joint: heldout_error(model) for model in joints.models if len(model.heldout.output)}
    judged = [joint for joint in scale if all(joint in found for found in errors.values())]
    if not judged:
        fix = "make the cases again with this version"
        raise LogError(f"{folders['with']}: no joint has held-out samples in all of its log sets", fix=fix)
    weights = np.array([scale[joint] for joint in judged])
    return {
        name: {"all": pooled(np.array([found[j] for j in judged]), weights), **{j: found[j] ** 0.5 for j in judged}}
        for name, found in errors.items()
    }


def samples_scale(samples: Samples) -> float:
    """What errors of a joint count against, in the unit of its output, see `hqpipe.gap.joint_scale`."""
    return joint_scale([samples.output[samples.trial == index] for index in np.unique(samples.trial)])


def heldout_error(model: JointModel) -> float:
    """Mean squared held-out error of the base model, fitted to the fit samples, in the squared unit of the output."""
    return float(np.mean(model.error(fit_base(model), heldout=True) ** 2))


def fit_base(model: JointModel) -> np.ndarray:
    """(P,) values of `hqpipe.identify.model.all_parameters` with the base parameters fitted and every effect absent.

    Least squares within the bounds, from the neutral values and from each of the `starts` of a parameter; the best counts.
    """
    parameters = all_parameters(model)
    values = np.array([parameter.neutral for parameter in parameters], dtype=np.float64)
    free = positions(model, ())
    if not len(free):
        return values
    starts = [values[free]]
    for index in free:
        for start in parameters[index].starts:
            starts.append(np.where(free == index, start, values[free]))
    low, high = (np.array([getattr(parameters[index], name) for index in free]) for name in ("low", "high"))
    fits = [_fit_from(model, values, free, start, low, high) for start in starts]
    values[free] = min(fits, key=lambda fit: fit.cost).x
    return values


def _fit_from(
    model: JointModel, values: np.ndarray, free: np.ndarray, start: np.ndarray, low: np.ndarray, high: np.ndarray
) -> Any:
    def error(x: np.ndarray) -> np.ndarray:
        row = values.copy()
        row[free] = x
        return model.error(row)

    return least_squares(error, np.clip(start, low, high), bounds=(low, high), x_scale="jac", max_nfev=MOST_STEPS)
