"""What the layer gives: neutral values, masks, units, what is left out and what is said."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from layers.joint_motion.closed_loop import HZ, fitted, log_set, reference, simulate

from hqpipe.errors import IdentificationError
from hqpipe.identify.identify import identify
from hqpipe.identify.model import all_parameters
from hqpipe.layers.joint_motion import JointMotion
from hqpipe.layers.joint_motion.bandwidth import derivative
from hqpipe.layers.joint_motion.motion import ParallelFilter
from hqpipe.layers.joint_motion.records import bridged
from hqpipe.logs.log_set import read_log_set

DATA = Path(__file__).parents[5] / "shared" / "data"
DRY, VISCOUS = "coulomb_friction", "viscous_friction"


@pytest.fixture(scope="module")
def runs():
    commands = [reference(12, seed) for seed in (1, 2)]
    truth = {"inertia": 1.5, "load": lambda q: 8.0 * np.sin(q), "dry": lambda v, load: 2.0, "torque_noise": 0.1}
    return [(c, *simulate(c, seed=k, **truth)) for k, c in enumerate(commands)]


def names(model):
    return {effect.name for effect in model.effects}


def test_effects_do_nothing_at_their_neutral_values(runs):
    whole = JointMotion().joints(log_set(runs)).models[0]
    base = JointMotion().joints(log_set(runs), without=names(whole)).models[0]
    neutral = np.array([p.neutral for p in all_parameters(whole)])
    assert not base.effects
    for heldout in (False, True):
        assert np.array_equal(whole.error(neutral, heldout), base.error(neutral[: len(base.base)], heldout))


def test_every_parameter_of_an_effect_that_is_present_moves_the_prediction(runs):
    model = JointMotion().joints(log_set(runs)).models[0]
    values = np.array([p.neutral + 0.2 * (p.spread if np.isfinite(p.spread) else 1.0) for p in all_parameters(model)])
    before = model.error(values)
    for k, parameter in enumerate(all_parameters(model)):
        moved = values.copy()
        moved[k] += 0.1 * (parameter.spread if np.isfinite(parameter.spread) else 1.0)
        assert np.any(model.error(moved) != before), parameter.name


def test_under_a_constant_load_dry_friction_may_be_friction_by_load():
    commands = [0.1 * reference(12, seed) for seed in (1, 2)]
    truth = {"inertia": 0.5, "load": lambda q: 20.0, "dry": lambda v, load: 0.15 * abs(load), "torque_noise": 0.1}
    logs = log_set([(c, *simulate(c, seed=k, **truth)) for k, c in enumerate(commands)], kinds={"joint": "prismatic"})
    (joint,) = identify(JointMotion().joints(logs)).found
    assert {c.effect: c.confused_with for c in joint.causes} == {DRY: ("load_dependent_friction",)}
    (joint,) = identify(JointMotion().joints(logs, without=["load_dependent_friction"])).found
    assert {c.effect: c.confused_with for c in joint.causes} == {DRY: ()}


def test_a_push_is_left_out_and_said(runs):
    c = runs[0][0]
    push = np.zeros(len(c))
    push[4000:5000] = 30.0
    pushed = simulate(
        c, inertia=1.5, load=lambda q: 8.0 * np.sin(q), dry=lambda v, load: 2.0, push=push, torque_noise=0.1
    )
    model = JointMotion().joints(log_set([(c, *pushed), runs[1]])).models[0]
    inside = (model.fit.time > 4.1) & (model.fit.time < 4.9)
    assert not inside.any()
    assert any("something outside pushed" in note for note in model.notes)
    found = fitted(model, [DRY])[0]
    assert found["friction_nm"] == pytest.approx(2.0, rel=0.05)


def test_samples_that_were_not_recorded_are_no_evidence(runs):
    logs = log_set(runs)
    first = logs.trials[0]
    observed = np.ones((len(runs[0][0]), 1), dtype=bool)
    observed[3000:4000] = False
    effort = first.trajectory.effort.copy()
    effort[3000:4000] = 1e3
    gap = replace(first, trajectory=replace(first.trajectory, effort=effort, observed=observed))
    model = JointMotion().joints(replace(logs, trials=(gap, *logs.trials[1:]))).models[0]
    assert not np.any((model.fit.time > 3.0) & (model.fit.time < 4.0))
    assert fitted(model, [DRY])[0]["friction_nm"] == pytest.approx(2.0, rel=0.05)


def test_scattered_rows_that_were_bridged_cost_only_themselves(runs):
    """Every filtered sample is near one: as in a log that loses 2 % of its rows on the bus."""
    logs = log_set(runs)
    whole = JointMotion().joints(logs).models[0]
    trials = []
    for k, trial in enumerate(logs.trials):
        t = trial.trajectory
        seen = np.random.default_rng(k).random(t.samples) > 0.02
        seen[[0, -1]] = True
        rows = np.arange(t.samples)
        position, effort = (np.interp(rows, rows[seen], v[seen, 0])[:, None] for v in (t.position, t.effort))
        lost = replace(t, position=position, effort=effort, observed=seen[:, None])
        trials.append(replace(trial, trajectory=lost))
    model = JointMotion().joints(replace(logs, trials=tuple(trials))).models[0]
    assert len(model.fit.time) > 0.95 * len(whole.fit.time)
    assert fitted(model, [DRY])[0]["friction_nm"] == pytest.approx(2.0, rel=0.02)


def test_advice_fits_the_reason_why_no_joint_is_judged(runs):
    def advice(change):
        logs = log_set(runs)
        trials = tuple(replace(t, trajectory=change(t.trajectory)) for t in logs.trials)
        with pytest.raises(IdentificationError) as caught:
            JointMotion().joints(replace(logs, trials=trials))
        return caught.value.fix

    def gaps(t):
        observed = np.arange(t.samples)[:, None] % 200 < 20
        return replace(t, observed=observed)

    assert "no row is missing" in advice(gaps)
    assert "below the limit" in advice(lambda t: replace(t, effort=np.sign(t.effort)))
    assert "reversals" in advice(lambda t: replace(t, position=0.0 * t.position))


def test_a_gap_is_bridged_where_it_is_short_beside_the_filter():
    recorded = np.ones(100, dtype=bool)
    recorded[10:13] = recorded[50:54] = recorded[96:] = False
    found = bridged(recorded, 5.0, 0.0125)  # a quarter of a period is four samples
    assert found[:50].all() and not found[50:54].any() and not found[96:].any()
    assert np.array_equal(bridged(recorded, 40.0, 0.0125), recorded)


def test_rest_is_no_evidence():
    c = np.concatenate([reference(8, 1), np.full(4 * HZ, reference(8, 1)[-1]), reference(8, 1)[::-1]])
    logs = log_set([(c, *simulate(c, inertia=1.5, dry=lambda v, load: 3.0, seed=k)) for k in range(2)])
    model = JointMotion().joints(logs).models[0]
    assert not np.any((model.fit.time > 9.0) & (model.fit.time < 11.5))
    assert fitted(model, [DRY])[0]["friction_nm"] == pytest.approx(3.0, rel=0.05)


def test_what_a_neighbour_does_to_a_joint_is_taken_out_and_is_no_friction():
    c, other = (np.array([reference(15, seed) for seed in pair]) for pair in ((1, 2), (3, 4)))
    trials = []
    for k in range(2):
        q, tau = simulate(c[k], inertia=1.5, dry=lambda v, load: 1.0, torque_noise=0.05, seed=k)
        q2, tau2 = simulate(other[k], inertia=0.4, dry=lambda v, load: 0.5, torque_noise=0.05, seed=9 + k)
        a2 = np.gradient(np.gradient(np.convolve(q2, np.hanning(41) / np.hanning(41).sum(), "same"), 1 / HZ), 1 / HZ)
        trials.append((np.array([c[k], other[k]]).T, np.array([q, q2]).T, np.array([tau + 0.6 * a2, tau2]).T))
    model = JointMotion().joints(log_set(trials, joints=("a", "b"))).models[0]
    alone = (
        JointMotion().joints(log_set([(c[:, :1], q[:, :1], t[:, :1]) for c, q, t in trials], joints=("a",))).models[0]
    )
    numbers, left = fitted(model, [DRY])[:2]
    assert numbers["friction_nm"] == pytest.approx(1.0, rel=0.03)
    assert left[1] < 0.3 * fitted(alone, [DRY])[1][1]


def test_one_speed_leaves_dry_and_viscous_friction_apart_unknown():
    t = np.arange(20 * HZ) / HZ
    c = 0.5 * np.abs((t / 2.0) % 2.0 - 1.0)
    logs = log_set([(c, *simulate(c, inertia=1.0, dry=lambda v, load: 3.0, count=1e-4, seed=k)) for k in range(2)])
    model = JointMotion().joints(logs).models[0]
    dry = next(effect for effect in model.effects if effect.name == DRY)
    assert VISCOUS in dry.excludes
    assert any("cannot be told apart" in note for note in model.notes)


def test_current_is_in_ampere_until_something_gives_its_scale(runs):
    def model(**stated):
        amperes = [(c, q, tau / 0.5) for c, q, tau in runs]
        return JointMotion().joints(log_set(amperes, channel="current", **stated)).models[0]

    plain = model()
    assert plain.unit == "A" and plain.base[0].unit == "A·s²/rad" and any("ratios" in note for note in plain.notes)
    assert {p.unit for e in plain.effects for p in e.parameters if e.name == VISCOUS} == {"A·s/rad"}
    constant = model(drive={"*": {"torque_constant": 0.5}})
    assert constant.unit == "N·m"
    assert fitted(constant, [DRY])[0]["friction_nm"] == pytest.approx(2.0, rel=0.03)
    mass = 8.0 / 9.80665 / 0.4
    load = model(load={"*": {"mass_kg": mass, "lever_m": 0.4}})
    assert load.unit == "N·m" and "armature" in names(load)
    assert fitted(load, [DRY, "armature"])[0]["friction_nm"] == pytest.approx(2.0, rel=0.05)


def test_a_known_load_shows_armature_and_a_wrong_torque_constant(runs):
    logs = log_set(
        [(c, q, 1.1 * tau) for c, q, tau in runs], load={"*": {"mass_kg": 8.0 / 9.80665 / 0.4, "lever_m": 0.4}}
    )
    model = JointMotion().joints(logs).models[0]
    found = fitted(model, [DRY, "armature", "torque_scale"])[0]
    assert found["ratio"] == pytest.approx(0.1, abs=0.02)
    assert found["kg_m2"] == pytest.approx(1.5 - 8.0 / 9.80665 * 0.4, rel=0.05)
    assert found["friction_nm"] == pytest.approx(2.0, rel=0.03)


def test_joints_that_cannot_be_judged_are_left_with_a_reason(runs):
    still = [tuple(np.column_stack([x, np.full_like(x, 0.3)]) for x in run) for run in runs]
    found = JointMotion().joints(log_set(still, joints=("a", "b")))
    assert [model.joint for model in found.models] == ["a"] and "does not move" in found.left["b"]
    with pytest.raises(IdentificationError, match="no joint can be judged"):
        JointMotion().joints(log_set([(c, np.full_like(q, 0.3), tau) for c, q, tau in runs]))
    opposed = log_set([(c, q, -tau) for c, q, tau in runs])
    with pytest.raises(IdentificationError, match="wrong sign"):
        JointMotion().joints(opposed)


def test_logs_without_torque_are_refused_in_words(runs):
    logs = log_set(runs)
    bare = replace(logs, trials=tuple(replace(t, trajectory=replace(t.trajectory, effort=None)) for t in logs.trials))
    assert JointMotion().lacking(bare) and not JointMotion().lacking(logs)
    with pytest.raises(IdentificationError, match="effort or"):
        JointMotion().joints(bare)


@pytest.mark.parametrize("samples", [50, 57, 100, 101, 1000])
@pytest.mark.parametrize("cutoff", [5.0, 13.0, 40.0, 300.0])
def test_the_parallel_filter_is_a_weighted_mean_about_its_centres(samples, cutoff):
    low_pass = ParallelFilter.of(cutoff, 1e-3)
    if low_pass.length > samples:
        return
    x = np.random.default_rng(0).standard_normal((2, samples))
    half = low_pass.length // 2
    expected = [x[:, k - half : k + half + 1] @ low_pass.weights for k in low_pass.centres(samples)]
    assert np.allclose(low_pass.apply(x), np.transpose(expected))


def test_the_difference_quotient_is_of_sixth_order():
    errors = []
    for n in (101, 201):
        t = np.linspace(0.0, 1.0, n)
        errors.append(np.max(np.abs(derivative(np.sin(9 * t), t[1]) - 9 * np.cos(9 * t))[3:-3]))
    assert errors[0] / errors[1] > 50.0


def data(name):
    folder = DATA / name
    if not folder.is_dir():
        pytest.skip(f"no {folder}: real logs are not part of the project")
    return read_log_set(folder)


@pytest.mark.parametrize("kinds", [{}, {"slide": "prismatic"}])
def test_emps_gives_what_its_authors_publish(kinds):
    """Janot, Gautier & Brunot 2019: M 95.11 kg, viscous 203.5 N·s/m, Coulomb 20.39 N, offset −3.165 N."""
    model = JointMotion().joints(replace(data("emps"), kinds=kinds)).models[0]
    found, rms, _ = fitted(model, [DRY, VISCOUS])
    expected = {"inertia_kg_m2": 95.11, "nm_s_per_rad": 203.5, "friction_nm": 20.39, "offset_nm": -3.165}
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=0.02), name
    assert rms[1] < 0.2 * fitted(model, [])[1][1]


def test_friction_has_grown_without_lubricant_and_gravity_has_not():
    found = {}
    for name in ("cranfield_ref", "cranfield_same", "cranfield_lube1"):
        model = JointMotion().joints(data(name)).models[0]
        assert model.unsigned
        found[name] = fitted(model, [DRY])[0]
    friction = {name: values["friction_nm"] for name, values in found.items()}
    assert friction["cranfield_lube1"] - friction["cranfield_ref"] == pytest.approx(0.12, abs=0.02)
    assert friction["cranfield_same"] == pytest.approx(friction["cranfield_ref"], abs=0.02)
    assert np.ptp([values["offset_nm"] for values in found.values()]) < 0.03


def test_a_load_that_differs_between_the_trials_fixes_no_scale(runs):
    logs = log_set(runs, load={"*": {"mass_kg": 8.0 / 9.80665 / 0.4, "lever_m": 0.4}})
    first, last = logs.trials
    logs = replace(logs, trials=(first, replace(last, load={"*": {"mass_kg": 9.0, "lever_m": 0.4}})))
    model = JointMotion().joints(logs).models[0]
    assert model.load == (0.0, 0.0) and not {"armature", "torque_scale"} & names(model)
    assert any("load differs between the trials" in note for note in model.notes)


def test_a_torque_that_only_the_held_out_trials_show_is_left_with_a_reason(runs):
    (c, q, tau), held = runs
    with pytest.raises(IdentificationError, match="torque is constant in the trials of the fit"):
        JointMotion().joints(log_set([(c, q, 0.0 * tau), held]))


@pytest.mark.parametrize("load", [None, {"*": {"mass_kg": 8.0 / 9.80665 / 0.4, "lever_m": 0.4}}])
def test_nothing_changed_where_the_same_joint_moved_elsewhere(runs, load):
    truth = {"inertia": 1.5, "load": lambda q: 8.0 * np.sin(q), "dry": lambda v, load: 2.0, "torque_noise": 0.1}
    commands = [reference(12, seed) + 0.4 for seed in (3, 4)]
    elsewhere = [(c, *simulate(c, seed=k, **truth)) for k, c in enumerate(commands)]
    then, now = (
        JointMotion().joints(log_set(r, kinds={"joint": "revolute"}, **({"load": load} if load else {})))
        for r in (runs, elsewhere)
    )
    (joint,) = identify(now, reference=then).found
    assert joint.causes == () and all(name.endswith("in both records") for name in joint.full.effects)
    assert np.sqrt(np.mean(joint.base.heldout**2)) < 2.0 * now.models[0].noise[1]
