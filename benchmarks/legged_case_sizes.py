"""How much each effect of the withheld legged cases changes the log, as a table in Markdown.

    python benchmarks/legged_case_sizes.py [--machines 3] [--seconds 6]

Each cell holds two medians over machines and joints, of one trial with hanging and one with standing legs: the RMS change of
the logged torque as a share of the torque's standard deviation, and that of the logged position as a share of the position's.
The faulty machine and the sound one move by the same commands.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from hqpipe.benchmark.cases.legged.draw import LeggedMachine, draw_machine, with_settings
from hqpipe.benchmark.cases.legged.effects import RECIPES, LeggedRecipe
from hqpipe.benchmark.cases.legged.outside import OUTSIDE
from hqpipe.benchmark.cases.legged.record import record
from hqpipe.benchmark.cases.legged.robots import ROBOTS
from hqpipe.benchmark.cases.legged_cases import plant, shows
from hqpipe.benchmark.cases.planted import SIZES


def short(machine: LeggedMachine, seconds: float) -> LeggedMachine:
    """The machine with one trial of hanging and one of standing legs."""
    free = next(trial for trial in machine.trials if trial.motion == "multisine")
    stand = next(trial for trial in machine.trials if trial.motion == "tread")
    return replace(machine, trials=(replace(free, seconds=seconds), replace(stand, seconds=seconds)))


def changes(machine: LeggedMachine, faulty: LeggedMachine) -> np.ndarray:
    """(J, 2) changes of torque and position, as shares of what they vary by."""
    logs = [(record(machine, trial), record(faulty, trial)) for trial in machine.trials]
    rows = []
    for name in machine.names:
        row = []
        for channel in (f"joint/{name}/effort", f"joint/{name}/position"):
            sound, other = (np.concatenate([log[side][channel] for log in logs]) for side in (0, 1))
            row.append(float(np.sqrt(np.mean((other - sound) ** 2)) / np.std(sound)))
        rows.append(row)
    return np.array(rows)


def machines(recipe: LeggedRecipe, count: int, seconds: float) -> Iterator[LeggedMachine]:
    """Sound machines on whose logs the effect shows, the robots in turn; the same for every effect if they can be."""
    for number in range(count):
        for attempt in range(100):
            machine = draw_machine(ROBOTS[number % len(ROBOTS)](), np.random.default_rng([number, attempt]))
            if shows(recipe, machine):
                yield short(machine, seconds)
                break


def row(recipe: LeggedRecipe, count: int, seconds: float) -> str:
    """A line of the table."""
    cells = []
    for size in SIZES if len(recipe.sizes) > 1 else ("typical",):
        values = []
        for number, machine in enumerate(machines(recipe, count, seconds)):
            planted = plant(machine, recipe, size, machine.names, np.random.default_rng([number, 5]))
            values.append(changes(machine, with_settings(machine, planted.settings)))
        torque, position = np.median(np.concatenate(values), axis=0)
        level = recipe.sizes[SIZES.index(size)] if len(recipe.sizes) > 1 else recipe.sizes[0]
        cells.append(f"{level:g}: {100.0 * torque:.2g} %, {100.0 * position:.2g} %")
    cells = cells if len(cells) == 3 else ["–", *cells, "–"]
    return f"| `{recipe.name}` | {recipe.unit} | {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--effect", choices=[*RECIPES, *OUTSIDE], action="append", help="repeatable; all without")
    asked = parser.parse_args()
    print("| effect | size in | small | typical | large |\n|---|---|---|---|---|")
    for name, recipe in (RECIPES | OUTSIDE).items():
        if not asked.effect or name in asked.effect:
            print(row(recipe, asked.machines, asked.seconds), flush=True)


if __name__ == "__main__":
    main()
