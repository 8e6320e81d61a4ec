"""What holds of the chain whatever its numbers are: shifts in time, units, and windows, rows and batches that agree."""

from __future__ import annotations

import numpy as np
import pytest
from machine.augmented_rows import planted, row, signals_of

from hqpipe.machine import EFFECTS
from hqpipe.machine import effect as scales
from hqpipe.machine.chain import loops, residual_windows
from hqpipe.machine.layout import FIELDS, slot

MACHINE = [name for name in planted.TYPICAL if not EFFECTS[name].of_the_log]


def predicted(p, signals):
    return residual_windows(p, signals) + signals.target[1:]


@pytest.mark.parametrize("samples", [1, 4, 11])
def test_a_delay_of_whole_samples_is_a_shifted_command(samples):
    signals = signals_of("valve_lag")
    sizes = {name: planted.TYPICAL[name] for name in ("valve_lag", "valve_deadband", "orifice_flow")}
    late = row(sizes | {"command_delay": {"delay_s": samples * planted.DT}})
    shifted = signals.command.copy()
    for first, end in zip(signals.bounds[:-1], signals.bounds[1:], strict=True):
        piece = signals.command[first:end]
        shifted[first:end] = np.concatenate([np.full(samples, piece[0]), piece[:-samples]])
    found = predicted(row(sizes), signals._replace(command=shifted))
    np.testing.assert_allclose(predicted(late, signals), found, rtol=0.0, atol=1e-9)


def unit_power(owner: str, name: str, unit: str) -> int:
    """Power of a unit, "N·m" or "rad", in the number of a column as the chain holds it."""
    if owner in ("base", "setting"):
        torque = {"k1": 1, "k3": 1, "clear": 1, "effort_limit": 1}
        angle = {"k1": -1, "k3": -1, "k4": -1, "middle": 1}
        return (torque if unit == "N·m" else angle).get(name, 0)
    parameter = next(p for p in EFFECTS[owner].parameters if p.name == name)
    text = parameter.unit.replace("command", "rad")
    above, _, below = text.partition("/")
    power = above.split("·").count(unit) + ("N·m" in above and unit == "N·m") - below.split("·").count(unit)
    return -power if parameter.inverse else power


@pytest.mark.parametrize("unit", ["N·m", "rad"])
def test_units_of_torque_and_angle_scale_what_is_in_them(unit):
    """Logs in other units, and numbers in these units, give the same torque in its unit."""
    factor = 4.0  # a power of two: exact
    signals = signals_of("valve_lag")
    sizes = {
        name: planted.TYPICAL[name] for name in MACHINE if name not in ("position_dependent_stiffness", "supply_droop")
    }
    p = row(sizes)
    scaled = p.copy()
    for i, (owner, name) in enumerate(FIELDS):
        scaled[i] *= factor ** unit_power(owner, name, unit)
    names = ("effort", "target") if unit == "N·m" else ("command", "position", "velocity", "demand")
    other = signals._replace(**{name: factor * getattr(signals, name) for name in names})
    expected = predicted(p, signals) * (factor if unit == "N·m" else 1.0)
    np.testing.assert_allclose(predicted(scaled, other), expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_a_fit_step_moves_the_prediction_by_its_slope():
    """A difference over twice the step is twice as large, however much of the run is kept."""
    signals = signals_of("valve_lag")
    smooth = ("valve_lag", "orifice_flow", "gain_drift", "leakage_drift", "viscous_friction", "torque_bias")
    begin = row({name: planted.TYPICAL[name] for name in smooth})
    work, out = loops().make_work(signals), np.empty((signals.steps, len(signals.first)))

    def run(p):
        loops().fill_errors(p, signals, work, out)
        return out.copy()

    start = run(begin)
    for owner, name in FIELDS:
        column = slot(owner, name)
        if owner not in ("base", *smooth) or begin[column] == 0.0:
            continue
        moved = []
        for step in (1e-6, 2e-6):
            p = begin.copy()
            p[column] *= 1.0 + step
            moved.append(run(p) - start)
        assert np.abs(moved[0]).max() > 0.0, name
        np.testing.assert_allclose(moved[1], 2.0 * moved[0], rtol=0.0, atol=2e-3 * np.abs(moved[1]).max(), err_msg=name)


def test_the_scales_of_the_search_are_units_of_the_numbers():
    of = {
        scales.SECOND: "s",
        scales.EFFORT: "N·m",
        scales.VELOCITY: "rad/s",
        scales.ANGLE: "rad",
        scales.TRAVEL: "rad",
        scales.CURVE: "1/rad",
        scales.FLOW: "rad/s",
    }
    for effect in EFFECTS.values():
        for parameter in effect.parameters:
            if parameter.search.scale in of:
                assert parameter.unit == of[parameter.search.scale], (effect.name, parameter.name)
