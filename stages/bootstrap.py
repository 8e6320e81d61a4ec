"""bootstrap: policies trained with no actuator model – the first ones that a machine is driven with."""

from __future__ import annotations

from typing import Any

from hqpipe.pipeline.config import StageParams
from hqpipe.stages.inputs.training import METRICS, Training, headline, run_training
from hqpipe.stages.output.figures import draw_training


class Params(StageParams):
    """One training per control mode of the machine's firmware.

    Attributes:
        position: stiff PD stands in for the position loop. torque: the torque target is taken as reached.
    """

    position: Training = {}
    torque: Training = {}


def run(context: Any) -> dict[str, Any]:
    from hqpipe.rl.worlds import unmodelled_actuator
    from hqpipe.robots import load_robot

    robot = load_robot(context.robot)
    metrics = {
        mode: run_training(context, unmodelled_actuator(robot, mode), getattr(context.params, mode), mode, mode)
        for mode in ("position", "torque")
    }
    draw_training(context.output, {mode: context.output / mode / METRICS for mode in metrics})
    return {"headline": headline(metrics["position"]), **metrics}
