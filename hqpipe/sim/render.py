"""Pictures of the robot for figures and video frames.

pybullet's software renderer draws the robot, so that no graphics library is needed; the floor is drawn here, by casting
a ray through every pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.robots import RobotSpec
from hqpipe.sim.engine import FRICTION, robot_setup
from hqpipe.sim.frames import com_from_base
from hqpipe.sim.pybullet_robot import load_robot_into, open_world, pybullet

SKY = (0.93, 0.95, 0.97)  # colours are red, green, blue in 0 … 1
FLOOR_LIGHT, FLOOR_DARK = (0.80, 0.82, 0.84), (0.72, 0.745, 0.77)
TILE = 1.0  # m, edge of a floor tile: lets the eye see speed
LIGHT = (3.0, 4.0, 7.0)  # m, towards the light, relative to the robot
NEAR, FAR = 0.1, 40.0  # m, planes of the view frustum
HAZE = 9.0  # m, distance at which the floor fades into the sky by 1 − 1/e
SHADOW_RADIUS, SHADOW_DEPTH = 0.22, 0.35  # m and share of the light, soft shadow below a foot


@dataclass(frozen=True)
class Camera:
    """Looks at the ground below the base and follows it.

    Attributes:
        distance: from the point looked at, m.
        azimuth: of the viewer about world z, degrees; 0 looks at the robot's front when it heads along +x.
        elevation: of the viewer above the horizon, degrees.
        height: of the point looked at, m.
        field_of_view: vertical, degrees.
    """

    distance: float = 3.4
    azimuth: float = 38.0
    elevation: float = 16.0
    height: float = 0.52
    field_of_view: float = 42.0


class Renderer:
    """Draws one robot.

    Args:
        width, height: pixels.
    """

    def __init__(self, robot: RobotSpec, *, width: int = 640, height: int = 480, camera: Camera | None = None) -> None:
        camera = camera or Camera()
        self._size, self._camera = (width, height), camera
        self._client, floor = open_world()
        pybullet.removeBody(floor, physicsClientId=self._client)
        place = (0.0, 0.0, robot.nominal_height)
        self._robot = load_robot_into(self._client, robot_setup(robot), robot.urdf, FRICTION, place)
        self._projection = pybullet.computeProjectionMatrixFOV(camera.field_of_view, width / height, NEAR, FAR)

    def frame(self, base_position: np.ndarray, base_orientation: np.ndarray, joint_position: np.ndarray) -> np.ndarray:
        """Draw a state.

        Args:
            base_position: (3,) m.
            base_orientation: (4,) quaternion x, y, z, w.
            joint_position: (J,) rad in the order of RobotSpec.joints.

        Returns:
            (height, width, 3) uint8, red, green, blue.
        """
        self._pose(base_position, base_orientation, joint_position)
        camera, (width, height) = self._camera, self._size
        target = (float(base_position[0]), float(base_position[1]), camera.height)
        # pybullet's yaw turns the camera about z from looking along +y.
        view = pybullet.computeViewMatrixFromYawPitchRoll(
            target, camera.distance, camera.azimuth + 90.0, -camera.elevation, 0.0, 2
        )
        _, _, pixels, _, segments = pybullet.getCameraImage(
            width,
            height,
            view,
            self._projection,
            lightDirection=LIGHT,
            shadow=0,
            lightAmbientCoeff=0.55,
            lightDiffuseCoeff=0.5,
            lightSpecularCoeff=0.05,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )
        image = np.asarray(pixels, dtype=np.uint8).reshape(height, width, 4)[..., :3]
        empty = np.asarray(segments).reshape(height, width, 1) < 0
        return np.where(empty, self._background(np.reshape(view, (4, 4)).T), image)

    def _background(self, view: np.ndarray) -> np.ndarray:
        """(H, W, 3) uint8: tiled floor with soft shadows below the feet, fading into the sky."""
        (width, height), tangent = self._size, np.tan(np.radians(self._camera.field_of_view) / 2.0)
        x = (np.arange(width) + 0.5 - width / 2.0) / (height / 2.0) * tangent
        y = (height / 2.0 - np.arange(height) - 0.5) / (height / 2.0) * tangent
        rotation = view[:3, :3].T  # columns: right, up and back of the camera in the world
        eye = -rotation @ view[:3, 3]
        ray = x[None, :, None] * rotation[:, 0] + y[:, None, None] * rotation[:, 1] - rotation[:, 2]
        down = np.minimum(ray[..., 2], -1e-6)
        distance = -eye[2] / down
        floor = eye[:2] + distance[..., None] * ray[..., :2]
        odd = np.floor(floor / TILE).astype(np.int64).sum(axis=-1) % 2 == 1
        colour = np.where(odd[..., None], FLOOR_DARK, FLOOR_LIGHT) * self._shade(floor)[..., None]
        clear = np.where(ray[..., 2] < 0.0, np.exp(-((distance / HAZE) ** 2)), 0.0)[..., None]
        return np.round(255.0 * (clear * colour + (1.0 - clear) * np.array(SKY))).astype(np.uint8)

    def _shade(self, floor: np.ndarray) -> np.ndarray:
        """Share of the light that reaches floor points (..., 2) m; a lifted foot's shadow is fainter."""
        light = np.ones(floor.shape[:-1])
        feet = pybullet.getLinkStates(
            self._robot.body, self._robot.feet, computeForwardKinematics=1, physicsClientId=self._client
        )
        for foot in feet:
            x, y, z = foot[4]
            square = ((floor - (x, y)) ** 2).sum(axis=-1) / SHADOW_RADIUS**2
            light *= 1.0 - SHADOW_DEPTH * np.exp(-square - max(z, 0.0) / SHADOW_RADIUS)
        return light

    def _pose(self, position: np.ndarray, orientation: np.ndarray, joints: np.ndarray) -> None:
        pose, twist, still = np.zeros(7), np.zeros(6), np.zeros(3)
        com_from_base(
            self._robot.inertial,
            np.asarray(position, dtype=float),
            np.asarray(orientation, dtype=float),
            still,
            still,
            pose,
            twist,
        )
        body, client = self._robot.body, self._client
        pybullet.resetBasePositionAndOrientation(body, pose[:3], pose[3:], physicsClientId=client)
        for link, angle in zip(self._robot.joints, joints, strict=True):
            pybullet.resetJointState(body, link, float(angle), physicsClientId=client)

    def close(self) -> None:
        """Free pybullet's world."""
        pybullet.disconnect(physicsClientId=self._client)
