"""The same policy and the same commands in the training simulator, with one actuator model and with another, against logs.

A free-running replay says how well a model answers the logged motion. This says what the model does to the motion itself:
the policy walks with it, and the joints are compared with those of the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np

from hqpipe.actuators.base import ActuatorModel
from hqpipe.errors import UsageError
from hqpipe.rl.controller import HeadingHold, onnx_controller, torch_controller
from hqpipe.rl.leg import read_leg_geometry
from hqpipe.rl.observation import rotate_inverse
from hqpipe.rl.walk_measures import SETTLING_S
from hqpipe.rl.walk_statistics import (
    BANDS_HZ,
    LEAST_S,
    QUANTILES,
    SEGMENT_S,
    Walk,
    WalkFigures,
    log_figures,
    walk_figures,
)
from hqpipe.robots import RobotSpec
from hqpipe.sim.engine import PHYSICS_DT
from hqpipe.sim.world import BatchedWorld

FALL_TILT = 1.0  # rad of base tilt; assumption: nobody walks on from there
Progress = Callable[[float, float, str], None]


class Controller(Protocol):
    """See hqpipe.rl.controller.PolicyController; `period_s` is a multiple of 1 ms."""

    @property
    def period_s(self) -> float: ...

    def __call__(self, frame: Any, command: Mapping[str, float]) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class LoggedWalk:
    """A walk of the machine.

    Attributes:
        name: of the trial. walk: what was recorded, from its first sample on, joints in the order of the robot.
        vx, vy: command, m/s; wz: rad/s, or None if the heading was held.
        fell: whether the trial ended in a fall.
    """

    name: str
    walk: Walk
    vx: float
    vy: float = 0.0
    wz: float | None = None
    fell: bool = False


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Figures of the log and of every model, see `WalkFigures`.

    Attributes:
        joints: names, the order of every column.
        trials: names of the walks.
        log: the machine. models: by name.
    """

    joints: tuple[str, ...]
    trials: tuple[str, ...]
    log: WalkFigures
    models: dict[str, WalkFigures]

    def pooled(self, name: str) -> dict[str, float | None]:
        """One number per kind of figure for a model, all distances to the log; None where nothing was left to compare.

        Returns:
            tracking_rmse, of all joints, rad; tracking_gap, RMS over the joints of the difference of their tracking RMSE,
            rad; torque_distance, N·m, and spectral_distance, dB, means over the joints; speed_gap, mean over the walks of
            the distance of the horizontal velocities, m/s.
        """
        figures = self.models[name]
        apart = figures.tracking_rmse - self.log.tracking_rmse
        speed = np.linalg.norm((figures.body_velocity - self.log.body_velocity)[:, :2], axis=1)
        known = speed[np.isfinite(speed)]
        values = {
            "tracking_rmse": np.sqrt(np.mean(figures.tracking_rmse**2)),
            "tracking_gap": np.sqrt(np.mean(apart**2)),
            "torque_distance": np.mean(figures.torque_distance),
            "spectral_distance": np.mean(figures.spectral_distance),
            "speed_gap": known.mean() if known.size else np.nan,
        }
        return {key: _plain(value) for key, value in values.items()}

    def to_dict(self) -> dict[str, Any]:
        """JSON-able form; what could not be determined is null."""

        def table(figures: WalkFigures) -> dict[str, Any]:
            return {name: _plain(value) for name, value in vars(figures).items()}

        return {
            "joints": list(self.joints),
            "trials": list(self.trials),
            "quantiles": list(QUANTILES),
            "bands_hz": list(BANDS_HZ),
            "log": table(self.log),
            "models": {name: {**table(f), "pooled": self.pooled(name)} for name, f in self.models.items()},
        }


def closed_loop(
    controller: Callable[[HeadingHold | None], Controller],
    robot: RobotSpec,
    models: Mapping[str, ActuatorModel],
    logged: Sequence[LoggedWalk],
    *,
    engine: str = "mujoco",
    workers: int = 1,
    settling_s: float = SETTLING_S,
    progress: Progress | None = None,
) -> ClosedLoop:
    """Walk every logged command in the simulator with every model, from the pose in which the log begins.

    Args:
        controller: makes the controller of one walk, as `policy_walker` does; it is given the heading hold or None.
        models: by name, e.g. before and after; joints are matched by name, their sample time must be 1 ms.
        logged: walks of the machine under the same policy.
        engine, workers: see `BatchedWorld`; workers do not change the result.
        settling_s: left out at the start of every walk, s.
        progress: (done, total, text) in walks.

    Raises:
        UsageError: no walk or no model, a walk that is too short or has other joints, or a model of another rate.
    """
    if not models or not logged:
        raise UsageError(
            f"closed loop: {len(models)} models and {len(logged)} logged walks, expected at least one of each"
        )
    for trial in logged:
        _check(trial, robot, settling_s)
    steady = [trial.walk.section(settling_s, trial.walk.seconds) for trial in logged]
    figures = {}
    for number, (name, model) in enumerate(models.items()):
        with BatchedWorld(robot, model, len(logged), engine=engine, workers=workers, decimation=1) as world:
            simulated, fell = _walk_all(world, controller, logged)
        pairs = [
            (walk.section(settling_s, walk.seconds) if walk.seconds >= settling_s + SEGMENT_S else None, reference)
            for walk, reference in zip(simulated, steady, strict=True)
        ]
        figures[name] = walk_figures(pairs, int(fell.sum()))
        if progress is not None:
            progress((number + 1) * len(logged), len(models) * len(logged), name)
    return ClosedLoop(
        joints=robot.joints,
        trials=tuple(trial.name for trial in logged),
        log=log_figures(steady, sum(trial.fell for trial in logged)),
        models=figures,
    )


def policy_walker(folder: Path, joints: tuple[str, ...]) -> Callable[[HeadingHold | None], Controller]:
    """`controller` of `closed_loop` for a folder with policy.onnx, or with policy.safetensors."""
    load = onnx_controller if (folder / "policy.onnx").is_file() else torch_controller
    return lambda hold: load(folder, joints=joints, heading_hold=hold)


def body_velocity(orientation: np.ndarray, linear: np.ndarray, angular: np.ndarray) -> np.ndarray:
    """(T, 3) forward, sideways and turning rate from the log's base columns.

    Args:
        orientation: (T, 4) unit quaternion xyzw. linear: (T, 3) m/s, world. angular: (T, 3) rad/s, base frame.
    """
    return np.column_stack((rotate_inverse(orientation, linear)[:, :2], angular[:, 2]))


def _check(trial: LoggedWalk, robot: RobotSpec, settling_s: float) -> None:
    walk, least = trial.walk, settling_s + LEAST_S
    if walk.position.shape[1] != len(robot.joints):
        raise UsageError(
            f"{trial.name}: {walk.position.shape[1]} joints, expected those of {robot.name}: {', '.join(robot.joints)}",
            file=trial.name,
            field="joints",
            fix="give walks of this robot",
        )
    if walk.seconds < least:
        raise UsageError(
            f"{trial.name}: the walk lasts {walk.seconds:.1f} s, expected at least {least:g} s",
            file=trial.name,
            fix="leave it out",
        )


def _walk_all(
    world: BatchedWorld, make: Callable[[HeadingHold | None], Controller], logged: Sequence[LoggedWalk]
) -> tuple[list[Walk], np.ndarray]:
    """Every logged command by one robot, each until it falls or its time is over; the walks, and which of them fell (N,)."""
    count, state = world.num_envs, world.state
    controllers = [make(HeadingHold() if trial.wz is None else None) for trial in logged]
    commands = [{"vx": trial.vx, "vy": trial.vy, "wz": trial.wz or 0.0} for trial in logged]
    hold = [_ticks(each.period_s) for each in controllers]
    length = np.array([round(trial.walk.seconds / PHYSICS_DT) for trial in logged])
    _start(world, logged)
    targets = state.joint_position.copy()
    record = np.empty((length.max(), count, 4, targets.shape[1]))
    body = np.empty((length.max(), count, 3))
    rows, fell = length.copy(), np.zeros(count, dtype=bool)
    for tick in range(length.max()):
        going = np.flatnonzero(tick < rows)
        if not going.size:
            break
        for n in going:
            if tick % hold[n] == 0:
                targets[n] = controllers[n](_frame(state, n), commands[n])
        # Targets, positions and velocities of this millisecond, as the machine logs them before the firmware acts.
        record[tick, :, 0], record[tick, :, 1], record[tick, :, 2] = targets, state.joint_position, state.joint_velocity
        record[tick, :, 3] = state.joint_effort
        body[tick] = body_velocity(state.base_orientation, state.base_linear_velocity, state.base_angular_velocity)
        world.step(targets)
        down = _down(state) & (tick + 1 < rows)
        rows[down], fell[down] = tick + 1, True
    walks = []
    for n in range(count):
        command, position, velocity, effort = record[: rows[n], n].swapaxes(0, 1)
        walks.append(Walk(1.0 / PHYSICS_DT, command, position, velocity, effort, body[: rows[n], n]))
    return walks, fell


def _start(world: BatchedWorld, logged: Sequence[LoggedWalk]) -> None:
    """Joints as in the first sample of the log; the body level and at rest, its lowest foot on the ground."""
    robot, first = world.robot, [trial.walk for trial in logged]
    joints = np.array([walk.position[0] for walk in first])
    geometry = read_leg_geometry(robot)
    feet = geometry.forward(joints.reshape(len(first), len(robot.feet), 3))
    place = np.zeros((len(first), 3))
    place[:, 2] = geometry.foot_radius - feet[..., 2].min(axis=1)
    level, still = np.tile([0.0, 0.0, 0.0, 1.0], (len(first), 1)), np.zeros((len(first), 3))
    effort = np.array([walk.effort[0] for walk in first])
    world.reset(np.arange(len(first)), place, level, still, still, joints, np.zeros_like(joints), effort)


def _down(state: Any) -> np.ndarray:
    """(N,) bool: trunk or thighs on the ground, lying over, or a simulation that diverged."""
    upright = 1.0 - 2.0 * (state.base_orientation[:, :2] ** 2).sum(axis=1)
    finite = np.isfinite(state.joint_velocity + state.joint_effort).all(axis=1)
    return state.illegal_contact | (upright < np.cos(FALL_TILT)) | ~finite


def _frame(state: Any, n: int) -> SimpleNamespace:
    """What a controller sees of robot `n`; copies, because the state changes in place."""
    return SimpleNamespace(
        q=state.joint_position[n].copy(),
        qd=state.joint_velocity[n].copy(),
        gyro=state.base_angular_velocity[n].copy(),
        orientation=state.base_orientation[n].copy(),
    )


def _ticks(period_s: float) -> int:
    ticks = round(period_s / PHYSICS_DT)
    if ticks < 1 or abs(ticks * PHYSICS_DT - period_s) > 1e-9:
        raise UsageError(f"controller: its period is {period_s} s, expected a multiple of {PHYSICS_DT} s")
    return ticks


def _plain(value: Any) -> Any:
    """Lists and numbers for JSON; NaN becomes None."""
    if isinstance(value, np.ndarray):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value
