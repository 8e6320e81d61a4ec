"""Which of two rivals is named, and what is borne out, where small effects and predictions without bounds stand beside them."""

from __future__ import annotations

import numpy as np
from identify.toy_joint import ToyJoint

from hqpipe.identify.identify import identify
from hqpipe.identify.model import Effect, LayerJoints, Parameter
from hqpipe.identify.prior import prior_odds
from hqpipe.identify.search import Search
from hqpipe.identify.uncertain_effects import certainty

RIPPLE = 0.05  # of the spring's torque: 0.2 % of the squared gap, and far above the noise


def _named(model):
    (joint,) = identify(LayerJoints("joint_motion", "rmse", 0.1, "", (model,))).found
    return [cause.effect for cause in joint.causes], joint


def _with_columns(model, columns, effects):
    """The model with effects that are linear in a number; columns: position → (K, N)."""
    whole, count = model.error, len(effects)
    model.effects += tuple(Effect(name, (Parameter("size", "1", 0.0, 0.5),)) for name in effects)

    def error(values, heldout=False):
        q = (model.heldout if heldout else model.fit).position
        return whole(values[:-count], heldout) + values[-count:] @ columns(q)

    model.error = error
    return model


def test_a_rival_that_wins_by_a_small_effect_loses_beside_it():
    """A worn spring does most of what a spring and a ripple do, and something that neither does."""

    def columns(q):
        ripple = RIPPLE * np.sin(8.0 * q)
        return np.stack([ripple, q + ripple + 0.5 * RIPPLE * np.sin(13.0 * q)])

    model = _with_columns(ToyJoint(truth={"spring": 1.0}, noise=0.005, seed=3), columns, ("ripple", "worn_spring"))
    for part in (model.fit, model.heldout):
        part.output[:] += columns(part.position)[0]
    search = Search(model, prior_odds(model, {}, 0))
    spring, worn = (search.grown_along([name]) for name in ("spring", "worn_spring"))
    assert search.preference(worn, spring) > 10.0, "by itself the rival is far more probable"
    assert _named(model)[0] == ["spring"]


def test_a_shape_that_the_logs_do_not_show_makes_an_effect_no_less_sure():
    model = ToyJoint(truth={"spring": 1.0}, noise=0.01, seed=3)
    whole, spring = model.error, len(model.base) + 2
    numbers = Parameter("stiffness", "N·m/rad", 0.0, 2.0), Parameter("bend", "1", 0.0, np.inf, 0.0, 9.0, shape=True)
    model.effects = (*(e for e in model.effects if e.name != "spring"), Effect("bent_spring", numbers))

    def error(values, heldout=False):
        q = (model.heldout if heldout else model.fit).position
        stiffness, bend = values[-2:]
        return whole(np.insert(values[:-2], spring, 0.0), heldout) + stiffness * (1.0 + bend * (1.0 + 1e-4 * q)) * q

    model.error = error
    search = Search(model, prior_odds(model, {}, 0))
    bent = search.grown_by(search.base, "bent_spring")
    place = np.flatnonzero(bent.solution.free == search.screening.places("bent_spring")[0])[0]
    assert bent.covariance.robust[place, place] ** 0.5 > bent.solution.values[-2], "beside a free shape it has no size"
    assert certainty(search, bent, "bent_spring") > 10.0


def test_a_cause_without_which_the_prediction_of_held_out_trials_overflows_is_borne_out():
    model = ToyJoint(truth={"coulomb_friction": 0.5, "spring": 1.0}, seed=3)
    whole = model.error

    def error(values, heldout=False):
        found = whole(values, heldout)
        overflows = heldout and values[2] > 0.0 and values[4] == 0.0
        return np.full(len(found), np.inf) if overflows else found

    model.error = error
    names, joint = _named(model)
    assert sorted(names) == ["coulomb_friction", "spring"] and joint.withdrawn == ()


def test_a_rival_that_errs_less_than_twice_as_much_beyond_the_noise_is_told():
    """What both leave above the noise is of unknown form, and favours one of them."""

    def columns(q):
        return np.stack([q + 0.03 * np.sin(13.0 * q)])

    truth = {"spring": 1.0}
    sound = _with_columns(ToyJoint(truth=truth, noise=0.005, seed=3), columns, ("belt",))
    assert _named(sound)[1].causes[0].confused_with == ()
    rough = _with_columns(ToyJoint(truth=truth, noise=0.005, seed=3, unknown=0.1), columns, ("belt",))
    rough.effects = tuple(effect for effect in rough.effects if effect.named)
    whole = rough.error
    rough.error = lambda values, heldout=False: whole(np.insert(values, 5, [0.0, 0.0]), heldout)
    (cause,) = _named(rough)[1].causes
    assert {cause.effect, *cause.confused_with} == {"spring", "belt"}


def test_an_effect_that_does_little_of_what_a_cause_does_is_no_rival():
    """The cause closes less than the unknown: with anything in its place the set errs less than twice as much."""
    model = ToyJoint(truth={"coulomb_friction": 0.12}, noise=0.005, seed=3, unknown=0.2)
    whole = model.error
    model.effects = (model.effects[0], Effect("rubbing", (Parameter("size", "1", 0.0, 0.5),)))

    def error(values, heldout=False):
        part = model.heldout if heldout else model.fit
        rubbing = np.sign(part.velocity) * (part.position > 0.2)
        return whole(np.append(values[:3], np.zeros(4)), heldout) + values[3] * rubbing

    model.error = error
    names, joint = _named(model)
    left, without = (np.sum(fit.error**2) for fit in (joint.named, joint.without["coulomb_friction"]))
    assert names == ["coulomb_friction"] and without - left < joint.unexplained * np.sum(joint.base.error**2)
    assert joint.causes[0].confused_with == ()
