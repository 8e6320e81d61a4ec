"""The walk that a report shows: driven on the plant, filmed, and drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

AFTER_FALL_S = 1.0  # of a fall, so that it is seen how it ends
FILM, FIGURE = "walk.gif", "walk.png"


@dataclass(frozen=True)
class Order:
    """What the policy is told, and how it is filmed.

    Attributes:
        seconds: of the walk. vx, vy: m/s; wz: rad/s, None holds the heading.
        shown_seconds: of it in the film, the last ones. speed: seconds of the walk in a second of film.
        frame_rate: frames a second. width, height: pixels. seed: of sensor noise. plant: as in collect.
    """

    seconds: float
    vx: float
    vy: float
    wz: float | None
    shown_seconds: float
    speed: float
    frame_rate: int
    width: int
    height: int
    seed: int
    plant: dict[str, Any]


def film_walk(context: Any, order: Order) -> Any:
    """Write walk.gif and walk.png into the output folder, and return the `Walk`.

    A walk that falls goes on for AFTER_FALL_S.
    """
    from hqpipe.report.chain_parts import Walk
    from hqpipe.robots import load_robot
    from hqpipe.stages.output.figures import draw_walk, walk_trajectory
    from hqpipe.stages.walks.machine import Job, run_jobs

    robot = load_robot(context.robot)
    job = Job("walk", order.seconds, order.seed, vx=order.vx, vy=order.vy, wz=order.wz, stop_at_fall=False)
    progress = _share(context.progress, 0.0, 0.5)
    (trial,) = run_jobs([job], context.robot, context.inputs["onnx"], order.plant, 1, progress)
    columns = _until_lying(trial)
    walk = walk_trajectory("walk", columns, robot)
    last = float(walk.time[-1])
    shown = (max(0.0, last - order.shown_seconds), last)
    _film(context, order, walk, shown, trial.fall_time)
    marks = {"posture": True, "filmed": shown, "fall_time": trial.fall_time}
    draw_walk(context.output, "walk", columns, context.robot, **marks)
    return Walk(
        robot=robot.name,
        film=context.output / FILM,
        figure=context.output / FIGURE,
        order=(order.vx, order.vy, order.wz),
        speed=_steady_speed(walk, trial.fall_time),
        seconds=last,
        fall_time=trial.fall_time,
        shown=shown,
        play=order.speed,
        seed=order.seed,
        plant=order.plant,
    )


def _until_lying(trial: Any) -> dict[str, Any]:
    """Log columns up to shortly after a fall."""
    if trial.fall_time is None:
        return trial.columns
    end = trial.fall_time + AFTER_FALL_S
    return {name: values[trial.time <= end] for name, values in trial.columns.items()}


def _steady_speed(walk: Any, fall_time: float | None) -> float:
    """Mean forward speed after settling and before a fall, m/s."""
    from hqpipe.report.walk_figures import forward_speed
    from hqpipe.rl.walk_measures import SETTLING_S

    end = float(walk.time[-1]) if fall_time is None else fall_time
    part = (walk.time >= min(SETTLING_S, 0.5 * end)) & (walk.time <= end)
    return float(forward_speed(walk)[part].mean())


def _film(context: Any, order: Order, walk: Any, shown: tuple[float, float], fall_time: float | None) -> None:
    import numpy as np

    from hqpipe.report.film import captioned, write_gif
    from hqpipe.sim.film import Poses, draw_poses

    moments = np.arange(shown[0], shown[1], order.speed / order.frame_rate)
    rows = np.searchsorted(walk.time, moments - 0.5 * walk.dt)
    poses = Poses(
        np.stack([walk.extra[f"base/position/{axis}"][rows] for axis in "xyz"], axis=1),
        np.stack([walk.extra[f"base/orientation/{axis}"][rows] for axis in "xyzw"], axis=1),
        walk.position[rows],
    )
    pictures = draw_poses(
        context.robot,
        poses,
        width=order.width,
        height=order.height,
        workers=context.workers,
        progress=_share(context.progress, 0.5, 1.0),
    )
    captions = _captions(walk, rows, fall_time)
    frames = [captioned(picture, caption) for picture, caption in zip(pictures, captions, strict=True)]
    write_gif(frames, context.output / FILM, order.frame_rate)


def _captions(walk: Any, rows: Any, fall_time: float | None) -> list[Any]:
    from hqpipe.report.film import Caption
    from hqpipe.report.walk_figures import contact_feet, mean_speed

    speed, feet = mean_speed(walk), contact_feet(walk)
    return [
        Caption(
            time=float(walk.time[row]),
            commanded=float(walk.extra["command/vx"][row]),
            actual=float(speed[row]),
            feet={foot: bool(walk.extra[f"foot/{foot}/contact"][row] > 0.5) for foot in feet},
            fallen=fall_time is not None and bool(walk.time[row] >= fall_time),
        )
        for row in rows
    ]


def _share(progress: Any, first: float, last: float) -> Any:
    """Progress of a part of the stage that takes from `first` to `last` of it."""
    return lambda done, total, note: progress(first + (last - first) * done / total, 1.0, note)
