"""Run by test_toy_effect.py: puts the toy effects into the table, makes logs of joints that have them, and diagnoses these."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import toy_effects

from hqpipe import machine

machine.add_effect(toy_effects.NOTCHES, behind="flow_saturation")
machine.add_effect(toy_effects.PILOT, behind="valve_lag")

import numpy as np  # noqa: E402

from hqpipe.actuators.augmented import Augmented  # noqa: E402
from hqpipe.actuators.files import load_actuator, save_actuator  # noqa: E402
from hqpipe.gap.diagnosis import diagnose, write_diagnosis  # noqa: E402
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial  # noqa: E402
from hqpipe.machine.chain import Signals, loops, residual_windows  # noqa: E402
from hqpipe.machine.layout import neutral_row, slot  # noqa: E402
from hqpipe.report.diagnosis_page import write_page  # noqa: E402

DT, SECONDS, NOISE = 1e-3, 6.0, 3.0
GAINS = {"k1": 540.0, "k2": 0.05, "k3": 21.6, "k4": 0.36}
TRUTH = {"metering_notches": {"doubled_at": 0.15}, "pilot_sag": {"share": 0.6, "time_s": 0.2}}
OWN_LAWS = ("pilot_sag", "metering_notches")  # joint 0 has the first, joint 1 the second, joint 2 none


def recorded(seed: int) -> Trajectory:
    """A trial of three joints by a plain loop that shares nothing with the package."""
    rng, samples = np.random.default_rng(seed), round(SECONDS / DT)
    time = np.arange(samples) * DT
    rates, phases = rng.uniform(0.4, 3.0, (5, 3)), rng.uniform(0.0, 6.0, (5, 3))
    target = 0.05 * np.sin(2.0 * np.pi * rates * time[:, None, None] + phases).sum(axis=1)
    target = target[np.arange(samples) // 10 * 10]
    share = np.array([TRUTH["pilot_sag"]["share"], 0.0, 0.0])
    bent = np.array([0.0, 1.0 / TRUTH["metering_notches"]["doubled_at"], 0.0])
    step = 1.0 - np.exp(-DT / TRUTH["pilot_sag"]["time_s"])
    q, qd, tau, risen, push = target[0].copy(), *np.zeros((4, 3))
    log = np.empty((3, samples, 3))
    for k in range(samples):
        log[:, k] = q, qd, tau
        u = target[k] - q
        u, risen = u - share * risen, risen + step * (u - risen)
        u = u * (1.0 + np.abs(u) * bent)
        impact = np.where(tau * u < 0.0, np.abs(tau), 0.0) * u
        push = 150.0 * rng.normal(size=3) if k % 50 == 0 else push
        before = tau
        tau = tau + GAINS["k1"] * u - GAINS["k2"] * tau - GAINS["k3"] * qd + GAINS["k4"] * impact
        qd = qd + DT * (before - 15.0 * qd - 120.0 + push) / 6.0
        q = q + DT * log[1, k]
    effort = log[2] + NOISE * rng.normal(size=log[2].shape)
    return Trajectory(time, ("a", "b", "c"), log[0], log[1], effort=effort, position_command=target)


def logs() -> LogSet:
    trials = tuple(Trial(f"t{i}.csv", "heldout" if i == 2 else "fit", None, recorded(i)) for i in range(3))
    return LogSet(
        path=Path("synthetic"),
        sha256="0" * 64,
        format="hqpipe-log/1",
        robot=None,
        base="fixed",
        control_mode="position",
        effort_source="load_cell",
        rate_hz=1.0 / DT,
        joints=("a", "b", "c"),
        trials=trials,
    )


def toy_row() -> np.ndarray:
    row = neutral_row()
    for name, value in GAINS.items():
        row[slot("base", name)] = value
    row[slot("pilot_sag", "share")], row[slot("pilot_sag", "time_s")] = TRUTH["pilot_sag"].values()
    row[slot("metering_notches", "doubled_at")] = 1.0 / TRUTH["metering_notches"]["doubled_at"]
    return row


def stepped() -> dict[str, float]:
    """Largest differences, N·m: of a row of joints and a batch, and of a row and one long window."""
    t, row = recorded(5), toy_row()
    rows = np.array([row] * 3)
    tau, memory = t.effort[0].copy(), np.zeros((3, loops().memory))
    model = Augmented(t.joints, rows, DT)
    many, planes = t.effort[:1].copy(), model.fresh_memory(1)
    out, batch = np.empty_like(t.effort), np.empty_like(t.effort)
    for k in range(t.samples):
        out[k], batch[k] = tau, many[0]
        loops().step_row(rows, tau, memory, t.position_command[k], t.position[k], t.velocity[k])
        model.step(many, planes, t.position_command[k : k + 1], t.position[k : k + 1], t.velocity[k : k + 1], DT)
    columns = [np.ascontiguousarray(x[:, 0]) for x in (t.position_command, t.position, t.velocity, t.effort)]
    target = np.ascontiguousarray(columns[3][:, None])
    bounds, first = np.array([0, t.samples]), np.array([0])
    signals = Signals(*columns, t.time, np.zeros(t.samples), bounds, first, t.samples - 1, target)
    window = (residual_windows(row, signals) + target[1:])[:, 0]
    return {"batch": float(np.abs(batch - out).max()), "window": float(np.abs(window - out[1:, 0]).max())}


def main(folder: Path) -> None:
    found = diagnose(logs())
    write_diagnosis(found, folder)
    text = write_page(folder, effects=machine.EFFECTS).read_text()
    model = Augmented(("a",), toy_row()[None], DT)
    save_actuator(model, folder)
    kept = load_actuator(folder)
    result = {
        "causes": found.content["causes"],
        "gap": found.content["gap"],
        "explained": [effect.meaning in text and effect.advice in text for effect in toy_effects.BOTH],
        "stepped": stepped(),
        "kept": bool(np.array_equal(kept.parameters, model.parameters)) and sorted(kept.effects),
    }
    (folder / "result.json").write_text(json.dumps(result))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
