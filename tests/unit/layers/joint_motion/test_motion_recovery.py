"""A known truth comes out of simulated closed loops, with noise and quantisation."""

from dataclasses import replace

import numpy as np
import pytest
from layers.joint_motion.closed_loop import fitted, log_set, reference, simulate

from hqpipe.layers.joint_motion import JointMotion
from hqpipe.layers.joint_motion.coupling import Coupling
from hqpipe.layers.joint_motion.joint_motion import moving_machine
from hqpipe.layers.joint_motion.judged import judge
from hqpipe.layers.joint_motion.motion import Motion, motion_of, rest_speed

DRY, VISCOUS = "coulomb_friction", "viscous_friction"


def model_of(logs, joint=0):
    return JointMotion().joints(logs).models[joint]


def logs_of(kinds=None, seconds=15, **truth):
    commands = [reference(seconds, seed) for seed in (1, 2)]
    noisy = {"torque_noise": 0.1, "count": 2e-5} | truth
    return log_set([(c, *simulate(c, seed=k, **noisy)) for k, c in enumerate(commands)], kinds=kinds)


def gravity(q):
    return 12.0 * np.sin(q + 0.4)


def test_inertia_gravity_dry_and_viscous_friction():
    model = model_of(logs_of(inertia=1.5, load=gravity, dry=lambda v, load: 3.0, viscous=lambda v: 1.2 * v))
    found, rms, _ = fitted(model, [DRY, VISCOUS])
    assert found["inertia_kg_m2"] == pytest.approx(1.5, rel=0.02)
    assert found["friction_nm"] == pytest.approx(3.0, rel=0.02)
    assert found["nm_s_per_rad"] == pytest.approx(1.2, rel=0.05)
    assert np.hypot(found["gravity_sin_nm"], found["gravity_cos_nm"]) == pytest.approx(12.0, rel=0.05)
    assert rms[1] < 0.1 * np.std(model.heldout.output)
    base = fitted(model, [])[1]
    assert base[1] > 3.0 * rms[1]


def test_spring_of_a_sliding_joint():
    model = model_of(
        logs_of({"joint": "prismatic"}, inertia=5.0, load=lambda q: 20.0 * (q - 0.1), dry=lambda v, load: 3.0)
    )
    assert model.unit == "N"
    found, _, _ = fitted(model, ["spring", DRY])
    assert found["nm_per_rad"] == pytest.approx(20.0, rel=0.03)
    assert found["inertia_kg_m2"] == pytest.approx(5.0, rel=0.02)


def test_friction_that_grows_with_the_load():
    model = model_of(logs_of(inertia=1.5, load=gravity, dry=lambda v, load: 1.0 + 0.2 * abs(load)))
    found, rms, _ = fitted(model, [DRY, "load_dependent_friction"])
    assert found["coefficient"] == pytest.approx(0.2, rel=0.1)
    assert rms[1] < 0.8 * fitted(model, [DRY, VISCOUS])[1][1]


def test_friction_that_falls_with_the_speed():
    model = model_of(logs_of(inertia=1.5, load=gravity, dry=lambda v, load: 2.0 + 2.0 * np.exp(-((v / 0.15) ** 2))))
    found, rms, _ = fitted(model, [DRY, "stribeck_friction"])
    assert found["static_nm"] == pytest.approx(2.0, rel=0.15)
    assert found["velocity_rad_s"] == pytest.approx(0.15, rel=0.2)
    assert rms[1] < 0.8 * fitted(model, [DRY, VISCOUS])[1][1]


@pytest.mark.parametrize("late", [0.006, -0.0045])
def test_torque_logged_later_or_earlier_than_the_position(late):
    commands = [reference(15, seed) for seed in (1, 2)]
    runs = [simulate(c, inertia=1.5, load=gravity, dry=lambda v, load: 1.0, torque_noise=0.05) for c in commands]
    t = np.arange(len(commands[0])) / 1000
    shifted = [(c, q, np.interp(t - late, t, tau)) for c, (q, tau) in zip(commands, runs, strict=True)]
    found, _, _ = fitted(model_of(log_set(shifted)), [DRY, "channel_skew"])
    assert found["skew_s"] == pytest.approx(late, rel=0.05)


def test_torque_constant_that_drifts():
    commands = [reference(15, seed) for seed in (1, 2)]
    runs = [simulate(c, inertia=1.5, load=gravity, dry=lambda v, load: 1.0) for c in commands]
    t = np.arange(len(commands[0])) / 1000
    drifting = [(c, q, tau * (1 + 0.01 * t)) for c, (q, tau) in zip(commands, runs, strict=True)]
    found, _, _ = fitted(model_of(log_set(drifting)), [DRY, "torque_by_time"])
    assert found["rate_per_s"] == pytest.approx(0.01, rel=0.1)


def test_viscous_friction_that_differs_by_direction():
    model = model_of(logs_of(inertia=1.5, dry=lambda v, load: 1.0, viscous=lambda v: (2.6 if v > 0 else 1.4) * v))
    found, _, _ = fitted(model, [DRY, VISCOUS, "direction_asymmetry"])
    assert found["ratio"] == pytest.approx(0.3, rel=0.1)
    assert found["nm_s_per_rad"] == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize("held", [2.0, 0.0])
def test_a_torque_without_its_sign(held):
    commands = [reference(15, seed) for seed in (1, 2)]
    truth = {"inertia": 0.5, "dry": lambda v, load: 4.0, "load": lambda q: held, "torque_noise": 0.1}
    runs = [(c, *simulate(c, seed=k, **truth)) for k, c in enumerate(commands)]
    model = model_of(log_set([(c, q, np.abs(tau)) for c, q, tau in runs]))
    assert model.unsigned
    found, _, _ = fitted(model, [DRY])
    assert found["friction_nm"] == pytest.approx(4.0, rel=0.05)
    assert found["offset_nm"] == pytest.approx(held, abs=0.15)
    assert not model_of(log_set(runs)).unsigned


def test_a_load_of_one_sign_keeps_it():
    commands = [reference(15, seed, fastest=0.6) for seed in (1, 2)]
    runs = [simulate(c, inertia=0.3, load=lambda q: 20.0, dry=lambda v, load: 2.0, torque_noise=0.1) for c in commands]
    logs = log_set([(c[500:], q[500:], tau[500:]) for c, (q, tau) in zip(commands, runs, strict=True)])
    assert min(t.trajectory.effort.min() for t in logs.trials) > 0.0
    model = model_of(logs)
    assert not model.unsigned
    assert fitted(model, [DRY])[0]["offset_nm"] == pytest.approx(20.0, rel=0.02)


def at_cutoff(logs, cutoff):
    """The machine filtered at a cut-off that lets much noise pass, as one that is fixed beforehand does."""
    machine = moving_machine(logs)
    band = replace(machine.bandwidths[0], cutoff=cutoff)
    slow = rest_speed(band, machine.dt, 0.0)
    motions = [motion_of(t.trajectory.position[:, 0], machine.dt, cutoff, slow) for t in logs.trials]
    return replace(machine, bandwidths=(band,), motions=tuple((motion,) for motion in motions))


def noisy_runs():
    """Noise of the position passes the loop into the torque, and through the derivatives into the regressors."""
    commands = [reference(40, seed, size=0.1, fastest=8.0) for seed in (1, 2)]
    truth = {
        "inertia": 0.5,
        "dry": lambda v, load: 0.2,
        "viscous": lambda v: 0.5 * v,
        "position_noise": 2e-3,
        "kd": 20.0,
    }
    return [(c, *simulate(c, kp=400.0, seed=k, **truth)) for k, c in enumerate(commands)]


def test_noise_that_passes_the_loop_biases_least_squares_and_instruments_correct_it():
    runs = noisy_runs()
    least_squares = judge(at_cutoff(log_set([(0.0 * c, q, tau) for c, q, tau in runs]), 40.0), "joint", None, ())
    instrumental = judge(at_cutoff(log_set(runs), 40.0), "joint", None, ())
    assert instrumental.instrumental and not least_squares.instrumental
    biased, corrected = (fitted(model, [DRY, VISCOUS])[0] for model in (least_squares, instrumental))
    assert abs(corrected["inertia_kg_m2"] / 0.5 - 1.0) < 0.02 < 0.04 < abs(biased["inertia_kg_m2"] / 0.5 - 1.0)
    assert abs(corrected["gravity_sin_nm"]) < 1.0 < 3.0 < abs(biased["gravity_sin_nm"])
    assert any("Durbin" in note for note in instrumental.notes)


def test_the_cutoff_of_the_log_leaves_no_bias_to_correct():
    model = model_of(log_set(noisy_runs()))
    assert not model.instrumental
    assert fitted(model, [DRY, VISCOUS])[0]["inertia_kg_m2"] == pytest.approx(0.5, rel=0.02)


def planar_arm(seed, in_turn=False):
    """A two-link arm in the vertical plane without friction: (command, position, torque), by its Lagrangian.

    Args:
        in_turn: each joint moves in a half of the time, and rests to the last bit in the other.
    """
    t = np.arange(15_000) / 1000
    q = np.array([reference(15, seed, size=0.8), reference(15, 10 + seed, size=0.8)])
    if in_turn:
        q *= np.clip([7.0 - t, t - 8.0], 0.0, 1.0) ** 3
    v = np.gradient(q, t, axis=1)
    a = np.gradient(v, t, axis=1)
    (q1, q2), (v1, v2), (a1, a2) = q, v, a
    c, s = np.cos(q2), np.sin(q2)
    first = (2.0 + 0.8 * c) * a1 + (0.3 + 0.4 * c) * a2 - 0.4 * s * (2 * v1 * v2 + v2**2)
    first += 20.0 * np.sin(q1) + 5.0 * np.sin(q1 + q2)
    second = (0.3 + 0.4 * c) * a1 + 0.3 * a2 + 0.4 * s * v1**2 + 5.0 * np.sin(q1 + q2)
    noise = 0.02 * np.random.default_rng(seed).standard_normal((2, len(t)))
    return q.T, q.T, (np.array([first, second]) + noise).T


@pytest.mark.parametrize("joint", [0, 1])
def test_the_coupling_of_an_arm_is_taken_out_and_leaves_its_noise(joint):
    runs = [planar_arm(1), planar_arm(2)]
    model = model_of(log_set(runs, joints=("shoulder", "elbow")), joint)
    by_itself = model_of(log_set([tuple(x[:, [joint]] for x in run) for run in runs]), 0)
    alone, base = fitted(by_itself, [])[1], fitted(model, [])[1]
    assert base[0] < 0.02 * alone[0] and base[1] < 0.02 * alone[1]
    assert max(base) < 0.1  # of a torque of 10 N·m and more, with noise of 0.02
    friction = fitted(model, [DRY, VISCOUS])[0]
    assert abs(friction["friction_nm"]) < 0.01 and abs(friction["nm_s_per_rad"]) < 0.01


@pytest.mark.parametrize("joint", [0, 1])
def test_joints_that_moved_one_by_one_say_nothing_wild_of_their_common_motion(joint):
    runs = [planar_arm(1, in_turn=True), planar_arm(2)]
    model = model_of(log_set(runs, joints=("shoulder", "elbow")), joint)
    found, rms, _ = fitted(model, [DRY, VISCOUS])
    assert rms[0] < 0.1
    assert rms[1] < 0.1 * np.std(model.heldout.output)
    assert abs(found["friction_nm"]) < 0.02


def test_terms_of_a_chain_hold_its_lagrangian():
    """The torque of a planar arm is a sum of the terms: both joints, no noise, no filter."""
    for own in (0, 1):
        command, _, torque = planar_arm(3)
        rate = np.gradient(command, 1e-3, axis=0)
        speed = np.gradient(rate, 1e-3, axis=0)
        chain = []
        for k in range(2):
            motion = Motion(command[:, k], rate[:, k], speed[:, k], np.zeros(1), np.zeros(1))
            chain.append((command[:, k] - command[:, k].mean(), motion, True))
        x = chain[own][0]
        base = [chain[own][1].acceleration, np.ones_like(x), np.sin(x), np.cos(x)]
        rows = np.concatenate([base, Coupling((True, True), own).rows(tuple(chain))])
        size = np.sqrt(np.mean(rows**2, axis=1))
        found = np.linalg.lstsq((rows.T / size)[100:-100], torque[100:-100, own], rcond=1e-10)[0]
        left = (torque[:, own] - (rows.T / size) @ found)[100:-100]
        assert np.std(left) == pytest.approx(0.02, rel=0.1)


def test_hysteresis_is_a_shape_and_no_named_cause():
    """An elastic element that slips after 0.15 rad, which no named effect is."""
    runs = []
    for seed in (1, 2):
        c = reference(15, seed)
        q, tau = simulate(c, inertia=1.5, load=gravity, torque_noise=0.1, count=2e-5, seed=seed)
        deflection = 0.0
        for k in range(1, len(q)):
            deflection = float(np.clip(deflection + (q[k] - q[k - 1]) / 0.15, -1.0, 1.0))
            tau[k] += 2.0 * deflection
        runs.append((c, q, tau))
    model = model_of(log_set(runs))
    base = fitted(model, [])[1][1]
    named = {e.name: fitted(model, [e.name])[1][1] for e in model.effects if e.named}
    assert fitted(model, ["hysteresis_shape"])[1][1] < 0.15 * base
    assert min(named.values()) > 0.4 * base, named
