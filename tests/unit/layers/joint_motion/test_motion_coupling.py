"""What other joints do to a joint is taken out of its errors; ripple and friction that changes have shapes."""

import numpy as np
import pytest
from layers.joint_motion.closed_loop import HZ, fitted, log_set, reference, simulate

from hqpipe.identify.identify import identify
from hqpipe.layers.joint_motion import JointMotion
from hqpipe.layers.joint_motion.coupling import Coupling, Nuisance, Predicted, coupling_for, ridge_of

DRY, VISCOUS = "coulomb_friction", "viscous_friction"


def test_whitened_errors_have_the_square_of_the_best_coefficients():
    rng = np.random.default_rng(1)
    terms, errors, ridge = rng.standard_normal((200, 7)), rng.standard_normal(200), 30.0
    left = Nuisance.of(terms, ridge).left(errors)
    best = np.linalg.solve(terms.T @ terms + ridge * np.eye(7), terms.T @ errors)
    assert left @ left == pytest.approx(np.sum((errors - terms @ best) ** 2) + ridge * best @ best)


def test_without_terms_errors_stay_bit_for_bit():
    errors = np.random.default_rng(2).standard_normal(50)
    assert Nuisance.of(np.zeros((50, 0)), 1.0).left(errors) is errors
    assert Predicted.of(np.zeros((60, 0)), np.zeros((50, 0)), 1.0).left(errors, np.zeros(60)) is errors


def test_unfitted_samples_keep_what_the_fit_knows_not_to_be_the_other_joints():
    rng = np.random.default_rng(3)
    fitted_terms, terms, truth = rng.standard_normal((2000, 4)), rng.standard_normal((100, 4)), rng.standard_normal(4)
    fitted_terms[:, 3] = 0.0  # a term that the fit does not show
    predicted = Predicted.of(fitted_terms, terms, 1e-3)
    known = truth * np.array([1.0, 1.0, 1.0, 0.0])
    assert np.abs(predicted.left(terms @ known, fitted_terms @ known)).max() < 1e-3
    absent = terms[:, 0]  # a motion of which the fit has found that it does nothing
    assert np.linalg.norm(predicted.left(absent, np.zeros(2000))) > 0.8 * np.linalg.norm(absent)
    assert np.linalg.norm(predicted.left(terms[:, 3], np.zeros(2000))) < 0.05 * np.linalg.norm(terms[:, 3])


def test_the_width_of_the_prior_follows_the_coefficients():
    rng = np.random.default_rng(4)
    terms, own = rng.standard_normal((3000, 60)), np.ones((3000, 1))
    for size in (0.05, 0.5):
        output = terms @ (size * rng.standard_normal(60)) + rng.standard_normal(3000)
        assert ridge_of(terms, own, output) == pytest.approx(1.0 / size**2, rel=0.6)


def test_a_short_log_takes_in_fewer_joints():
    chain = [True] * 7
    whole, first = coupling_for(chain, 3, 1e6)
    assert len(whole.turns) == 7 and first == 0
    less, first = coupling_for(chain, 3, 5.0 * whole.count() - 1.0)
    assert 1 < len(less.turns) < 7 and less.count() < whole.count() and first > 0
    assert coupling_for(chain, 3, 20.0) == (None, 0)
    assert coupling_for([True], 0, 1e6) == (None, 0)
    assert coupling_for([True, True], 0, 1e6)[0] == Coupling((True, True), 0, True)


def two_links(seed, friction, posture=0.0, mass=0.0):
    """Torques of a two-link arm in the vertical plane, with dry friction in both joints.

    Args:
        posture: rad, mean position of the elbow. mass: kg, at the tip, 0.5 m from the elbow, which is 0.5 m from the shoulder.
    """
    t = np.arange(15 * HZ) / HZ
    q = np.array([reference(15, seed, size=0.8), posture + reference(15, 10 + seed, size=0.8)])
    v = np.gradient(q, t, axis=1)
    a = np.gradient(v, t, axis=1)
    (q1, q2), (v1, v2), (a1, a2) = q, v, a
    c, s, tip = np.cos(q2), np.sin(q2), 0.25 * mass
    crossed, weight = 0.4 + tip, 5.0 + 0.5 * 9.81 * mass
    first = (2.0 + 2.0 * tip + 2.0 * crossed * c) * a1 + (0.3 + tip + crossed * c) * a2
    first -= crossed * s * (2 * v1 * v2 + v2**2)
    first += (20.0 + 0.5 * 9.81 * mass) * np.sin(q1) + weight * np.sin(q1 + q2)
    second = (0.3 + tip + crossed * c) * a1 + (0.3 + tip) * a2 + crossed * s * v1**2 + weight * np.sin(q1 + q2)
    torque = np.array([first, second]) + friction * np.sign(v)
    return q.T, q.T, (torque + 0.02 * np.random.default_rng(seed).standard_normal(torque.shape)).T


@pytest.mark.parametrize("joint", [0, 1])
def test_friction_of_an_arm_is_right_beside_the_motion_of_its_other_joint(joint):
    runs = [two_links(seed, 0.4) for seed in (1, 2)]
    model = JointMotion().joints(log_set(runs, joints=("shoulder", "elbow"))).models[joint]
    assert fitted(model, [DRY])[0]["friction_nm"] == pytest.approx(0.4, rel=0.02)
    alone = JointMotion().joints(log_set([tuple(x[:, [joint]] for x in run) for run in runs])).models[0]
    assert abs(fitted(alone, [DRY])[0]["friction_nm"] / 0.4 - 1.0) > 0.1
    assert any("other joints" in note for note in model.notes) and not any("other joints" in n for n in alone.notes)


@pytest.mark.parametrize(("mass", "causes"), [(0.0, set()), (1.0, {"payload"})])
def test_another_posture_of_the_other_joints_is_no_payload(mass, causes):
    def arm(seeds, **changed):
        return log_set([two_links(seed, 0.4, **changed) for seed in seeds], joints=("shoulder", "elbow"))

    then, now = arm((1, 2, 3)), arm((4, 5, 6), posture=0.8, mass=mass)
    layer = JointMotion().comparing(now, then)
    found = identify(layer.joints(now), reference=layer.joints(then)).found
    assert {cause.effect for joint in found for cause in joint.causes} == causes


def runs_with(change):
    found = []
    for seed in (1, 2):
        c = reference(15, seed)
        q, tau = simulate(c, inertia=1.5, load=lambda q: 8.0 * np.sin(q), torque_noise=0.1, seed=seed)
        found.append((c, q, tau + change(q, np.gradient(q, 1.0 / HZ))))
    return log_set(found)


def test_a_torque_that_is_periodic_in_the_position_is_a_shape_and_no_named_cause():
    model = JointMotion().joints(runs_with(lambda q, v: 2.0 * np.sin(30.0 * q))).models[0]
    base = fitted(model, [])[1][1]
    assert fitted(model, ["ripple_shape"])[1][1] < 0.35 * base
    assert min(fitted(model, [e.name])[1][1] for e in model.effects if e.named) > 0.9 * base


def test_friction_that_changes_within_a_trial_is_a_shape():
    half = 15 * HZ // 2
    model = (
        JointMotion()
        .joints(runs_with(lambda q, v: np.sign(v) * np.where(np.arange(len(q)) < half, 2.0, 1.0)))
        .models[0]
    )
    plain, with_shape = fitted(model, [DRY]), fitted(model, [DRY, "friction_by_time"])
    assert with_shape[1][1] < 0.4 * plain[1][1]
    assert with_shape[0]["friction_nm"] == pytest.approx(1.5, rel=0.03)
    assert with_shape[0]["coefficient_1"] == pytest.approx(-1.0, rel=0.06)


def test_a_lost_sign_is_restored_where_only_a_spring_pulls():
    """A slide without gravity, at whose standstills the spring holds the torque."""
    runs = []
    for seed in (1, 2):
        c = reference(15, seed)
        q, tau = simulate(
            c, inertia=1.3, load=lambda q: 9.0 * (q - 0.1), viscous=lambda v: 1.1 * v, torque_noise=0.02, seed=seed
        )
        runs.append((c, q, np.abs(tau)))
    model = JointMotion().joints(log_set(runs, kinds={"joint": "prismatic"})).models[0]
    assert model.unsigned
    found = fitted(model, ["spring", VISCOUS])[0]
    assert found["inertia_kg_m2"] == pytest.approx(1.3, rel=0.03)
    assert found["nm_per_rad"] == pytest.approx(9.0, rel=0.03)
    assert found["nm_s_per_rad"] == pytest.approx(1.1, rel=0.05)


def test_a_lost_sign_is_restored_beside_other_joints():
    runs = [two_links(seed, 0.4) for seed in (1, 2)]
    sized = [(c, q, np.column_stack([tau[:, 0], np.abs(tau[:, 1])])) for c, q, tau in runs]
    model = JointMotion().joints(log_set(sized, joints=("shoulder", "elbow"))).models[1]
    assert model.unsigned
    assert fitted(model, [DRY])[0]["friction_nm"] == pytest.approx(0.4, rel=0.1)
