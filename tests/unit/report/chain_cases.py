"""A chain as `hqpipe report` reads it: small folders and records with made-up numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from diagnosis_cases import explained, write_case
from PIL import Image

from hqpipe.report.chain_parts import Chain, Part, Walk
from hqpipe.report.gap_figures import gap_steps

STAGES = {
    "bootstrap": "bootstrap",
    "rollouts": "collect",
    "actuator": "fit-actuator",
    "diagnosis": "diagnose",
    "policy": "retrain",
    "onnx": "export",
    "validation": "validate",
    "comparison": "compare",
}
FIGURES = {
    "bootstrap": ["training.png"],
    "rollouts": ["distribution.png"],
    "actuator": ["comparison.png", "stress.png", "fit.png", "fit_joints.png", "constants.png"],
    "policy": ["training.png"],
    "comparison": ["learning_curves.png", "plant.png"],
}
_WALK = {"distance": 9.4, "speed": 0.99, "speed_error": 0.01, "drift": 0.3, "seconds": 10.0, "fell": False}
_FELL = {**_WALK, "seconds": 3.2, "fell": True}
_RUN = {"command": [1.0, 0.0, 0.0], "velocity": [0.98, -0.001, 0.02], "falls": 1, "robots": 2}
_TRAINED = {"policy": {"commands": [_RUN]}, "zero_action_baseline": {"commands": [_RUN]}}
METRICS: dict[str, dict[str, Any]] = {
    "bootstrap": {"headline": "0.96 m/s at 1", "position": _TRAINED},
    "rollouts": {
        "headline": "68 s in 8 trials",
        "walks": {"walk_04": _WALK, "walk_10": _FELL},
        "stress": {"fall": {"fell": True}},
    },
    "actuator": {
        "headline": "held-out free run 39.1 N·m",
        "held_out_rmse": {
            "mine": {"one_step": 4.4, "free_run": 39.1},
            "wild <net>": {"one_step": 5.0, "free_run": None},
            "persistence": {"one_step": 5.3, "free_run": 149.0},
        },
        "stress_rmse": {"mine": {"one_step": 4.4, "free_run": 41.2}},
        "noise_floor": 1.02,
    },
    "diagnosis": {"headline": "explained"},
    "policy": {"headline": "1.00 m/s at 1", **_TRAINED},
    "onnx": {"headline": "obs 44 → actions 12", "bytes": 407661},
    "validation": {
        "headline": "1 of 2 checks passed",
        "checks": [
            {"check": "latency, µs", "value": 104.4, "limit": 1000.0},
            {"check": "speed error of the walks, m/s", "value": None, "limit": 0.15},
        ],
        "latency": {"median_us": 104.4, "p99_us": 256.9},
        "scenarios": [
            {"title": "1.0 m/s forward", "walks": 2, "falls": 1, "worst": {"speed_error": 0.0123, "drift": 0.42}},
            {"title": "standing <still>", "walks": 2, "falls": 0, "worst": {"speed_error": None, "drift": 0.0}},
        ],
    },
    "comparison": {"headline": "3 controllers"},
}


def record(artifact: str) -> dict[str, Any]:
    """A manifest."""
    return {
        "key": f"{artifact}{'0' * 64}"[:64],
        "recipe": {"stage": STAGES[artifact], "version": 1, "params": {}, "seed": 7, "inputs": {}},
        "sources": {},
        "outputs": {},
        "metrics": METRICS[artifact],
        "provenance": {
            "hqpipe": "0.1.0",
            "created": "2026-01-02T03:04:05+00:00",
            "python": "3.11.7",
            "packages": {"numpy": "2.4.6", "scipy": None},
            "git": {"commit": "abcdef0123456789", "dirty": True},
            "machine": {"cpu": "EPYC", "cores": 2, "system": "Linux"},
            "profile": "ci",
            "wall_time_s": 30.0,
        },
    }


def part(folder: Path, artifact: str) -> Part:
    """One result with its figures."""
    folder.mkdir(parents=True)
    for name in FIGURES.get(artifact, []):
        Image.new("RGB", (8, 4), "white").save(folder / name)
    if artifact == "diagnosis":
        write_case(folder, explained(), traces=False)
        (folder / "diagnosis.html").write_text("<p>diagnosis</p>", encoding="utf-8")
    return Part(artifact, folder, f"artifacts/{artifact}", f"hqpipe {STAGES[artifact]}", record(artifact))


def chain(folder: Path, artifacts: tuple[str, ...] = tuple(STAGES), **walk: Any) -> Chain:
    """A chain of which `artifacts` were read; `walk` changes fields of the walk."""
    parts = {name: part(folder / name, name) for name in artifacts}
    Image.new("RGB", (8, 4)).save(folder / "walk.gif")
    Image.new("RGB", (8, 4)).save(folder / "walk.png")
    fields = {
        "robot": "Hyd <3>",
        "film": folder / "walk.gif",
        "figure": folder / "walk.png",
        "order": (1.0, 0.0, None),
        "speed": 0.987,
        "seconds": 12.0,
        "fall_time": None,
        "shown": (4.0, 12.0),
        "play": 1.0,
        "seed": 1900,
        "plant": {},
    }
    return Chain(
        walk=Walk(**(fields | walk)),
        parts=parts,
        commands={name: f"hqpipe {stage} --profile ci" for name, stage in STAGES.items()},
        options={name: f"--{name}" for name in STAGES},
        gap=gap_steps(explained(), folder / "gap.png") if "diagnosis" in parts else None,
    )
