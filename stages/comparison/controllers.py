"""The controllers that compare trains: on which actuator, for which of the firmware's control modes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from hqpipe.errors import UsageError, near_match

if TYPE_CHECKING:
    import numpy as np

    from hqpipe.actuators.base import ActuatorModel
    from hqpipe.actuators.posterior import Posterior

NetKind = Literal["strong", "paper"]
TORQUE, STIFF, FITTED, DIAGNOSED, ORACLE = "torque", "stiff_pd", "fitted", "diagnosed", "oracle"
NETS = ("mlp", "lstm", "gru")
TITLES = {
    TORQUE: "torque PID, ideal torque",
    STIFF: "position PID, stiff PD",
    FITTED: "position PID, fitted model",
    DIAGNOSED: "position PID, diagnosed model",
    ORACLE: "position PID, the plant's own numbers",
    **{kind: f"position PID, {kind.upper()}" for kind in NETS},
}
"""Name → how the machine is driven, and what stood in for its actuators in the training."""
ACTUATOR_FOLDERS = {
    **{(kind, "paper"): kind for kind in NETS},
    **{(kind, "strong"): f"strong_{kind}" for kind in NETS},
}
"""(net, `NetKind`) → its folder under rivals/ in the artifact of fit-actuator."""
DIAGNOSIS = "diagnosis"


@dataclass(frozen=True, eq=False)
class Controller:
    """What is trained.

    Attributes:
        name: of `TITLES`. control_mode: position or torque.
        actuator: in the simulator. posterior: of its parameters, if it has one.
        stiffness: (J,) N·m/rad that the gait prior compensates; None takes the actuator's own.
        files: relative path → SHA-256 of what the model was read from; empty for one that was computed.
    """

    name: str
    control_mode: str
    actuator: ActuatorModel
    posterior: Posterior | None = None
    stiffness: np.ndarray | None = None
    files: Mapping[str, str] = field(default_factory=dict)

    @property
    def title(self) -> str:
        return TITLES[self.name]

    def training(self, training: Mapping[str, Any]) -> dict[str, Any]:
        """The settings of its training, a `Training`: numbers that are known have no spread, unless one is asked for."""
        randomisation = training["randomisation"]
        actuator = randomisation["actuator"]
        if self.name != ORACLE or actuator["mode"] != "auto":
            return dict(training)
        return {**training, "randomisation": {**randomisation, "actuator": {**actuator, "mode": "none"}}}

    @property
    def effects(self) -> list[str]:
        """Effects that the model has beyond the law of the paper."""
        return sorted(getattr(self.actuator, "effects", ()))

    @property
    def content(self) -> dict[str, Any]:
        """All that decides how its policy comes out beside the training's own settings; plain data."""
        model = dict(self.files) or self.actuator.to_dict()
        stiffness = None if self.stiffness is None else [float(value) for value in self.stiffness]
        return {"control_mode": self.control_mode, "model": model, "stiffness": stiffness}


def checked_names(names: Sequence[str]) -> list[str]:
    """The names in the order of `TITLES`.

    Raises:
        ValueError: there is none, one is unknown or given twice.
    """
    for name in names:
        if name not in TITLES:
            raise ValueError(f"unknown controller '{name}'{near_match(name, TITLES)} (known: {', '.join(TITLES)})")
    if len(set(names)) != len(names) or not names:
        raise ValueError(f"expected names of controllers, each once ({', '.join(TITLES)}), got {list(names)!r}")
    return [name for name in TITLES if name in names]


def read_controllers(context: Any, names: Sequence[str], nets: NetKind) -> tuple[list[Controller], list[str]]:
    """The controllers with their models, read before anything is trained; and why one is left out, in lines.

    Raises:
        UsageError: a model is missing, or of another machine.
    """
    from hqpipe.robots import load_robot

    robot, found, left_out = load_robot(context.robot), [], []
    for name in names:
        reason = _no_diagnosis(context) if name == DIAGNOSED else _no_loop(context, robot) if name == ORACLE else ""
        if reason:
            left_out.append(f"{TITLES[name]}: left out: {reason}")
        else:
            found.append(_controller(context, robot, name, nets))
    if not found:
        raise UsageError(
            f"compare: nothing to train; {'; '.join(left_out)}",
            field="compare.controllers",
            fix="name other controllers as well",
        )
    return found, left_out


def _controller(context: Any, robot: Any, name: str, nets: NetKind) -> Controller:
    from hqpipe.actuators.files import load_actuator
    from hqpipe.actuators.posterior_file import load_posterior
    from hqpipe.rl.worlds import unmodelled_actuator
    from hqpipe.sim.engine import PHYSICS_DT
    from hqpipe.stages.comparison.oracle import oracle_actuator
    from hqpipe.stages.inputs.logs import model_at

    if name in (TORQUE, STIFF):
        mode = "torque" if name == TORQUE else "position"
        return Controller(name, mode, unmodelled_actuator(robot, mode))
    if name == ORACLE:
        return Controller(name, "position", oracle_actuator(robot, context.params.plant, PHYSICS_DT))
    folder = context.inputs["actuator"]
    if name in (FITTED, DIAGNOSED):
        folder, option = (folder, "--actuator") if name == FITTED else (context.inputs[DIAGNOSIS], "--diagnosis")
        posterior = load_posterior(folder, load_actuator(folder))
        model = model_at(folder, robot.joints, option)
        return Controller(name, "position", model, posterior, files=_hashes(folder))
    rival = _net_folder(folder, name, nets)
    stiffness = _loop_stiffness(folder, robot.joints)
    return Controller(name, "position", model_at(rival, robot.joints), stiffness=stiffness, files=_hashes(rival))


def _hashes(folder: Path) -> dict[str, str]:
    """File name → SHA-256 of what there is of a model."""
    from hqpipe.actuators import files, posterior_file, weights_file

    names = (files.FILE, weights_file.FILE, posterior_file.FILE)
    there = [folder / name for name in names if (folder / name).is_file()]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in there}


def _loop_stiffness(folder: Path, joints: Sequence[str]) -> Any:
    """What the gait prior of a net compensates: the stiffness that the paper's model finds in the same logs.

    A net has none of its own but its slope at one posture, which for some is near zero or negative: the trot would be lost
    before the training began, and that would say little of training inside the net.
    """
    from hqpipe.rl.policy_spec import position_stiffness
    from hqpipe.stages.inputs.logs import model_at

    return position_stiffness(model_at(folder, tuple(joints)))


def _net_folder(folder: Path, name: str, nets: NetKind) -> Path:
    from hqpipe.actuators.files import FILE

    rival = ACTUATOR_FOLDERS[name, nets]
    found = folder / "rivals" / rival
    if not (found / FILE).is_file():
        others = " or ".join(kind for kind in get_args(NetKind) if kind != nets)
        raise UsageError(
            f"{found}: no such actuator model",
            file=found,
            field=name,
            fix=f"run hqpipe fit-actuator with '{rival}' among its rivals, or leave '{name}' out of "
            f"compare.controllers, or set compare.nets to {others}",
        )
    return found


def _no_loop(context: Any, robot: Any) -> str:
    """Why the plant has no numbers for a model of position control; empty if it has."""
    from hqpipe.sim.engine import PHYSICS_DT
    from hqpipe.stages.comparison.oracle import oracle_actuator

    try:
        oracle_actuator(robot, context.params.plant, PHYSICS_DT)
    except UsageError as error:
        return error.message
    return ""


def _no_diagnosis(context: Any) -> str:
    """Why there is no diagnosed model; empty if there is one."""
    from hqpipe.actuators.files import FILE

    folder = context.inputs.get(DIAGNOSIS)
    if folder is None:
        return "no diagnosis is read: run hqpipe diagnose first, or name one with --diagnosis DIR"
    if not (folder / FILE).is_file():
        return "the diagnosis has no actuator model, as one that was not identifiable or not of position control"
    return ""
