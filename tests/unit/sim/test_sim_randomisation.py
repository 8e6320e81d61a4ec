"""Families of robots: ranges, seeds, and that nothing else changes."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from hqpipe.errors import UsageError
from hqpipe.sim.engine import FRICTION
from hqpipe.sim.randomisation import KinematicsRandomisation, robot_variants

OFF = {name: 0.0 for name in ("link_length", "frame_offset", "frame_angle", "mass", "com", "friction")}


def numbers(urdf: str, path: str, key: str) -> np.ndarray:
    return np.array(
        [[float(v) for v in e.get(key, "0 0 0").split()] for e in ElementTree.fromstring(urdf).findall(path)]
    )


def test_without_randomisation_all_robots_are_the_urdf(robot):
    (variant,) = robot_variants(robot, None, seed=0)
    assert variant.urdf == robot.urdf.read_text(encoding="utf-8") and variant.friction == FRICTION


@pytest.mark.parametrize(
    ("size", "path", "key", "relative"),
    [
        ("link_length", "joint/origin", "xyz", True),
        ("frame_offset", "joint/origin", "xyz", False),
        ("frame_angle", "joint/origin", "rpy", False),
        ("mass", "link/inertial/mass", "value", True),
        ("com", "link/inertial/origin", "xyz", False),
    ],
)
def test_each_size_changes_its_own_numbers_within_its_range(robot, size, path, key, relative):
    original = robot.urdf.read_text(encoding="utf-8")
    before = numbers(original, path, key)
    changes = []
    for variant in robot_variants(robot, KinematicsRandomisation(variants=20, **{**OFF, size: 0.02}), seed=1):
        after = numbers(variant.urdf, path, key)
        known = before != 0.0 if relative else np.ones_like(after, dtype=bool)
        change = (after - before)[known]
        changes.append(change / before[known] if relative else change)
        for other_path, other_key in (
            ("joint/origin", "xyz"),
            ("link/inertial/mass", "value"),
            ("joint/limit", "lower"),
        ):
            if (other_path, other_key) != (path, key):
                np.testing.assert_array_equal(
                    numbers(variant.urdf, other_path, other_key), numbers(original, other_path, other_key)
                )
    spread = np.concatenate(changes)
    assert 0.015 < np.abs(spread).max() <= 0.02 + 1e-12
    assert abs(spread.mean()) < 0.004


def test_inertia_scales_with_mass(robot):
    original = robot.urdf.read_text(encoding="utf-8")
    (variant,) = robot_variants(robot, KinematicsRandomisation(variants=1, **{**OFF, "mass": 0.1}), seed=0)
    ratios = [
        numbers(variant.urdf, path, key) / numbers(original, path, key)
        for path, key in (("link/inertial/mass", "value"), ("link/inertial/inertia", "ixx"))
    ]
    np.testing.assert_allclose(*ratios, rtol=1e-12)


def test_friction_stays_in_its_range(robot):
    sizes = KinematicsRandomisation(variants=50, **{**OFF, "friction": 0.25})
    values = [variant.friction for variant in robot_variants(robot, sizes, seed=0)]
    assert 0.6 <= min(values) < 0.65 and 0.95 < max(values) <= 1.0


def test_a_variant_depends_on_seed_and_number_only(robot):
    few, many, other = (
        robot_variants(robot, KinematicsRandomisation(variants=n), seed) for n, seed in ((2, 0), (5, 0), (2, 1))
    )
    assert few == many[:2] and few[0] != few[1] and few[0] != other[0]


def test_environments_take_turns(make_world, engine, robot):
    world = make_world(5, engine=engine, randomisation=KinematicsRandomisation(variants=2))
    feet = world.state.foot_position
    np.testing.assert_allclose(feet[0], feet[2], atol=1e-12)
    np.testing.assert_allclose(feet[1], feet[3], atol=1e-12)
    assert np.abs(feet[0] - feet[1]).max() > 1e-3


@pytest.mark.parametrize("wrong", [{"variants": 0}, {"mass": -0.1}, {"link_length": 1.0}])
def test_senseless_sizes_are_refused(wrong):
    with pytest.raises(UsageError, match=next(iter(wrong))):
        KinematicsRandomisation(**wrong)
