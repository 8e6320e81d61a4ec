"""Ways in which a logger, a sensor or its user spoils a log set, for `degraded_logs.py`; each is a function of a seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

Columns = dict[str, np.ndarray]
Trials = dict[str, Columns]  # file → its columns
HELD = ("position_command", "effort_command", "valve_command")  # a command stays what it was until the next one
RATES_HZ = (20, 50, 100, 200, 500, 5000)
RATE_RATIO = 5.0  # the most by which a rate is multiplied, and the most by which it is divided is ten times that
DEGREE = np.pi / 180.0
CUT_ROWS = 30


@dataclass(frozen=True)
class Planted:
    """What a variant should be found to have.

    Attributes:
        kinds: defect kinds that name it rightly; empty where nothing should be found.
        joint: where it was planted; None for whole trials. file: the rotten trial; None for all trials.
        costs: whether the answer would be another without it for certain. The way round of a valve, the unit of a channel
            that a model scales by itself, or a velocity that the positions stand in for, may be told and cost nothing.
    """

    kinds: tuple[str, ...] = ()
    joint: str | None = None
    file: str | None = None
    costs: bool = True


@dataclass(frozen=True)
class Variant:
    """One way of spoiling a set: `make` changes a copy; `planted` says what should be found."""

    name: str
    make: Callable[[Trials, np.random.Generator], Trials]
    planted: Planted = Planted()


def channel(name: str) -> str:
    """Last part of a column name."""
    return name.rsplit("/", 1)[-1]


def joints_of(trials: Trials) -> list[str]:
    """In the order of the columns."""
    first = next(iter(trials.values()))
    return list(dict.fromkeys(n.split("/")[1] for n in first if n.startswith("joint/")))


def _each(change: Callable[[Columns, np.random.Generator], Columns]) -> Callable[[Trials, np.random.Generator], Trials]:
    return lambda trials, rng: {file: change(dict(columns), rng) for file, columns in trials.items()}


def _only(
    file: str, change: Callable[[Columns, np.random.Generator], Columns]
) -> Callable[[Trials, np.random.Generator], Trials]:
    return lambda trials, rng: {f: change(dict(c), rng) if f == file else c for f, c in trials.items()}


def _lost(share: float, burst: int) -> Callable[[Columns, np.random.Generator], Columns]:
    """Without a share of the rows, `burst` on end at a time; the clock of the others stays."""

    def change(columns: Columns, rng: np.random.Generator) -> Columns:
        rows = len(columns["time"])
        gone = np.zeros(rows, dtype=bool)
        for start in rng.integers(1, max(2, rows - burst), size=max(1, round(share * rows / burst))):
            gone[start : start + burst] = True
        gone[0] = False
        return {name: values[~gone] for name, values in columns.items()}

    return change


def _at(columns: Columns, time: np.ndarray) -> Columns:
    """The trial as a logger would have recorded it at other instants."""
    old = columns["time"]
    last = np.clip(np.searchsorted(old, time + 1e-9, side="right") - 1, 0, len(old) - 1)
    found = {n: v[last] if channel(n) in HELD else np.interp(time, old, v) for n, v in columns.items() if n != "time"}
    return {"time": time, **found}


def _jitter(share: float) -> Callable[[Columns, np.random.Generator], Columns]:
    """Rows taken at instants that scatter round the beat by a share of it (standard deviation, kept in order)."""

    def change(columns: Columns, rng: np.random.Generator) -> Columns:
        time = columns["time"]
        dt = float(np.median(np.diff(time)))
        return _at(columns, np.sort(time + dt * np.clip(share * rng.standard_normal(len(time)), -0.45, 0.45)))

    return change


def _at_rate(rate: float, *, averaged: bool) -> Callable[[Columns, np.random.Generator], Columns]:
    """The trial at another rate: interpolated upwards; picked, or averaged over the new step, downwards."""

    def change(columns: Columns, rng: np.random.Generator) -> Columns:
        time = columns["time"]
        width = max(1, round(1.0 / (rate * float(np.median(np.diff(time))))))
        smooth = np.ones(width) / width
        if averaged and width > 1:
            columns = {
                n: v
                if n == "time" or channel(n) in HELD
                else np.convolve(np.pad(v, width, "edge"), smooth, "same")[width:-width]
                for n, v in columns.items()
            }
        return _at(columns, np.arange(time[0], time[-1], 1.0 / rate))

    return change


def _mixed(rate: float) -> Callable[[Trials, np.random.Generator], Trials]:
    """Every second trial at half the rate."""
    slower = _at_rate(rate / 2.0, averaged=False)
    return lambda trials, rng: {f: slower(c, rng) if i % 2 else c for i, (f, c) in enumerate(trials.items())}


def _quantised(what: Sequence[str], levels: int) -> Callable[[Trials, np.random.Generator], Trials]:
    """Channels rounded to a share of their range over all trials."""

    def make(trials: Trials, rng: np.random.Generator) -> Trials:
        found = {file: dict(columns) for file, columns in trials.items()}
        for name in (n for n in next(iter(trials.values())) if channel(n) in what):
            every = np.concatenate([c[name] for c in trials.values()])
            step = float(np.ptp(every)) / levels or 1.0
            for columns in found.values():
                columns[name] = np.round(columns[name] / step) * step
        return found

    return make


def _clipped(what: str, joint: str | None, share: float) -> Callable[[Trials, np.random.Generator], Trials]:
    """A channel of one joint, or of all, cut off at the quantile of its size that leaves out a share of the samples."""

    def make(trials: Trials, rng: np.random.Generator) -> Trials:
        found = {file: dict(columns) for file, columns in trials.items()}
        names = [n for n in next(iter(trials.values())) if channel(n) == what and joint in (None, n.split("/")[1])]
        for name in names:
            every = np.concatenate([c[name] for c in trials.values()])
            middle = float(np.median(every))
            limit = float(np.quantile(np.abs(every - middle), 1.0 - share))
            for columns in found.values():
                columns[name] = np.clip(columns[name], middle - limit, middle + limit)
        return found

    return make


def _values(
    joints: Sequence[str], what: Sequence[str], change: Callable[[np.ndarray], np.ndarray]
) -> Callable[[Columns, np.random.Generator], Columns]:
    def apply(columns: Columns, rng: np.random.Generator) -> Columns:
        for name in [f"joint/{joint}/{part}" for joint in joints for part in what]:
            if name in columns:
                columns[name] = change(columns[name])
        return columns

    return apply


def _swap(what: str, a: str, b: str) -> Callable[[Columns, np.random.Generator], Columns]:
    def apply(columns: Columns, rng: np.random.Generator) -> Columns:
        first, second = f"joint/{a}/{what}", f"joint/{b}/{what}"
        columns[first], columns[second] = columns[second], columns[first]
        return columns

    return apply


def _shuffled(columns: Columns, rng: np.random.Generator) -> Columns:
    order = rng.permutation(len(columns["time"]))
    return {name: values if name == "time" else values[order] for name, values in columns.items()}


def _reversed(columns: Columns, rng: np.random.Generator) -> Columns:
    return {name: values if name == "time" else values[::-1] for name, values in columns.items()}


def _column_shuffled(joint: str, what: str) -> Callable[[Columns, np.random.Generator], Columns]:
    def apply(columns: Columns, rng: np.random.Generator) -> Columns:
        name = f"joint/{joint}/{what}"
        columns[name] = rng.permutation(columns[name])
        return columns

    return apply


def variants(trials: Trials, mode: str) -> list[Variant]:
    """Every variant that makes sense for a set.

    Args:
        trials: sound. mode: position, torque or valve.
    """
    rate = 1.0 / float(np.median(np.diff(next(iter(trials.values()))["time"])))
    return [
        Variant("sound", lambda trials, rng: trials),
        *_of_the_logger(rate),
        *_of_the_sensor(trials),
        *_of_the_wiring(trials, mode),
        *_of_one_trial(trials, mode),
    ]


def _of_the_logger(rate: float) -> list[Variant]:
    found = [
        Variant(f"rows lost {share:.1%}, {'bursts of 20' if burst > 1 else 'single'}", _each(_lost(share, burst)))
        for burst in (1, 20)
        for share in (0.001, 0.01, 0.1)
    ]
    found += [Variant(f"clock jitter {share:.0%}", _each(_jitter(share))) for share in (0.05, 0.2, 0.4)]
    for other in RATES_HZ:
        if other > rate * 1.05 and other <= RATE_RATIO * rate * 1.01:
            found.append(Variant(f"{other} Hz, interpolated", _each(_at_rate(other, averaged=False))))
        elif other < rate / 1.5 and rate <= 10.0 * RATE_RATIO * other * 1.01:
            found += [
                Variant(
                    f"{other} Hz, {'averaged' if averaged else 'picked'}", _each(_at_rate(other, averaged=averaged))
                )
                for averaged in (True, False)
            ]
    return [*found, Variant("every second trial at half the rate", _mixed(rate))]


def _of_the_sensor(trials: Trials) -> list[Variant]:
    """Of the channels of one joint; coarse sensors and commands at their limit are no defects."""
    joint, columns = joints_of(trials)[0], next(iter(trials.values()))
    has = [part for part in ("position", "effort") if f"joint/{joint}/{part}" in columns]
    found = [
        Variant(f"{part} in {levels} steps", _quantised((part,), levels)) for part in has for levels in (1000, 100)
    ]
    found += [
        Variant(f"{part} at its limit", _clipped(part, None, 0.1))
        for part in HELD
        if f"joint/{joint}/{part}" in columns
    ]
    for part in has:
        dead = Planted(("constant",), joint)
        found.append(
            Variant(f"{part} of one joint dead", _each(_values((joint,), (part,), lambda v: v * 0.0 + v[0])), dead)
        )
        found.append(Variant(f"{part} of one joint NaN", _each(_values((joint,), (part,), lambda v: v * np.nan)), dead))
    if "effort" in has:
        found.append(
            Variant(
                "effort of one joint cut off",
                _clipped("effort", joint, 0.2),
                Planted(("saturated",), joint, costs=False),
            )
        )
    return found


def _of_the_wiring(trials: Trials, mode: str) -> list[Variant]:
    """One joint, or a pair, wired or scaled wrongly in every trial."""
    joints, columns = joints_of(trials), next(iter(trials.values()))
    joint = joints[0]
    command = {"position": "position_command", "torque": "effort_command", "valve": "valve_command"}[mode]
    found = []
    for part in ("effort", "velocity", command):
        if f"joint/{joint}/{part}" not in columns:
            continue
        signless = part == "effort" and min(c[f"joint/{joint}/effort"].min() for c in trials.values()) >= 0.0
        free = part == command and mode == "valve"  # which way a valve counts is its own affair
        sizes = min(c.get(f"joint/{joint}/effort", np.ones(1)).min() for c in trials.values()) >= 0.0
        told_only = free or part == "velocity" or sizes  # an effort without a sign takes that of any command
        flipped = Planted(("sign_flipped", "unsigned"), joint, costs=not told_only)
        if not signless:
            found.append(
                Variant(f"{part} of one joint flipped", _each(_values((joint,), (part,), np.negative)), flipped)
            )
        shuffled = Planted(("rows_out_of_order",), joint, costs=part != "velocity")
        found.append(Variant(f"{part} of one joint shuffled", _each(_column_shuffled(joint, part)), shuffled))
        if len(joints) > 2:
            swapped = Planted(("swapped", "velocity_mismatch"), joint, costs=part != "velocity")
            found.append(Variant(f"{part} of two joints swapped", _each(_swap(part, joint, joints[2])), swapped))
    if f"joint/{joint}/velocity" in columns:
        unit = Planted(("velocity_mismatch", "units"), joint, costs=False)
        found.append(
            Variant(
                "velocity of one joint in deg/s", _each(_values((joint,), ("velocity",), lambda v: v / DEGREE)), unit
            )
        )
    for name, factor in (("degrees", 1.0 / DEGREE), ("mm", 1000.0)):
        change = _each(_values((joint,), ("position",), lambda v, f=factor: v * f))
        unit = Planted(("units", "velocity_mismatch"), joint, costs=False)
        found.append(Variant(f"position of one joint in {name}", change, unit))
    return found


def _of_one_trial(trials: Trials, mode: str) -> list[Variant]:
    """One rotten trial, the second of several."""
    if len(trials) < 3:
        return []
    file, joints = list(trials)[1], joints_of(trials)
    columns = trials[file]
    signal = "effort" if mode != "valve" else "valve_command"

    def rotten(*kinds: str) -> Planted:
        return Planted(kinds, None, file)

    found = [
        Variant("one trial shuffled", _only(file, _shuffled), rotten("rows_out_of_order")),
        Variant("one trial backwards", _only(file, _reversed), rotten("rows_out_of_order", "sign_flipped")),
        Variant(
            "one trial cut short",
            _only(file, lambda c, rng: {n: v[:CUT_ROWS] for n, v in c.items()}),
            Planted(("too_short",), None, file, costs=False),
        ),
    ]
    moved = ("position", "position_command", "velocity")
    change = _values(joints, moved, lambda v: v / DEGREE)
    found.append(
        Variant("one trial in degrees", _only(file, change), rotten("other_units", "units", "velocity_mismatch"))
    )
    if f"joint/{joints[0]}/{signal}" in columns and not (
        signal == "effort" and columns[f"joint/{joints[0]}/effort"].min() >= 0.0
    ):
        change = _values(joints, (signal,), np.negative)
        found.append(Variant(f"{signal} of one trial flipped", _only(file, change), rotten("sign_flipped")))
    return found


def by_seed(variant: Variant, trials: Mapping[str, Columns], seed: int) -> Trials:
    """The spoilt copy; the same for the same seed."""
    number = int.from_bytes(variant.name.encode()[-6:], "little")
    return variant.make(dict(trials), np.random.default_rng([seed, number]))
