"""The fields of policy.json, checked one by one."""

from __future__ import annotations

import numpy as np

from hqpipe.files.entries import Entry
from hqpipe.rl.config import PRIORS, GaitConfig
from hqpipe.rl.leg import LegGeometry
from hqpipe.rl.observation import Layout, Term
from hqpipe.rl.policy_spec import CONTROL_MODES, FORMAT, PolicySpec

MOST_HIDDEN = 4096  # units of a layer; the paper has 512, and a call must end within its 10 ms
MOST_LAYERS = 8
MOST_JOINTS = 200
TURN = 1000.0  # rad: no angle, offset or target of a joint is larger
LARGEST = 1e9  # of gains, stiffnesses and scales, SI: `RIGID` of hqpipe.rl.policy_spec
_REASON = "larger nets cannot be run at 100 Hz"
_GAIT = {
    "frequency_hz": (1e-3, 50.0),
    "duty": (1e-3, 0.999),
    "swing_height": (0.0, 10.0),
    "lead_s": (0.0, 10.0),
    "standing_speed": (1e-6, 100.0),
}
_OBSERVATION = ("base_angular_velocity", "joint_position", "joint_velocity", "previous_target", "velocity_command")
_LATER = ("leg_odometry",)  # fields that older policies lack: they have the estimator of o_t alone
_OF_JOINTS = ("joint_position", "joint_velocity", "previous_target")
_STATE = ("base_linear_velocity", "gravity", "base_height", "foot_contact", "foot_height")
_SIZES = {
    "base_angular_velocity": 3,
    "velocity_command": 3,
    "clock": 2,
    "base_linear_velocity": 3,
    "gravity": 3,
    "base_height": 1,
}


def read_spec(document: Entry) -> PolicySpec:
    """The spec that policy.json holds; inverse of `PolicySpec.to_dict`.

    Raises:
        ConfigError: another format, or a field is missing, unknown, malformed or does not fit the others.
    """
    names = tuple(name for name in PolicySpec.__dataclass_fields__ if name not in _LATER)
    if isinstance(document.value, dict) and "format" in document.value:
        document.inner("format").text((FORMAT,))
    fields = document.mapping(("format", *names), _LATER)
    joints, feet = fields["joints"].names(MOST_JOINTS), fields["feet"].names(MOST_JOINTS)
    if len(joints) != 3 * len(feet):
        raise fields["joints"].error(f"{len(joints)} joints for {len(feet)} feet, expected three to a leg")

    def column(name: str, lower: float, upper: float) -> np.ndarray:
        return np.array(fields[name].numbers(len(joints), lower=lower, upper=upper), dtype=float)

    angles = {name: column(name, -TURN, TURN) for name in ("nominal", "lower", "upper")}
    if not (angles["lower"] < angles["upper"]).all():
        raise fields["lower"].error("expected lower below upper for every joint")
    gait = _gait(fields["gait"])
    return PolicySpec(
        robot=fields["robot"].name(),
        joints=joints,
        feet=feet,
        control_mode=fields["control_mode"].text(CONTROL_MODES),
        kp=column("kp", 0.0, LARGEST),
        kd=column("kd", 0.0, LARGEST),
        position_stiffness=column("position_stiffness", 1e-9, LARGEST),
        weight=fields["weight"].number(1e-6, 1e9, unit="N"),
        **angles,
        action_scale=fields["action_scale"].number(1e-9, TURN, unit="rad"),
        standing_scale=fields["standing_scale"].number(0.0, 1.0),
        gait=gait,
        geometry=_geometry(fields["geometry"], len(feet)),
        observation=_observation(fields["observation"], joints, gait.prior),
        state=_layout(fields["state"], _STATE, {**_SIZES, "foot_contact": len(feet), "foot_height": len(feet)}),
        hidden=tuple(item.whole(1, MOST_HIDDEN, _REASON) for item in fields["hidden"].items(1, MOST_LAYERS)),
        period_s=fields["period_s"].number(1e-3, 1.0, unit="s"),
        command_range=np.array(fields["command_range"].numbers(3, 2, lower=-100.0, upper=100.0), dtype=float),
        symmetric=_symmetric(fields["symmetric"], feet),
        leg_odometry="leg_odometry" in fields and fields["leg_odometry"].flag(),
    )


def _symmetric(entry: Entry, feet: tuple[str, ...]) -> bool:
    if entry.flag() and set(feet) != {"LF", "RF", "LH", "RH"}:
        raise entry.error(f"is true, but the feet are {', '.join(feet)}, expected LF, RF, LH and RH")
    return entry.value


def _gait(entry: Entry) -> GaitConfig:
    fields = entry.mapping(("prior", *_GAIT))
    numbers = {name: fields[name].number(*bounds) for name, bounds in _GAIT.items()}
    return GaitConfig(prior=fields["prior"].text(PRIORS), **numbers)


def _geometry(entry: Entry, legs: int) -> LegGeometry:
    fields = entry.mapping(tuple(LegGeometry.__dataclass_fields__))
    lengths = {name: fields[name].number(1e-6, 1e3, unit="m") for name in ("thigh", "shank", "foot_radius")}
    if fields["knee_sign"].number() not in (-1.0, 1.0):
        raise fields["knee_sign"].wrong("-1 or 1")
    return LegGeometry(
        hip=np.array(fields["hip"].numbers(legs, 3, lower=-1e3, upper=1e3), dtype=float),
        side_offset=np.array(fields["side_offset"].numbers(legs, lower=-1e3, upper=1e3), dtype=float),
        knee_sign=float(fields["knee_sign"].value),
        **lengths,
    )


def _observation(entry: Entry, joints: tuple[str, ...], prior: str) -> Layout:
    expected = _OBSERVATION if prior == "none" else (*_OBSERVATION, "clock")
    layout = _layout(entry, expected, {**_SIZES, **dict.fromkeys(_OF_JOINTS, len(joints))})
    for term in layout.terms:
        if term.name in _OF_JOINTS and term.names != joints:
            raise entry.error(f"{term.name} does not list the joints in their order")
    return layout


def _layout(entry: Entry, expected: tuple[str, ...], sizes: dict[str, int]) -> Layout:
    terms = tuple(_term(item, sizes) for item in entry.mapping(("terms",))["terms"].items(1, 100))
    if tuple(term.name for term in terms) != expected:
        raise entry.error(f"terms are {', '.join(term.name for term in terms)[:200]}, expected {', '.join(expected)}")
    return Layout(terms)


def _term(entry: Entry, sizes: dict[str, int]) -> Term:
    fields = entry.mapping(("name", "names", "unit", "offset", "scale"))
    name = fields["name"].text(tuple(sizes))
    names = tuple(item.text() for item in fields["names"].items(sizes[name], sizes[name]))
    offset = np.array(fields["offset"].numbers(len(names), lower=-TURN, upper=TURN), dtype=float)
    return Term(name, names, fields["unit"].text(), offset, fields["scale"].number(1e-9, LARGEST))
