"""What fixes the scale of torques of a joint, and so which of its numbers these logs can tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.logs.columns import joint_column
from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.drive import of_joint
from hqpipe.logs.joint_kinds import PRISMATIC, unit_of
from hqpipe.logs.trajectory import Trajectory, Trial

GRAVITY = 9.80665  # m/s², standard gravity (ISO 80000-3)
VOLTAGE = "supply/voltage"
_FOLLOWS = 0.8  # of the variance of the duty, that a position loop must explain; assumption
_SAME_LAW = 1.3  # ratio of the gains of two trials, over the stated ones, up to which they are one law; assumption
ROD = (1.0 / 3.0, 0.5)  # inertia and static moment of a uniform rod about its end, over m l² and m l


@dataclass(frozen=True, eq=False)
class Scale:
    """Known quantities of one joint, (R,) by trial, and what is free.

    Attributes:
        kind: "revolute", "prismatic" or None. duty: whether the input is duty × voltage, and not the position command.
        si: whether torques are in N·m (N). load: whether the load is known, which fixes inertia and gravity.
        gain, drag: of the drive: torque per input, and torque lost per speed; or their ratios between trials where
            `free_gain`, `free_drag`.
        inertia, gravity: m l² and m g l of the known load, else 0.
        stall: torque at standstill and full duty, of all trials, where the supply may sag unseen; else None.
        winding_ohm: resistance of the motor, or None.
        volts: what the logged duty is multiplied by where the voltage is not logged, (R,); None where it is.
        gain_unstated: the gain of a position loop is not known, so that it may differ from trial to trial.
        may_sag: the supply voltage is not logged.
    """

    kind: str | None
    duty: bool
    si: bool
    load: bool
    gain: np.ndarray
    drag: np.ndarray
    free_gain: bool
    free_drag: bool
    inertia: np.ndarray
    gravity: np.ndarray
    stall: float | None
    winding_ohm: float | None
    volts: np.ndarray | None
    gain_unstated: bool = False
    may_sag: bool = False

    @property
    def torque(self) -> str:
        if self.si:
            return unit_of("N·m", self.kind)
        return "1" if self.duty else self.angle

    @property
    def angle(self) -> str:
        return unit_of("rad", self.kind)

    @property
    def drag_unit(self) -> str:
        if self.si:
            return unit_of("N·m·s/rad", self.kind)
        return f"s/{self.angle}" if self.duty else "s"

    @property
    def inertia_unit(self) -> str:
        if self.si:
            return unit_of("kg·m²", self.kind)
        return f"s²/{self.angle}" if self.duty else "s²"


def duty_of(trajectory: Trajectory, joint: str) -> np.ndarray | None:
    """(T,) logged duty of a joint, or None; a column that only some joints have stands among the extra ones."""
    if trajectory.duty is not None:
        return trajectory.duty[:, trajectory.joint(joint)]
    return trajectory.extra.get(joint_column(joint, "duty"))


def by_duty(trials: Sequence[Trial], joint: str) -> bool:
    """Whether the duty is the input, and not the position command: where there is no command, or no one law leads to the duty.

    Behind a loop that closes on the position the duty goes with the error of the command and the speed. If it does so by the
    same law in all trials, the command is the better input: it shows what is wrong before the motor too. Where motor constants
    are stated, the duty gives torques in N·m.
    """
    duties = [duty_of(trial.trajectory, joint) for trial in trials]
    if any(duty is None for duty in duties):
        return False
    if any(trial.trajectory.position_command is None for trial in trials):
        return True
    if _all([of_joint(trial.drive, joint) for trial in trials], "torque_constant") is not None:
        return True  # which fixes the scale of torques behind a duty only
    fit = [trial for trial in trials if trial.split == "fit"]
    drives = [of_joint(trial.drive, joint) for trial in fit]
    stated = next((g for g in (_all(drives, "kp"), _all(drives, "firmware_kp")) if g is not None), np.ones(len(fit)))
    explained, gains = np.array([_loop(trial, joint) for trial in fit]).T
    gains = np.abs(gains) / stated
    return bool(np.median(explained) < _FOLLOWS or gains.max() > _SAME_LAW * gains.min())


def _loop(trial: Trial, joint: str) -> tuple[float, float]:
    """Share of the variance of a duty that the error of the command and the speed explain, and the gain of the error."""
    t = trial.trajectory
    j, duty = t.joint(joint), duty_of(t, joint)
    variance = 0.0 if duty is None else float(np.var(duty))
    if variance == 0.0:
        return 0.0, 0.0
    q = t.position[:, j]
    columns = np.column_stack([t.position_command[:, j] - q, differentiate(q[:, None], t.dt)[:, 0], np.ones(len(q))])
    law = np.linalg.lstsq(columns, duty, rcond=None)[0]
    return 1.0 - float(np.var(duty - columns @ law)) / variance, float(law[0])


def scale_of(trials: Sequence[Trial], joint: str, kind: str | None) -> Scale:
    """What is stated and logged of a joint.

    Args:
        trials: R of them, of both splits.
    """
    drives = [of_joint(trial.drive, joint) for trial in trials]
    load, inertia, gravity = _load([of_joint(trial.load, joint) for trial in trials], kind)
    if by_duty(trials, joint):
        return _duty_scale(trials, drives, kind, load, inertia, gravity)
    kp, kd = _all(drives, "kp"), _all(drives, "kd")
    firmware_kp, firmware_kd = _all(drives, "firmware_kp"), _all(drives, "firmware_kd")
    ones = np.ones(len(trials))
    si = load or kp is not None
    if kp is not None:
        gain = kp
    elif firmware_kp is not None and np.median(firmware_kp) > 0.0:
        gain = firmware_kp / np.median(firmware_kp)
    else:
        gain = ones
    known_drag = kd is not None and si
    if known_drag:
        drag = kd
    elif firmware_kd is not None and np.median(firmware_kd) > 0.0:
        drag = firmware_kd / np.median(firmware_kd)
    else:
        drag = ones
    motor = [_all(drives, name) for name in ("torque_constant", "ohm", "supply_v")]
    stall = None
    if si and all(values is not None and values.min() > 0.0 for values in motor):
        stall = float(np.median(motor[0] / motor[1] * motor[2]))
    return Scale(
        kind=kind,
        duty=False,
        si=si,
        load=load,
        gain=gain,
        drag=drag,
        free_gain=load and kp is None,
        free_drag=not known_drag,
        inertia=inertia,
        gravity=gravity,
        stall=stall if not all(VOLTAGE in trial.trajectory.extra for trial in trials) else None,
        winding_ohm=float(np.median(motor[1])) if stall else None,
        volts=None,
        gain_unstated=kp is None and firmware_kp is None,
        may_sag=not all(VOLTAGE in trial.trajectory.extra for trial in trials),
    )


def _duty_scale(
    trials: Sequence[Trial],
    drives: Sequence[dict[str, float]],
    kind: str | None,
    load: bool,
    inertia: np.ndarray,
    gravity: np.ndarray,
) -> Scale:
    constant, ohm, supply = (_all(drives, name) for name in ("torque_constant", "ohm", "supply_v"))
    logged = all(VOLTAGE in trial.trajectory.extra for trial in trials)
    stated_volts = supply is not None and supply.min() > 0.0
    ones = np.ones(len(trials))
    volts = None if logged else supply if stated_volts else ones
    full = float(np.median(np.concatenate([t.trajectory.extra[VOLTAGE] for t in trials]))) if logged else 0.0
    full = full if logged else float(np.median(volts))
    motor = constant is not None and ohm is not None and ohm.min() > 0.0 and (logged or stated_volts)
    gain = constant / ohm if motor else ones if load else ones / full
    return Scale(
        kind=kind,
        duty=True,
        si=load or motor,
        load=load,
        gain=gain,
        drag=constant**2 / ohm if motor else ones,
        free_gain=load and not motor,
        free_drag=not motor,
        inertia=inertia,
        gravity=gravity,
        stall=None if logged else float(np.median(gain)) * full,
        winding_ohm=float(np.median(ohm)) if motor and not logged else None,
        volts=volts,
        may_sag=not logged,
    )


def _load(stated: Sequence[dict[str, float]], kind: str | None) -> tuple[bool, np.ndarray, np.ndarray]:
    """Whether the load of every trial is known, its inertia and m g l."""
    mass, lever = _all(stated, "mass_kg"), _all(stated, "lever_m")
    zero = np.zeros(len(stated))
    arm = np.array([load.get("arm_mass_kg", 0.0) for load in stated])
    if kind == PRISMATIC:
        known = mass is not None and mass.min() > 0.0
        return known, mass + arm if known else zero, zero  # how steep the slide is nobody states
    if mass is None or lever is None or mass.min() <= 0.0 or lever.min() <= 0.0:
        return False, zero, zero
    return True, (mass + ROD[0] * arm) * lever**2, (mass + ROD[1] * arm) * GRAVITY * lever


def _all(stated: Sequence[dict[str, float]], name: str) -> np.ndarray | None:
    """(R,) a quantity that every trial states, else None."""
    values = [numbers.get(name) for numbers in stated]
    return None if any(value is None for value in values) else np.array(values, dtype=np.float64)


def scale_note(joint: str, scale: Scale) -> str:
    """A sentence on what the units of this joint are, and what would fix them."""
    if scale.si:
        return ""
    fix = "state load: {mass_kg: …, lever_m: …} in logset.yaml, or drive: "
    if scale.kind == PRISMATIC:
        fix = "state load: {mass_kg: …} in logset.yaml, or drive: "
    if scale.duty:
        return (
            f"{joint}: no torque is logged and neither load nor motor constants are stated, so torques are shares of the stall "
            f"torque (unit 1); for N·m {fix}{{torque_constant: …, ohm: …}} with the supply voltage"
        )
    return (
        f"{joint}: no torque is logged and neither load nor kp is stated, so torques are in {scale.angle} of command error "
        f"(kp = 1); for N·m {fix}{{kp: …}}"
    )
