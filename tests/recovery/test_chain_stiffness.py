"""A soft chain of the reference plant is named, with its stiffness, by the friction of the seals in front of it."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from hqpipe.gap.diagnosis import diagnose

sys.path.insert(0, str(Path(__file__).parents[1] / "unit" / "gap"))
from plant_logs import plant_logs

RADIUS = 0.06  # m, sprocket, robot.yaml
STRAND, TOOTH = 6.67e6, 6.67e7  # N/m
STIFFNESS = RADIUS**2 / (0.5 / STRAND + 1.0 / TOOTH)  # N·m/rad, of two strands and the teeth
SOFT = {
    "chain": {"stiffness": STRAND, "tooth_stiffness": TOOTH},
    "cylinder": {"coulomb_friction": 120.0},  # N, of each seal
}
JOINTS = ("LFP", "RFP", "RHR")


def test_the_stiffness_of_a_soft_chain_is_told():
    logs = plant_logs(seeds=(0, 1, 2), source="load_cell", changes=json.dumps(SOFT))
    trials = tuple(replace(trial, trajectory=trial.trajectory.for_joints(JOINTS)) for trial in logs.trials)
    content = diagnose(replace(logs, joints=JOINTS, trials=trials), workers=2).content
    causes = {cause["effect"]: cause for cause in content["causes"]}
    assert "coulomb_friction" in causes
    soft = causes["transmission_compliance"]
    told = soft["parameters"]["stiffness_nm_per_rad"]
    assert soft["joints"] == list(JOINTS) and told["value"] == pytest.approx(STIFFNESS, rel=0.15)
    assert told["ci95"][0] < STIFFNESS < told["ci95"][1]
