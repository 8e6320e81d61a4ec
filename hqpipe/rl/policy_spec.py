"""Everything besides the weights that is needed to run a policy, as plain numbers: policy.json."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.net import NetActuator
from hqpipe.actuators.settled import settled_stiffness
from hqpipe.actuators.two_chamber import TwoChamber
from hqpipe.errors import ConfigError
from hqpipe.rl.config import CONTROL_PERIOD_S, GaitConfig, TrainConfig
from hqpipe.rl.gait import Trot
from hqpipe.rl.leg import LegGeometry, read_leg_geometry, total_mass
from hqpipe.rl.mirror import check_alike
from hqpipe.rl.observation import Layout, observation_layout, state_layout
from hqpipe.rl.targets import TargetRule
from hqpipe.robots import RobotSpec

FORMAT = "hqpipe-policy/1"
CONTROL_MODES = ("position", "torque")
GRAVITY = 9.81  # m/s²
RIGID = 1e9  # N·m/rad, for a model that is infinitely stiff at rest: four orders above any joint of this size


def position_stiffness(actuator: ActuatorModel) -> np.ndarray:
    """(J,) static torque per position error, N·m/rad: kp of a PD law, k1 R² / k2 of eq. (7) at rest.

    Where no coefficient tells, it is what the model settles at: a net around the mean posture and torque of its fit trials,
    two chambers unloaded in the middle of the stroke.

    A model without leak (k2 = 0) is infinitely stiff at rest. Effects that a diagnosis added to eq. (7) are left out: what
    the trot's compensation of the load misses by them is for the policy to correct.
    """
    if "kp" in actuator.FIELDS:
        return actuator.column("kp").copy()
    if isinstance(actuator, NetActuator):
        return settled_stiffness(actuator, actuator.mean("position"), actuator.mean("effort"), actuator.dt)
    if isinstance(actuator, TwoChamber):
        middle = actuator.column("middle")
        return settled_stiffness(actuator, middle, np.zeros_like(middle), actuator.dt)
    radius = actuator.column("sprocket_radius") if "sprocket_radius" in actuator.FIELDS else 1.0  # gains of the joint
    with np.errstate(divide="ignore", invalid="ignore"):
        return actuator.column("k1") * radius**2 / actuator.column("k2")


@dataclass(frozen=True)
class PolicySpec:
    """A policy without its weights.

    Attributes:
        robot: name. joints, feet: names, in the order of every vector.
        control_mode: position (targets go to the position loop) | torque (targets pass kp, kd to the torque loop).
        kp, kd: (J,) gains that turn targets into torque targets, N·m/rad and N·m·s/rad; 0 where the loop is hydraulic.
        position_stiffness: (J,) static stiffness of the position loops that the trot compensates, N·m/rad.
        weight: of the robot, N.
        nominal, lower, upper: (J,) rad. action_scale: rad. standing_scale: factor on it while standing is commanded, see
            `hqpipe.rl.targets.TargetRule`.
        gait, geometry: clock and trot. observation, state: layouts of o_t and x_t. hidden: units per layer.
        period_s: between two calls of the policy.
        command_range: rows (low, high) of vx, vy (m/s) and ω (rad/s) seen in training.
        symmetric: whether estimator and actor do the same on both sides.
        leg_odometry: whether the estimator takes the linear velocity from the legs.
    """

    robot: str
    joints: tuple[str, ...]
    feet: tuple[str, ...]
    control_mode: str
    kp: np.ndarray
    kd: np.ndarray
    position_stiffness: np.ndarray
    weight: float
    nominal: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    action_scale: float
    standing_scale: float
    gait: GaitConfig
    geometry: LegGeometry
    observation: Layout
    state: Layout
    hidden: tuple[int, ...]
    period_s: float
    command_range: np.ndarray
    symmetric: bool
    leg_odometry: bool

    @classmethod
    def build(
        cls,
        robot: RobotSpec,
        actuator: ActuatorModel,
        config: TrainConfig,
        control_mode: str = "position",
        stiffness: np.ndarray | None = None,
    ) -> PolicySpec:
        """The spec of a policy that `config` trains for `robot` with `actuator`.

        Args:
            stiffness: (J,) static stiffness that the trot compensates, N·m/rad; None takes the actuator's own.

        Raises:
            ConfigError: unknown control mode, an actuator that cannot hold a joint, or a robot whose sides differ for a policy
                that is to be symmetric.
        """
        if control_mode not in CONTROL_MODES:
            raise ConfigError(
                f"control_mode: '{control_mode}', expected {' or '.join(CONTROL_MODES)}", field="control_mode"
            )
        if stiffness is None:
            stiffness = position_stiffness(actuator.for_joints(robot.joints))
        if limp := [joint for joint, value in zip(robot.joints, stiffness, strict=True) if not value > 0]:
            raise ConfigError(
                f"the actuator model does not push a held joint back at {', '.join(limp)}, as if that had not been identified",
                field=limp[0],
                fix="fit it on logs in which these joints move under load, or take another model",
            )
        gains = robot.torque_pd if control_mode == "torque" else None
        count = len(robot.joints)
        command, geometry = config.command, read_leg_geometry(robot)
        if config.policy.symmetric:
            check_alike(robot.name, robot.feet, geometry, robot.nominal_position)
        return cls(
            robot=robot.name,
            joints=robot.joints,
            feet=robot.feet,
            control_mode=control_mode,
            kp=np.full(count, gains.kp if gains else 0.0),
            kd=np.full(count, gains.kd if gains else 0.0),
            position_stiffness=np.minimum(stiffness, RIGID),
            weight=GRAVITY * total_mass(robot),
            nominal=robot.nominal_position,
            lower=robot.position_lower,
            upper=robot.position_upper,
            action_scale=config.policy.action_scale,
            standing_scale=config.policy.standing_scale,
            gait=config.gait,
            geometry=geometry,
            observation=observation_layout(robot, config.gait.prior, config.policy.command_scale),
            state=state_layout(robot),
            hidden=config.policy.hidden,
            period_s=CONTROL_PERIOD_S,
            command_range=np.array([command.vx, command.vy, command.wz]),
            symmetric=config.policy.symmetric,
            leg_odometry=config.policy.leg_odometry,
        )

    @property
    def has_clock(self) -> bool:
        return self.observation.has("clock")

    def target_rule(self) -> TargetRule:
        trot = None
        if self.gait.prior == "trot_residual":
            trot = Trot.build(self.gait, self.geometry, self.feet, self.nominal, self.position_stiffness, self.weight)
        scales = (self.action_scale, self.standing_scale, self.gait.standing_speed)
        return TargetRule(self.nominal, self.lower, self.upper, *scales, trot)

    def to_dict(self) -> dict[str, Any]:
        """JSON-able form; `hqpipe.rl.policy_fields.read_spec` restores equal numbers."""
        raw = _plain(asdict(self))
        return {"format": FORMAT, **raw}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.tolist() if isinstance(value, np.ndarray) else value
