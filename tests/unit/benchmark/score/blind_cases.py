"""Made-up answers and diagnoses of the blind check."""

from __future__ import annotations

from typing import Any

from hqpipe.benchmark.score.case import Judged
from hqpipe.benchmark.score.truth import Answer, TrueEffect

LEG = ("LFR", "LFP", "LFK")
ALL = tuple(f"{leg}{kind}" for leg in ("LF", "RF", "LH", "RH") for kind in "RPK")


def effect(name: str, joints: tuple[str, ...] = ALL, **changes: Any) -> TrueEffect:
    scope = "machine" if joints == ALL else "joint" if len(joints) == 1 else "group"
    fields = {"outside": False, "size": "typical", "span": None, "parameters": {}} | changes
    return TrueEffect(effect=name, layer="actuator", joints=joints, scope=scope, **fields)


def cause(name: str, joints: tuple[str, ...] = ALL, **changes: Any) -> dict[str, Any]:
    return {
        "effect": name,
        "layer": "actuator",
        "joints": list(joints),
        "scope": "machine",
        "probability": 0.95,
        "parameters": {},
        "shrink": 0.5,
        "shrink_ci95": [0.4, 0.6],
        "confused_with": [],
    } | changes


def diagnosis(*causes: dict[str, Any], **changes: Any) -> dict[str, Any]:
    return {
        "verdict": "explained" if causes else "no_gap",
        "gap": {"shrink": 0.5, "shrink_ci95": [0.45, 0.55]},
        "where": [],
        "causes": list(causes),
        "unexplained": {"above_noise": False, "where": []},
    } | changes


def place(joint: str, share: float = 0.5, regime: str = "reversal") -> dict[str, Any]:
    return {"layer": "actuator", "joint": joint, "regime": regime, "share": share}


def judged(kind: str, effects: list[TrueEffect], content: dict[str, Any] | None, **more: Any) -> Judged:
    answer = Answer(more.pop("case", "case_000"), kind, tuple(effects), {"all": None, "without": {}})
    return Judged(answer, content, **more)
