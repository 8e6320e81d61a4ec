"""Folders as `hqpipe diagnose` writes them, with made-up but plausible numbers."""

from __future__ import annotations

import copy
import csv
import json
import math
import random
from pathlib import Path
from typing import Any

QUADRUPED = [leg + part for leg in ("LF", "RF", "LH", "RH") for part in ("R", "P", "K")]
FAMILIES = {
    "all": ["all"],
    "direction": ["extending", "retracting", "standstill"],
    "reversal": ["reversal", "between_reversals"],
    "demand": ["high_flow_demand", "low_flow_demand"],
    "saturation": ["saturation", "no_saturation"],
    "impact": ["impact", "no_impact"],
    "stance": ["stance", "swing"],
    "span": ["quarter_1", "quarter_2", "quarter_3", "quarter_4"],
    "frequency": ["0-5_hz", "5-20_hz", "20-100_hz", "100-500_hz"],
}
PART_OF_TIME = [[1.0], [0.4, 0.4, 0.2], [0.2, 0.8], [0.2, 0.8], [0.05, 0.95], [0.1, 0.9], [0.6, 0.4]]
PART_OF_TIME += [[0.25] * 4, [0.35, 0.4, 0.2, 0.05]]
COLUMNS = "trial joint family regime n rmse share share_low share_high rmse_after share_after".split()
SPREAD = 200.0  # N·m, of every joint


def gap(before: float, after: float, floor: float, persistence: float, unit: str = "N·m") -> dict[str, Any]:
    shrink = 1.0 - after / before
    return {
        "layer": "actuator",
        "metric": "free_run_rmse",
        "unit": unit,
        "window_s": 0.1,
        "before": before,
        "after": after,
        "noise_floor": floor,
        "persistence": persistence,
        "normalised": {
            "before": before / SPREAD,
            "after": after / SPREAD,
            "noise_floor": floor / SPREAD,
            "persistence": persistence / SPREAD,
        },
        "shrink": shrink,
        "shrink_ci95": [shrink - 0.02, shrink + 0.01] if shrink else [0.0, 0.0],
    }


def cause(effect: str, joints: list[str], shrink: float, *parameters: tuple[str, float, float, str], **more: Any):
    """`parameters`: name, value, half width of the interval, unit."""
    return {
        "effect": effect,
        "layer": "actuator",
        "joints": joints,
        "scope": "joint" if len(joints) == 1 else "group",
        "probability": 0.98,
        "parameters": {
            name: {"value": value, "unit": unit, "ci95": [value - half, value + half]}
            for name, value, half, unit in parameters
        },
        "shrink": shrink,
        "shrink_ci95": [shrink - 0.03, shrink + 0.03],
        "confused_with": [],
    } | more


def content(verdict: str, gap: dict[str, Any] | None, joints: list[str], **more: Any) -> dict[str, Any]:
    above = verdict in ("unknown", "partly_explained")
    return {
        "format": "hqpipe-diagnosis/2",
        "verdict": verdict,
        "logs": {
            "path": "/data/trot_2024_05_17",
            "sha256": "9f2c" * 16,
            "trials": 5,
            "joints": joints,
            "control_mode": "position",
        },
        "gap": gap,
        "where": [],
        "causes": [],
        "effects_considered": [],
        "unexplained": {"share_of_gap": None, "above_noise": above, "where": [], "depends_on": []},
        "next_experiment": None,
        "warnings": [],
    } | more


def explained() -> dict[str, Any]:
    """Three causes on twelve joints."""
    knees = [name for name in QUADRUPED if name.endswith("K")]
    considered = [
        {"effect": effect, "layer": "actuator", "joints": [joint], "scope": "joint"}
        | {"score": 6.0 - 0.7 * i, "shrink": 0.05 - 0.006 * i, "reason": reason}
        for i, (effect, joint, reason) in enumerate(
            [
                ("channel_skew", "LFK", "cannot be told from command_delay, which fits better"),
                ("valve_lag", "LFK", "its time constant does not exclude zero beside the delay"),
                ("coulomb_friction", "RHP", "leaves the held-out error within its uncertainty"),
                ("supply_droop", "LFR", "the fall is no larger than chance gives among 264 tries"),
                ("backlash", "RFK", "the fall is no larger than chance gives among 264 tries"),
                ("gain_drift", "LHP", "its rate does not exclude zero"),
            ]
        )
    ]
    return content(
        "explained",
        gap(67.4, 6.3, 2.1, 91.0),
        QUADRUPED,
        where=[
            {"layer": "actuator", "joint": "LFK", "regime": "all", "share": 0.31},
            {"layer": "actuator", "joint": "LFK", "regime": "reversal", "share": 0.17},
            {"layer": "actuator", "joint": "RHK", "regime": "extending", "share": 0.11},
        ],
        causes=[
            cause(
                "command_delay",
                list(QUADRUPED),
                0.468,
                ("delay_s", 0.0048, 0.0002, "s"),
                scope="machine",
                confused_with=["channel_skew"],
            ),
            cause("valve_deadband", ["LFK"], 0.2715, ("half_width", 0.0062, 0.00025, "rad")),
            cause(
                "direction_asymmetry",
                knees,
                0.167,
                ("ratio", 0.087, 0.006, "1"),
                probability=0.91,
                confused_with=["torque_bias", ["coulomb_friction", "position_bias"]],
            ),
        ],
        effects_considered=considered,
        unexplained={"share_of_gap": 0.008, "above_noise": False, "where": [], "depends_on": []},
        next_experiment="To tell command delay from channel skew, record a trial in which the torque is excited from "
        "outside: `hqpipe collect --excitation pushes --seconds 20`",
        warnings=["joint/LFR/effort: 212 samples at its limit"],
    )


def unknown() -> dict[str, Any]:
    places = [
        {"layer": "actuator", "joint": "RFP", "regime": "all", "share": 0.62},
        {"layer": "actuator", "joint": "RFP", "regime": "20-100_hz", "share": 0.41},
    ]
    depends = [
        {"signal": "past_torque", "joints": ["RFP"], "share": 0.44},
        {"signal": "velocity_of_neighbours", "joints": ["RFP", "RFK"], "share": 0.21},
        {"signal": "time", "joints": ["RFP"], "share": 0.05},
    ]
    return content(
        "unknown",
        gap(31.2, 31.2, 2.4, 88.0),
        QUADRUPED,
        where=places,
        effects_considered=explained()["effects_considered"]
        + [
            {"effect": f"effect_{i}", "layer": "actuator", "joints": [QUADRUPED[i]], "score": 1.0 - 0.1 * i}
            for i in range(12)
        ],
        unexplained={"share_of_gap": 1.0, "above_noise": True, "where": places, "depends_on": depends},
        next_experiment="Hold the other joints still and sweep RFP alone: `hqpipe collect --excitation chirp`",
        warnings=["a flexible model predicts 71% of the base model's squared held-out error from the logged signals"],
    )


def no_gap() -> dict[str, Any]:
    rest = {"share_of_gap": 0.0, "above_noise": False, "where": [], "depends_on": []}
    return content("no_gap", gap(2.3, 2.3, 2.2, 74.0), QUADRUPED, unexplained=rest)


def not_identifiable() -> dict[str, Any]:
    return content(
        "not_identifiable",
        None,
        QUADRUPED,
        next_experiment="record the missing channels",
        warnings=["the actuator layer needs joint/<name>/position_command: only the sensing layer was evaluated"],
    )


def mixed_units() -> dict[str, Any]:
    """A swing that turns beside a cylinder that slides: no size of both in a unit."""
    case = renamed(explained(), ["swing", "boom"])
    sizes = ("before", "after", "noise_floor", "persistence")
    case["gap"] |= dict.fromkeys(("unit", *sizes))
    case["gap"]["joints"] = [
        {"joint": joint, "type": kind, "unit": unit, "scale": scale, "normalised": case["gap"]["normalised"]}
        | {name: scale * case["gap"]["normalised"][name] for name in sizes}
        for joint, kind, unit, scale in (("swing", "revolute", "N·m", 900.0), ("boom", "prismatic", "N", 40.0))
    ]
    return case


CASES = {"explained": explained, "unknown": unknown, "no_gap": no_gap, "not_identifiable": not_identifiable}


def residual_rows(content: dict[str, Any], seed: int = 0, *, after: bool = True) -> list[dict[str, Any]]:
    """Rows of residuals.csv of the pooled trial and of one trial, in which some places stand out."""
    rng = random.Random(seed)
    joints, found = content["logs"]["joints"], content["gap"]
    weight = {joint: rng.uniform(0.2, 1.0) for joint in joints}
    for place in content["where"]:
        weight[place["joint"]] += 8.0 * place["share"]
    total, left = sum(weight.values()), sum(range(1, len(joints) + 1))
    special = {(p["joint"], p["regime"]) for p in content["where"]}
    rows = []
    for index, joint in enumerate(joints):
        share = weight[joint] / total
        for (family, regimes), times in zip(FAMILIES.items(), PART_OF_TIME, strict=True):
            raw = [
                t * rng.uniform(0.7, 1.4) * (5.0 if (joint, r) in special else 1.0)
                for r, t in zip(regimes, times, strict=True)
            ]
            for regime, time, part in zip(regimes, times, raw, strict=True):
                here, rest = share * part / sum(raw), (index + 1) / left * part / sum(raw)
                row = {"joint": joint, "family": family, "regime": regime, "n": round(20000 * time)}
                row |= {
                    "rmse": SPREAD * found["normalised"]["before"] * math.sqrt(here / time * len(joints)),
                    "share": here,
                }
                row |= {"share_low": 0.8 * here, "share_high": 1.2 * here}
                if after:
                    row |= {"rmse_after": SPREAD * found["normalised"]["after"], "share_after": rest}
                rows += [{"trial": trial} | row for trial in ("all", "walk.parquet")]
    return rows


def trace(before: float, after: float, seed: int, samples: int = 500) -> dict[str, Any]:
    """Half a second at 1 kHz in which the model runs free for 100 ms at a time."""
    rng = random.Random(seed)
    time = [3.2 + 1e-3 * k for k in range(samples)]
    pace = rng.uniform(8.0, 20.0)
    phase = rng.uniform(0, 6.28)
    measured = [120 * math.sin(pace * t + phase) + 25 * math.sin(3.1 * pace * t) + rng.gauss(0, 2) for t in time]
    drift = [math.sin(math.pi * (k % 100) / 200) * math.cos(pace * t) for k, t in enumerate(time)]
    position = [0.3 * math.sin(pace * t + phase - 0.5) - 0.8 for t in time]
    return {
        "trial": "walk.parquet",
        "time": time,
        "command": [0.3 * math.sin(pace * (t // 0.01 * 0.01) + phase) - 0.8 for t in time],
        "position": position,
        "measured": measured,
        "before": [m + 1.9 * before * d for m, d in zip(measured, drift, strict=True)],
        "after": [m + 1.9 * after * d for m, d in zip(measured, drift, strict=True)],
        "restarts": [time[k] for k in range(0, samples, 100)],
    }


def write_case(folder: Path, content: dict[str, Any], *, traces: bool = True, after: bool = True) -> Path:
    """A diagnosis folder; without `after`, residuals.csv lacks the columns of the model with the found effects."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "diagnosis.json").write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")
    if content["gap"] is None:
        return folder
    with (folder / "residuals.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS if after else COLUMNS[:-2])
        writer.writeheader()
        writer.writerows(residual_rows(content, after=after))
    if content["causes"]:
        (folder / "actuator.json").write_text("{}", encoding="utf-8")
    if traces:
        sizes = [SPREAD * content["gap"]["normalised"][name] for name in ("before", "after")]
        joints = {name: trace(*sizes, seed=i) for i, name in enumerate(content["logs"]["joints"])}
        unit = {} if content["gap"]["unit"] is None else {"unit": content["gap"]["unit"]}
        text = json.dumps({"joints": joints} | unit, ensure_ascii=False)
        (folder / "traces.json").write_text(text, encoding="utf-8")
    return folder


def renamed(case: dict[str, Any], joints: list[str]) -> dict[str, Any]:
    """The same diagnosis of another machine: its joints take the names in turn."""
    names = dict(zip(case["logs"]["joints"], joints, strict=False))
    fresh = copy.deepcopy(case)
    for item in [*fresh["where"], *fresh["unexplained"]["where"]]:
        item["joint"] = names.get(item["joint"], joints[0])
    for item in [*fresh["causes"], *fresh["effects_considered"], *fresh["unexplained"]["depends_on"]]:
        item["joints"] = list(dict.fromkeys(names.get(name, joints[0]) for name in item["joints"]))
    fresh["logs"]["joints"] = joints
    return fresh
