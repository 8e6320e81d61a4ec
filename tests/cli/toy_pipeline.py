"""A chain of three toy stages with the shape of the real one: numbers → squares → report (with a gate).

``python toy_pipeline.py run all`` is the command line on it.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from hqpipe.cli import main
from hqpipe.errors import LogError
from hqpipe.pipeline.config import StageParams
from hqpipe.pipeline.stage import Input, Stage, StageTable
from hqpipe.system import durable

PIPELINE_YAML = """\
robot: toy
seed: 1
profile: default
workers: 2
stages:
  numbers: {count: 4}
  square_up: {offset: 0}
  report: {}
profiles:
  default: {}
  ci:
    numbers: {count: 2}
"""


class NumbersParams(StageParams):
    """What the numbers are.

    Attributes:
        count: how many. label: says nothing about the content.
    """

    count: int = 3
    label: str = "a"


class SquareParams(StageParams):
    offset: float = 0.0
    fault: str = "none"
    steps: int = 0
    tasks: int = 0
    whole_numbers: bool = False


class ReportParams(StageParams):
    limit: float = 1e6


def make_numbers(context) -> dict:
    numbers = [context.seed + i for i in range(context.params.count)]
    (context.output / "part").mkdir()
    (context.output / "part" / "numbers.json").write_text(json.dumps(numbers))
    (context.output / "count.txt").write_text(str(len(numbers)))
    print("chatter that must not reach standard output")
    return {"headline": f"{len(numbers)} numbers", "count": len(numbers), "undefined": float("nan")}


def square(context) -> dict:
    params = context.params
    resumed = (context.scratch / "step").is_file()
    first = int((context.scratch / "step").read_text()) if resumed else 0
    for step in range(first, params.steps):
        durable.write_file(context.scratch / "step", str(step))
        (context.output / "half.txt").write_text("half")
        context.progress(step, params.steps, "stepping")
        time.sleep(0.05)
    (context.output / "half.txt").unlink(missing_ok=True)
    if params.fault == "unexpected":
        raise ZeroDivisionError("a fault of the stage")
    if params.fault == "expected":
        raise LogError("column 'time' is missing")
    if params.fault == "interrupt":
        (context.output / "half.txt").write_text("half")
        raise KeyboardInterrupt
    if params.fault == "link":
        (context.output / "squares.json").symlink_to("/etc/hostname")
        return {}
    if params.fault == "empty":
        return {}
    if params.fault == "chatty":
        (context.output / "note.txt").write_text("more than anyone reads")
    if params.tasks:
        (context.output / "made.json").write_text(json.dumps(run_tasks(context, params.tasks)))
    if params.fault == "late":
        raise LogError("the tasks are done, the stage is not")
    numbers = json.loads((context.inputs["numbers"] / "part" / "numbers.json").read_text())
    squares = [round(n * n + params.offset) if params.whole_numbers else n * n + params.offset for n in numbers]
    content = [time.time_ns()] if params.fault == "random" else squares
    (context.output / "squares.json").write_text(json.dumps(content))
    return {"first": squares[0], "resumed_from": first}


def run_tasks(context, count: int) -> list[int]:
    """Numbers of the tasks that were not there yet."""
    made = []
    for number in range(count):
        task = context.tasks.find(number=number)
        if not task.is_done():
            folder = task.begin()
            (folder / "number.txt").write_text(str(number))
            task.finish(folder)
            made.append(number)
    return made


def report(context) -> dict:
    squares = json.loads((context.inputs["squares"] / "squares.json").read_text())
    (context.output / "report.txt").write_text(str(squares))
    failures = [f"{value} above {context.params.limit}" for value in squares if value > context.params.limit]
    return {"gate": {"passed": not failures, "failures": failures}}


def _module(name: str, run, params) -> str:
    """Make ``run`` and ``Params`` importable as a module of their own, as real stages are."""
    module = type(sys)(name)
    module.run, module.Params = run, params
    sys.modules[name] = module
    return name


TABLE = StageTable(
    [
        Stage("numbers", "numbers", _module("toy_numbers", make_numbers, NumbersParams), "Make numbers."),
        Stage(
            "square-up",
            "squares",
            _module("toy_square", square, SquareParams),
            "Square them.",
            inputs=(Input("numbers", "numbers", "--numbers"),),
            flags=(("--exact", "Exactly; the only way."),),
            switches=(("--whole-numbers", "Round them."),),
            settings=(("--offset", "NUMBER", "Add this."),),
        ),
        Stage(
            "report",
            "report",
            _module("toy_report", report, ReportParams),
            "Write about them.",
            inputs=(Input("squares", "squares", "--squares", files=("squares.json",)),),
        ),
    ],
    template=Path(__file__).parents[2] / "pipeline.yaml",
)

if __name__ == "__main__":
    main(TABLE)
