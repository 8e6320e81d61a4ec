"""Where a fit starts: regression of the smoothed equation of motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from hqpipe.layers.servo.scale import Scale
from hqpipe.layers.servo.tracks import Tracks
from hqpipe.logs.joint_kinds import PRISMATIC

LARGEST = 0.99  # quantile that counts as the largest value; the rest may be glitches
_COARSE = 10  # samples; assumption: an acceleration needs a few times the span of the initial state
_REST = 0.05  # of the largest speed, over which the direction of dry friction turns; assumption
_ROWS = 20_000  # of the regression; assumption: more add nothing to a starting value


@dataclass(frozen=True)
class Start:
    """Values of the base with which a fit starts; unused where they are known. `least_inertia` is what a step can resolve."""

    inertia: float
    gain: float
    drag: float
    gravity_sin: float
    gravity_cos: float
    offset: float
    least_inertia: float


def drive_error(tracks: Tracks, scale: Scale) -> np.ndarray:
    """(N,) what the gain of the drive multiplies: the error of the command, or duty × voltage."""
    return tracks.inputs if scale.duty else tracks.inputs - tracks.smooth


def start_of(
    tracks: Tracks,
    rows: np.ndarray,
    scale: Scale,
    response_s: float,
    substep: float,
    travel: float,
    gain: np.ndarray,
    load: np.ndarray,
) -> Start:
    """Base values of a joint from its fit trials.

    Args:
        rows: (R,) of the trials into the numbers of `scale`. response_s: of the joint. substep: s, of the simulation.
        gain, load: ratios of the trials of `scale`, where these differ without being stated.
    """
    acceleration = acceleration_of(tracks, response_s)
    of = rows[tracks.trial]
    pull = scale.gain[of] * gain[of] * drive_error(tracks, scale)
    drag = scale.drag[of] * tracks.velocity
    needed = scale.inertia[of] * acceleration + scale.gravity[of] * np.sin(tracks.smooth)
    # Columns: torque asked for = what is known, plus free numbers times these.
    columns = {"offset": np.ones(len(pull))}
    if not scale.load:
        columns["inertia"] = load[of] * acceleration
        if scale.kind != PRISMATIC:
            sine, cosine = load[of] * np.sin(tracks.smooth), load[of] * np.cos(tracks.smooth)
            columns |= {"gravity_sin": sine, "gravity_cos": cosine}
    if scale.free_gain:
        columns["gain"] = -pull
    else:
        needed = needed - pull
    if scale.free_drag:
        columns["drag"] = drag
    else:
        needed = needed + drag
    # Dry friction is no part of the base, but without it gravity and drag would take its share.
    columns["dry"] = np.tanh(tracks.velocity / (_REST * (np.abs(tracks.velocity).max() or 1.0)))
    picked = np.flatnonzero(tracks.usable)
    picked = picked[:: max(1, len(picked) // _ROWS)]
    matrix = np.column_stack([column[picked] for column in columns.values()])
    size = np.sqrt(np.mean(matrix**2, axis=0)) + 1e-300
    low = [0.0 if name in ("inertia", "gain", "drag", "dry") else -np.inf for name in columns]
    solved = lsq_linear(matrix / size, -needed[picked], (np.array(low), np.full(len(low), np.inf))).x / size
    found = dict.fromkeys(("inertia", "gain", "drag", "gravity_sin", "gravity_cos", "offset"), 0.0)
    found |= dict(zip(columns, (float(value) for value in solved), strict=True))
    return _bounded(found, scale, pull, response_s, substep, travel)


def _bounded(
    found: dict[str, float], scale: Scale, pull: np.ndarray, response_s: float, substep: float, travel: float
) -> Start:
    """The same, with what a regression on noisy derivatives may have lost put at what the response allows."""
    gain = found["gain"] if scale.free_gain else 1.0
    torque = float(np.quantile(np.abs(pull), LARGEST)) or 1.0
    if scale.free_gain and gain <= 0.0:
        gain = max(float(np.max(scale.gravity)), 1e-3) / torque
    # A loop whose natural period is shorter than six substeps, or a joint that crosses its travel in one, is not resolved.
    stiffest = 0.0 if scale.duty else float(np.max(scale.gain)) * gain
    least = max(stiffest * substep**2, torque * gain * substep**2 / (2.0 * travel))
    inertia = max(found["inertia"], 4.0 * least)
    drag = found["drag"] if scale.free_drag else 1.0
    if scale.free_drag and drag <= 0.0:
        reference = gain if not scale.duty else inertia / response_s**2
        drag = reference * response_s / float(np.median(scale.drag))
    return Start(inertia, gain, drag, found["gravity_sin"], found["gravity_cos"], found["offset"], least)


def acceleration_of(tracks: Tracks, response_s: float) -> np.ndarray:
    """(N,) zero-phase slope of the smoothed velocity, of each trial."""
    from scipy.signal import savgol_filter

    result = np.empty(len(tracks.position))
    for number, dt in enumerate(tracks.dt):
        rows = np.flatnonzero(tracks.trial == number)
        span = min(max(_COARSE, int(round(0.25 * response_s / dt))) | 1, len(rows) - 1 + len(rows) % 2)
        result[rows] = savgol_filter(tracks.velocity[rows], span, 2, deriv=1, delta=dt)
    return result
