"""Withheld cases of legged machines: their log sets, and what answers.json says of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hqpipe.system import durable


def make_legged_case(case: Any, out: Path) -> None:
    """Simulate one case and its machines without effects; nothing half-made is left under its name."""
    from hqpipe.benchmark.legged_cases import write
    from hqpipe.logs.writer import LogSetWriter
    from hqpipe.stages.blind_make import HALF_MADE, TRUTH, truth_sets

    half = out / HALF_MADE / case.name
    write(case, half / "logs", LogSetWriter)
    for name, left_out in truth_sets(case).items():
        write(case, half / TRUTH / name, LogSetWriter, left_out)
    truth = out / TRUTH / case.name
    if (half / TRUTH).is_dir():
        truth.parent.mkdir(parents=True, exist_ok=True)
        durable.move_into_place(half / TRUTH, truth)
    else:
        durable.remove(truth)
    durable.move_into_place(half / "logs", out / case.name)  # last, because a case that has its name is complete


def legged_answer(case: Any) -> dict[str, Any]:
    """What is wrong in a case, JSON-able; the machines without effects keep what is ordinary."""
    from hqpipe.benchmark.legged_cases import describe
    from hqpipe.stages.blind_make import truth_folders

    return {
        "case": case.name,
        "kind": case.kind,
        **describe(case),
        "effects": [one.answer() for one in (*case.planted, *case.also)],
        "truth": truth_folders(case),
    }
