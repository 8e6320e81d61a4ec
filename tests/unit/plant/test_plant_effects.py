"""Every nuisance effect, in the plant's own terms, moves its own measure in the expected direction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from hqpipe.plant import Plant, PlantConfig
from hqpipe.plant.trial import PlantTrial

KNEE, PITCH, ROLL = 2, 1, 0
RADIUS = 0.06  # m


# Experiments: what is done with the machine.


def step(size: float, joint: int = KNEE, duration: float = 0.6) -> Callable[[Plant], PlantTrial]:
    """A step of one joint in the gantry at 0.1 s."""

    def experiment(plant: Plant) -> PlantTrial:
        def controller(frame, command):
            target = plant.robot.nominal_position.copy()
            target[joint] += size * (frame.time >= 0.1)
            return target

        return plant.run(controller, duration, control_period_s=0.001)

    return experiment


def sine(amplitude: float, hertz: float, duration: float = 1.0) -> Callable[[Plant], PlantTrial]:
    """All pitches and knees of the gantry robot in step."""
    shape = np.tile([0.0, amplitude, amplitude], 4)

    def experiment(plant: Plant) -> PlantTrial:
        def controller(frame, command):
            return plant.robot.nominal_position + shape * np.sin(2.0 * np.pi * hertz * frame.time)

        return plant.run(controller, duration, control_period_s=0.001)

    return experiment


def strokes(opening: float, duration: float = 0.4, late: float = 0.0) -> Callable[[Plant], PlantTrial]:
    """The knee's valve opened forwards, then backwards."""

    def experiment(plant: Plant) -> PlantTrial:
        hold = plant.robot.nominal_position
        while plant.time < late:
            plant.step(hold)
        start = plant.time

        def controller(frame, command):
            valve = 2.4 * (hold - frame.q)
            valve[KNEE] = opening if frame.time - start < 0.5 * duration else -opening
            return valve

        return plant.run(controller, duration, control_period_s=0.001, mode="valve")

    return experiment


def stand(plant: Plant) -> PlantTrial:
    return plant.run(lambda frame, command: plant.robot.nominal_position, 0.5)


def shuffle(plant: Plant) -> PlantTrial:
    """The feet of a standing robot pushed sideways against each other."""
    shape = np.tile([0.25, 0.0, 0.0], 4) * np.repeat([1.0, -1.0, 1.0, -1.0], 3)
    return plant.run(lambda f, c: plant.robot.nominal_position + shape * np.sin(6.0 * f.time), 1.0)


# Measures: one number of a trial.


def knee(trial: PlantTrial, signal: str) -> np.ndarray:
    return trial.columns[f"joint/LFK/{signal}"]


def truth(trial: PlantTrial, signal: str, joint: str = "LFK") -> np.ndarray:
    return trial.truth[f"joint/{joint}/{signal}"]


def first_reaction(trial: PlantTrial) -> float:
    """s from the step to the first spool motion."""
    return np.argmax(np.abs(truth(trial, "spool") - truth(trial, "spool")[99]) > 0.005) * 1e-3 - 0.1


def spool_rise(trial: PlantTrial) -> float:
    """s until the spool has reached half of the first command."""
    return np.argmax(truth(trial, "spool") > 0.5 * knee(trial, "valve_command")[100]) * 1e-3 - 0.1


def static_error(trial: PlantTrial) -> float:
    return float(np.abs(knee(trial, "position_command") - knee(trial, "position"))[-100:].mean())


def static_pitch_error(trial: PlantTrial) -> float:
    columns = trial.columns
    return float(np.abs(columns["joint/LFP/position_command"] - columns["joint/LFP/position"])[-100:].mean())


def peak_speed(trial: PlantTrial) -> float:
    return float(np.abs(truth(trial, "velocity")).max())


def stroke_speeds(trial: PlantTrial) -> tuple[float, float]:
    speed, length = truth(trial, "velocity"), len(trial.time)
    return float(speed[length // 4 : length // 2].mean()), float(-speed[3 * length // 4 :].mean())


def forward_speed(trial: PlantTrial) -> float:
    return stroke_speeds(trial)[0]


def direction_ratio(trial: PlantTrial) -> float:
    forward, backward = stroke_speeds(trial)
    return forward / backward


def friction_torque(trial: PlantTrial) -> float:
    """Pressure torque less chain torque, along the motion, above 0.3 rad/s, N·m."""
    pressed = RADIUS * 8.0e-4 * (truth(trial, "pressure_a") - truth(trial, "pressure_b"))
    pulled = RADIUS * (truth(trial, "tension_a") - truth(trial, "tension_b"))
    speed = truth(trial, "velocity")
    return float(np.mean(((pressed - pulled) * np.sign(speed))[np.abs(speed) > 0.3]))


def friction_one_sidedness(trial: PlantTrial) -> float:
    pressed = RADIUS * 8.0e-4 * (truth(trial, "pressure_a") - truth(trial, "pressure_b"))
    pulled = RADIUS * (truth(trial, "tension_a") - truth(trial, "tension_b"))
    speed, loss = truth(trial, "velocity"), pressed - pulled
    return float(loss[speed > 0.3].mean() + loss[speed < -0.3].mean())


def slow_friction(trial: PlantTrial) -> float:
    """Half the height of the friction loop below 0.05 rad/s, N·m."""
    pressed = RADIUS * 8.0e-4 * (truth(trial, "pressure_a") - truth(trial, "pressure_b"))
    pulled = RADIUS * (truth(trial, "tension_a") - truth(trial, "tension_b"))
    speed, loss = truth(trial, "velocity"), pressed - pulled
    slow = np.abs(speed) < 0.05
    return float(0.5 * (np.percentile(loss[slow], 95) - np.percentile(loss[slow], 5)))


def lost_motion(trial: PlantTrial) -> float:
    """Travel of the chain that the joint does not follow, rad."""
    slip = truth(trial, "chain") / RADIUS - truth(trial, "position")
    return float(np.ptp(slip))


def dominant_frequency(trial: PlantTrial) -> float:
    """Hz of the strongest ringing in the rate of the pressure difference after the step."""
    ring = np.gradient(truth(trial, "pressure_a") - truth(trial, "pressure_b"))[105:305]
    fading = np.hanning(400)[200:]
    power = np.abs(np.fft.rfft((ring - ring.mean()) * fading, 4096))
    return float(np.fft.rfftfreq(4096, 1e-3)[np.argmax(power)])


def pressure_torque_peak(trial: PlantTrial) -> float:
    return RADIUS * 8.0e-4 * float(np.abs(truth(trial, "pressure_a") - truth(trial, "pressure_b")).max())


def lowest_supply(trial: PlantTrial) -> float:
    return float(trial.truth["supply/pressure"].min())


def supply_swing(trial: PlantTrial) -> float:
    return float(np.std(trial.columns["supply/pressure"]))


def supply_recovery(trial: PlantTrial) -> float:
    pressure = trial.truth["supply/pressure"]
    return float(pressure[-1] - pressure.min())


def total_knee_effort(trial: PlantTrial) -> float:
    return float(sum(trial.columns[f"joint/{leg}K/effort"].mean() for leg in ("LF", "RF", "LH", "RH")))


def peak_torque(trial: PlantTrial) -> float:
    return float(np.abs(truth(trial, "torque")).max())


def static_pitch_torque(trial: PlantTrial) -> float:
    return float(truth(trial, "torque", "LFP")[-100:].mean())


def front_left_load(trial: PlantTrial) -> float:
    return float(trial.columns["foot/LF/force/z"].mean())


def foot_drag(trial: PlantTrial) -> float:
    """Largest sideways share of the foot force."""
    side = np.hypot(trial.columns["foot/LF/force/x"], trial.columns["foot/LF/force/y"])
    return float(np.percentile(side / np.maximum(trial.columns["foot/LF/force/z"], 50.0), 99))


def height(trial: PlantTrial) -> float:
    return float(trial.columns["base/position/z"].mean())


def base_pitch(trial: PlantTrial) -> float:
    return float(2.0 * trial.columns["base/orientation/y"].mean())


def base_tilt(trial: PlantTrial) -> float:
    columns = trial.columns
    return float(np.hypot(columns["base/orientation/x"], columns["base/orientation/y"]).mean())


def effort_offset(trial: PlantTrial) -> float:
    pulled = RADIUS * 8.0e-4 * (truth(trial, "pressure_a") - truth(trial, "pressure_b"))
    return float((knee(trial, "effort") - pulled).mean())


def effort_ratio(trial: PlantTrial) -> float:
    pulled = RADIUS * 8.0e-4 * (truth(trial, "pressure_a") - truth(trial, "pressure_b"))
    return float(np.linalg.lstsq(pulled[:, None], knee(trial, "effort"), rcond=None)[0][0])


def position_offset(trial: PlantTrial) -> float:
    return float((knee(trial, "position") - truth(trial, "position")).mean())


def effort_lag(trial: PlantTrial) -> float:
    """s by which the logged effort lags the true one, sub-sample, by the slope of the phase."""
    pulled = RADIUS * 8.0e-4 * (truth(trial, "pressure_a") - truth(trial, "pressure_b"))
    rate = np.gradient(pulled, 1e-3)
    return float(-np.dot(rate, knee(trial, "effort") - pulled) / np.dot(rate, rate))


def lowest_effort(trial: PlantTrial) -> float:
    return float(knee(trial, "effort").min())


def spool_hold(trial: PlantTrial) -> float:
    """Share of samples in which the spool does not move at all."""
    return float(np.mean(np.diff(truth(trial, "spool")) == 0.0))


def spool_loop(trial: PlantTrial) -> float:
    """Width of the loop of spool over command: their mean distance signed by the command's direction."""
    command, spool = knee(trial, "valve_command"), truth(trial, "spool")
    rate = np.gradient(command)
    moving = np.abs(rate) > np.percentile(np.abs(rate), 50)
    return float(np.mean(((command - spool) * np.sign(rate))[moving]))


def neighbour_motion(trial: PlantTrial) -> float:
    """The knee's command talks over to the roll, which follows it in the leg's ring."""
    return float(np.ptp(truth(trial, "position", "LFR")))


def held_command_error(trial: PlantTrial) -> float:
    return float(np.sqrt(np.mean((knee(trial, "position_command") - knee(trial, "position")) ** 2)))


def spool_offset(trial: PlantTrial) -> float:
    return float((truth(trial, "spool") - knee(trial, "valve_command"))[-100:].mean())


def spool_rate(trial: PlantTrial) -> float:
    return float(np.abs(np.diff(truth(trial, "spool"))).max() / 1e-3)


def swept_knee_stiffness(trial: PlantTrial) -> float:
    """Torque per rad of the loaded stance: knee torque of the standing robot over its sag."""
    sag = np.abs(truth(trial, "position") + 1.1).mean()
    return float(np.abs(truth(trial, "torque")).mean() / sag)


def temperature_rise(trial: PlantTrial) -> float:
    return float(np.ptp(trial.columns["supply/oil_temperature"]))


def gyro_mean(trial: PlantTrial) -> float:
    return float(trial.columns["base/angular_velocity/x"].mean())


# The table.


@dataclass(frozen=True)
class Case:
    """`change` is the least difference (or ratio, if `relative`) that the effect must make."""

    effect: str
    overrides: dict[str, Any]
    experiment: Callable[[Plant], PlantTrial]
    measure: Callable[[PlantTrial], float]
    change: float
    relative: bool = False
    base: str = "fixed"


JOINT = "LFK"
CASES = (
    Case("command_delay", {"firmware": {"command_delay": 5.0e-3}}, step(0.1), first_reaction, 4.0e-3),
    Case("valve_delay", {"valve": {"delay": 6.0e-3}}, step(0.1), first_reaction, 4.0e-3),
    Case("valve_lag", {"valve": {"bandwidth_hz": 15.0}}, step(0.1), spool_rise, 5.0e-3),
    Case("slew_rate", {"valve": {"slew_rate": 5.0}}, step(0.2), spool_rate, -20.0),
    Case("valve_deadband", {"valve": {"overlap": 0.06}}, step(0.04), static_error, 4.0e-3),
    Case("flow_saturation", {"valve": {"opening_limit": 0.2}}, step(0.3), peak_speed, 0.5, relative=True),
    Case(
        "supply_droop",
        {"supply": {"pump_flow": 2.0e-4, "accumulator_volume": 3.0e-4}},
        sine(0.3, 2.0),
        lowest_supply,
        -2.0e6,
    ),
    Case("supply_recovery", {"supply": {"pump_flow": 2.0e-4}}, step(0.5, duration=0.8), lowest_supply, -0.2e6),
    Case(
        "supply_pressure",
        {"supply": {"pressure": 10.0e6, "accumulator_precharge": 6.0e6}},
        strokes(0.2),
        forward_speed,
        0.8,
        relative=True,
    ),
    Case("direction_asymmetry", {"valve": {"asymmetry": 0.2}}, strokes(0.2), direction_ratio, 0.25),
    Case("unequal_areas", {"cylinder": {"area_b": 7.0e-4}}, strokes(0.2), direction_ratio, 0.03),
    Case(
        "position_dependent_stiffness",
        {"cylinder": {"dead_volume_a": 2.0e-5, "dead_volume_b": 2.0e-4}},
        step(0.2),
        dominant_frequency,
        -1.0,
    ),
    Case(
        "gain_drift",
        {"valve": {"gain_drift": -0.1}},
        strokes(0.2, late=2.0),
        forward_speed,
        0.85,
        relative=True,
    ),
    Case("oil_heating", {"fluid": {"heating_rate": 5.0}}, strokes(0.2), temperature_rise, 1.5),
    Case(
        "hot_oil_leaks",
        {"fluid": {"heating_rate": 5.0}, "cylinder": {"leakage": 5.0e-11}},
        step(0.1, PITCH, 1.0),
        static_pitch_error,
        2.0e-3,
    ),
    Case(
        "leakage",
        {"cylinder": {"leakage": 3.0e-11}},
        stand,
        swept_knee_stiffness,
        0.6,
        relative=True,
        base="floating",
    ),
    Case(
        "integral_action",
        {"firmware": {"position_pid": {"ki": 10.0}}},
        step(0.1, PITCH, 1.0),
        static_pitch_error,
        -1.0e-3,
    ),
    Case("coulomb_friction", {"cylinder": {"coulomb_friction": 260.0}}, sine(0.3, 1.0), friction_torque, 15.0),
    Case(
        "coulomb_asymmetry",
        {"cylinder": {"coulomb_asymmetry": 50.0}},
        sine(0.3, 1.0),
        friction_one_sidedness,
        8.0,
    ),
    Case("stribeck_friction", {"cylinder": {"stribeck_friction": 430.0}}, sine(0.2, 1.0), slow_friction, 10.0),
    Case("viscous_friction", {"cylinder": {"viscous_friction": 3000.0}}, sine(0.3, 1.0), friction_torque, 10.0),
    Case(
        "load_dependent_friction",
        {"cylinder": {"load_friction": 0.02}},
        sine(0.3, 1.0),
        friction_torque,
        12.0,
    ),
    Case("backlash", {"chain": {"slack": 1.5e-3}}, sine(0.2, 2.0), lost_motion, 0.015),
    Case("transmission_compliance", {"chain": {"stiffness": 1.0e6}}, step(0.2), dominant_frequency, -4.0),
    Case("hose_compliance", {"cylinder": {"hose_compliance": 5.0e-13}}, step(0.2), dominant_frequency, -4.0),
    Case("bulk_modulus", {"fluid": {"bulk_modulus": 0.3e9}}, step(0.2), dominant_frequency, -2.0),
    Case("armature", {"cylinder": {"piston_mass": 20.0}}, step(0.2), pressure_torque_peak, 1.1, relative=True),
    Case(
        "payload",
        {"body": {"payloads": [{"link": "trunk", "mass": 60.0, "com": [0.0, 0.0, 0.2]}]}},
        stand,
        total_knee_effort,
        1.1,
        relative=True,
        base="floating",
    ),
    Case(
        "payload_com",
        {"body": {"payloads": [{"link": "trunk", "mass": 60.0, "com": [0.5, 0.2, 0.2]}]}},
        stand,
        front_left_load,
        200.0,
        base="floating",
    ),
    Case(
        "inertia_error",
        {"body": {"links": {"LF_shank": {"inertia_scale": 8.0}}}},
        step(0.2),
        peak_torque,
        1.2,
        relative=True,
    ),
    Case(
        "com_error",
        {"body": {"links": {"LF_thigh": {"com_offset": [0.1, 0.0, 0.0]}}}},
        step(0.0),
        static_pitch_torque,
        -5.0,
    ),
    Case(
        "ground_friction",
        {"body": {"ground": {"friction": 0.1}}},
        shuffle,
        foot_drag,
        0.8,
        relative=True,
        base="floating",
    ),
    Case("ground_compliance", {"body": {"ground": {"stiffness": 4.0e4}}}, stand, height, -0.01, base="floating"),
    Case("ground_slope", {"body": {"ground": {"slope": 0.1}}}, stand, base_pitch, -0.07, base="floating"),
    Case(
        "ground_unevenness",
        {"body": {"ground": {"roughness": 0.05}}},
        stand,
        base_tilt,
        2.0e-3,
        base="floating",
    ),
    Case("torque_bias", {"sensors": {"effort_bias": 20.0}}, sine(0.2, 1.0), effort_offset, 18.0),
    Case("torque_scale", {"sensors": {"effort_scale": 1.1}}, sine(0.2, 2.0), effort_ratio, 0.08),
    Case("position_bias", {"sensors": {"position_bias": 0.03}}, sine(0.2, 1.0), position_offset, 0.028),
    Case("channel_skew", {"sensors": {"effort_delay": 1.7e-3}}, sine(0.2, 5.0), effort_lag, 1.4e-3),
    Case("unsigned_sensor", {"sensors": {"effort_unsigned": 1}}, sine(0.2, 2.0), lowest_effort, 5.0),
    Case("gyro_bias", {"imu": {"gyro_bias": 0.1}}, stand, gyro_mean, 0.08, base="floating"),
    Case("pump_ripple", {"supply": {"ripple_pressure": 1.0e6}}, sine(0.1, 1.0), supply_swing, 0.5e6),
    Case("sticking_valve", {"valve": {"stiction": 0.03}}, sine(0.1, 0.5), spool_hold, 0.2),
    Case("crosstalk", {"valve": {"crosstalk": 0.1}}, step(0.3), neighbour_motion, 2.0e-3),
    Case("hysteresis", {"valve": {"hysteresis": 0.02}}, sine(0.3, 0.5, 2.0), spool_loop, 0.005),
    Case(
        "dropped_frames",
        {"bus": {"drop_rate": 10.0, "drop_duration": 0.05}},
        sine(0.3, 2.0),
        held_command_error,
        2.0e-3,
    ),
    Case("neutral_offset", {"valve": {"neutral_offset": 0.03}}, step(0.0), spool_offset, 0.025),
)


@pytest.fixture(scope="module")
def sound(robot):
    """Measures of the machine without any effect, each experiment run once."""
    plants, trials = {}, {}

    def measure(case: Case) -> float:
        key = (case.experiment, case.base)
        if key not in trials:
            plant = plants.setdefault(case.base, Plant(robot, base=case.base))
            plant.reset()
            trials[key] = case.experiment(plant)
        return case.measure(trials[key])

    return measure


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.effect)
def test_effect_moves_its_measure(robot, sound, case):
    trial = case.experiment(Plant(robot, PlantConfig(case.overrides), base=case.base))
    with_effect, without = case.measure(trial), sound(case)
    change = with_effect / without if case.relative else with_effect - without
    rises = case.change > (1.0 if case.relative else 0.0)
    report = f"{case.effect}: {without:.5g} → {with_effect:.5g}, change {change:.4g}, expected {case.change:g}"
    assert (change > case.change) if rises else (change < case.change), report


LIBRARY = """
command_delay valve_lag valve_deadband flow_saturation supply_droop direction_asymmetry
position_dependent_stiffness gain_drift integral_action coulomb_friction stribeck_friction
viscous_friction load_dependent_friction backlash transmission_compliance armature payload
inertia_error com_error ground_friction ground_compliance ground_slope torque_bias torque_scale
position_bias channel_skew unsigned_sensor pump_ripple sticking_valve crosstalk hysteresis
dropped_frames
""".split()


def test_no_effect_is_left_out():
    """Orifice flow is no option of the plant but its nature: see test_hydraulics_analytic."""
    assert set(LIBRARY) <= {case.effect for case in CASES}


@pytest.mark.parametrize("selector", ["LFK", "LF", "knee"])
def test_an_effect_stays_where_it_is_put(robot, selector):
    plant = Plant(robot, PlantConfig({"joints": {selector: {"sensors": {"position_bias": 0.05}}}}), base="fixed")
    trial = plant.run(lambda frame, command: robot.nominal_position, 0.05)
    names = {"LFK": {"LFK"}, "LF": {"LFR", "LFP", "LFK"}, "knee": {"LFK", "RFK", "LHK", "RHK"}}[selector]
    for name in robot.joints:
        error = trial.columns[f"joint/{name}/position"] - trial.truth[f"joint/{name}/position"]
        assert np.abs(error - (0.05 if name in names else 0.0)).max() < 1e-4


def test_a_load_cell_does_not_feel_the_seals(robot):
    friction = {"cylinder": {"coulomb_friction": 400.0}}

    def loop(source: str) -> float:
        trial = sine(0.3, 1.0)(Plant(robot, PlantConfig(friction | {"effort_source": source}), base="fixed"))
        torque, speed = knee(trial, "effort") - truth(trial, "torque"), truth(trial, "velocity")
        return float(np.mean((torque * np.sign(speed))[np.abs(speed) > 0.3]))

    assert loop("pressure") > 30.0
    assert abs(loop("load_cell")) < 5.0
