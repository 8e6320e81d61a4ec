"""constants.csv of fit-actuator: the fits read as physics, beside what the robot's files say of the machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

PAPER, CHAMBERS = "paper's model", "two chambers"  # the column `model`
CONSTANTS = "constants.csv"


def write_constants(context: Any, log_set: Any, fit: Any, chamber_fits: Sequence[Any]) -> None:
    """Write constants.csv, draw constants.png, and show a table of all joints together, as far as the fits tell anything.

    One number a row: joint, model, quantity, unit, value, low and high of the 95 % interval, and what is expected by design;
    empty where the logs or the robot's files do not say.

    Args:
        fit: `FitResult`. chamber_fits: `ChamberJointFit` of each joint; empty without that rival.
    """
    from hqpipe.report.constants_figures import SHOWN, constants_chart
    from hqpipe.report.tables import constants_table
    from hqpipe.stages.terminal import show
    from hqpipe.stages.training import write_rows
    from hqpipe.sysid.chamber_constants import chamber_constants
    from hqpipe.sysid.design import chamber_expected, paper_expected
    from hqpipe.sysid.paper_constants import paper_quantities

    reports = {chambers.joint: chambers for chambers in chamber_fits}
    designs, rows = joint_designs(context.robot, log_set), []
    for index, joint in enumerate(log_set.joints):
        radius = float(fit.model.column("sprocket_radius")[index])
        own = fit.fits[index if len(fit.fits) > 1 else 0]
        found = [(PAPER, paper_quantities(own, radius, fit.dt), paper_expected)]
        if joint in reports:
            found.append((CHAMBERS, chamber_constants(reports[joint]), chamber_expected))
        for model, quantities, expected in found:
            rows += _rows(joint, model, quantities, designs[joint], expected)
    if rows:
        write_rows(context.output / CONSTANTS, rows)
        show(constants_table(rows))
    if any(row["quantity"] in SHOWN for row in rows):
        constants_chart(rows, context.output / "constants.png")


def _rows(joint: str, model: str, quantities: Sequence[Any], design: Any, expected: Any) -> list[dict[str, Any]]:
    from math import isfinite

    from hqpipe.sysid.design import oil_quantities

    wanted = expected(design)
    rows = []
    for q in (*quantities, *oil_quantities(quantities, design)):
        low, high = q.interval or (None, None)
        by_design = wanted.get(q.name)
        if by_design is None or not isfinite(by_design):
            by_design = None
        head = {"joint": joint, "model": model, "quantity": q.name, "unit": q.unit}
        rows.append({**head, "value": q.value, "low": low, "high": high, "expected": by_design})
    return rows


def joint_designs(robot_folder: Any, log_set: Any) -> dict[str, Any]:
    """Joint → `Design` from the robot's files, at the mean posture and valve opening of the fit trials.

    A joint of another machine has nothing but a radius of 1, and so has nothing to expect.
    """
    from dataclasses import replace

    import numpy as np

    from hqpipe.robots import load_robot
    from hqpipe.sysid.design import UNKNOWN, Design

    robot, designs = load_robot(robot_folder), {}
    for index, joint in enumerate(log_set.joints):
        if joint not in robot.joints:
            designs[joint] = Design(radius=1.0)
            continue
        at = robot.joints.index(joint)
        middle = 0.5 * (robot.position_lower[at] + robot.position_upper[at])
        trials = [trial.trajectory for trial in log_set.fit]
        position = np.concatenate([t.position[:, index] for t in trials])
        error = np.concatenate([t.position_command[:, index] - t.position[:, index] for t in trials])
        designs[joint] = _design(robot.hydraulics, float(robot.sprocket_radius[at]), position.mean() - middle, error)
        if log_set.control_mode not in (None, "position"):  # the valve then follows another gain
            designs[joint] = replace(designs[joint], gain=UNKNOWN, opening=UNKNOWN)
    return designs


def _design(hydraulics: Mapping[str, Any], radius: float, offset: float, error: Any) -> Any:
    """`Design` of a joint that stands `offset` rad from the middle of its range; error: (T,) rad of the fit trials."""
    import numpy as np

    from hqpipe.sysid.design import UNKNOWN, Design

    def known(path: str) -> float:
        node: Any = hydraulics
        for key in path.split("."):
            node = node.get(key, {}) if isinstance(node, Mapping) else {}
        return float(node) if isinstance(node, int | float) else UNKNOWN

    area = known("cylinder.area_a") if known("cylinder.area_a") == known("cylinder.area_b") else UNKNOWN
    half, moved = 0.5 * area * known("cylinder.stroke"), area * radius * offset
    null, gain = known("valve.null_opening"), known("firmware.position_pid.kp")
    opening = np.clip(gain * error, -1.0, 1.0)
    lag = (
        2.0 * known("valve.damping_ratio") / (2.0 * np.pi * known("valve.bandwidth_hz"))
    )  # of a second-order spool, slow motion
    return Design(
        radius=radius,
        area=area,
        bulk_modulus=known("fluid.bulk_modulus"),
        volume_a=known("cylinder.dead_volume_a") + half + moved,
        volume_b=known("cylinder.dead_volume_b") + half - moved,
        strand_stiffness=known("chain.stiffness"),
        tooth_stiffness=known("chain.tooth_stiffness"),
        leakage=known("cylinder.leakage"),
        pressure=known("supply.pressure") - known("supply.return_pressure"),
        valve_gain=known("valve.rated_flow") / np.sqrt(0.5 * known("valve.rated_drop")),
        null_opening=null,
        opening=float(np.mean(np.hypot(opening, null))),
        valve_delay=lag + known("valve.delay"),
        gain=gain,
    )
