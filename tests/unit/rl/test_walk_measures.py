"""Measures of a walk against walks whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.rl import walk_measures as measures

TIME = np.arange(10_000) * 1e-3


def test_a_straight_walk_is_judged_along_its_course():
    """Two seconds of standing, then 0.5 m/s with a bow of 0.3 m to the side that is gone at the end."""
    ahead = 0.5 * np.maximum(TIME - 2.0, 0.0)
    beside = 0.3 * np.sin(np.pi * TIME / TIME[-1])
    found = measures.course(TIME, np.stack((7.0 + ahead, 2.0 + beside), axis=1), (0.4, 0.0))
    assert found["distance"] == pytest.approx(ahead[-1])
    assert found["speed"] == pytest.approx(0.5, abs=1e-6), "the two seconds do not count"
    assert found["speed_error"] == pytest.approx(0.1, abs=1e-6)
    assert found["drift"] == pytest.approx(0.3, abs=1e-3), "the largest, and not that of the end"


def test_a_walk_to_the_side_drifts_forwards():
    track = np.stack((0.02 * TIME, 0.3 * TIME), axis=1)
    found = measures.course(TIME, track, (0.0, 0.3))
    assert found["speed"] == pytest.approx(0.3) and found["drift"] == pytest.approx(0.02 * TIME[-1])
    backwards = measures.course(TIME, -track, (0.0, 0.3))
    assert backwards["speed_error"] == pytest.approx(0.6), "the wrong way is no walk at this speed"


def test_a_walk_that_ends_at_once_has_no_speed():
    found = measures.course(np.zeros(1), np.zeros((1, 2)), (1.0, 0.0))
    assert np.isnan(found["speed_error"]) and found["drift"] == 0.0


def test_wander_is_the_farthest_point_from_the_start():
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    assert measures.wander(0.2 * np.stack((np.cos(angle), np.sin(angle)), axis=1)) == pytest.approx(0.4, abs=1e-3)


def test_turning_is_counted_over_full_circles():
    yaw = 3.0 + 1.2 * TIME
    zero = np.zeros_like(yaw)
    heading = measures.heading(np.stack((zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)), axis=1))
    found = measures.order_error(TIME, np.tile([0.03, -0.04], (len(TIME), 1)), heading, (0.0, 0.0, 1.0))
    assert found["yaw_rate"] == pytest.approx(1.2)
    assert found["yaw_error"] == pytest.approx(0.2)
    assert found["velocity_error"] == pytest.approx(0.05)


def feet(*offsets: float, frequency: float = 2.0, duty: float = 0.6) -> np.ndarray:
    """(1000, F) bool at 100 Hz of feet that touch down `offsets` of a stride after the first."""
    time = np.arange(1000)[:, None] * 0.01
    return (frequency * time - np.array([0.0, *offsets])) % 1.0 < duty


def test_a_trot_has_its_diagonal_feet_together_and_half_a_stride_apart():
    found = measures.contact_schedule(feet(0.5, 0.5, 0.0), 100.0)
    assert found.frequency == pytest.approx(2.0, rel=0.06)
    np.testing.assert_allclose(found.duty, 0.6, atol=0.01)
    np.testing.assert_allclose(found.phase[1:3], 0.5, atol=0.01)
    np.testing.assert_allclose(np.cos(2.0 * np.pi * found.phase[[0, 3]]), 1.0, atol=0.01)
    np.testing.assert_allclose(found.regularity, 1.0, atol=0.01)


def test_a_bounce_is_no_stride():
    contact = feet(0.5)
    contact[10:12] = True, False
    contact[30:980:50, 1] ^= True
    found = measures.contact_schedule(contact, 100.0)
    assert found.frequency == pytest.approx(2.0, rel=0.06)
    assert found.phase[1] == pytest.approx(0.5, abs=0.01)


def test_a_foot_that_never_steps_has_no_phase():
    contact = feet(0.5)
    contact[:, 1] = True
    found = measures.contact_schedule(contact, 100.0)
    assert found.duty[1] == 1.0 and np.isnan(found.phase[1])
    assert np.isnan(measures.contact_schedule(contact[:, ::-1], 100.0).phase).all(), "of a first foot without strides"


def steps(lift: float, touch_down: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(1000,) m and bool at 1 kHz: swings of 0.2 s between stances of 0.2 s, each ending `touch_down` higher."""
    part = np.arange(1000) % 400
    swing = part >= 200
    share = np.where(swing, (part - 200) / 200, 0.0)
    level = touch_down * (np.arange(1000) // 400)
    return level + swing * (lift * np.sin(np.pi * share) ** 2 + touch_down * share), ~swing


def test_clearance_is_that_of_the_laziest_foot():
    (high, on), (low, _) = steps(0.12), steps(0.05)
    found = measures.clearance(np.stack((high, low), axis=1), np.stack((on, on), axis=1), 1000.0)
    assert found == pytest.approx(0.05, abs=1e-3)


def test_lift_onto_a_step_is_counted_from_the_step():
    height, on = steps(0.12, touch_down=0.04)
    (lifts,) = measures.swing_lifts(height[:, None], on[:, None], 1000.0)
    assert len(lifts) == 2
    assert ((lifts > 0.08) & (lifts < 0.11)).all(), "over the higher foothold, 4 cm above the lower one"


def test_a_foot_that_bounces_does_not_swing():
    on = np.ones((1000, 1), dtype=bool)
    on[500:520] = False
    assert measures.swing_lifts(np.zeros((1000, 1)), on, 1000.0)[0].size == 0
    assert np.isnan(measures.clearance(np.zeros((1000, 1)), on, 1000.0))


def test_a_swing_that_the_record_cuts_does_not_count():
    on = np.ones((1000, 1), dtype=bool)
    on[:300] = on[700:] = False
    assert measures.swing_lifts(np.zeros((1000, 1)), on, 1000.0)[0].size == 0


def test_impact_is_of_one_foot_in_weights():
    force = np.zeros((1000, 2, 3))
    force[:, :, 2] = 500.0
    force[5, 1] = [0.0, 3000.0, 4000.0]
    found = measures.impact(force, 1000.0)
    assert found["peak_force"] == pytest.approx(5.0)
    assert found["force_p99"] == pytest.approx(0.5)


def test_share_at_limit_and_lean():
    value = np.array([[10.0, -4.0], [9.0, 5.0]])
    assert measures.share_at_limit(value, np.array([10.0, 5.0])) == 0.5
    tilted = np.array([[0.0, 0.0, -1.0], [np.sin(0.2), 0.0, -np.cos(0.2)]])
    assert measures.lean(tilted) == pytest.approx(0.2)


def test_the_estimator_is_held_against_the_truth_term_by_term():
    names = (
        *(f"base_linear_velocity/{axis}" for axis in "xyz"),
        *(f"gravity/{axis}" for axis in "xyz"),
        "base_height/z",
        "foot_contact/LF",
        "foot_contact/RF",
        "foot_height/RF",
    )
    count = 50
    truth = dict.fromkeys(names, np.zeros(count)) | {"gravity/z": -np.ones(count), "foot_contact/LF": np.ones(count)}
    told = np.zeros((count, len(names)))
    told[: count // 2, :2], told[count // 2 :, :2] = [0.3, 0.4], [0.3, -0.4]
    told[:, 3], told[:, 5] = 2.0 * np.sin(0.1), -2.0 * np.cos(0.1)  # a belief need not have length 1
    told[:, 6], told[:, 7], told[:, 9] = 0.02, 0.8, -0.03
    told[: count // 2, 8] = 0.6
    found = measures.estimator_error(names, told, truth)
    assert found["estimate_velocity"] == pytest.approx(0.5)
    assert found["estimate_velocity_bias"] == pytest.approx(0.3), "errors to either side cancel"
    assert found["estimate_tilt"] == pytest.approx(0.1)
    assert found["estimate_height"] == pytest.approx(0.02)
    assert found["estimate_foot_height"] == pytest.approx(0.03)
    assert found["estimate_contact"] == pytest.approx(0.25), "one of two feet, half of the time"


def test_what_is_not_told_has_no_error():
    found = measures.estimator_error(("base_height/z",), np.ones((3, 1)), {"base_height/z": np.ones(3)})
    assert found["estimate_height"] == 0.0
    assert {name for name, value in found.items() if value is None} == set(found) - {"estimate_height"}
