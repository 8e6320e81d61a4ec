"""The servo layer: which joints of a log set it can judge, and their models."""

from __future__ import annotations

import os
from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from hqpipe.identify.model import LayerJoints
from hqpipe.layers.refusal import no_joint_judged
from hqpipe.layers.servo.build import joint_model
from hqpipe.layers.servo.prepare import Prepared, prepare
from hqpipe.layers.servo.rows import LEAST_WINDOW
from hqpipe.layers.servo.scale import duty_of
from hqpipe.logs.columns import joint_column
from hqpipe.logs.survey.end_stop import EndStop, end_stops
from hqpipe.logs.trajectory import LogSet

RESPONSES = 5.0  # a window is this many response times long: what is left of a first-order response is e⁻⁵, 0.7 %
LONGEST_WINDOW = 2.0  # s; assumption: longer windows leave too few of them


class Servo:
    """Free run of the position from its command, or from duty and voltage."""

    NAME = "servo"

    def lacking(self, log_set: LogSet) -> list[str]:
        """Columns without which nothing can be judged."""
        trials = [trial.trajectory for trial in log_set.trials]
        commanded = all(t.position_command is not None for t in trials)
        duty = any(all(duty_of(t, joint) is not None for t in trials) for joint in log_set.joints)
        return [] if commanded or duty else [joint_column("<name>", "position_command")]

    def joints(self, log_set: LogSet, window_s: float | None = None, without: Collection[str] = ()) -> LayerJoints:
        """Models of all joints that can be judged.

        Args:
            window_s: s, length of a free run; None for five response times of the slowest joint.
            without: names of effects to leave out.

        Raises:
            IdentificationError: no joint can be judged.
        """
        ready: list[Prepared] = []
        left: dict[str, str] = {}
        stops = end_stops([(trial.file, trial.trajectory) for trial in log_set.trials])
        for joint in log_set.joints:
            found = prepare(log_set, joint, stops, window_s)
            if isinstance(found, str):
                left[joint] = found
            else:
                ready.append(found)
        length, reason = _window(ready, window_s) if ready else (0.0, "")
        models = []
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:  # most of it is compiled code
            built = list(pool.map(lambda item: joint_model(item, length, without), ready))
        for item, model in zip(ready, built, strict=True):
            if isinstance(model, str):
                left[item.joint] = model
            else:
                models.append(model)
        if not models:
            raise no_joint_judged(
                log_set.path,
                "from its position",
                left,
                "record the position command, or duty and voltage, of joints that move, at a steady rate",
            )
        return LayerJoints(
            layer=self.NAME,
            metric="free_run_rmse",
            window_s=length,
            window_reason=reason,
            models=tuple(models),
            left=left,
            warnings=_stop_warnings(stops),
        )


def _stop_warnings(stops: list[EndStop]) -> tuple[str, ...]:
    return tuple(
        f"{stop.joint} stands at an end stop at {stop.position:.4g} in {', '.join(stop.files)}: these samples are left out"
        for stop in stops
    )


def _window(ready: list[Prepared], stated: float | None) -> tuple[float, str]:
    """Length of a window, s, and why."""
    dt = max(float(np.median(item.tracks[0].dt)) for item in ready)
    if stated is not None:
        length = max(stated, LEAST_WINDOW * dt)
        reason = "as asked for" if length == stated else f"{LEAST_WINDOW} samples, more than the {stated:g} s asked for"
        return length, reason
    slowest = max(ready, key=lambda item: item.response_s)
    length = max(min(RESPONSES * slowest.response_s, LONGEST_WINDOW), LEAST_WINDOW * dt)
    reason = f"{RESPONSES:g} times the {1e3 * slowest.response_s:.0f} ms by which {slowest.joint} follows its input"
    if length == LEAST_WINDOW * dt:
        reason = f"{LEAST_WINDOW} samples, more than {reason}"
    elif length == LONGEST_WINDOW:
        reason = f"at most {LONGEST_WINDOW:g} s; {slowest.joint} follows its input by {1e3 * slowest.response_s:.0f} ms"
    return length, reason
