"""How much each effect of the withheld servo, arm and cylinder cases adds to the log, as a table in Markdown.

    python benchmarks/joint_case_sizes.py [--machines 12]

Each number is a median over machines, joints and one trial: of the RMS change that the effect makes to the position (servo,
share of the swing), to the torque that the same motion takes (arm, share of the typical torque) or to the speed at the same
commands (cylinder, share of the RMS speed); of cylinders commanded in force, what it adds to the RMS error of the force
(share of the force's RMS).
"""

from __future__ import annotations

import argparse

import numpy as np

from hqpipe.benchmark.cases.cylinder import machine as cylinder
from hqpipe.benchmark.cases.cylinder.hydraulics import run_cylinders
from hqpipe.benchmark.cases.cylinder.record import KEEP, dead_times, references
from hqpipe.benchmark.cases.electric import machine as electric
from hqpipe.benchmark.cases.electric.record import record
from hqpipe.benchmark.cases.families import FAMILIES
from hqpipe.benchmark.cases.force_cylinder import machine as force_cylinder
from hqpipe.benchmark.cases.force_cylinder.record import run as run_force
from hqpipe.benchmark.cases.planted import SIZES


def electric_change(machine: electric.ElectricMachine, faulty: electric.ElectricMachine) -> list[float]:
    """Share per joint, over the first trial."""
    trial = machine.trials[0]
    sound, other = record(machine, trial), record(faulty, trial)
    found = []
    for j, name in enumerate(machine.names):
        servo = machine.family == "servo"
        channel = "position" if servo else "effort"
        scale = machine.rooms[j].swing if servo else machine.torque[j] * machine.logger.effort_scale[j]
        change = other[f"joint/{name}/{channel}"] - sound[f"joint/{name}/{channel}"]
        found.append(float(np.sqrt(np.mean(change**2)) / scale))
    return found


def _run(machine: cylinder.CylinderMachine, reference: np.ndarray, speed: np.ndarray, open_loop: bool) -> np.ndarray:
    """(T, J, 6) of `run_cylinders`, in open loop with `speed` as the commands."""
    axes, count = machine.axes.copy(), len(machine.names)
    if open_loop:
        axes["loop_gain"], axes["feedforward"] = 0.0, 1.0
    axes["jump_from"] = np.minimum(axes["jump_from"] * len(reference) * cylinder.STEP, 1e9)
    lost = np.zeros(reference.shape, dtype=np.bool_)
    for j in range(count):
        if machine.sensing.get(f"lost_frames/{j}", 0.0):
            lost[:, j] = np.random.default_rng(j).random(len(lost) // 1500 + 1).repeat(1500)[: len(lost)] < 0.15
    kept = np.empty((len(reference) // KEEP, count, 6))
    every = round(1.0 / machine.logger.host_hz / cylinder.STEP)
    fine = np.full(count, machine.logger.resolution)
    start = reference[0].copy()
    run_cylinders(
        axes,
        np.array(machine.supply),
        reference,
        speed,
        lost,
        dead_times(machine),
        fine,
        cylinder.STEP,
        every,
        KEEP,
        start,
        kept,
    )
    return kept


def cylinder_change(machine: cylinder.CylinderMachine, faulty: cylinder.CylinderMachine) -> list[float]:
    """Share per joint, over the first trial: the faulty machine against the sound one with the faulty one's commands."""
    reference, speed = references(machine, machine.trials[0])
    other = _run(faulty, reference, speed, False)
    commands = np.repeat(other[:, :, 4], KEEP, axis=0)
    sound = _run(machine, reference[: len(commands)], commands, True)
    rms = np.sqrt(np.mean(other[:, :, 1] ** 2, axis=0))
    return list(np.sqrt(np.mean((other[:, :, 1] - sound[:, :, 1]) ** 2, axis=0)) / rms)


def force_change(machine: force_cylinder.ForceMachine, faulty: force_cylinder.ForceMachine) -> list[float]:
    """Share per joint, over the first trial: error of the force that the faulty machine has and the sound one has not."""
    sound, other = run_force(machine, machine.trials[0]), run_force(faulty, machine.trials[0])
    mine, its = [np.mean((rows[:, :, 4] - rows[:, :, 6]) ** 2, axis=0) for rows in (sound, other)]
    return list(np.sqrt(np.maximum(its - mine, 0.0)) / np.std(other[:, :, 6], axis=0))


CHANGES = {"cylinder": cylinder_change, force_cylinder.FAMILY: force_change}


def rows(family: str, machines: int) -> list[str]:
    """Lines of the table."""
    kind = FAMILIES[family]
    room, effects = kind.room, kind.effects
    found = []
    for number, (key, recipe) in enumerate(effects.RECIPES.items()):
        if kind.electric and family not in recipe.families:
            continue
        cells = []
        for size in SIZES if len(recipe.sizes) > 1 else ("typical",):
            values: list[float] = []
            seed = done = 0
            while done < machines and seed < 1000:
                rng = np.random.default_rng([number, seed])
                seed += 1
                machine = kind.draw(rng)
                if len(machine.names) > 3 or key not in effects.possible(machine, recipe.outside):
                    continue
                planted = effects.plant(machine, key, size, machine.names, rng)
                if family == "cylinder":  # the load without which it does not show is there in both
                    for load in effects.with_load(machine, (planted,), rng)[1:]:
                        machine = cylinder.with_settings(machine, load.settings)
                change = CHANGES.get(family, electric_change)
                values += change(machine, room.with_settings(machine, planted.settings))
                done += 1
            cells.append(f"{100.0 * np.median(values):.2g} %")
        name = key.removesuffix("_of_arm")
        found.append(f"| {family} | `{name}` | {' | '.join(cells if len(cells) == 3 else ['–', *cells, '–'])} |")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=12)
    parser.add_argument("--family", choices=list(FAMILIES), action="append", help="repeatable; all without")
    asked = parser.parse_args()
    print("| machine | effect | small | typical | large |\n|---|---|---|---|---|")
    for family in asked.family or FAMILIES:
        print("\n".join(rows(family, asked.machines)), flush=True)


if __name__ == "__main__":
    main()
