"""Metadata that public ONNX policy runners read from the model, as name → comma-separated text."""

from __future__ import annotations

from collections.abc import Iterable

from hqpipe.rl.controller import ACTIONS, ESTIMATE
from hqpipe.rl.observation import Layout
from hqpipe.rl.policy_spec import PolicySpec


def numbers(values: Iterable[float]) -> str:
    """Comma-separated with nine significant digits, which restores every float32."""
    return ",".join(f"{float(value):.9g}" for value in values)


def runner_metadata(spec: PolicySpec) -> dict[str, str]:
    """Key → text; joint arrays are in the order of joint_names.

    The graph takes physical units and returns joint angles, so a runner has to scale nothing:
    observation_terms_scale is 1 and action_scale is 1. Joint gains are 0 where the position loop is in the machine.
    """
    layout = spec.observation
    count = len(spec.joints)
    clock = numbers([spec.gait.frequency_hz]) if spec.has_clock else "0"
    return {
        "robot": spec.robot,
        "control_mode": spec.control_mode,
        "control_period_s": numbers([spec.period_s]),
        "joint_names": ",".join(spec.joints),
        "joint_stiffness": numbers(spec.kp),
        "joint_damping": numbers(spec.kd),
        "default_joint_pos": numbers(spec.nominal),
        "joint_pos_lower": numbers(spec.lower),
        "joint_pos_upper": numbers(spec.upper),
        "action_scale": numbers([1.0] * count),
        "action_type": "joint_position_rad",
        "command_names": "velocity_command",
        "observation_names": ",".join(term.name for term in layout.terms),
        "observation_terms_size": ",".join(str(term.size) for term in layout.terms),
        "observation_terms_scale": numbers([1.0] * len(layout.terms)),
        "clock_frequency_hz": clock,
    }


def deploy_description(spec: PolicySpec) -> dict:
    """Content of deploy.yaml: what a controller must do around the graph."""
    return {
        "format": "hqpipe-deploy/1",
        "robot": spec.robot,
        "model": {"file": "policy.onnx", "input": "obs", "output": ACTIONS, "estimate_output": ESTIMATE},
        "rates": {"policy_hz": round(1.0 / spec.period_s), "joint_controller_hz": 1000},
        "control_mode": spec.control_mode,
        "observation": _terms(spec.observation),
        "actions": {
            "meaning": "joint position targets",
            "unit": "rad",
            "joints": list(spec.joints),
            "already_clipped": True,
        },
        "estimate": _terms(spec.state),
        "clock": _clock(spec),
        "command_range": {
            name: [float(v) for v in row] for name, row in zip(("vx", "vy", "wz"), spec.command_range, strict=True)
        },
        "joints": {
            name: {
                "default_position": float(spec.nominal[i]),
                "lower": float(spec.lower[i]),
                "upper": float(spec.upper[i]),
                "kp": float(spec.kp[i]),
                "kd": float(spec.kd[i]),
            }
            for i, name in enumerate(spec.joints)
        },
    }


def _terms(layout: Layout) -> list[dict]:
    rows = []
    start = 0
    for term in layout.terms:
        rows.append(
            {
                "name": term.name,
                "start": start,
                "size": term.size,
                "elements": list(term.names),
                "unit": term.unit,
            }
        )
        start += term.size
    return rows


def _clock(spec: PolicySpec) -> dict | None:
    if not spec.has_clock:
        return None
    return {
        "frequency_hz": spec.gait.frequency_hz,
        "initial_phase_cycles": 0.0,
        "order": "the phase at the call, advanced by frequency_hz × period after it",
    }
