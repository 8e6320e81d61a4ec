"""Every registered actuator model keeps the same contract."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from hqpipe.actuators import ACTUATOR_MODELS
from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.files import load_actuator, save_actuator
from hqpipe.actuators.net import NetActuator
from hqpipe.errors import UsageError

sys.path.insert(0, str(Path(__file__).parents[1] / "unit" / "actuators"))
from net_examples import random_net

JOINTS = ("LFR", "LFP", "LFK")


def example(name: str) -> ActuatorModel:
    """A model with an inner value for every parameter, 0 for those of either sign, and a limit of 200 N·m; random weights."""
    model = ACTUATOR_MODELS[name]
    if issubclass(model, NetActuator):
        return random_net(name, JOINTS, effort_limit=200.0, size=10.0)
    values = {}
    for position, (column, spec) in enumerate(model.FIELDS.items()):
        inner = min(spec.lower + 0.05 * (position + 1), 0.5 * (spec.lower + spec.upper))
        inner = 0.0 if spec.lower < 0.0 else inner
        values[column] = 200.0 if column == "effort_limit" else inner * np.array([1.0, 0.9, 0.8])
    return model.build(JOINTS, dt=0.001, **values)


@pytest.mark.parametrize("name", list(ACTUATOR_MODELS))
class TestEveryModel:
    def test_is_registered_under_its_own_name(self, name):
        assert ACTUATOR_MODELS[name].NAME == name

    def test_states_units_and_an_effort_limit(self, name):
        fields = ACTUATOR_MODELS[name].FIELDS
        assert all(spec.unit for spec in fields.values())
        assert "effort_limit" in fields

    def test_says_where_its_equation_comes_from(self, name):
        assert len(ACTUATOR_MODELS[name].__doc__) > 100

    def test_stays_within_the_effort_limit(self, name):
        rng = np.random.default_rng(0)
        tau, q_des, q, qd = (rng.normal(0, s, (64, 3)) for s in (100.0, 1e5, 1.0, 1e3))
        model = example(name)
        model.step(tau, model.fresh_memory(64), q_des, q, qd, dt=0.001)
        assert np.isfinite(tau).all() and (np.abs(tau) <= 200.0).all() and (np.abs(tau) == 200.0).any()

    def test_is_odd(self, name):
        """Without offsets and one-sided effects no law knows left from right: reversing every signal reverses the torque."""
        rng = np.random.default_rng(1)
        tau, q_des, q, qd = (rng.normal(size=(8, 3)) for _ in range(4))
        mirrored = -tau
        model = example(name)
        if isinstance(model, NetActuator):
            pytest.skip("a net has biases")
        model.step(tau, model.fresh_memory(8), q_des, q, qd, dt=0.001)
        model.step(mirrored, model.fresh_memory(8), -q_des, -q, -qd, dt=0.001)
        np.testing.assert_array_equal(mirrored, -tau)

    def test_permuting_joints_permutes_the_result(self, name):
        rng = np.random.default_rng(2)
        order = [2, 0, 1]
        tau, *inputs = (rng.normal(size=(8, 3)) for _ in range(4))
        permuted, *others = (np.ascontiguousarray(a[:, order]) for a in (tau, *inputs))
        model = example(name)
        model.step(tau, model.fresh_memory(8), *inputs, dt=0.001)
        model.for_joints([JOINTS[i] for i in order]).step(permuted, model.fresh_memory(8), *others, dt=0.001)
        rounding = 2e-4 if isinstance(model, NetActuator) else 0.0  # its sums run in another order, in single precision
        np.testing.assert_allclose(permuted, tau[:, order], rtol=0.0, atol=rounding)

    def test_survives_the_disk(self, name, tmp_path):
        model = example(name)
        save_actuator(model, tmp_path)
        loaded = load_actuator(tmp_path)
        assert type(loaded) is type(model)
        np.testing.assert_array_equal(loaded.parameters, model.parameters)
        np.testing.assert_array_equal(loaded.weights, model.weights)

    def test_names_a_misspelt_parameter(self, name):
        with pytest.raises(UsageError, match="did you mean 'effort_limit'"):
            ACTUATOR_MODELS[name].build(JOINTS, effort_limt=1.0)
