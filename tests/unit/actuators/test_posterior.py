"""Posterior of an actuator model: what is drawn from it, and its file."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.posterior import Alternative, Choice, Group, Posterior, Range
from hqpipe.actuators.posterior_file import FILE, FORMAT, MIXTURE, load_posterior, save_posterior
from hqpipe.errors import ConfigError, UsageError

FIELDS = ("k1", "k2", "k3", "k4")
MEAN = np.array([1.0e5, 0.05, 4.0e3, 20.0])
DEVIATION = 0.05 * MEAN
CORRELATION = np.array([[1.0, 0.5, 0.9, 0.0], [0.5, 1.0, 0.3, 0.0], [0.9, 0.3, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
SCATTER = CORRELATION * np.outer(DEVIATION, DEVIATION)
LOWER, UPPER = np.zeros(4), np.array([np.inf, 1.0, np.inf, np.inf])


def group(joints=("a",), mean=MEAN, scatter=SCATTER, between=None, ranges=None):
    return Group(tuple(joints), mean, scatter, between, 4, LOWER, UPPER, ranges or {})


def model(*groups):
    """The model that belongs to the groups, and their posterior."""
    joints = [joint for part in groups for joint in part.joints]
    table = np.concatenate([np.tile(part.mean, (len(part.joints), 1)) for part in groups])
    columns = dict(zip(FIELDS, table.T, strict=True))
    made = Hydraulic.build(joints, dt=1e-3, sprocket_radius=0.06, effort_limit=900.0, **columns)
    return made, Posterior("hydraulic", FIELDS, groups)


def draws(posterior, actuator, count=20_000, seed=0, scale=1.0):
    return posterior.draw(actuator, count, np.random.default_rng(seed), scale)


def mixture(weight=0.75):
    """Joints a and b, which both have the doubled coefficients of another law or none of them, and joint c."""
    means = {"as diagnosed": MEAN, "another law": 2.0 * MEAN}
    alternatives = tuple(
        Alternative(name, share, (group(("a",), mean), group(("b",), mean, 4.0 * SCATTER)))
        for (name, mean), share in zip(means.items(), (weight, 1.0 - weight), strict=True)
    )
    actuator, posterior = model(*alternatives[0].groups, group(("c",)))
    return actuator, replace(posterior, groups=posterior.groups[2:], choices=(Choice(alternatives),))


def test_whole_sets_are_drawn_with_their_correlations():
    actuator, posterior = model(group())
    table = draws(posterior, actuator)[:, 0]
    np.testing.assert_allclose(table[:, :4].mean(axis=0), MEAN, rtol=0.003)
    np.testing.assert_allclose(table[:, :4].std(axis=0), DEVIATION, rtol=0.03)
    np.testing.assert_allclose(np.corrcoef(table[:, :4].T), CORRELATION, atol=0.03)
    assert (table[:, 4] == 0.06).all() and (table[:, 5] == 900.0).all()


def test_shared_error_is_common_and_what_lies_between_is_each_joint_s_own():
    actuator, posterior = model(group(("a", "b"), between=3.0 * SCATTER))
    table = draws(posterior, actuator)
    np.testing.assert_allclose(table[:, :, 0].std(axis=0), 2.0 * DEVIATION[0], rtol=0.03)
    assert np.corrcoef(table[:, 0, 0], table[:, 1, 0])[0, 1] == pytest.approx(0.25, abs=0.03)


def test_a_mean_on_a_bound_is_not_heaped_there():
    on_bound = np.array([1.0e5, 0.05, 0.0, 20.0])
    spread = np.diag(np.array([1e3, 1e-3, 1e2, 1.0]) ** 2)
    actuator, posterior = model(group(mean=on_bound, scatter=spread))
    k3 = draws(posterior, actuator)[:, 0, 2]
    assert (k3 > 0.0).all()
    assert k3.mean() == pytest.approx(1e2 * np.sqrt(2.0 / np.pi), rel=0.03), "half of a normal distribution"


def test_scale_and_seed():
    actuator, posterior = model(group(between=SCATTER))
    np.testing.assert_array_equal(draws(posterior, actuator, 50), draws(posterior, actuator, 50))
    assert (draws(posterior, actuator, 50, seed=1)[..., 0] != draws(posterior, actuator, 50)[..., 0]).all()
    wide, plain = (draws(posterior, actuator, scale=s)[..., 0].std() for s in (2.0, 1.0))
    assert wide == pytest.approx(2.0 * plain, rel=0.03)
    np.testing.assert_array_equal(draws(posterior, actuator, 3, scale=0.0), np.tile(actuator.parameters, (3, 1, 1)))


def test_what_logs_do_not_determine_comes_from_its_range():
    silent = SCATTER.copy()
    silent[3], silent[:, 3] = 0.0, 0.0
    mean = np.array([*MEAN[:3], 0.0])
    actuator, posterior = model(group(mean=mean, scatter=silent, ranges={"k4": Range(0.0, 8.0, "no impacts")}))
    k4 = draws(posterior, actuator)[:, 0, 3]
    assert k4.min() >= 0.0 and k4.max() <= 8.0 and k4.mean() == pytest.approx(4.0, rel=0.05)


def test_alternatives_are_drawn_with_their_weights_for_all_of_their_joints():
    actuator, posterior = mixture()
    table = draws(posterior, actuator)[..., :4]
    (number,) = posterior.chosen(len(table), np.random.default_rng(0))
    assert np.mean(number == 1) == pytest.approx(0.25, abs=0.015)
    other = table[:, :, 0] > 1.5 * MEAN[0]
    np.testing.assert_array_equal(other[:, 0], number == 1)
    np.testing.assert_array_equal(other[:, 1], number == 1)
    assert not other[:, 2].any(), "a joint without alternatives"


def test_numbers_of_two_alternatives_are_never_mixed_in_a_joint():
    actuator, posterior = mixture()
    table = draws(posterior, actuator)[..., :4]
    (number,) = posterior.chosen(len(table), np.random.default_rng(0))
    for k, factor in enumerate((1.0, 2.0)):
        for joint, size in enumerate((1.0, 2.0)):
            drawn = table[number == k, joint]
            np.testing.assert_allclose(drawn.mean(axis=0), factor * MEAN, rtol=0.01)
            np.testing.assert_allclose(drawn.std(axis=0), size * DEVIATION, rtol=0.04)
            np.testing.assert_allclose(np.corrcoef(drawn.T), CORRELATION, atol=0.04)
            assert (np.abs(drawn - factor * MEAN) < 0.5 * MEAN).all(), "each of its numbers is of the same law"


def test_joints_are_matched_by_name():
    actuator, posterior = model(group(("a",)), group(("b",), mean=2.0 * MEAN, scatter=SCATTER))
    table = draws(posterior, actuator.for_joints(("b", "a")), 500)
    np.testing.assert_allclose(table[..., 0].mean(axis=0), [2.0e5, 1.0e5], rtol=0.02)
    with pytest.raises(UsageError, match="no joint 'c'"):
        draws(posterior, replace(actuator, joints=("a", "c")), 1)


def test_a_mean_far_out_of_bounds_is_an_error_and_no_endless_loop():
    lost = replace(group(), mean=np.array([-1e6, 0.05, 4e3, 20.0]))
    with pytest.raises(ConfigError, match="hardly a draw lies within the physical bounds: lower randomisation"):
        draws(Posterior("hydraulic", FIELDS, (lost,)), model(group())[0], 2)


def test_the_file_gives_back_the_same_draws(tmp_path):
    ranges = {"k4": Range(0.0, 8.0, "no impacts")}
    actuator, posterior = model(group(("a", "b"), between=SCATTER), group(("c",), ranges=ranges))
    first = save_posterior(posterior, actuator, tmp_path).read_bytes()
    again = load_posterior(tmp_path, actuator)
    np.testing.assert_array_equal(draws(again, actuator, 50), draws(posterior, actuator, 50))
    assert save_posterior(again, actuator, tmp_path).read_bytes() == first


def test_the_file_of_a_mixture_gives_back_the_same_draws(tmp_path):
    actuator, posterior = mixture()
    first = save_posterior(posterior, actuator, tmp_path).read_bytes()
    again = load_posterior(tmp_path, actuator)
    np.testing.assert_array_equal(draws(again, actuator, 50), draws(posterior, actuator, 50))
    assert save_posterior(again, actuator, tmp_path).read_bytes() == first
    assert json.loads(first)["format"] == MIXTURE
    save_posterior(replace(posterior, groups=posterior.held, choices=()), actuator, tmp_path)
    assert json.loads((tmp_path / FILE).read_text(encoding="utf-8"))["format"] == FORMAT


def test_a_folder_without_the_file_has_no_posterior(tmp_path):
    assert load_posterior(tmp_path, model(group())[0]) is None


def refused(folder, actuator, posterior, change, message):
    """The file of a posterior after a change is refused with a message."""
    path = save_posterior(posterior, actuator, folder)
    raw = json.loads(path.read_text(encoding="utf-8"))
    change(raw)
    path.write_text(json.dumps(raw), encoding="utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        load_posterior(folder, actuator)
    assert FILE in str(caught.value) and "run hqpipe fit-actuator again" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda raw: raw.pop("groups"), "missing field 'groups'"),
        (lambda raw: raw.update(group=1), "unknown field 'group' – did you mean 'groups'"),
        (lambda raw: raw.update(format="hqpipe-posterior/0"), "expected hqpipe-posterior/1"),
        (lambda raw: raw["fields"].__setitem__(0, "effort_limit"), "'effort_limit' is no fitted parameter"),
        (lambda raw: raw["groups"][0]["mean"].pop(), r"groups\[0\].mean: expected 4 elements"),
        (lambda raw: raw["groups"][0]["mean"].__setitem__(0, 1.0), "they are of two fits"),
        (lambda raw: raw["groups"][0]["scatter"][0].__setitem__(2, 1e9), "scatter: is no covariance"),
        (lambda raw: raw["groups"][0]["joints"].__setitem__(0, "z"), "joints are z, those of actuator.json a"),
        (lambda raw: raw["groups"][0]["lower"].__setitem__(0, 1e9), "mean: expected values between lower and upper"),
        (lambda raw: raw["groups"][0]["ranges"].update(k9={"low": 0, "high": 1, "reason": ""}), "unknown .k9."),
    ],
)
def test_a_broken_file_is_named_with_field_and_mend(tmp_path, change, message):
    refused(tmp_path, *model(group()), change, message)


def alternatives(raw):
    return raw["choices"][0]["alternatives"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda raw: raw.pop("choices"), "missing field 'choices'"),
        (lambda raw: raw.update(format=FORMAT), "unknown field 'choices'"),
        (lambda raw: raw["choices"].clear(), "choices: expected at least 1 elements"),
        (lambda raw: alternatives(raw).pop(), r"alternatives: expected at least 2 elements"),
        (lambda raw: alternatives(raw)[1].update(weight=0.5), "alternatives: expected weights that add up to 1"),
        (lambda raw: alternatives(raw)[1].update(weight=-0.5), r"alternatives\[1\].weight: is -0.5, expected 0 to 1"),
        (lambda raw: alternatives(raw)[1].pop("name"), r"alternatives\[1\]: missing field 'name'"),
        (lambda raw: alternatives(raw)[1]["groups"].pop(), "joints are a, those of the first alternative a, b"),
        (lambda raw: alternatives(raw).reverse(), "the mean of joint 'a' is not what actuator.json holds"),
        (
            lambda raw: alternatives(raw)[1]["groups"][0]["lower"].__setitem__(0, -1.0),
            "'k1' may be -1 to inf, expected 0",
        ),
        (lambda raw: raw["groups"].clear(), "joints are a, b, those of actuator.json a, b, c"),
        (lambda raw: raw["groups"].append(alternatives(raw)[0]["groups"][0]), "joints are c, a, a, b, those of"),
    ],
)
def test_a_broken_mixture_is_named_with_field_and_remedy(tmp_path, change, message):
    refused(tmp_path, *mixture(), change, message)


def test_a_setting_may_differ_between_alternatives_and_does_not_vary(tmp_path):
    actuator, posterior = mixture()
    names = (*FIELDS, "sprocket_radius")

    def with_radius(part):
        numbers = {"mean": np.append(part.mean, 0.06), "scatter": np.pad(part.scatter, (0, 1))}
        return replace(part, **numbers, lower=np.append(part.lower, 0.06), upper=np.append(part.upper, 0.06))

    laws = [replace(a, groups=tuple(map(with_radius, a.groups))) for a in posterior.choices[0].alternatives]
    groups = tuple(map(with_radius, posterior.groups))
    path = save_posterior(Posterior("hydraulic", names, groups, (Choice(tuple(laws)),)), actuator, tmp_path)
    assert load_posterior(tmp_path, actuator).fields == names
    raw = json.loads(path.read_text(encoding="utf-8"))
    raw["groups"][0]["scatter"][4][4] = 1.0
    path.write_text(json.dumps(raw), encoding="utf-8")
    with pytest.raises(
        ConfigError, match="scatter: varies 'sprocket_radius', which is no fitted parameter, expected 0"
    ):
        load_posterior(tmp_path, actuator)
