"""Physics read off fits to short logs of the reference plant, against what its files say; the fits know nothing of these."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from hqpipe.identify.constants.chamber_constants import chamber_constants
from hqpipe.identify.constants.design import chamber_expected, oil_quantities, paper_expected
from hqpipe.identify.constants.paper_constants import paper_quantities
from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.identify.rivals.fit_chambers import fit_chambers
from hqpipe.logs.assemble import assemble
from hqpipe.logs.columns import RawTable
from hqpipe.logs.trajectory import LogSet, Trial
from hqpipe.plant import Plant, PlantConfig
from hqpipe.plant.excitation import excitation
from hqpipe.robots import load_robot
from hqpipe.stages.fits.constants import joint_designs

SECONDS, RADIUS = 6.0, 0.06
JOINTS = ("LFR", "LFP")
QUICK_VALVE = {"valve": {"bandwidth_hz": 1000.0, "slew_rate": 1.0e5, "delay": 0.0}}  # eq. (7) has no lag


def logs_of(changes: dict) -> LogSet:
    robot = load_robot("hydraulic_quadruped")
    plant = Plant(robot, PlantConfig(changes), seed=0, base="fixed")
    columns = plant.run(excitation(robot, "multisine", SECONDS, seed=0), SECONDS).columns
    trial = Trial("a.parquet", "fit", None, assemble(RawTable(Path("a.parquet"), columns)).for_joints(JOINTS))
    return LogSet(Path("plant"), "", "hqpipe-log/1", robot.name, "fixed", "position", "pressure", 1e3, JOINTS, (trial,))


@pytest.fixture(scope="module")
def plain() -> LogSet:
    return logs_of({})


def ratios(logs: LogSet, model: str) -> list[dict[str, float]]:
    """Estimate over design, for each joint."""
    designs, found = joint_designs(load_robot("hydraulic_quadruped").folder, logs), []
    fits = fit_chambers(logs).fits if model == "chambers" else fit_actuator(logs, sprocket_radius=RADIUS).fits
    for fit in fits:
        design = designs[fit.joint]
        if model == "chambers":
            quantities, expected = chamber_constants(fit), chamber_expected(design)
        else:
            quantities, expected = paper_quantities(fit, RADIUS, 1e-3), paper_expected(design)
        everything = (*quantities, *oil_quantities(quantities, design))
        found.append({q.name: q.value / expected[q.name] for q in everything if q.name in expected})
    return found


def test_two_chambers_read_the_machine(plain):
    within = {
        "hydraulic stiffness": 0.05,
        "bulk modulus": 0.07,
        "flow gain": 0.03,
        "leakage": 0.02,
        "leak coefficient": 0.02,
        "loop stiffness": 0.03,
        "valve time constant": 0.12,
        "full torque": 0.1,
    }
    for joint in ratios(plain, "chambers"):
        for name, tolerance in within.items():
            assert joint[name] == pytest.approx(1.0, abs=tolerance), name


def test_the_papers_model_reads_a_machine_without_lag():
    within = {
        "hydraulic stiffness": 0.06,
        "bulk modulus": 0.08,
        "flow gain": 0.04,
        "leakage": 0.12,
        "loop stiffness": 0.14,
    }
    for joint in ratios(logs_of(QUICK_VALVE), "paper"):
        for name, tolerance in within.items():
            assert joint[name] == pytest.approx(1.0, abs=tolerance), name


def test_the_lag_of_a_valve_passes_for_soft_oil_in_the_papers_model(plain):
    for joint in ratios(plain, "paper"):
        assert 0.6 < joint["hydraulic stiffness"] < 0.85
        assert joint["flow gain"] == pytest.approx(1.0, abs=0.04)


def test_a_robot_that_says_nothing_of_its_hydraulics_is_expected_nothing(plain, tmp_path):
    folder = shutil.copytree(load_robot("hydraulic_quadruped").folder, tmp_path / "robot")
    text = (folder / "robot.yaml").read_text(encoding="utf-8")
    (folder / "robot.yaml").write_text(text[: text.index("hydraulics:")] + "hydraulics: {}\n", encoding="utf-8")
    for design in joint_designs(folder, plain).values():
        assert design.radius == RADIUS
        assert np.isnan([*paper_expected(design).values(), *chamber_expected(design).values()]).all()
