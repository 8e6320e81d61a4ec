"""Closed-loop data of joints with planted effects, made by a plain numpy loop that shares no code with the package.

Every joint carries its own effects, so that one run makes the data of all effects. The load is a lumped inertia with
damping and a constant torque; it is moved by the target and knocked about.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

DT = 1e-3
GAINS = {"k1": 540.0, "k2": 0.05, "k3": 21.6, "k4": 0.36}  # joint space, per sample
INERTIA, DAMPING, LOAD = 6.0, 15.0, 120.0  # kg·m², N·m·s/rad, N·m
POLICY_STEPS = 10  # the target is held for 10 ms
LEGS = ("LFR", "LFP", "LFK", "RFR", "RFP", "RFK", "LHR", "LHP", "LHK", "RHR", "RHP", "RHK")

# Sizes at which an effect stands well above 3 N·m of noise and leaves the loop stable.
TYPICAL: dict[str, dict[str, float]] = {
    "command_delay": {"delay_s": 0.0064},
    "position_bias": {"rad": 0.02},
    "integral_action": {"ki": 2.0, "limit": 0.03},
    "valve_delay": {"delay_s": 0.0047},
    "valve_lag": {"time_constant_s": 0.012},
    "valve_deadband": {"half_width": 0.02, "rounding": 0.2},
    "valve_underlap": {"half_width": 0.02},
    "flow_saturation": {"limit": 0.06},
    "direction_asymmetry": {"ratio": 0.2},
    "gain_drift": {"rate_per_s": 0.03},
    "leakage_drift": {"rate_per_s": 0.08},
    "supply_droop": {"droop": 0.1, "recovery_s": 0.15},
    "orifice_flow": {"effort_max_nm": 900.0},
    "position_dependent_stiffness": {"slope_per_rad": 1.5, "length_rad": 0.45, "strayed": 0.02},
    "backlash": {"gap": 0.008},
    "coulomb_friction": {"friction_nm": 25.0, "asymmetry_nm": 5.0, "presliding_rad": 0.00015},  # a link of 8 k3/Δt
    "stribeck_friction": {"static_nm": 30.0, "velocity_rad_s": 0.3, "exponent": 1.5},
    "viscous_friction": {"nm_s_per_rad": 20.0},
    "load_dependent_friction": {"coefficient": 0.15},
    "torque_bias": {"nm": 30.0},
    "channel_skew": {"skew_s": 0.0052},
}


@dataclass(frozen=True)
class Planted:
    """A recorded trial: time (T,), the other channels (T, J)."""

    time: np.ndarray
    command: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray


def leaking(*ratios: float) -> dict[str, list[float]]:
    """`gains` of joints that leak by these ratios more than `GAINS`, with what leaks away within a sample."""
    decay = -np.log(1.0 - GAINS["k2"])
    k2 = (1.0 - np.exp(-decay * np.array(ratios))) / GAINS["k2"]
    return {"k2": k2.tolist(), **{name: (k2 / np.array(ratios)).tolist() for name in ("k1", "k3", "k4")}}


class _Numbers:
    """Parameters of the effects as (J,) arrays; where a joint lacks an effect, the number that switches it off."""

    def __init__(self, effects: list[dict[str, dict[str, float]]]) -> None:
        self.effects = effects

    def __call__(self, effect: str, name: str, off: float) -> np.ndarray:
        return np.array([joint.get(effect, {}).get(name, off) for joint in self.effects])


def ago(history: list[np.ndarray], samples: np.ndarray) -> np.ndarray:
    """The signal `samples` (J,) before the last one, between samples on a straight line; never before the first."""
    found = np.empty(len(samples))
    for j, lag in enumerate(samples):
        place = max(len(history) - 1 - lag, 0.0)
        below = int(np.floor(place))
        above = min(below + 1, len(history) - 1)
        share = place - below
        found[j] = (1.0 - share) * history[below][j] + share * history[above][j]
    return found


def beyond(x: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """How far x reaches past ± gap."""
    return np.sign(x) * np.maximum(np.abs(x) - gap, 0.0)


def overlap(x: np.ndarray, half: np.ndarray, rounding: np.ndarray) -> np.ndarray:
    """Dead zone; inside half ± rounding a parabola joins the two straight lines."""
    excess = np.abs(x) - half
    bend = np.where(np.abs(excess) < rounding, (excess + rounding) ** 2 / (4.0 * np.maximum(rounding, 1e-30)), 0.0)
    return np.sign(x) * np.where(excess > rounding, excess, bend)


def simulate(
    seconds: float,
    effects: list[dict[str, dict[str, float]]],
    noise: float,
    seed: int,
    *,
    motion: float = 0.4,
    knocks: float = 500.0,
    middle: float = 0.0,
    order: tuple[str, ...] = ("saturation", "lag", "deadband", "asymmetry", "drift", "underlap"),
    flow: tuple[float, float] = (1.0, 0.0),
    gains: dict[str, list[float]] | None = None,
) -> Planted:
    """One trial of independent joints.

    Args:
        seconds: length.
        effects: per joint, effect → parameter → value; a shared supply sags with the flow of all joints.
        noise: standard deviation of the torque reading, N·m.
        seed: of target, knocks and noise.
        motion, knocks: sizes, rad and N·m.
        middle: position at which the stiffness is the nominal one, rad.
        order: in which the command side acts.
        flow: what a joint's speed and its position error (1/s) count in the flow, rad/s.
        gains: name in `GAINS` → per joint what it is multiplied by.
    """
    rng = np.random.default_rng(seed)
    number = _Numbers(effects)
    samples, joints = round(seconds / DT), len(effects)
    k1, k2, k3, k4 = (value * np.array((gains or {}).get(name, [1.0])) for name, value in GAINS.items())
    time = np.arange(samples) * DT
    rates, phases = rng.uniform(0.4, 4.0, (5, joints)), rng.uniform(0.0, 2.0 * np.pi, (5, joints))
    smooth = motion / 5.0 * sum(np.sin(2.0 * np.pi * rates[i] * time[:, None] + phases[i]) for i in range(5))
    target = smooth[np.arange(samples) // POLICY_STEPS * POLICY_STEPS]
    knock = np.zeros((samples, joints))
    for _ in range(int(2 * seconds)):
        start, length = rng.integers(0, max(samples - 80, 1)), rng.integers(20, 80)
        knock[start : start + length] += knocks * rng.normal(size=joints)

    delay, sent_late = (number(name, "delay_s", 0.0) / DT for name in ("command_delay", "valve_delay"))
    bias, offset = number("position_bias", "rad", 0.0), number("torque_bias", "nm", 0.0)
    ki, windup = number("integral_action", "ki", 0.0), number("integral_action", "limit", np.inf)
    constant = number("valve_lag", "time_constant_s", 0.0)
    left = np.where(constant > 0.0, np.exp(-DT / np.maximum(constant, 1e-30)), 0.0)  # of the way, after a sample
    mean_left = constant / DT * (1.0 - left)  # and on average over it
    half, share = number("valve_deadband", "half_width", 0.0), number("valve_deadband", "rounding", 0.0)
    lap = number("valve_underlap", "half_width", 0.0)
    widest, ratio = number("flow_saturation", "limit", np.inf), number("direction_asymmetry", "ratio", 0.0)
    rate, thinner = number("gain_drift", "rate_per_s", 0.0), number("leakage_drift", "rate_per_s", 0.0)
    droop, recovery = number("supply_droop", "droop", 0.0), number("supply_droop", "recovery_s", 1.0)
    most, slope = (
        number("orifice_flow", "effort_max_nm", np.inf),
        number("position_dependent_stiffness", "slope_per_rad", 0),
    )
    areas = number("direction_asymmetry", "areas", 0.0)  # unequal ones, over their sum
    balance = areas * np.where(areas != 0.0, most, 0.0)  # N·m, at which the pressures of both sides are equal
    length = number("position_dependent_stiffness", "length_rad", 0.5)
    strayed = number("position_dependent_stiffness", "strayed", 0.0)
    shorter = -np.sign(slope)  # 1 where the chamber that raises the torque is the smaller one
    slack = 0.5 * number("backlash", "gap", 0.0) * k3 / DT
    dry, uneven = number("coulomb_friction", "friction_nm", 0.0), number("coulomb_friction", "asymmetry_nm", 0.0)
    creep = number("coulomb_friction", "presliding_rad", 1e-3)
    static, slow = number("stribeck_friction", "static_nm", 0.0), number("stribeck_friction", "velocity_rad_s", 1.0)
    exponent = number("stribeck_friction", "exponent", 1.0)
    oil, load = number("viscous_friction", "nm_s_per_rad", 0.0), number("load_dependent_friction", "coefficient", 0.0)
    late = number("channel_skew", "skew_s", 0.0) / DT

    actions = {
        "deadband": lambda x, t: overlap(x, half, share * half),
        "underlap": lambda x, t: np.where(np.abs(x) < lap, 2.0 * x, x + np.sign(x) * lap),
        "saturation": lambda x, t: np.clip(x, -widest, widest),
        "asymmetry": lambda x, t: np.where(x > 0.0, (1.0 + ratio) * x, (1.0 - ratio) * x),
        "drift": lambda x, t: (1.0 + rate * t) * x,
    }
    q, qd, wound = smooth[0].copy(), np.zeros(joints), np.zeros(joints)
    integral, spool, bristle = np.zeros(joints), None, np.zeros(joints)
    loss, chambers = np.zeros(joints), np.zeros(joints)  # shares of the supply
    commands: list[np.ndarray] = []
    torques: list[np.ndarray] = []
    sent: list[np.ndarray] = []  # what the controllers put out
    log = np.empty((3, samples, joints))
    for k in range(samples):
        inner = beyond(wound, slack)
        lost = (
            dry * bristle
            + uneven * np.abs(bristle)
            + static * bristle * np.exp(-((np.abs(qd) / slow) ** exponent))
            + oil * qd
        )
        lost = lost + load * np.abs(inner) * bristle
        passed = beyond(wound - lost, slack)  # the seals rub on the piston's side of the slack
        inner = passed + lost
        commands.append(target[k])
        torques.append(passed + offset)
        log[:, k] = q, qd, ago(torques, late)
        error = ago(commands, delay) - q
        x = error + integral + bias
        integral = np.clip(integral + ki * DT * error, -windup, windup)
        sent.append(x)
        x = ago(sent, sent_late)
        for name in order:
            if name == "lag":
                behind = x - (x if spool is None else spool)
                spool, x = x - left * behind, x - mean_left * behind
            else:
                x = actions[name](x, time[k])
        drawn = flow[0] * np.abs(qd).sum() + flow[1] * np.abs(target[k] - q).sum()
        loss = loss - np.expm1(-DT / recovery) * (droop * drawn - loss)
        against = np.sign(x) * inner / most / (1.0 + np.sign(x) * areas)
        across = np.maximum(lap - 0.5 * np.abs(x), 0.0) / most  # what both open lands let pass, per torque
        leaks = (k2 * np.exp(thinner * time[k]) + k1 * across) * (inner - balance)
        more = (
            np.abs(slope) * length / (1.0 + shorter * (q - middle) / length)
        )  # of the smaller one, beyond the other's
        alike = 0.5 * (1.0 - np.abs(slope) * length)
        raising, lowering = (alike + np.where(side * shorter > 0.0, more, 0.0) for side in (1.0, -1.0))
        stiff = raising + lowering
        feeds, drains = np.where(x > 0.0, raising, lowering) / stiff, np.where(x > 0.0, lowering, raising) / stiff
        pressed, relieved = (
            np.sqrt(np.maximum(1.0 - 2.0 * loss - chambers - against, 0.0)),
            np.sqrt(np.maximum(1.0 + chambers - against, 0.0)),
        )
        mixed = k1 * np.abs(x) * (feeds * pressed - drains * relieved) - (raising - lowering) / stiff * (
            leaks + k3 * qd
        )
        room = np.maximum(
            1.0 - np.abs(inner) / most, 0.0
        )  # no chamber is emptier than the tank or fuller than the supply
        chambers = np.where(slope == 0.0, -loss, np.clip(chambers + stiff * mixed / most, -room, room))
        away = chambers + strayed
        pressed = np.sqrt(np.maximum(1.0 - 2.0 * loss - away - against, 0.0))
        fed = x * (feeds * pressed + drains * np.sqrt(np.maximum(1.0 + away - against, 0.0)))
        braked = k4 * np.where(inner * x < 0.0, np.abs(inner), 0.0) * x
        pulling = wound
        wound = wound + stiff * (k1 * fed - leaks - k3 * qd + braked)
        grip = (
            dry + static + load * np.abs(beyond(wound, slack))
        )  # while a piston sticks, friction holds against this change, and its spring follows the joint
        moved = DT * qd
        held = np.maximum(grip, 1e-30)
        pulled = np.where(grip > 0.0, (wound - pulling) / held, 0.0)
        loose = np.abs(pulling - grip * bristle) < slack  # then the oil alone pulls, whatever the joint does
        bristle = np.clip(bristle + pulled + np.where(loose, k3 / DT * moved / held, moved / creep), -1.0, 1.0)
        qd = qd + DT * (passed - DAMPING * qd - LOAD + knock[k]) / INERTIA
        q = q + moved
    return Planted(time, target, log[0], log[1], log[2] + noise * rng.normal(size=(samples, joints)))


def trajectory(trial: Planted, joints: tuple[str, ...] | None = None) -> Trajectory:
    """The trial as the package takes it."""
    names = joints or tuple(f"j{i}" for i in range(trial.position.shape[1]))
    return Trajectory(
        trial.time, names, trial.position, trial.velocity, effort=trial.torque, position_command=trial.command
    )


def logs_of(
    effects: list[dict[str, dict[str, float]]],
    *,
    seconds: float = 6.0,
    noise: float = 3.0,
    seed: int = 0,
    fit: int = 1,
    joints: tuple[str, ...] | None = None,
    source: str = "load_cell",
    **kwargs,
) -> LogSet:
    """A log set of `fit` trials and one held-out one.

    Args:
        effects: per joint. joints: their names; the first of the quadruped's if None.
    """
    names = joints or LEGS[: len(effects)]
    runs = [simulate(seconds, effects, noise, 100 * seed + i, **kwargs) for i in range(fit + 1)]
    trials = tuple(
        Trial(f"t{i}.parquet", "heldout" if i == fit else "fit", None, trajectory(run, names))
        for i, run in enumerate(runs)
    )
    return LogSet(
        path=Path("synthetic"),
        sha256="0" * 64,
        format="hqpipe-log/1",
        robot=None,
        base="fixed",
        control_mode="position",
        effort_source=source,
        rate_hz=1.0 / DT,
        joints=names,
        trials=trials,
    )
