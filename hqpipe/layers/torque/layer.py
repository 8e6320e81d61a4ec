"""Joints whose torque is commanded and measured: from the command to the effort."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.identify.model import FORCE_SENSOR, LayerJoints
from hqpipe.layers.refusal import no_joint_judged
from hqpipe.layers.torque.build import Seen, joint_of, seen_in
from hqpipe.logs.end_stops import at_end_stop, mark_end_stops
from hqpipe.logs.trajectory import LogSet

NEEDED = ("effort_command", "effort", "position", "velocity")
LEAST_ROWS, LEAST_S = 20, 0.1  # of a window; assumption: as in the other layers
RESPONSES, LONGEST_S = 15.0, 0.5  # response times of the loop in a window; s, of one chosen by these rules; assumption


class Torque:
    """The actuator layer in control mode torque: commanded torque → measured torque."""

    NAME = "actuator"

    def lacking(self, log_set: LogSet) -> list[str]:
        """Columns that the logs do not have."""
        return [name for name in NEEDED if any(getattr(t.trajectory, name) is None for t in log_set.trials)]

    def joints(self, log_set: LogSet, window_s: float | None = None, without: Collection[str] = ()) -> LayerJoints:
        """The joints whose torque is commanded.

        Args:
            log_set: with commanded and measured efforts; where no end stops are marked, they are looked for.
            window_s: length of a free run; None for one that suits the logs.
            without: names of effects to leave out.

        Raises:
            IdentificationError: no joint can be judged.
        """
        lacking = self.lacking(log_set)
        if lacking:
            raise IdentificationError(
                f"{log_set.path}: no column {' and '.join(lacking)}, which the layer '{self.NAME}' in mode torque needs",
                file=log_set.path,
                field=lacking[0],
                fix="record the commanded and the measured torque of the joints",
            )
        told: tuple[str, ...] = ()
        if all(at_end_stop(trial.trajectory) is None for trial in log_set.trials):
            log_set, told = mark_end_stops(log_set)
        dt = float(np.median([t.trajectory.dt for t in log_set.trials]))
        every = {name: seen_in(log_set, j, dt) for j, name in enumerate(log_set.joints)}
        left = {name: seen for name, seen in every.items() if isinstance(seen, str)}
        kept = {name: seen for name, seen in every.items() if not isinstance(seen, str)}
        length, reason = _window(dt, kept, window_s)
        models = []
        for name, seen in kept.items():
            model = joint_of(log_set, name, seen, length, without)
            if isinstance(model, str):
                left[name] = model
            else:
                models.append(model)
        if not models:
            raise no_joint_judged(
                log_set.path,
                "by its commanded torque",
                left,
                "record motions under changing commands",
                "effort_command",
            )
        return LayerJoints(self.NAME, "free_run_rmse", length, reason, tuple(models), left, told, material=FORCE_SENSOR)


def _window(dt: float, joints: dict[str, Seen], window_s: float | None) -> tuple[float, str]:
    """Length of a free run, s, and why."""
    if window_s is not None:
        return max(window_s, 10.0 * dt), "as asked for, and at least ten samples"
    slowest = max((RESPONSES / seen.look.rate + seen.look.delay_s for seen in joints.values()), default=0.0)
    length = max(LEAST_ROWS * dt, LEAST_S, min(slowest, LONGEST_S))
    return float(length), f"at least {LEAST_ROWS} samples and {RESPONSES:.0f} response times of the slowest loop"
