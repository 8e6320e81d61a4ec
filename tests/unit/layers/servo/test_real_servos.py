"""Two public recordings without a torque sensor; see the README beside them for their origin."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from servo_plant import fit

from hqpipe.layers.servo import Servo
from hqpipe.logs.log_set import read_log_set

DATA = Path(__file__).parents[5] / "shared" / "data"


def logs(name: str):
    if not (DATA / name).is_dir():
        pytest.skip(f"{DATA / name} is not there")
    return read_log_set(DATA / name)


@pytest.mark.parametrize("load", [{}, {"mass_kg": 0.49, "lever_m": 0.1}])
def test_friction_of_the_loaded_servo_grows_with_its_load(load):
    """Rhoban's fit of these recordings has 0.27–0.28 of the motor torque, and 0.14 of the load's beside it."""
    found = logs("xl330")
    trials = tuple(replace(trial, load={"*": load} if load else {}) for trial in found.trials)
    model = Servo().joints(replace(found, trials=trials)).models[0]
    rivals = ["coulomb_friction", "torque_by_position", "torque_by_speed_squared"]
    right = fit(model, ("load_dependent_friction",))
    assert 0.2 < right["load_dependent_friction.coefficient"] < 0.6
    for rival in rivals:
        wrong = fit(model, (rival,))
        assert right["rms"] < 0.8 * wrong["rms"] and right["heldout"] < wrong["heldout"], rival


def test_damping_of_the_quadruped_is_found_without_its_gains():
    """Its kd / kp is 75 ms; with friction in the model that, and no delay of this size, is what is found."""
    for model in Servo().joints(logs("go2")).models[:2]:
        found = fit(model, ("coulomb_friction", "command_delay"))
        assert found["drag"] == pytest.approx(0.075, rel=0.2)
        assert found["command_delay.delay_s"] < 0.025
        assert found["heldout"] < 0.5 * fit(model, ())["heldout"]
