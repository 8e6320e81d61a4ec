"""The stages of hqpipe, in the order in which `hqpipe run all` runs them.

A new stage is one file beside this one, with ``Params`` and ``run(context)``, and one row here.
"""

from __future__ import annotations

from pathlib import Path

from hqpipe.pipeline.stage import Input, Stage, StageTable

BOOTSTRAP = Input("policy", "bootstrap", "--policy")
WALKER = Input("policy", "bootstrap", "--policy", optional=True)
LOGS = Input("logs", "rollouts", "--logs")
REFERENCE = Input(
    "reference", None, "--reference", help="Say what changed since: logs or an actuator model of the same machine."
)
# What `load_actuator` reads, with the posterior for training and fit.json for the question which logs a model was fitted to: no
# rival, table or figure.
MODEL = ("actuator.json", "weights.safetensors")
ACTUATOR = Input("actuator", "actuator", "--actuator", files=(*MODEL, "posterior.json"))
FITTED = Input("actuator", "actuator", "--actuator", files=(*MODEL, "fit.json"))
# Its nets besides, as in the paper and with every advantage, in which compare trains.
NETS = tuple(
    f"rivals/{prefix}{kind}/{name}" for prefix in ("", "strong_") for kind in ("mlp", "lstm", "gru") for name in MODEL
)
MODELS = Input("actuator", "actuator", "--actuator", files=(*MODEL, "posterior.json", *NETS))
DIAGNOSED = Input(
    "diagnosis", "diagnosis", "--diagnosis", optional=True, files=(*MODEL, "posterior.json", "diagnosis.json")
)
POLICY = Input("policy", "policy", "--policy")
ONNX = Input("onnx", "onnx", "--onnx", also=("--policy",))
EXPORTED = Input("onnx", "onnx", "--onnx")
STRICT = ("--strict", "Refuse logs in which anything would have to be repaired, as for continuous integration.")
SEEDS = ("--seeds", "N|A:B", "Train each controller N times, or with the seeds A to B − 1, e.g. 0:3.")
ONNX_FLAG = ("--onnx", "Write ONNX; the only format, so it is the default.")
# What the page of `report` shows beside the exported policy, as far as it has been made.
SHOWN = tuple(
    Input(artifact, artifact, option, optional=True)
    for artifact, option in (
        ("bootstrap", "--bootstrap"),
        ("rollouts", "--logs"),
        ("actuator", "--actuator"),
        ("diagnosis", "--diagnosis"),
        ("policy", "--policy"),
        ("validation", "--validation"),
        ("comparison", "--comparison"),
    )
)

# fmt: off
STAGES = StageTable(
    [
        Stage("bootstrap", "bootstrap", "hqpipe.stages.bootstrap",
              "Train a first policy, with no actuator model.", version=6),
        Stage("collect", "rollouts", "hqpipe.stages.collect",
              "Record logs of the machine under that policy.", version=3, inputs=(BOOTSTRAP,)),
        Stage("fit-actuator", "actuator", "hqpipe.stages.fit_actuator",
              "Fit the actuator model to the logs.", version=9, inputs=(LOGS,), switches=(STRICT,)),
        Stage("diagnose", "diagnosis", "hqpipe.stages.diagnose",
              "Find where the gap lies, what causes it and how far it shrinks.", version=39,
              inputs=(LOGS, WALKER, REFERENCE), switches=(STRICT,)),
        Stage("retrain", "policy", "hqpipe.stages.retrain",
              "Train the policy with the actuator model.", version=7, inputs=(ACTUATOR,)),
        Stage("export", "onnx", "hqpipe.stages.export",
              "Write the policy as ONNX for the robot.", version=2, inputs=(POLICY,), flags=(ONNX_FLAG,)),
        Stage("validate", "validation", "hqpipe.stages.validate",
              "Hold the exported policy against its thresholds; exit 4 if one is missed.", version=4,
              inputs=(ONNX, LOGS, FITTED), switches=(STRICT,)),
        Stage("compare", "comparison", "hqpipe.stages.compare",
              "Train controllers with every actuator model and walk them on the plant.", version=6,
              inputs=(MODELS, DIAGNOSED), settings=(SEEDS,), alone=True),
        Stage("report", "report", "hqpipe.stages.report",
              "Film a walk of the exported policy, and show the results of the chain on one page.", version=1,
              inputs=(EXPORTED, *SHOWN), alone=True),
    ],
    template=Path(__file__).with_name("pipeline_template.yaml"),
    robot_check="hqpipe.stages.inputs.robot_check:check_robot",
)
