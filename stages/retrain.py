"""retrain: the policy, trained with the fitted actuator model in the loop."""

from __future__ import annotations

from typing import Any

from hqpipe.pipeline.config import StageParams
from hqpipe.stages.inputs.training import METRICS, Training, headline, run_training
from hqpipe.stages.output.figures import draw_training


class Params(StageParams):
    """See `hqpipe.rl.config.TrainConfig`."""

    training: Training = {}


def run(context: Any) -> dict[str, Any]:
    from hqpipe.actuators.files import load_actuator
    from hqpipe.actuators.posterior_file import load_posterior
    from hqpipe.robots import load_robot
    from hqpipe.stages.inputs.logs import model_for
    from hqpipe.stages.output.terminal import show

    actuator = model_for(context, load_robot(context.robot).joints)
    folder = context.inputs["actuator"]
    posterior = load_posterior(folder, load_actuator(folder))
    metrics = run_training(context, actuator, context.params.training, "position", posterior=posterior)
    show(*actuators_told(metrics["actuator_randomisation"]))
    draw_training(context.output, {"actuator model": context.output / METRICS})
    return {"headline": headline(metrics), **metrics}


def actuators_told(report: dict[str, Any]) -> list[str]:
    """How the actuators of the robots differed, in lines for the terminal; `report` as of `run_training`."""
    if report["mode"] == "none":
        return ["every robot had the actuators of the model"]
    if report["mode"] == "half_range":
        return [f"actuators: each coefficient within ±{100.0 * report['half_range']:g} % of the model's"]
    lines = [f"actuators: drawn from the posterior of the fit, {report['scale']:g} times its deviations"]
    for choice in report.get("alternatives", ()):
        drawn = ", ".join(f"{each['name']} in {each['robots']}" for each in choice["drawn"])
        lines.append(f"{', '.join(choice['joints'])}: {drawn} of {report['robots']} robots")
    if joints := report["without_sections"]:
        lines.append(
            f"warning: {', '.join(joints)}: the fit had no two sections of 2 s and more, or trials, to compare, so that the "
            "draws hold the error of the estimate only; fit longer logs, or set randomisation.actuator.mode to half_range"
        )
    return lines
