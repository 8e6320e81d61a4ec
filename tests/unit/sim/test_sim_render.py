"""Pictures: the right size, the robot in them, and its motion."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.sim.render import Camera, Renderer

STANDING = ([0.0, 0.0, 0.877], [0.0, 0.0, 0.0, 1.0])


@pytest.fixture
def draw(robot):
    renderers = []

    def open_(**options) -> Renderer:
        renderers.append(Renderer(robot, width=160, height=120, **options))
        return renderers[-1]

    yield open_
    for renderer in renderers:
        renderer.close()


def trunk(image: np.ndarray) -> np.ndarray:
    """Pixels in the trunk's dark blue."""
    red, _, blue = np.moveaxis(image.astype(int), -1, 0)
    return (blue - red > 15) & (red < 100)


def test_the_robot_fills_the_middle_of_the_picture(draw, robot):
    image = draw().frame(*STANDING, robot.nominal_position)
    assert image.shape == (120, 160, 3) and image.dtype == np.uint8
    rows, columns = np.nonzero(trunk(image))
    assert 0.04 < len(rows) / trunk(image).size < 0.4
    assert 50 < columns.mean() < 110 and 25 < rows.mean() < 75


def test_sky_above_and_floor_below(draw, robot):
    image = draw().frame(*STANDING, robot.nominal_position)
    assert image[0].mean() > image[-1].mean() > 150
    assert np.ptp(image[0], axis=0).max() <= 1 and np.ptp(image[-1], axis=0).max() > 5


def test_the_same_state_gives_the_same_picture(draw, robot):
    frames = [draw().frame(*STANDING, robot.nominal_position) for _ in range(2)]
    np.testing.assert_array_equal(*frames)


def test_a_joint_that_moves_is_seen(draw, robot):
    renderer = draw()
    bent = robot.nominal_position.copy()
    bent[2] -= 0.8
    before, after = (renderer.frame(*STANDING, q) for q in (robot.nominal_position, bent))
    assert (before != after).any(axis=-1).sum() > 50


def test_the_camera_follows_and_the_floor_shows_the_motion(draw, robot):
    renderer = draw()
    here = renderer.frame(*STANDING, robot.nominal_position)
    there = renderer.frame([0.6, 0.0, 0.877], [0.0, 0.0, 0.0, 1.0], robot.nominal_position)
    np.testing.assert_array_equal(trunk(here), trunk(there))
    assert (here != there).any(axis=-1).sum() > 100


def test_a_camera_from_the_side_sees_the_whole_length(draw, robot):
    side = draw(camera=Camera(azimuth=90.0, elevation=0.0)).frame(*STANDING, robot.nominal_position)
    front = draw(camera=Camera(azimuth=0.0, elevation=0.0)).frame(*STANDING, robot.nominal_position)
    width = [np.ptp(np.nonzero(trunk(image))[1]) for image in (side, front)]
    assert width[0] > 2.5 * width[1]
