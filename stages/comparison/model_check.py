"""How far each controller's actuator model is from the plant: its free-run error on a trial of the gantry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.errors import UsageError
from hqpipe.stages.comparison.controllers import ORACLE, TORQUE, Controller
from hqpipe.stages.comparison.oracle import FRICTION

SECONDS = 5.0  # of a multisine that moves all joints; assumption
KIND = "multisine"


def free_run_errors(context: Any, controllers: Sequence[Controller]) -> dict[str, Any]:
    """The models of position control beside each other on a trial of the plant that none was fitted to.

    The speed is that of the step which is predicted, as the simulator has it. The log has the torque of the plant's own
    sensors; where these are of pressure, seals do not show in it, and the oracle is judged without them.

    Returns:
        seconds, of the trial; window_s; effort_rms, N·m; persistence, RMSE of holding the torque over each window, N·m; rmse:
        controller → N·m over all joints, None for a model that cannot be replayed sample by sample, as one with backlash.
    """
    from hqpipe.identify.free_run import WINDOW_S, free_run, window_samples
    from hqpipe.identify.rivals.baselines import Persistence

    trajectory, source = _trial(context)
    held = Persistence().predict(trajectory, window_samples(trajectory.dt, WINDOW_S)) - trajectory.effort
    errors: dict[str, float | None] = {}
    for controller in controllers:
        if controller.name == TORQUE:
            continue
        model = controller.actuator
        if controller.name == ORACLE and source != "load_cell":
            model = without_friction(model)
        try:
            error = free_run(trajectory, model) - trajectory.effort
        except UsageError:
            errors[controller.name] = None
            continue
        errors[controller.name] = _rms(error[1:])
    return {
        "seconds": SECONDS,
        "window_s": WINDOW_S,
        "effort_rms": _rms(trajectory.effort),
        "persistence": _rms(held[1:]),
        "rmse": errors,
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def without_friction(model: Any) -> Any:
    """An augmented model as sensors of pressure see it."""
    from hqpipe.machine.layout import neutral_row, slots

    table = np.array(model.parameters)
    for name in FRICTION:
        table[:, slots(name)] = neutral_row()[slots(name)]
    return replace(model, parameters=table)


def _trial(context: Any) -> tuple[Any, str]:
    """The trial, its speed that of the step from each sample to the next; and whence the torque is."""
    from hqpipe.logs.assemble import assemble
    from hqpipe.logs.columns import RawTable
    from hqpipe.plant import Plant, PlantConfig
    from hqpipe.plant.excitation import excitation
    from hqpipe.robots import load_robot

    robot, seed = load_robot(context.robot), 1000 * context.seed + 699  # before those of the walks
    plant = Plant(robot, PlantConfig(context.params.plant), seed=seed, base="fixed")
    trial = plant.run(excitation(robot, KIND, SECONDS, seed), SECONDS, mode="position")
    trajectory = assemble(RawTable(Path(KIND), trial.columns)).for_joints(robot.joints)
    step = np.diff(trajectory.position, axis=0) / trajectory.dt
    return replace(trajectory, velocity=np.vstack([step, step[-1:]])), trial.effort_source
