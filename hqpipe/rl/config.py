"""Configuration of a training as frozen dataclasses; every field states its unit and its source.

"recipe" means: found by training this robot with benchmarks/training.py. "paper" is the table of that name in Lee et
al., Learning Quadrupedal Locomotion for a Heavy Hydraulic Robot Using an Actuator Model. The paper gives no
coefficients.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar

from hqpipe.errors import ConfigError, near_match, shown
from hqpipe.rl.limits import (
    SAMPLES,
    CombinationError,
    check_choice,
    check_commands,
    check_layers,
    check_numbers,
    check_range,
    check_slowest,
    wrong,
)
from hqpipe.rl.reward_config import RewardConfig
from hqpipe.sim import ENGINES

PRIORS = ("none", "clock", "trot_residual")
ACTUATOR_MODES = ("auto", "posterior", "half_range", "none")
CONTROL_PERIOD_S = 0.01  # paper: policy and estimator at 100 Hz

_LARGEST = 2**63

_Config = TypeVar("_Config")


@dataclass(frozen=True)
class GaitConfig:
    """Clock and open-loop trot.

    Attributes:
        prior: none (paper) | clock (sine and cosine of the phase join the observation) | trot_residual (in addition the
            action is an offset on the open-loop trot).
        frequency_hz: steps of one leg per second; recipe.
        duty: share of a cycle that a foot is to stay on the ground; recipe.
        swing_height: m; recipe, the paper asks for feet that "reach sufficient height".
        lead_s: targets lead by the lag of the position loop, s; the default machine has 40 ms.
        standing_speed: commands below shrink the steps, m/s, turning at a lever of 1 m; assumption.
    """

    prior: str = "trot_residual"
    frequency_hz: float = 1.7
    duty: float = 0.6
    swing_height: float = 0.14
    lead_s: float = 0.04
    standing_speed: float = 0.15


@dataclass(frozen=True)
class CommandConfig:
    """Velocity commands drawn during training, base frame.

    Attributes:
        vx, vy: ranges, m/s; wz: range, rad/s. The paper walks at 0.4 and 1.0 m/s, turns and steps sideways.
        standing_share: of the draws that command zero velocity; assumption.
        standing_at_once: whether standing is commanded before the curriculum has reached its end. A gait that is learned
            from standing takes the first step on the spot sooner without.
        straight_share: of the moving draws with vy = ω = 0; assumption.
        in_place_share: of the moving draws, half that only turn and half that only step sideways, which a learned gait needs.
        smallest: norm of the slowest moving command, turning at a lever of 1 m, m/s. Rewards tell stepping from standing
            by whether the command is zero, which no policy can tell from a few mm/s.
        resample_s: mean time between draws, s; assumption.
        ramp_s: longest time from one command to the next, s; episodes then begin from standing. 0 changes them at once.
    """

    vx: tuple[float, float] = (0.0, 1.2)
    vy: tuple[float, float] = (-0.3, 0.3)
    wz: tuple[float, float] = (-0.5, 0.5)
    standing_share: float = 0.08
    standing_at_once: bool = True
    straight_share: float = 0.3
    in_place_share: float = 0.0
    smallest: float = 0.0
    resample_s: float = 4.0
    ramp_s: float = 0.0


@dataclass(frozen=True)
class NoiseConfig:
    """Observation noise: uniform, half-width. The paper randomises observations and gives no sizes.

    Attributes:
        gyro: rad/s; about ten times the noise of robot.yaml, for vibration.
        position: rad; encoder offset and chain stretch, assumption.
        velocity: rad/s; filtered differentiation, assumption.
    """

    gyro: float = 0.05
    position: float = 0.01
    velocity: float = 0.2


@dataclass(frozen=True)
class ActuatorRandomisationConfig:
    """How the actuators of the robots differ.

    Attributes:
        mode: posterior (whole parameter sets from what the fit knows, see hqpipe.actuators.posterior) | half_range (each
            coefficient by a factor of its own) | auto (posterior where the model has one, else half_range) | none.
        scale: of every deviation from the mean of the posterior; 1 covers the error of the estimate and what differed
            between sections of the logs, more is for what these did not hold, as warmer oil.
        half_range: as a share of a coefficient, for a model without posterior; assumption: covers the spread between joints
            and the drift with oil temperature.
    """

    mode: str = "auto"
    scale: float = 1.0
    half_range: float = 0.2

    def __post_init__(self) -> None:
        check_choice("randomisation.actuator.mode", self.mode, ACTUATOR_MODES)


@dataclass(frozen=True)
class RandomisationConfig:
    """What differs between episodes and robots. Sizes are assumptions unless a source is given.

    Attributes:
        position: initial joint angles around the nominal pose, rad.
        tilt: initial roll and pitch, rad.
        linear_velocity: initial base velocity, m/s; angular_velocity: rad/s.
        push_interval_s: mean time between pushes, s; 0 turns them off.
        push_speed: largest sideways change of the base's velocity by a push, m/s.
        kinematics: half-range of link lengths, masses and joint offsets as a multiple of the simulator's documented
            range (the paper randomises the kinematics); 0 turns it off.
        actuator: coefficients of the actuator model.
        friction: half-range of the ground friction, as a share.
    """

    position: float = 0.1
    tilt: float = 0.05
    linear_velocity: float = 0.3
    angular_velocity: float = 0.2
    push_interval_s: float = 3.0
    push_speed: float = 1.2
    kinematics: float = 1.0
    actuator: ActuatorRandomisationConfig = field(default_factory=ActuatorRandomisationConfig)
    friction: float = 0.3


@dataclass(frozen=True)
class CurriculumConfig:
    """Factor c_f of the paper's rewards, from `start` to 1.

    Attributes:
        start: c_f of the first iteration.
        iterations: c_f reaches 1 after these; the paper gives no schedule.
    """

    start: float = 0.3
    iterations: int = 30


@dataclass(frozen=True)
class PolicyConfig:
    """Networks.

    Attributes:
        hidden: units of each hidden layer of actor, critic and estimator (ELU); measured on this machine to be enough.
        action_scale: joint angle for an action of 1, rad.
        command_scale: of the velocity command as the networks see it, s/m and s/rad. At 1 a command of 1 m/s weighs as
            much as a joint angle of 0.25 rad.
        standing_scale: factor on the actions while standing is commanded, rising to 1 at gait.standing_speed. What a policy
            learns of walking it does at zero command, too: with 1 it steps on the spot. A fifth of a step leaves the feet
            on the ground, and still leans against a push; recipe.
        initial_log_std: e^−2 is 34 mrad of a joint target, 150 N·m at the machine's stiffness; a policy that starts
            on the trot does not fall; recipe.
        final_log_std: bound at the end, reached on a line from the initial one, see curriculum.py; recipe.
        output_gain: factor on the initial weights of the last layer, so that training starts at the prior.
        symmetric: whether actor and estimator do on the left what they do on the right, see mirror.py.
        leg_odometry: whether the estimator takes the linear velocity from the legs, see odometry_estimator.py; the paper's
            estimator is a network of o_t alone.
    """

    hidden: tuple[int, ...] = (256, 128)
    action_scale: float = 0.25
    command_scale: float = 1.0
    standing_scale: float = 1.0
    initial_log_std: float = -2.0
    final_log_std: float = -3.5
    output_gain: float = 0.01
    symmetric: bool = True
    leg_odometry: bool = False


@dataclass(frozen=True)
class PPOConfig:
    """PPO (Schulman et al. 2017) in Stable-Baselines3's spelling.

    Attributes:
        n_steps: samples per environment and iteration.
        batch_size: samples per gradient step.
        n_epochs: passes over the samples.
        learning_rate: of the actor's first step; then it follows the KL divergence.
        target_kl: where the learning rate is held, by halving above twice and raising below half of it.
        critic_learning_rate: fixed; a critic that shared the actor's rate would learn slowest when it is worst; recipe.
        estimator_learning_rate: of the supervised loss (Ji et al. 2022, concurrent training).
        estimator_epochs: in how many of the passes the estimator learns, too.
        critic_warmup: iterations in which only critic and estimator learn; a first update with an untrained critic
            moves a good prior in a random direction; recipe.
    """

    n_steps: int = 24
    batch_size: int = 2400
    n_epochs: int = 5
    learning_rate: float = 3e-4
    target_kl: float = 0.012
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    ent_coef: float = 0.0
    max_grad_norm: float = 1.0
    critic_learning_rate: float = 1e-3
    estimator_learning_rate: float = 1e-3
    estimator_epochs: int = 5
    critic_warmup: int = 3


@dataclass(frozen=True)
class EvaluationConfig:
    """Deterministic evaluation in the simulator, without noise or randomisation of the robot.

    Attributes:
        num_envs: robots; each command goes to the same number of them.
        seconds: length, s; speeds are averaged up to the push.
        push_speed: change of the base's velocity by one push after two thirds of the time, m/s; its direction
            differs from robot to robot. Without it every policy of a training stands all trials and robustness
            decides nothing.
        interval: iterations between evaluations.
        commands: (vx, vy, ω) rows.
    """

    num_envs: int = 24
    seconds: float = 6.0
    push_speed: float = 1.5
    interval: int = 25
    commands: tuple[tuple[float, float, float], ...] = (
        (1.0, 0.0, 0.0),
        (0.4, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        (0.7, 0.0, 0.4),
        (0.5, 0.2, 0.0),
        (1.0, 0.0, -0.3),
    )


@dataclass(frozen=True)
class TrainConfig:
    """A whole training.

    Attributes:
        seed: of networks, exploration, commands, noise and randomisation.
        total_steps: environment steps (policy periods, all environments together).
        num_envs: parallel robots; the paper has 400.
        engine: name in hqpipe.sim.ENGINES.
        first_engine, first_share: another engine for the first part of the training, and its share of the iterations, which is
            rounded down to a checkpoint. A faster engine teaches a gait sooner; the policy is chosen in `engine`.
        episode_s: time limit, s.
        checkpoint_interval: iterations between checkpoints; all environments are reset there, so that a resumed
            training ends in the same bytes as an uninterrupted one.
        torch_threads: sums depend on it, so it is fixed and recorded.
    """

    seed: int = 1
    total_steps: int = 1_000_000
    num_envs: int = 400
    engine: str = "pybullet"
    first_engine: str = "mujoco"
    first_share: float = 0.0
    episode_s: float = 20.0
    checkpoint_interval: int = 50
    torch_threads: int = 1
    gait: GaitConfig = field(default_factory=GaitConfig)
    command: CommandConfig = field(default_factory=CommandConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    randomisation: RandomisationConfig = field(default_factory=RandomisationConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    curriculum: CurriculumConfig = field(default_factory=CurriculumConfig)
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    ppo: PPOConfig = field(default_factory=PPOConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)

    def __post_init__(self) -> None:
        check_choice("gait.prior", self.gait.prior, PRIORS)
        check_choice("engine", self.engine, ENGINES)
        check_choice("first_engine", self.first_engine, ENGINES)
        check_numbers(self)
        c = self.command
        ranges = {"vx": c.vx, "vy": c.vy, "wz": c.wz}
        for name, ends in ranges.items():
            check_range(f"command.{name}", ends)
        on_the_spot = c.in_place_share > 0.0
        check_slowest(c.smallest, ranges, {"vx": c.straight_share > 0.0, "vy": on_the_spot, "wz": on_the_spot})
        check_layers("policy.hidden", self.policy.hidden)
        check_commands("evaluation.commands", self.evaluation.commands)
        self._check_sizes()

    def _check_sizes(self) -> None:
        """What several fields must agree on."""
        size, batch = self.rollout_size, self.ppo.batch_size
        together = ("num_envs", "ppo.n_steps", "ppo.batch_size")
        if size > SAMPLES:
            text = f"num_envs × ppo.n_steps is {size}, expected at most {SAMPLES} samples, which take 3 GB"
            raise CombinationError(text, together, "lower one of them")
        if size % batch:
            text = f"ppo.batch_size: {batch} does not divide num_envs × ppo.n_steps = {size}"
            raise CombinationError(text, ("ppo.batch_size", *together), "change one of the three")
        shares = self.command.straight_share + self.command.in_place_share
        if shares > 1.0:
            names = ("command.straight_share", "command.in_place_share")
            raise CombinationError(
                f"{' and '.join(names)} add up to {shares:g}, expected at most 1", names, "lower one of them"
            )
        if self.first_share > 0.0 and self.first_iterations == 0:
            names = ("first_share", "checkpoint_interval", "total_steps")
            first = self.first_share * self.iterations
            text = f"first_share of {self.iterations} iterations is {first:.3g}, expected checkpoint_interval or more"
            raise CombinationError(f"{text} ({self.checkpoint_interval})", names, "change one of the three")
        robots, commands = self.evaluation.num_envs, len(self.evaluation.commands)
        if robots % commands:
            text = f"evaluation.num_envs: {robots}, expected a multiple of the {commands} commands"
            fix = "change it, or the number of evaluation.commands"
            raise CombinationError(text, ("evaluation.num_envs", "evaluation.commands"), fix)

    @property
    def rollout_size(self) -> int:
        """Samples per iteration."""
        return self.num_envs * self.ppo.n_steps

    @property
    def iterations(self) -> int:
        """Iterations that fit into total_steps, at least one."""
        return max(1, self.total_steps // self.rollout_size)

    @property
    def first_iterations(self) -> int:
        """Iterations in `first_engine`: episodes begin anew at a checkpoint, where nothing of the old engine is left."""
        return self.checkpoint_interval * int(self.first_share * self.iterations / self.checkpoint_interval)

    def engine_of(self, iteration: int) -> str:
        """Engine of the iteration after so many others."""
        return self.first_engine if iteration < self.first_iterations else self.engine


def from_mapping(base: _Config, raw: Mapping[str, Any], where: str = "") -> _Config:
    """`base` with the fields of a nested mapping replaced.

    Raises:
        ConfigError: an unknown field or a value of the wrong kind; the message names the field's full path.
    """
    known = [f.name for f in fields(base)]
    changes = {}
    for name, value in raw.items():
        path = f"{where}{name}"
        if name not in known:
            text = f"unknown field '{path[:80]}'{near_match(name[:80], known)} (known: {', '.join(known)})"
            raise ConfigError(text, field=path, fix="rename or remove it")
        changes[name] = _convert(getattr(base, name), value, path)
    return replace(base, **changes)


def to_mapping(config: Any) -> dict[str, Any]:
    """The inverse of `from_mapping`, JSON-able."""
    return asdict(config)


def _convert(present: Any, value: Any, path: str) -> Any:
    if is_dataclass(present):
        if not isinstance(value, Mapping):
            raise wrong(path, f"{path}: expected a mapping of fields, got {shown(value)}")
        return from_mapping(present, value, f"{path}.")
    if isinstance(present, tuple):
        if not isinstance(value, list | tuple):
            raise wrong(path, f"{path}: expected a list, got {shown(value)}")
        return tuple(tuple(v) if isinstance(v, list | tuple) else v for v in value)
    if isinstance(present, bool):
        if not isinstance(value, bool):
            raise wrong(path, f"{path}: expected true or false, got {shown(value)}")
        return value
    if isinstance(present, str):
        expected, told = (str,), "text"
    elif isinstance(present, int):
        expected, told = (int,), "a whole number, written without point or exponent"
    else:
        expected, told = (int, float), "a number"
    if not isinstance(value, expected) or isinstance(value, bool):
        raise wrong(path, f"{path}: expected {told}, got {shown(value)}")
    # A whole number beyond what a float holds is out of every limit as it is.
    return value if isinstance(value, int) and abs(value) > _LARGEST else type(present)(value)
