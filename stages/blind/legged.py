"""Withheld cases of legged machines: their log sets, and what answers.json says of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def make_legged_case(case: Any, out: Path) -> None:
    """Simulate one case and its machines without effects; nothing half-made is left under its name."""
    from hqpipe.benchmark.cases.legged_cases import write
    from hqpipe.logs.writer import LogSetWriter
    from hqpipe.stages.blind.make import HALF_MADE, TRUTH, put_in_place, truth_sets

    half = out / HALF_MADE / case.name
    write(case, half / "logs", LogSetWriter)
    for name, left_out in truth_sets(case).items():
        write(case, half / TRUTH / name, LogSetWriter, left_out)
    put_in_place(half, out, case.name)


def legged_answer(case: Any) -> dict[str, Any]:
    """What is wrong in a case, JSON-able; the machines without effects keep what is ordinary."""
    from hqpipe.benchmark.cases.legged_cases import describe
    from hqpipe.stages.blind.make import truth_folders

    return {
        "case": case.name,
        "kind": case.kind,
        **describe(case),
        "effects": [one.answer() for one in (*case.planted, *case.also)],
        "truth": truth_folders(case),
    }
