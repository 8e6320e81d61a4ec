"""Wrong units of the velocity and clipped channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, plant_logs, real, recorded, values

from hqpipe.gap.checks.sanity_values import clip, value_defects, velocity_slopes

LFK = 2


@pytest.mark.parametrize("source", ["pressure", "load_cell"])
def test_sound_values(source):
    assert value_defects(plant_logs((0, 1), source), set()) == []


def test_real_machines():
    assert value_defects(real("emps"), set()) == []
    (found,) = value_defects(real("so101"), set())
    assert (found.kind, found.joints) == ("velocity_mismatch", ("Jaw",))  # its angle is scaled, its speed is not
    assert "2.3" in found.message


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (180 / np.pi, "degrees per second"),
        (30 / np.pi, "revolutions per minute"),
        (1000.0, "mm/s"),
        (1.3, "derivative of its position; correct"),
        (0.7, "derivative of its position; correct"),
    ],
)
def test_velocity_in_another_unit(factor, words):
    (found,) = value_defects(broken(plant_logs(), values("velocity", lambda v: factor * v, LFK)), set())
    assert (found.kind, found.joints, found.fatal) == ("velocity_mismatch", ("LFK",), True)
    assert words in found.message
    assert float(found.message.split(" times the")[0].split()[-1]) == pytest.approx(factor, rel=0.01)


@pytest.mark.parametrize("factor", [1.99, 0.5])
def test_one_factor_in_all_joints_points_at_the_clock(factor):
    (found,) = value_defects(broken(plant_logs(), lambda t: replace(t, velocity=factor * t.velocity)), set())
    assert f"(time × {1 / factor:.2g}" in found.reason and found.fix.startswith("correct the clock if it is that")
    (one,) = value_defects(broken(plant_logs(), values("velocity", lambda v: factor * v, LFK)), set())
    (unit,) = value_defects(broken(plant_logs(), lambda t: replace(t, velocity=180 / np.pi * t.velocity)), set())
    turned = value_defects(broken(plant_logs(), lambda t: replace(t, velocity=-factor * t.velocity)), set())
    assert all("clock" not in defect.message for defect in (one, unit, *turned))


@pytest.mark.parametrize("factor", [0.95, 1.05, -1.0])
def test_velocity_within_tolerance_or_only_flipped(factor):
    t = values("velocity", lambda v: factor * v)(recorded(0))
    assert set(velocity_slopes(t).values()) == {1.0}


def test_velocity_of_something_else():
    other = np.cumsum(np.random.default_rng(0).standard_normal((3000, 1)), axis=0) * 0.05
    (found,) = value_defects(broken(plant_logs(), values("velocity", lambda v: other, LFK), [0]), set())
    assert "is unlike the derivative of its position" in found.message and found.trials == ("t0.parquet",)


def test_clipped_effort_and_who_is_to_blame():
    def cut(v):
        return np.clip(v, -0.6 * np.abs(v).max(axis=0), 0.6 * np.abs(v).max(axis=0))

    (found,) = value_defects(broken(plant_logs(), values("effort", cut, LFK)), set())
    assert (found.kind, found.joints, found.fatal) == ("saturated", ("LFK",), True)
    (found,) = value_defects(
        broken(plant_logs(source="load_cell"), values("effort", cut, LFK)), {("effort", "t0.parquet")}
    )
    assert found.trials == ("t1.parquet",)


def test_clip_needs_a_pile_of_samples_at_the_limit():
    time = np.arange(5000) * 1e-3
    wave = np.sin(2 * np.pi * 1.3 * time)
    assert clip(wave) is None
    assert clip(np.round(wave, 2)) is None  # coarse, not clipped
    assert clip(np.sign(wave)) is None
    limit, share = clip(np.minimum(wave, 0.7))
    assert limit == 0.7 and share == pytest.approx(np.mean(wave > 0.7), abs=0.01)
