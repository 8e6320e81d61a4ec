"""The loop closed: the policy that made the logs, in the simulator with and without the effects found, against the logs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

FILE = "closed_loop.json"


def close_loop(context: Any, log_set: Any, diagnosis: Any) -> Any:
    """Write closed_loop.json and return the `ClosedLoop`; None, with the reason told, where it cannot be done."""
    from hqpipe.rl.closed_loop import closed_loop, policy_walker
    from hqpipe.robots import load_robot
    from hqpipe.stages.output.terminal import show

    if "policy" not in context.inputs or diagnosis.augmented is None:
        return None
    robot = load_robot(context.robot)
    walks = _walks(log_set, robot) if set(log_set.joints) == set(robot.joints) else []
    if not walks:
        show("closed loop: left out, no logged walk of this robot is long enough")
        return None
    folder = context.inputs["policy"]
    folder = folder / "position" if (folder / "position").is_dir() else folder
    models = {"before": diagnosis.base.for_joints(robot.joints), "after": diagnosis.augmented.for_joints(robot.joints)}
    result = closed_loop(policy_walker(folder, robot.joints), robot, models, walks, workers=context.workers)
    text = json.dumps(result.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
    Path(context.output / FILE).write_text(text + "\n", encoding="utf-8")
    return result


def _walks(log_set: Any, robot: Any) -> list[Any]:
    """The held-out trials that are walks under a steady command."""
    import numpy as np

    from hqpipe.rl.closed_loop import SETTLING_S, LoggedWalk, body_velocity
    from hqpipe.rl.walk_statistics import LEAST_S, Walk

    found = []
    for trial in log_set.heldout:
        t = trial.trajectory.for_joints(robot.joints)
        if trial.command is None or "base/linear_velocity/x" not in t.extra or t.duration < SETTLING_S + LEAST_S:
            continue

        def columns(name: str, axes: str, extra: Any = t.extra) -> Any:
            return np.stack([extra[f"base/{name}/{axis}"] for axis in axes], axis=1)

        velocity = body_velocity(
            columns("orientation", "xyzw"), columns("linear_velocity", "xyz"), columns("angular_velocity", "xyz")
        )
        walk = Walk(1.0 / t.dt, t.position_command, t.position, t.velocity, t.effort, velocity)
        command = dict(trial.command)
        turn = command.get("wz", 0.0) or None  # a walk that is not told to turn holds its heading
        found.append(LoggedWalk(trial.file, walk, command.get("vx", 0.0), command.get("vy", 0.0), turn, False))
    return found


def closed_loop_lines(result: Any) -> list[str]:
    """What changed, for the terminal: distances to the log before and after."""
    before, after = result.pooled("before"), result.pooled("after")
    names = {
        "tracking_gap": ("tracking", "rad"),
        "torque_distance": ("torque distribution", "N·m"),
        "spectral_distance": ("joint spectra", "dB"),
        "speed_gap": ("speed", "m/s"),
    }
    parts = [
        f"{label} {before[key]:.3g} → {after[key]:.3g} {unit}"
        for key, (label, unit) in names.items()
        if before[key] is not None and after[key] is not None
    ]
    return [f"closed loop, distance of the simulated walks to the logged ones: {', '.join(parts)}"]
