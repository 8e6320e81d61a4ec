"""retrain: the policy, trained with the fitted actuator model in the loop."""

from __future__ import annotations

from typing import Any

from hqpipe.pipeline.config import StageParams
from hqpipe.stages.figures import draw_training
from hqpipe.stages.training import METRICS, Training, headline, run_training


class Params(StageParams):
    """See `hqpipe.rl.config.TrainConfig`."""

    training: Training = {}


def run(context: Any) -> dict[str, Any]:
    from hqpipe.actuators.files import load_actuator
    from hqpipe.actuators.posterior_file import load_posterior
    from hqpipe.robots import load_robot
    from hqpipe.stages.logs import model_for

    actuator = model_for(context, load_robot(context.robot).joints)
    folder = context.inputs["actuator"]
    posterior = load_posterior(folder, load_actuator(folder))
    metrics = run_training(context, actuator, context.params.training, "position", posterior=posterior)
    draw_training(context.output, {"actuator model": context.output / METRICS})
    return {"headline": headline(metrics), **metrics}
