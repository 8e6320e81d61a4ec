"""Withheld cases of servos, arms and cylinders: their log sets, and what answers.json says of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hqpipe.system import durable

REFERENCE = "_reference"
"""Ends the name of the folder with the earlier recording of a case of kind "change"."""


def make_joint_case(case: Any, out: Path) -> None:
    """Simulate one case, its machines without effects and its reference; nothing half-made is left under its name."""
    from hqpipe.benchmark.cases.joint_cases import write
    from hqpipe.logs.writer import LogSetWriter
    from hqpipe.stages.blind.make import HALF_MADE, TRUTH, put_in_place, truth_sets

    half = out / HALF_MADE / case.name
    write(case, half / "logs", LogSetWriter)
    for name, left_out in truth_sets(case).items():
        write(case, half / TRUTH / name, LogSetWriter, left_out)
    if case.reference is not None:
        write(case, half / "reference", LogSetWriter, before=True)
        durable.move_into_place(half / "reference", out / f"{case.name}{REFERENCE}")
    put_in_place(half, out, case.name)


def joint_answer(case: Any) -> dict[str, Any]:
    """What is wrong in a case, JSON-able."""
    from hqpipe.benchmark.cases.joint_cases import describe
    from hqpipe.stages.blind.make import truth_folders

    found = {
        "case": case.name,
        "kind": case.kind,
        **describe(case),
        "ordinary_friction": any(one.ordinary for one in case.planted),
        "effects": [one.answer() for one in case.planted],
        "truth": truth_folders(case),
    }
    if case.reference is not None:
        found["reference"] = f"{case.name}{REFERENCE}"
        found["change"] = case.change
        found["effects_of_reference"] = [one.answer() for one in case.reference]
    return found
