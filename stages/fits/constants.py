"""constants.csv of fit-actuator: the fits read as physics, beside what the robot's files say of the machine."""

from __future__ import annotations

from collections.abc import Sequence
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
    from hqpipe.identify.constants.chamber_constants import chamber_constants
    from hqpipe.identify.constants.design import chamber_expected, paper_expected
    from hqpipe.identify.constants.paper_constants import paper_quantities
    from hqpipe.report.constants_figures import SHOWN, constants_chart
    from hqpipe.report.tables import constants_table
    from hqpipe.stages.inputs.training import write_rows
    from hqpipe.stages.output.terminal import show

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

    from hqpipe.identify.constants.design import oil_quantities

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
    """Joint → `Design` from the robot's files, see `hqpipe.identify.constants.robot_design`."""
    from hqpipe.identify.constants.robot_design import designs_at
    from hqpipe.robots import load_robot

    robot = load_robot(robot_folder)
    middle = 0.5 * (robot.position_lower + robot.position_upper)
    radius, middles = (dict(zip(robot.joints, column, strict=True)) for column in (robot.sprocket_radius, middle))
    return designs_at(log_set, robot.hydraulics, radius, middles)
