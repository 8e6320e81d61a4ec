"""Draw docs/figures/plant_*.png: step responses in the gantry, and an open-loop trot.

Run: python benchmarks/plant_figures.py [--out docs/figures]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from hqpipe.plant import Plant, PlantTrial
from hqpipe.report.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    name_line,
    new_figure,
    save_figure,
    styled,
    title_row,
)
from hqpipe.robots import RobotSpec, load_robot

THIGH = SHANK = 0.45  # m, lengths in robot.urdf
STEP_TIME = 0.1  # s
STEP_SIZES = {0.02: SKY, 0.1: BLUE, 0.3: INK}  # rad
GAIT_HZ, STRIDE, LIFT = 2.0, 0.35, 0.14  # Hz, m, m
DIAGONAL = {"LF": 0.0, "RH": 0.0, "RF": 0.5, "LH": 0.5}  # phase of a trot
JOINT_COLORS = {"R": GREEN, "P": BLUE, "K": VERMILION}


class Trot:
    """An open-loop trot: feet sweep back on a line for half of the period and swing forward on a half sine."""

    def __init__(self, robot: RobotSpec) -> None:
        self._robot = robot
        _, pitch, knee = robot.nominal_position[:3]
        self._foot_x = -THIGH * np.sin(pitch) - SHANK * np.sin(pitch + knee)
        self._foot_z = -THIGH * np.cos(pitch) - SHANK * np.cos(pitch + knee)

    def __call__(self, frame, command) -> np.ndarray:
        """(12,) joint targets, rad."""
        target, blend = self._robot.nominal_position.copy(), min(frame.time, 1.0)
        for number, leg in enumerate(self._robot.feet):
            phase = (frame.time * GAIT_HZ + DIAGONAL[leg]) % 1.0
            swing = max(2.0 * phase - 1.0, 0.0)
            x = STRIDE * (0.5 - 2.0 * phase) if phase < 0.5 else -0.5 * STRIDE * np.cos(np.pi * swing)
            z = LIFT * np.sin(np.pi * swing)
            target[3 * number + 1 : 3 * number + 3] = _joint_angles(self._foot_x + blend * x, self._foot_z + blend * z)
        return target


def _joint_angles(x: float, z: float) -> tuple[float, float]:
    """Pitch and knee that put the foot at x, z below the hip; law of cosines, knee bent backwards."""
    cosine = (x * x + z * z - THIGH**2 - SHANK**2) / (2.0 * THIGH * SHANK)
    knee = -np.arccos(np.clip(cosine, -1.0, 1.0))
    lean = np.arctan2(SHANK * np.sin(knee), THIGH + SHANK * np.cos(knee))
    return np.arctan2(-x, -z) - lean, knee


def step_trials(robot: RobotSpec, joint: str) -> dict[float, PlantTrial]:
    """Steps of one joint in the gantry, by size in rad."""
    plant, index, trials = Plant(robot, base="fixed"), robot.joints.index(joint), {}
    for size in STEP_SIZES:

        def controller(frame, command, size=size):
            target = robot.nominal_position.copy()
            target[index] += size * (frame.time >= STEP_TIME)
            return target

        plant.reset()
        trials[size] = plant.run(controller, 0.45)
    return trials


@styled
def draw_steps(trials: dict[float, PlantTrial], joint: str, path: Path) -> None:
    """Position, torque, pressures, valve."""
    figure = new_figure(6.0)
    position, torque, pressure, valve = figure.subplots(2, 2, sharex=True).ravel()
    for size, color in STEP_SIZES.items():
        trial = trials[size]
        time, column = 1e3 * (trial.time - STEP_TIME), lambda name, t=trial: t.columns[f"joint/{joint}/{name}"]
        start = column("position")[int(1e3 * STEP_TIME) - 1]
        position.plot(time, (column("position") - start) / size, color=color)
        torque.plot(time, trial.truth[f"joint/{joint}/torque"], color=color)
        pressure.plot(time, column("pressure_a") / 1e6, color=color)
        pressure.plot(time, column("pressure_b") / 1e6, color=color, linestyle=(0, (3, 1.5)))
        valve.plot(time, column("valve_command"), color=color)
        valve.plot(time, trial.truth[f"joint/{joint}/spool"], color=color, linestyle=(0, (1, 1)))
    position.axhline(1.0, color=GREY, linewidth=0.7)
    position.axhline(1.0 - np.exp(-1.0), color=GREY, linewidth=0.7, linestyle=":")
    position.text(335, 0.625, "63 %", color=GREY, fontsize=8, va="top", ha="right")
    position.set(title="Position, share of the step", ylabel="share")
    torque.set(title="Torque on the link", ylabel="N·m")
    pressure.set(title="Chamber A (solid) and B (dashed)", ylabel="MPa", xlabel="ms after the step")
    valve.set(title="Valve command (solid), spool (dotted)", ylabel="opening", xlabel="ms after the step")
    valve.set_xlim(-20, 340)
    title_row(figure, [(f"Step of {joint} by", INK)] + [(f"{size:g} rad", color) for size, color in STEP_SIZES.items()])
    save_figure(figure, path)


@styled
def draw_trot(trial: PlantTrial, robot: RobotSpec, path: Path) -> None:
    """Tracking, torque, pressure and feet of one leg over two seconds, supply and distance over the whole run."""
    figure = new_figure(9.0)
    grid = figure.subplots(4, 2)
    time, part = trial.time, slice(4000, 6000)
    for kind, color in JOINT_COLORS.items():
        panels = (
            (grid[0, 0], "position_command", 0.7),
            (grid[0, 0], "position", 1.2),
            (grid[0, 1], "effort", 0.8),
            (grid[1, 1], "valve_command", 0.8),
        )
        for axes, name, width in panels:
            axes.plot(time[part], trial.columns[f"joint/LF{kind}/{name}"][part], color=color, linewidth=width)
    grid[0, 0].set(title="LF joints: target (thin), position", ylabel="rad")
    grid[0, 1].set(title="Torque from pressures", ylabel="N·m")
    grid[1, 1].set(title="Valve command", ylabel="opening")
    for name, color in (("pressure_a", VERMILION), ("pressure_b", ORANGE)):
        pressure = trial.columns[f"joint/LFK/{name}"][part] / 1e6
        grid[1, 0].plot(time[part], pressure, color=color, linewidth=0.8)
    grid[1, 0].plot(time[part], trial.columns["supply/pressure"][part] / 1e6, color=GREY)
    grid[1, 0].set(title="LFK chambers A, B (orange), supply (grey)", ylabel="MPa")
    for row, foot in enumerate(robot.feet):
        contact = trial.columns[f"foot/{foot}/contact"][part] > 0
        grid[2, 0].fill_between(time[part], row + 0.1, row + 0.9, where=contact, color=INK, step="mid", linewidth=0)
    grid[2, 0].set(title="Feet on the ground", yticks=np.arange(4) + 0.5, yticklabels=robot.feet)
    grid[2, 0].grid(False)
    grid[2, 1].plot(time, trial.columns["supply/pressure"] / 1e6, color=GREY, linewidth=0.7)
    grid[2, 1].set(title="Supply pressure", ylabel="MPa")
    grid[3, 0].plot(time, trial.columns["base/position/x"], color=INK)
    grid[3, 0].set(title="Distance walked", ylabel="m", xlabel="s")
    _draw_power(grid[3, 1], trial, robot)
    names = [("Open-loop trot, LF leg:", INK)]
    names += [(name, JOINT_COLORS[name[0].upper()]) for name in ("roll", "pitch", "knee")]
    title_row(figure, names)
    save_figure(figure, path)


def _draw_power(axes, trial: PlantTrial, robot: RobotSpec) -> None:
    """Where the pump's energy goes, kJ since the start."""
    time, truth = trial.time, trial.truth
    power = sum(truth[f"joint/{name}/torque"] * truth[f"joint/{name}/velocity"] for name in robot.joints)
    series = (
        ("pump", truth["energy/pump"], INK),
        ("relief valve", truth["energy/relief"], GREY),
        ("joints, positive work", np.cumsum(np.maximum(power, 0.0)) * 1e-3, PURPLE),
    )
    for name, energy, color in series:
        axes.plot(time, energy / 1e3, color=color)
        name_line(
            axes, 0.62 * time[-1], np.interp(0.62 * time[-1], time, energy) / 1e3, name, color, ha="right", va="bottom"
        )
    axes.set(title="Energy", ylabel="kJ", xlabel="s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    out = parser.parse_args().out
    robot = load_robot("hydraulic_quadruped")
    draw_steps(step_trials(robot, "LFK"), "LFK", out / "plant_step_knee.png")
    draw_steps(step_trials(robot, "LFP"), "LFP", out / "plant_step_pitch.png")
    plant = Plant(robot)
    trial = plant.run(Trot(robot), 10.0)
    draw_trot(trial, robot, out / "plant_trot.png")
    late = trial.time > 2.0
    speed = np.ptp(trial.columns["base/position/x"][late]) / np.ptp(trial.time[late])
    lowest = trial.columns["supply/pressure"].min() / 1e6
    exchanged = sum(
        np.abs(trial.truth[f"joint/{name}/torque"] * trial.truth[f"joint/{name}/velocity"]).sum() * 1e-3
        for name in robot.joints
    )
    print(f"trot: {speed:.2f} m/s, fell {trial.fell}, lowest supply {lowest:.2f} MPa")
    print(f"coupling: {plant.interface_error:.1f} J gained of {exchanged:.0f} J exchanged")


if __name__ == "__main__":
    main()
