"""The reference plant: what stands in for the real machine.

A firmware tick of 1 ms is two body steps of 0.5 ms, each followed by ten hydraulic substeps of 0.05 ms. The
body steps under the torque that stands at the start of the step; the hydraulics then follow the joint motion
which that step produced, so that angles never disagree and a chain as a spring is integrated symplectically.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.errors import UsageError, near_match
from hqpipe.plant import firmware, hydraulics, sensors
from hqpipe.plant.config import PlantConfig
from hqpipe.plant.disturbance import Disturbance, Outside
from hqpipe.plant.parameters import SUBSTEP, Parameters, build_schedule, check_stability
from hqpipe.plant.run import run_trial
from hqpipe.plant.trial import PlantTrial
from hqpipe.robots import RobotSpec
from hqpipe.sim.mujoco_body import MujocoBody

TICK = 1.0e-3  # s, firmware period: the paper records and controls joints at 1000 Hz
BODY_STEP = 5.0e-4  # s
SETTLE_TIME = {"floating": 1.0, "fixed": 0.4}  # s before the trial in which the firmware takes up the weight
RING = 512  # ticks of command and samples of sensor history kept: longer than any delay the schema allows
FALL_TILT = 1.0  # rad of base tilt that counts as a fall


@dataclass(frozen=True)
class SensorFrame:
    """What the control computer receives at one tick.

    Attributes:
        time: s since the start of the trial.
        q, qd, effort: (J,) measured rad, rad/s, N·m.
        gyro: (3,) rad/s in the base frame.
        orientation: (4,) unit quaternion x, y, z, w from the attitude filter.
        accel: (3,) m/s² in the base frame, gravity included.
        pressure_a, pressure_b: (J,) Pa.
        supply_pressure: Pa.
    """

    time: float
    q: np.ndarray
    qd: np.ndarray
    effort: np.ndarray
    gyro: np.ndarray
    orientation: np.ndarray
    accel: np.ndarray
    pressure_a: np.ndarray
    pressure_b: np.ndarray
    supply_pressure: float


class Plant:
    """Hydraulic quadruped with firmware and sensors.

    Args:
        robot: geometry, limits and the `hydraulics` section.
        config: what is different on this machine; None for a sound one.
        seed: of all noise.
        base: "floating" or "fixed" (trunk welded to a gantry).
        substep: hydraulic integration step, s; 0.5 ms must be a multiple.

    Raises:
        ConfigError: the configuration or robot.yaml is wrong.
    """

    def __init__(
        self,
        robot: RobotSpec,
        config: PlantConfig | None = None,
        seed: int = 0,
        base: str = "floating",
        substep: float = SUBSTEP,
    ) -> None:
        config = config or PlantConfig()
        self.robot, self.config, self.base, self._seed = robot, config, base, seed
        self.schedule = build_schedule(robot, config)
        self.effort_source = config.effort_source
        self.body = MujocoBody(robot, base=base, timestep=BODY_STEP, changes=config.body_changes())
        substeps = round(BODY_STEP / substep)
        self._clock = np.array([0.0, substep, TICK, substeps])
        if substeps < 1 or abs(substeps * substep - BODY_STEP) > 1e-9:
            raise UsageError(f"substep: expected a divisor of {BODY_STEP} s, got {substep}")
        check_stability(self.schedule, robot, substep)
        legs = [[i for i, name in enumerate(robot.joints) if name.startswith(foot)] for foot in robot.feet]
        self._neighbour = np.arange(len(robot.joints))
        for leg in legs:
            self._neighbour[leg] = np.roll(leg, 1)
        self.reset()

    def reset(self, position: np.ndarray | None = None, yaw: float = 0.0, clearance: float = 0.0) -> None:
        """Stand at a pose with settled pressures, the firmware holding, at time 0.

        Args:
            position: (J,) rad, the nominal pose if None.
            yaw: heading, rad.
            clearance: m; above 0 the trunk is held this much higher until time 0, and then let go.
        """
        joints = len(self.robot.joints)
        pose = self.robot.nominal_position if position is None else np.asarray(position, dtype=float)
        self._rng = np.random.default_rng(self._seed)
        self._noise_rows, self._noise = 0, np.empty((0, 0))
        self._pending, self._active = list(self.schedule), self.schedule[0]
        self.state = np.zeros(joints, hydraulics.STATE)
        self.ledger = np.zeros(joints, hydraulics.LEDGER)
        self.supply = np.zeros(1, hydraulics.SUPPLY)
        self._reading = np.zeros(joints, sensors.READING)
        self._memory = np.zeros(joints, firmware.MEMORY)
        self._commands, self._targets = np.zeros((RING, joints)), np.tile(pose, (RING, 1))
        self._history, self._head = np.zeros((RING, sensors.CHANNELS, joints)), 0
        self._valve, self._mode, self._drop_until = np.zeros(joints), "position", -np.inf
        self._frame: SensorFrame | None = None
        self._tick = -round(SETTLE_TIME[self.base] / TICK)
        self._switch_parameters()
        self.body.reset(pose, yaw, clearance)
        machine = self._active.machine
        half = 0.5 * (machine["supply_pressure"] + machine["supply_return_pressure"])
        self.supply["pressure"] = machine["supply_pressure"]
        filled = np.repeat(half, joints)
        hydraulics.settle(self._active.joint, machine, self.state, self.body.joint_position, filled, filled, self.time)
        self._remember()
        self._history[:] = self._history[self._head]
        while self._tick < 0:
            self.step(pose)
            if clearance > 0.0:
                self.body.hold_base()
        self.ledger[:] = 0.0
        for name in ("pump", "relief", "drawn", "returned"):
            self.supply[name] = 0.0

    @property
    def time(self) -> float:
        """s since the start of the trial; negative while it settles."""
        return self._tick * TICK

    @property
    def parameters(self) -> Parameters:
        """What holds now."""
        return self._active

    @property
    def valve_command(self) -> np.ndarray:
        """(J,) −1…1, of the last tick."""
        return self._valve

    @property
    def effort_logged(self) -> np.ndarray:
        """(J,) N·m, as the logger gets it at this tick."""
        return self._reading["effort_logged"].copy()

    @property
    def interface_error(self) -> float:
        """J that the body took up beyond what the hydraulics gave, since the start of the trial."""
        return float((self.ledger["body_work"] - self.ledger["joint_work"]).sum())

    @property
    def oil_temperature(self) -> float:
        """°C."""
        machine = self._active.machine[0]
        return float(machine["fluid_temperature"] + machine["fluid_heating_rate"] * max(self.time, 0.0))

    def sense(self) -> SensorFrame:
        """The sensor frame of this tick; asking twice gives the same frame."""
        if self._frame is None:
            self._frame = self._sense()
        return self._frame

    def _sense(self) -> SensorFrame:
        joints, machine = len(self.robot.joints), self._active.machine[0]
        noise = self._draw_noise(joints * sensors.CHANNELS + 10)
        reading = self._reading
        sensors.read_joints(
            self._active.joint,
            reading,
            self.body.joint_position,
            self._history,
            self._head,
            BODY_STEP,
            TICK,
            self.effort_source == "load_cell",
            noise[: joints * sensors.CHANNELS].reshape(joints, sensors.CHANNELS),
        )
        gyro, accel, attitude, manifold = noise[-10:-7], noise[-7:-4], noise[-4:-1], noise[-1]
        pressure_noise = self._active.joint["sensors_pressure_noise"][0]
        return SensorFrame(
            time=self.time,
            q=reading["position"].copy(),
            qd=reading["velocity"].copy(),
            effort=reading["effort_logged"].copy(),
            gyro=self.body.base_angular_velocity + machine["imu_gyro_noise"] * gyro + machine["imu_gyro_bias"],
            orientation=_rotate_slightly(self.body.base_orientation, machine["imu_orientation_noise"] * attitude),
            accel=self.body.imu_acceleration() + machine["imu_accelerometer_noise"] * accel,
            pressure_a=reading["pressure_a"].copy(),
            pressure_b=reading["pressure_b"].copy(),
            supply_pressure=float(self.supply["pressure"][0] + self.ripple + pressure_noise * manifold),
        )

    @property
    def ripple(self) -> float:
        """Pa that the pump's pulsation adds to the supply pressure now."""
        machine = self._active.machine[0]
        phase = 2.0 * np.pi * machine["supply_ripple_hz"] * self.time
        return float(machine["supply_ripple_pressure"] * np.sin(phase))

    def _draw_noise(self, count: int) -> np.ndarray:
        """The next (count,) standard normal numbers, drawn 256 ticks at a time."""
        if self._noise_rows == len(self._noise):
            self._noise, self._noise_rows = self._rng.standard_normal((256, count)), 0
        self._noise_rows += 1
        return self._noise[self._noise_rows - 1]

    def step(self, target: np.ndarray, mode: str = "position", outside: Outside | None = None) -> None:
        """One firmware tick of 1 ms.

        Args:
            target: (J,) joint angles rad, torques N·m, or valve commands −1…1, by `mode`.
            mode: "position", "torque" or "valve".
            outside: what acts on the body beside hydraulics and floor, held over the tick.

        Raises:
            UsageError: unknown mode, or a target of the wrong shape or not finite.
        """
        if mode not in firmware.MODES:
            hint = near_match(mode, firmware.MODES)
            raise UsageError(f"mode: expected one of {', '.join(firmware.MODES)}, got '{mode}'{hint}")
        target = np.asarray(target, dtype=float)
        if target.shape != (len(self.robot.joints),) or not np.isfinite(target).all():
            raise UsageError(f"target: expected {len(self.robot.joints)} finite numbers, got {target!r}")
        self._switch_parameters()
        self.sense()
        if mode != self._mode:
            self._mode, self._memory[:] = mode, np.zeros(1, firmware.MEMORY)
            self._targets[:] = target
        row = self._tick % RING
        self._targets[row] = self._targets[(self._tick - 1) % RING] if self._frame_dropped() else target
        firmware.firmware_tick(
            self._active.joint,
            self._memory,
            self._reading,
            self._targets,
            self._tick,
            TICK,
            firmware.MODES[mode],
            self._valve,
        )
        self._commands[row] = self._valve
        for number in range(round(TICK / BODY_STEP)):
            self._advance(self.time + number * BODY_STEP, outside)
        self._tick += 1
        self._frame = None

    def _frame_dropped(self) -> bool:
        """Whether this tick's command frame is lost; bursts come as a Poisson process."""
        machine = self._active.machine[0]
        if machine["bus_drop_rate"] == 0.0:
            return False
        if self.time >= self._drop_until and self._rng.random() < machine["bus_drop_rate"] * TICK:
            self._drop_until = self.time + machine["bus_drop_duration"]
        return self.time < self._drop_until

    def _advance(self, time: float, outside: Outside | None) -> None:
        """One body step and the hydraulic substeps that follow its motion."""
        first = self.body.joint_position
        if outside is None:
            self.body.step(self.state["torque"])
        else:
            self.body.step(self.state["torque"] + outside.torque, outside.force)
        self._clock[0] = time
        hydraulics.advance(
            self._active.joint,
            self._active.machine,
            self.state,
            self.ledger,
            self.supply,
            self._commands,
            self._neighbour,
            first,
            self.body.joint_position,
            self.body.joint_velocity,
            self._clock,
        )
        self._remember()

    def _remember(self) -> None:
        self._head = (self._head + 1) % RING
        row = self._history[self._head]
        for channel, name in enumerate(("pressure_a", "pressure_b", "tension_a", "tension_b")):
            row[channel] = self.state[name]

    def _switch_parameters(self) -> None:
        """Take up the parameters of this time; pressures stay as they are."""
        switched = False
        while self._pending and self._pending[0].start <= self.time + 1e-9:
            self._active, switched = self._pending.pop(0), True
        if switched:
            hydraulics.refill(self._active.joint, self._active.machine, self.state, self.time)

    def run(
        self,
        controller: Callable[[SensorFrame, dict[str, float]], np.ndarray],
        duration: float,
        command: dict[str, float] | Callable[[float], dict[str, float]] | None = None,
        control_period_s: float = 0.01,
        mode: str = "position",
        targets: str | None = None,
        disturbances: Sequence[Disturbance] = (),
        stop_at_fall: bool = True,
    ) -> PlantTrial:
        """Run a controller and record; see `hqpipe.plant.run.run_trial`."""
        return run_trial(
            self, controller, duration, command, control_period_s, mode, targets, disturbances, stop_at_fall
        )

    @property
    def heading(self) -> float:
        """rad to the left of world x, of the trunk's forward axis over the ground."""
        x, y, z, w = self.body.base_orientation
        return float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))

    def has_fallen(self, illegal_contact: bool) -> bool:
        """Whether the trunk, a hip or a thigh touches the ground, or the base lies over."""
        x, y, _, _ = self.body.base_orientation
        upright = 1.0 - 2.0 * (x * x + y * y)
        return illegal_contact or upright < np.cos(FALL_TILT)


def _rotate_slightly(orientation: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Turn a quaternion x, y, z, w by small angles (3,) rad about the base axes."""
    x, y, z, w = orientation
    a, b, c = 0.5 * angles
    turned = np.array(
        [
            x + w * a + y * c - z * b,
            y + w * b + z * a - x * c,
            z + w * c + x * b - y * a,
            w - x * a - y * b - z * c,
        ]
    )
    return turned / np.linalg.norm(turned)
