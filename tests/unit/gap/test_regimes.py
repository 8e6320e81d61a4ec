"""Every family cuts each sample into exactly one regime, and each regime is where it should be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hqpipe.gap.regimes import frequency_bands, label, thresholds
from hqpipe.logs.trajectory import Excerpt, Trajectory

SAMPLES, DT = 4000, 1e-3


@pytest.fixture
def sine() -> Trajectory:
    """Two joints at 1 Hz, the second twice as far; torque with one step and a plateau."""
    time = np.arange(SAMPLES) * DT
    position = np.sin(2 * np.pi * time)[:, None] * [1.0, 2.0]
    velocity = 2 * np.pi * np.cos(2 * np.pi * time)[:, None] * [1.0, 2.0]
    effort = np.clip(150 * np.sin(2 * np.pi * time)[:, None] * [1.0, 0.5], -100, 100)
    effort[2500:, 1] += 60.0
    contact = (np.arange(SAMPLES) >= 1000).astype(float)
    return Trajectory(
        time=time,
        joints=("LFK", "RFK"),
        position=position,
        velocity=velocity,
        effort=effort,
        position_command=position + 0.01 * velocity,
        extra={"foot/LF/contact": contact, "foot/RF/contact": 1 - contact, "foot/LF/force/x": contact},
    )


def test_families_partition_the_samples(sine):
    found = label(sine, thresholds([sine]))
    assert set(found) == {
        "direction",
        "reversal",
        "speed",
        "flow",
        "saturation",
        "impact",
        "contact",
        "time_span",
    }
    for family, regimes in found.items():
        assert (sum(mask.astype(int) for mask in regimes.values()) == 1).all(), family


def test_direction_and_reversal_follow_the_velocity(sine):
    found = label(sine, thresholds([sine]))
    assert found["direction"]["extending"][0].all() and found["direction"]["retracting"][500].all()
    assert found["direction"]["standstill"][250].all()
    reversal = found["reversal"]["reversal"][:, 0]
    assert reversal[250] and reversal[750] and not reversal[500]
    assert reversal.sum() == pytest.approx(8 * 41, abs=8)  # ±20 ms around eight turns


def test_noise_at_standstill_is_no_reversal(sine):
    shaken = sine.velocity.copy()
    shaken[1000:2000] = 1e-3 * np.where(np.arange(1000) % 2, 1.0, -1.0)[:, None]
    still = label(replace(sine, velocity=shaken), thresholds([sine]))["reversal"]["reversal"]
    assert not still[1100:1900].any()


def test_speed_is_the_top_fifth(sine):
    found = label(sine, thresholds([sine]))
    assert found["speed"]["high_speed"].mean(axis=0) == pytest.approx(0.2, abs=0.01)
    assert found["flow"]["high_flow_demand"].mean() == pytest.approx(0.2, abs=0.01)
    assert found["speed"]["high_speed"][0].all()


def test_saturation_is_the_plateau(sine):
    saturated = label(sine, thresholds([sine]))["saturation"]["saturation"]
    assert saturated[250, 0] and not saturated[150 - 50, 0]


def test_impact_is_the_jump_and_the_touchdown(sine):
    impact = label(sine, thresholds([sine]))["impact"]["impact"]
    assert impact[2495:2506, 1].all() and not impact[2600, 1]
    assert impact[1000:1050, 0].all() and not impact[1060, 0]
    assert not impact[1000:1050, 1].any()  # the other leg lifts off there


def test_stance_belongs_to_the_joints_own_foot(sine):
    stance = label(sine, thresholds([sine]))["contact"]["stance"]
    assert not stance[999, 0] and stance[1000, 0] and stance[999, 1] and not stance[1000, 1]


def test_contact_needs_every_foot_and_flow_needs_a_second_joint(sine):
    lone = replace(sine.for_joints(["LFK"]), extra={})
    assert not {"contact", "flow"} & set(label(lone, thresholds([lone])))


def test_quarters(sine):
    quarters = label(sine, thresholds([sine]))["time_span"]
    assert [int(np.argmax(mask[:, 0])) for mask in quarters.values()] == [0, 1000, 2000, 3000]


def test_quarters_of_a_section_are_those_of_its_trial(sine):
    whole = label(sine, thresholds([sine]))["time_span"]
    part = replace(sine.section(900, 2100), excerpt=Excerpt("t.parquet", float(sine.time[900]), sine.duration))
    found = label(part, thresholds([part]))["time_span"]
    for name, mask in whole.items():
        np.testing.assert_array_equal(found[name], mask[900:2100])


def test_bands_end_at_nyquist():
    assert list(frequency_bands(1000.0)) == ["0-5_hz", "5-20_hz", "20-100_hz", "100-500_hz"]
    assert list(frequency_bands(50.0)) == ["0-5_hz", "5-20_hz", "20-25_hz"]
