"""Runs a policy on a machine: sensor frame and command in, joint targets out, every 10 ms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from hqpipe.errors import ConfigError, UsageError
from hqpipe.files.documents import read_yaml_mapping
from hqpipe.files.entries import Entry
from hqpipe.rl import gait
from hqpipe.rl.observation import build_observation

INPUT, ACTIONS, ESTIMATE = "obs", "actions", "estimate"  # of the graph; its outputs in this order
_TERMS = ("base_angular_velocity", "joint_position", "joint_velocity", "previous_target", "velocity_command")
_BY_JOINT = ("joint_position", "joint_velocity", "previous_target")
DEPLOY_FORMAT = "hqpipe-deploy/1"
FASTEST_HZ = 1000.0  # of a policy: the joint controllers' own rate
SLOWEST_HZ = 1.0  # of a policy: below, the robot has fallen between two calls
_HIGHEST_CLOCK_HZ = 50.0  # of a gait: ten times that of any legged machine
_DEPLOY_FIX = "give the folder that hqpipe export wrote, or run it again"
Infer = Callable[[np.ndarray], Sequence[np.ndarray]]


class Frame(Protocol):
    """What the controller reads of the sensors; joints in the order of the policy.

    Attributes:
        q, qd: (J,) rad, rad/s. gyro: (3,) rad/s in the base frame. orientation: (4,) quaternion xyzw, for heading hold.
    """

    q: np.ndarray
    qd: np.ndarray
    gyro: np.ndarray
    orientation: np.ndarray


@dataclass(frozen=True)
class HeadingHold:
    """Replaces the commanded turning rate by a P law on the heading, as an operator steers a robot straight.

    Attributes:
        gain: rad/s per rad of error. limit: rad/s. heading: rad, world; None takes that of the first frame.
    """

    gain: float = 1.0
    limit: float = 0.4
    heading: float | None = None


@dataclass(frozen=True)
class Wiring:
    """How a policy is connected.

    Attributes:
        joints: names, in the order of the policy. period_s: between two calls.
        clock_hz: frequency of the clock in the observation, None if it has none.
        control_mode: what the targets are for, position or torque.
        estimate: elements of x̃_t as term/element, e.g. foot_contact/LF; empty if the policy does not tell it.
    """

    joints: tuple[str, ...]
    period_s: float
    clock_hz: float | None
    control_mode: str
    estimate: tuple[str, ...] = ()


@dataclass
class EstimateLog:
    """x̃_t of every call of a controller.

    Attributes:
        names: as `Wiring.estimate`. period_s: between two calls. rows: (m,) each, in physical units; the first belongs to the
            first row of the trial. Empty if the policy does not tell it.
    """

    names: tuple[str, ...] = ()
    period_s: float = 0.0
    rows: list[np.ndarray] = field(default_factory=list)


class PolicyController:
    """`controller(frame, command)` → (J,) joint position targets, rad, once every `period_s`.

    Args:
        infer: (1, n) float32 observation → (1, J) targets and, if `wiring` names its elements, (1, m) x̃_t; see
            `torch_controller` and `onnx_controller`.
        joints: names in the order of the frames; must be those of the policy.

    Attributes:
        record: where x̃_t is written down, or None.

    Raises:
        UsageError: other joints than the policy's.
    """

    def __init__(
        self,
        wiring: Wiring,
        infer: Infer,
        *,
        joints: tuple[str, ...] | None = None,
        heading_hold: HeadingHold | None = None,
    ) -> None:
        if joints is not None and sorted(joints) != sorted(wiring.joints):
            raise UsageError(
                f"policy for joints {', '.join(wiring.joints)} cannot drive {', '.join(joints)}: expected the same names",
                field="joints",
                fix="take a policy that was trained for this robot",
            )
        order = wiring.joints if joints is None else joints
        self.wiring, self.infer, self.heading_hold = wiring, infer, heading_hold
        self._to_policy = np.array([order.index(name) for name in wiring.joints])
        self._to_frame = np.argsort(self._to_policy)
        self.record: EstimateLog | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the last trial: clock, previous target and heading."""
        self.phase = 0.0
        self.previous: np.ndarray | None = None
        self.heading = self.heading_hold.heading if self.heading_hold else None

    @property
    def period_s(self) -> float:
        return self.wiring.period_s

    def __call__(self, frame: Frame, command: Mapping[str, float]) -> np.ndarray:
        """`command` holds vx, vy (m/s) and wz (rad/s)."""
        position = np.asarray(frame.q)[self._to_policy]
        if self.previous is None:
            self.previous = position
        clock_hz = self.wiring.clock_hz
        observation = build_observation(
            np.asarray(frame.gyro),
            position,
            np.asarray(frame.qd)[self._to_policy],
            self.previous,
            self._steered(frame, np.array([command[name] for name in ("vx", "vy", "wz")])),
            None if clock_hz is None else gait.clock(np.asarray(self.phase)),
        )
        answer = self.infer(observation[None])
        targets = np.asarray(answer[0][0], dtype=float)
        self.previous = targets
        if self.record is not None and self.wiring.estimate:
            self.record.names, self.record.period_s = self.wiring.estimate, self.period_s
            self.record.rows.append(np.array(answer[1][0], dtype=float))
        if clock_hz is not None:
            self.phase = float(gait.advance(np.asarray(self.phase), clock_hz, self.period_s))
        return targets[self._to_frame]

    def _steered(self, frame: Frame, command: np.ndarray) -> np.ndarray:
        hold = self.heading_hold
        if hold is None:
            return command
        x, y, z, w = frame.orientation
        heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        if self.heading is None:
            self.heading = float(heading)
        error = np.angle(np.exp(1j * (self.heading - heading)))
        return np.array([command[0], command[1], np.clip(hold.gain * error, -hold.limit, hold.limit)])


def torch_controller(
    folder: Path, *, joints: tuple[str, ...] | None = None, heading_hold: HeadingHold | None = None
) -> PolicyController:
    """A controller from the folder of `save_policy`."""
    import torch

    from hqpipe.rl.networks import DeployedPolicy
    from hqpipe.rl.policy_io import WEIGHTS, load_policy

    spec, networks = load_policy(folder)
    weights = folder / WEIGHTS
    deployed = DeployedPolicy(spec, networks).eval()

    def infer(observation: np.ndarray) -> list[np.ndarray]:
        with torch.no_grad():
            return _finite([output.numpy() for output in deployed(torch.as_tensor(observation))], weights)

    wiring = Wiring(
        joints=spec.joints,
        period_s=spec.period_s,
        clock_hz=spec.gait.frequency_hz if spec.has_clock else None,
        control_mode=spec.control_mode,
        estimate=tuple(f"{term.name}/{name}" for term in spec.state.terms for name in term.names),
    )
    return PolicyController(wiring, infer, joints=joints, heading_hold=heading_hold)


def onnx_controller(
    folder: Path, *, joints: tuple[str, ...] | None = None, heading_hold: HeadingHold | None = None
) -> PolicyController:
    """A controller from policy.onnx and deploy.yaml in `folder`; needs no torch.

    Raises:
        ConfigError: deploy.yaml is missing or describes another observation than this code builds.
    """
    from hqpipe.rl.onnx_session import open_session, run

    path = folder / "policy.onnx"
    session, wiring = open_session(path), read_wiring(folder)
    outputs = [ACTIONS, ESTIMATE] if wiring.estimate else [ACTIONS]
    sizes = (len(wiring.joints), len(wiring.estimate))
    known = [end.name for end in session.get_outputs()]
    if wiring.estimate and ESTIMATE not in known:
        raise _mismatch(path, ESTIMATE, f"outputs are {', '.join(known)[:200]}, but deploy.yaml tells of {ESTIMATE}")

    def infer(observation: np.ndarray) -> list[np.ndarray]:
        return session.run(outputs, {INPUT: observation})

    width = sum((len(wiring.joints) * 3, 6, 2 if wiring.clock_hz is not None else 0))
    first = run(session, outputs, np.zeros((1, width), dtype=np.float32), path)
    for name, output, size in zip(outputs, first, sizes[: len(outputs)], strict=True):
        if output.shape != (1, size):
            raise _mismatch(path, name, f"{name} has shape {output.shape}, expected {(1, size)} as deploy.yaml says")
    return PolicyController(
        wiring, lambda observation: _finite(infer(observation), path), joints=joints, heading_hold=heading_hold
    )


def _mismatch(path: Path, field: str, problem: str) -> ConfigError:
    return ConfigError(f"{path}: {problem}", file=path, field=field, fix=_DEPLOY_FIX)


def _finite(outputs: list[np.ndarray], path: Path) -> list[np.ndarray]:
    """The outputs of a policy; a machine must never get a target that is no number."""
    if not np.isfinite(outputs[0]).all():
        raise ConfigError(
            f"{path}: {ACTIONS} are not finite",
            file=path,
            field=ACTIONS,
            fix="train the policy again, or give another one",
        )
    return outputs


def read_wiring(folder: Path) -> Wiring:
    """Read deploy.yaml.

    Raises:
        ConfigError: the file is missing or describes another observation than `build_observation` makes.
    """
    path = folder / "deploy.yaml"
    top = Entry(read_yaml_mapping(path, _DEPLOY_FIX), path, _DEPLOY_FIX).table()

    def field(entry: Mapping[str, Entry], name: str, place: str = "") -> Entry:
        if name not in entry:
            where = f"{place}.{name}" if place else name
            raise ConfigError(f"{path}: missing field '{where}'", file=path, field=where, fix=_DEPLOY_FIX)
        return entry[name]

    field(top, "format").text((DEPLOY_FORMAT,))
    joints = field(field(top, "actions").table(), "joints", "actions").names()
    clock = field(top, "clock").or_none(
        lambda entry: field(entry.table(), "frequency_hz", "clock").number(1e-3, _HIGHEST_CLOCK_HZ, unit="Hz")
    )
    observation = _terms(field(top, "observation"), joints)
    expected = [*_TERMS, "clock"] if clock is not None else list(_TERMS)
    if observation != expected:
        found = ", ".join(observation)[:300]
        raise top["observation"].error(f"observation is {found}, expected {', '.join(expected)}")
    rate = field(field(top, "rates").table(), "policy_hz", "rates").number(SLOWEST_HZ, FASTEST_HZ, unit="Hz")
    return Wiring(
        joints=joints,
        period_s=1.0 / rate,
        clock_hz=clock,
        control_mode=field(top, "control_mode").text(("position", "torque")),
        # A graph from elsewhere may keep its x̃_t to itself, or have none.
        estimate=_elements(top["estimate"]) if "estimate" in top else (),
    )


def _terms(entry: Entry, joints: tuple[str, ...]) -> list[str]:
    """Names of the terms of an observation; terms of joints must list them in the order of the actions."""
    found = []
    for term in entry.items(1, 100):
        fields = term.table()
        for name in ("name", "elements"):
            if name not in fields:
                raise term.error(f"missing field '{name}'")
        found.append(fields["name"].text())
        elements = [item.text() for item in fields["elements"].items(1, 1000)]
        if found[-1] in _BY_JOINT and tuple(elements) != joints:
            raise fields["elements"].error("are not the joints of actions.joints in their order")
    return found


def _elements(entry: Entry) -> tuple[str, ...]:
    """Elements of x̃_t as term/element."""
    found = []
    for term in entry.items(0, 100):
        fields = term.table()
        for name in ("name", "elements"):
            if name not in fields:
                raise term.error(f"missing field '{name}'")
        found += [f"{fields['name'].text()}/{item.text()}" for item in fields["elements"].items(1, 1000)]
    return tuple(found)
