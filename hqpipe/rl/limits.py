"""What every number of a training may be: outside of it the training would fail after it has begun, or not end.

`hqpipe.rl.config` checks against this table when a configuration is made, long before anything is simulated.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from hqpipe.errors import ConfigError, near_match, shown


class CombinationError(ConfigError):
    """Fields that do not fit together.

    Args:
        message: what is wrong. together: their dotted names, the first is the error's `field`. fix: what to do.
    """

    def __init__(self, message: str, together: Sequence[str], fix: str) -> None:
        super().__init__(message, field=together[0], fix=fix)
        self.together = tuple(together)


@dataclass(frozen=True)
class Limit:
    """Lowest and highest value, both allowed, and why."""

    lower: float
    upper: float
    reason: str


_SHARE = Limit(0.0, 1.0, "a share")
_ANGLE = Limit(0.0, 3.2, "rad, up to half a turn")
_SPEED = Limit(0.0, 10.0, "m/s or rad/s, beyond any legged machine")
_RATE = Limit(1e-9, 1.0, "a learning rate; steps of the size of the weights diverge")
_LOG_STD = Limit(-10.0, 2.0, "log of a spread in actions: 5e-5 to 7")
_COEFFICIENT = Limit(-1e6, 1e6, "a coefficient of a reward; beyond it sums in single precision lose the other terms")
_COUNT = Limit(1, 1e6, "a count of iterations, 50 times the paper's 20,000")
_ROBOTS = Limit(1, 10_000, "robots in memory, 25 times the paper's 400")

LIMITS: dict[str, Limit] = {
    "seed": Limit(0, 2**32 - 1, "NumPy and PyTorch both take seeds of 32 bits"),
    "total_steps": Limit(1, 1e10, "50 times the paper's 192 million"),
    "num_envs": _ROBOTS,
    "first_share": Limit(0.0, 0.95, "a share of the training, of which some must be left for the other engine"),
    "episode_s": Limit(0.01, 3600.0, "from one control period to an hour"),
    "checkpoint_interval": _COUNT,
    "torch_threads": Limit(1, 1024, "cores of a machine"),
    "gait.frequency_hz": Limit(0.1, 10.0, "the clock divides by it, and a leg of 30 kg does not step faster"),
    "gait.duty": Limit(0.05, 0.95, "the gait divides by the share of stance and by that of swing"),
    "gait.swing_height": Limit(0.0, 1.0, "m, the length of a leg"),
    "gait.lead_s": Limit(0.0, 1.0, "s, of a lag of a position loop"),
    "gait.standing_speed": Limit(1e-3, 10.0, "m/s, the gait divides by it"),
    "command.standing_share": _SHARE,
    "command.straight_share": _SHARE,
    "command.in_place_share": _SHARE,
    "command.smallest": _SPEED,
    "command.resample_s": Limit(0.01, 3600.0, "from one control period to an hour"),
    "command.ramp_s": Limit(0.0, 3600.0, "s; 0 changes a command at once"),
    "noise.gyro": Limit(0.0, 100.0, "rad/s, full scale of a gyroscope"),
    "noise.position": _ANGLE,
    "noise.velocity": Limit(0.0, 100.0, "rad/s, beyond any joint"),
    "randomisation.position": _ANGLE,
    "randomisation.tilt": Limit(0.0, 1.6, "rad, up to lying on the side"),
    "randomisation.linear_velocity": _SPEED,
    "randomisation.angular_velocity": _SPEED,
    "randomisation.push_interval_s": Limit(0.0, 3600.0, "s; 0 for no pushes"),
    "randomisation.push_speed": _SPEED,
    "randomisation.kinematics": Limit(0.0, 10.0, "ten times the documented range, masses off by half"),
    "randomisation.friction": Limit(0.0, 0.95, "a share of the friction, of which some must be left"),
    "randomisation.actuator.scale": Limit(0.0, 100.0, "times the deviations of the posterior"),
    "randomisation.actuator.half_range": Limit(0.0, 0.95, "a share of a coefficient, which must keep its sign"),
    "reward.scale": Limit(1e-9, 1e6, "multiplies all rewards; 0 leaves nothing to learn from"),
    "reward.clearance_target": Limit(0.0, 1.0, "m, the length of a leg"),
    "curriculum.start": _SHARE,
    "curriculum.iterations": Limit(0, 1e6, _COUNT.reason),
    "policy.action_scale": Limit(1e-3, 3.2, "rad; up to half a turn"),
    "policy.command_scale": Limit(1e-3, 1000.0, "s/m; the other inputs are of order one"),
    "policy.standing_scale": _SHARE,
    "policy.initial_log_std": _LOG_STD,
    "policy.final_log_std": _LOG_STD,
    "policy.output_gain": Limit(0.0, 10.0, "times the usual initial weights"),
    "ppo.n_steps": Limit(1, 100_000, "samples of one robot in an iteration: a quarter of an hour"),
    "ppo.batch_size": Limit(2, 4_000_000, "advantages are scaled by their spread in it, which one sample lacks"),
    "ppo.n_epochs": Limit(1, 1000, "passes over the same samples; the paper has a few"),
    "ppo.learning_rate": _RATE,
    "ppo.target_kl": Limit(1e-6, 10.0, "the learning rate is halved above twice of it"),
    "ppo.gamma": _SHARE,
    "ppo.gae_lambda": _SHARE,
    "ppo.clip_range": Limit(1e-3, 1.0, "a share; 0 stops the learning"),
    "ppo.ent_coef": Limit(0.0, 10.0, "beyond the return, which is of order one"),
    "ppo.max_grad_norm": Limit(1e-6, 1e6, "0 stops the learning"),
    "ppo.critic_learning_rate": _RATE,
    "ppo.estimator_learning_rate": _RATE,
    "ppo.estimator_epochs": Limit(1, 1000, "passes over the same samples, at most ppo.n_epochs of them count"),
    "ppo.critic_warmup": Limit(0, 1e6, _COUNT.reason),
    "evaluation.num_envs": _ROBOTS,
    "evaluation.seconds": Limit(0.1, 600.0, "from ten control periods to ten minutes"),
    "evaluation.push_speed": _SPEED,
    "evaluation.interval": _COUNT,
}
"""Dotted field of `TrainConfig` → what it may be; the coefficients of the rewards are `_COEFFICIENT`."""

FASTEST = 10.0  # m/s and rad/s of a command; beyond any legged machine
_REACH = 2.0  # times the slowest command; so at most half of the draws are thrown away
LAYERS, UNITS = 6, 2048  # of a network; one such layer has 4 million weights, 70 MB with gradient and moments
SAMPLES = 4_000_000  # of an iteration; at some 200 numbers each they take 3 GB


def check_numbers(config: Any, above: str = "") -> None:
    """Check every number of `TrainConfig` against the table.

    Raises:
        ConfigError: one is outside; the message begins with its dotted name.
    """
    for name, value in _numbers(config, above):
        limit = LIMITS.get(name, _COEFFICIENT)
        if not limit.lower <= value <= limit.upper:  # so is NaN
            message = f"{name}: expected {limit.lower:g} to {limit.upper:g} ({limit.reason}), got {shown(value)}"
            raise wrong(name, message)


def _numbers(config: Any, above: str) -> Iterator[tuple[str, float]]:
    for entry in fields(config):
        value, name = getattr(config, entry.name), f"{above}{entry.name}"
        if is_dataclass(value):
            yield from _numbers(value, f"{name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield name, value


def check_choice(name: str, value: str, known: Collection[str]) -> None:
    """Check a field that is one of several names."""
    if value not in known:
        message = f"{name}: '{value[:80]}'{near_match(value[:80], known)}, expected one of {', '.join(known)}"
        raise ConfigError(message, field=name, fix="name one of these")


def check_range(name: str, value: Any) -> None:
    """Check the (low, high) of a command."""
    if not (_speeds(value, 2) and value[0] <= value[1]):
        raise wrong(name, f"{name}: expected [low, high], numbers within ±{FASTEST:g}, got {_listed(value)}")


def check_slowest(smallest: float, ranges: Mapping[str, Sequence[float]], alone: Mapping[str, bool]) -> None:
    """Check that commands as fast as command.smallest are drawn.

    Args:
        smallest: norm of the slowest moving command, m/s. ranges: (low, high) of vx, vy (m/s) and wz (rad/s).
        alone: whether there are commands in which that axis moves by itself.
    """
    fastest = {name: max(abs(value) for value in ends) for name, ends in ranges.items()}
    slow = [name for name in ranges if fastest[name] < _REACH * smallest]
    if len(slow) == len(ranges) or any(alone[name] for name in slow):
        name = f"command.{slow[0]}"
        least = f"{_REACH:g} × command.smallest or more, since slower ones are drawn again"
        text = f"{name} reaches {fastest[slow[0]]:g}, expected {least}"
        raise CombinationError(text, ("command.smallest", name), "change one of the two")


def check_commands(name: str, rows: Any) -> None:
    """Check the (vx, vy, ω) rows of an evaluation."""
    if not rows or not all(_speeds(row, 3) for row in rows):
        message = (
            f"{name}: expected one or more of [vx, vy, yaw rate], numbers within ±{FASTEST:g}, got {_listed(rows)}"
        )
        raise wrong(name, message)


def check_layers(name: str, units: Any) -> None:
    """Check the units of hidden layers."""
    whole = all(isinstance(each, int) and not isinstance(each, bool) and 1 <= each <= UNITS for each in units)
    if not (whole and 1 <= len(units) <= LAYERS):
        message = f"{name}: expected 1 to {LAYERS} layers of 1 to {UNITS} units (more do not fit the memory)"
        raise wrong(name, f"{message}, got {_listed(units)}")


def wrong(name: str, message: str) -> ConfigError:
    """The error of one field."""
    return ConfigError(message, field=name, fix=f"set {name} to a value that is allowed")


def _speeds(row: Any, count: int) -> bool:
    return (
        isinstance(row, tuple)
        and len(row) == count
        and all(isinstance(v, int | float) and not isinstance(v, bool) and abs(v) <= FASTEST for v in row)
    )


def _listed(value: Any) -> str:
    return shown([list(part) if isinstance(part, tuple) else part for part in value])
