"""One robot body in MuJoCo, driven by joint torques: the rigid-body half of the reference plant.

Nothing here knows of hydraulics. The state is read in the order of `RobotSpec.joints` and `RobotSpec.feet`.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)
from hqpipe.errors import ConfigError, near_match
from hqpipe.robots import RobotSpec
from hqpipe.sim.body_changes import BodyChanges, Ground, LinkChange
from hqpipe.sim.mujoco_refusal import named

GRAVITY = 9.81  # m/s², standard gravity to three digits
GANTRY_HEIGHT = 1.6  # m, base above ground when welded: the feet hang free at every pose
IMPEDANCE = 0.9  # MuJoCo's d, constant over penetration so that the static stiffness is linear; assumption
IMPEDANCE_RATIO = 30.0  # friction 30 times stiffer than the normal direction: a loaded foot does not creep; assumption
SPIN_ROLL_FRICTION = (0.005, 0.0001)  # m, MuJoCo's defaults; unused by 3-dimensional contacts
PAYLOAD_EDGE = 0.3  # m, a payload is a cube of this edge; assumption
HFIELD_HALF_SIZE = (25.0, 8.0)  # m, half extent of uneven ground
HFIELD_CELL = 0.25  # m, grid spacing of uneven ground; assumption


class MujocoBody:
    """The robot on its floor, or its trunk welded to a gantry.

    Args:
        robot: gives URDF, joint and foot order.
        base: "floating" or "fixed".
        timestep: s.
        changes: floor, payloads and link errors.

    Raises:
        ConfigError: unknown base or link.
    """

    def __init__(
        self,
        robot: RobotSpec,
        *,
        base: str = "floating",
        timestep: float = 5.0e-4,
        changes: BodyChanges | None = None,
    ) -> None:
        if base not in ("floating", "fixed"):
            raise ConfigError(
                f"base: expected 'floating' or 'fixed', got '{base}'{near_match(base, ('floating', 'fixed'))}",
                field="base",
            )
        changes = changes or BodyChanges()
        self.robot, self.floating, self.ground = robot, base == "floating", changes.ground
        self._model = _compile(robot, self.floating, timestep, changes)
        self._data = mujoco.MjData(self._model)
        joint_ids = [self._model.joint(name).id for name in robot.joints]
        self._qpos = _as_slice(self._model.jnt_qposadr[joint_ids])
        self._dof = _as_slice(self._model.jnt_dofadr[joint_ids])
        self._index_geoms()
        self._velocity_mark, self._time_mark = np.zeros(3), 0.0
        self.reset(robot.nominal_position)

    def _index_geoms(self) -> None:
        model = self._model
        self._base_id = model.body(self.robot.base_link).id
        feet = [model.body(name).id for name in self.robot.foot_links]
        shanks = {model.body(name).id for name in self.robot.shank_links}
        self._foot_of_geom = np.full(model.ngeom, -1)
        self._may_touch = np.zeros(model.ngeom, dtype=bool)
        for geom, body in enumerate(model.geom_bodyid):
            if body in feet:
                self._foot_of_geom[geom] = feet.index(body)
            self._may_touch[geom] = body in feet or body in shanks
        self._floor = model.geom("floor").id

    @property
    def timestep(self) -> float:
        return self._model.opt.timestep

    @property
    def mass(self) -> float:
        """Total mass with payloads, kg."""
        return float(self._model.body_mass.sum())

    @property
    def joint_position(self) -> np.ndarray:
        """(J,) rad, a copy."""
        return self._data.qpos[self._qpos].copy()

    @property
    def joint_velocity(self) -> np.ndarray:
        """(J,) rad/s, a copy."""
        return self._data.qvel[self._dof].copy()

    @property
    def base_position(self) -> np.ndarray:
        """(3,) m, world, a copy."""
        return self._data.qpos[:3].copy() if self.floating else self._model.body_pos[self._base_id].copy()

    @property
    def base_orientation(self) -> np.ndarray:
        """(4,) unit quaternion x, y, z, w of the base in the world."""
        quat = self._data.qpos[3:7] if self.floating else self._model.body_quat[self._base_id]
        return quat[[1, 2, 3, 0]]

    @property
    def base_linear_velocity(self) -> np.ndarray:
        """(3,) m/s, world."""
        return self._data.qvel[:3].copy() if self.floating else np.zeros(3)

    @property
    def base_angular_velocity(self) -> np.ndarray:
        """(3,) rad/s, base frame."""
        return self._data.qvel[3:6].copy() if self.floating else np.zeros(3)

    def reset(self, position: np.ndarray, yaw: float = 0.0, clearance: float = 0.0) -> None:
        """Place the robot at rest.

        Args:
            position: (J,) joint angles, rad.
            yaw: heading, rad; a floating base also lies along the slope.
            clearance: m that the base is put above its nominal height along the ground's normal.
        """
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[self._qpos] = position
        if self.floating:
            tilt = _slope_quaternion(self.ground)
            heading, orientation, up = np.zeros(4), np.zeros(4), np.zeros(3)
            mujoco.mju_axisAngle2Quat(heading, np.array([0.0, 0.0, 1.0]), yaw)
            mujoco.mju_mulQuat(orientation, tilt, heading)
            mujoco.mju_rotVecQuat(up, np.array([0.0, 0.0, 1.0]), tilt)
            height = self.robot.nominal_height + clearance + 0.5 * self.ground.roughness
            self._data.qpos[:3], self._data.qpos[3:7] = height * up, orientation
        mujoco.mj_forward(self._model, self._data)
        self._placed = self._data.qpos[:7].copy()
        self._velocity_mark, self._time_mark = self.base_linear_velocity, 0.0

    def hold_base(self) -> None:
        """Put a floating base back where `reset` placed it, at rest: it hangs there until it is held no more."""
        if self.floating:
            self._data.qpos[:7], self._data.qvel[:6] = self._placed, 0.0

    def step(self, torque: np.ndarray, push: np.ndarray | None = None) -> None:
        """Advance one timestep.

        Args:
            torque: (J,) N·m on the joints, held over the step.
            push: (3,) N on the base's centre of mass, world frame; None for none. A fixed base does not feel it.
        """
        self._data.qfrc_applied[self._dof] = torque
        self._data.xfrc_applied[self._base_id, :3] = 0.0 if push is None else push
        mujoco.mj_step(self._model, self._data)

    def imu_acceleration(self) -> np.ndarray:
        """(3,) m/s², base frame, gravity included: the mean since the last call (delta-velocity)."""
        velocity, elapsed = self.base_linear_velocity, self._data.time - self._time_mark
        change = (velocity - self._velocity_mark) / elapsed if elapsed > 0 else np.zeros(3)
        self._velocity_mark, self._time_mark = velocity, self._data.time
        x, y, z, w = self.base_orientation
        specific, result = change + np.array([0.0, 0.0, GRAVITY]), np.zeros(3)
        mujoco.mju_rotVecQuat(result, specific, np.array([w, -x, -y, -z]))
        return result

    def contacts(self) -> tuple[np.ndarray, bool]:
        """Read the contacts of the last step.

        Returns:
            (F,3) N, the force of the ground on each foot in the world frame, and whether anything but a foot
            or a shank touches the ground.
        """
        force, contact = np.zeros((len(self.robot.feet), 3)), self._data.contact
        if self._data.ncon == 0:
            return force, False
        geoms, rows, frames = contact.geom, contact.efc_address, contact.frame
        illegal = _sum_contacts(
            geoms, rows, frames, self._data.efc_force, self._foot_of_geom, self._may_touch, self._floor, force
        )
        return force, illegal

    def energy(self) -> tuple[float, float]:
        """Potential and kinetic energy of the body, J."""
        mujoco.mj_energyPos(self._model, self._data)
        mujoco.mj_energyVel(self._model, self._data)
        return float(self._data.energy[0]), float(self._data.energy[1])


@njit(cache=True)
def _sum_contacts(geoms, rows, frames, constraint_force, foot_of_geom, may_touch, floor, force) -> bool:
    """Add up the forces on the feet, (F,3) N in the world, in place; return whether another part touches."""
    illegal = False
    for k in range(len(rows)):
        floor_first = geoms[k, 0] == floor
        geom = geoms[k, 1] if floor_first else geoms[k, 0]
        illegal |= not may_touch[geom]
        foot = foot_of_geom[geom]
        if foot < 0 or rows[k] < 0:
            continue
        sign = 1.0 if floor_first else -1.0  # the contact frame points from the first geom to the second
        for axis in range(3):
            for i in range(3):
                force[foot, axis] += sign * constraint_force[rows[k] + i] * frames[k, 3 * i + axis]
    return illegal


def _as_slice(addresses: np.ndarray) -> slice | np.ndarray:
    """The same addresses as a slice where they are consecutive: reading is several times faster."""
    if (np.diff(addresses) == 1).all():
        return slice(int(addresses[0]), int(addresses[-1]) + 1)
    return addresses


def _slope_quaternion(ground: Ground) -> np.ndarray:
    """(4,) w, x, y, z that tilts the floor so that it rises towards `slope_heading`."""
    axis = np.array([np.sin(ground.slope_heading), -np.cos(ground.slope_heading), 0.0])
    quat = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quat, axis, ground.slope)
    return quat


def _compile(robot: RobotSpec, floating: bool, timestep: float, changes: BodyChanges) -> mujoco.MjModel:
    fix = "correct what it names, or the section `body` of the plant"
    with named(robot.urdf, fix):
        spec = mujoco.MjSpec.from_file(str(robot.urdf))
    spec.compiler.fusestatic = False  # fusing would merge the feet into the shanks
    spec.option.timestep, spec.option.gravity = timestep, [0.0, 0.0, -GRAVITY]
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, IMPEDANCE_RATIO
    for geom in spec.geoms:  # the robot collides with the floor only
        geom.contype, geom.conaffinity = 1, 0
    base = spec.body(robot.base_link)
    if floating:
        base.add_freejoint(name="base")
    else:
        base.pos = [0.0, 0.0, GANTRY_HEIGHT]
    for name, change in changes.links.items():
        _change_link(_link(spec, name), change)
    for number, payload in enumerate(changes.payloads):
        inertia = payload.mass * PAYLOAD_EDGE**2 / 6.0  # solid cube
        _link(spec, payload.link).add_body(
            name=f"payload_{number}",
            pos=payload.com,
            mass=payload.mass,
            inertia=[inertia] * 3,
            explicitinertial=True,
        )
    _add_floor(spec, changes.ground)
    with named(robot.urdf, fix):
        model = spec.compile()
    _set_contact_stiffness(model, robot, changes.ground)
    return model


def _link(spec: mujoco.MjSpec, name: str) -> mujoco.MjsBody:
    body = spec.body(name)
    if body is None or name == "world":
        known = [other.name for other in spec.bodies if other.name != "world"]
        raise ConfigError(
            f"plant.body: no link '{name[:80]}'{near_match(name, known)} (known: {', '.join(known)})",
            field="plant.body",
            fix="name a link of robot.urdf",
        )
    return body


def _change_link(body: mujoco.MjsBody, change: LinkChange) -> None:
    body.mass *= change.mass_scale
    body.ipos = np.asarray(body.ipos) + np.asarray(change.com_offset)
    scale = change.mass_scale * change.inertia_scale
    if np.isfinite(body.fullinertia[0]):
        body.fullinertia = np.asarray(body.fullinertia) * scale
    else:
        body.inertia = np.asarray(body.inertia) * scale


def _add_floor(spec: mujoco.MjSpec, ground: Ground) -> None:
    friction = [ground.friction, *SPIN_ROLL_FRICTION]
    floor = spec.worldbody.add_geom(name="floor", friction=friction, condim=3, quat=_slope_quaternion(ground))
    floor.contype, floor.conaffinity, floor.priority = 0, 1, 1
    if ground.roughness <= 0.0:
        floor.type, floor.size = mujoco.mjtGeom.mjGEOM_PLANE, [0.0, 0.0, 1.0]
        return
    rows, columns = (int(2 * half / HFIELD_CELL) + 1 for half in reversed(HFIELD_HALF_SIZE))
    heights = np.random.default_rng(ground.roughness_seed).random((rows, columns))
    spec.add_hfield(
        name="floor",
        nrow=rows,
        ncol=columns,
        size=[*HFIELD_HALF_SIZE, ground.roughness, 0.5],
        userdata=heights.ravel().tolist(),
    )
    floor.type, floor.hfieldname = mujoco.mjtGeom.mjGEOM_HFIELD, "floor"
    floor.pos = -0.5 * ground.roughness * np.array([0.0, 0.0, 1.0])


def _set_contact_stiffness(model: mujoco.MjModel, robot: RobotSpec, ground: Ground) -> None:
    """Turn N/m into MuJoCo's reference acceleration.

    With a constant impedance d the constraint force is (k/d·r)/R with R = (1 − d)/d · A, A the foot's inverse
    weight (MuJoCo documentation, "Computation", solver parameters): K = k / ((1 − d) A).
    """
    inverse_weight = model.body(robot.foot_links[0]).invweight0[0]
    stiffness = ground.stiffness * (1.0 - IMPEDANCE) * inverse_weight  # 1/s²
    floor = model.geom("floor")
    floor.solref = [-stiffness, -2.0 * ground.damping_ratio * np.sqrt(stiffness)]
    floor.solimp = [IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0]
