"""Earlier logs as a record: what they tell, and which of them are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plant_logs import broken, rows, values
from planted_logs import logs_of

from hqpipe.errors import IdentificationError
from hqpipe.gap.change.position_record import position_record
from hqpipe.gap.change.since import EarlierLogs


@pytest.fixture(scope="module")
def sound():
    return logs_of([{}, {}], seconds=4.0)


def record_of(logs, window_s=0.1, **kwargs):
    return position_record(EarlierLogs(logs), window_s, **kwargs)


def test_sound_logs_are_a_record_of_all_joints(sound):
    record = record_of(sound)
    assert [model.joint for model in record.joints.models] == list(sound.joints)
    assert record.warnings == [] and record.measured == frozenset() and record.joints.window_s == 0.1
    assert record_of(sound, None).joints.window_s >= 0.1, "a length that suits the logs"


def test_effects_that_are_left_out_are_so_in_the_record_too(sound):
    names = {effect.name for effect in record_of(sound, without=["valve_lag"]).joints.models[0].effects}
    assert "valve_lag" not in names and "valve_deadband" in names


def test_a_joint_that_is_left_out_is_told_as_of_the_reference(sound):
    record = record_of(broken(sound, values("effort", np.negative, 0)))
    assert [model.joint for model in record.joints.models] == [sound.joints[1]]
    assert record.warnings and all(text.startswith("reference: ") for text in record.warnings)
    assert any(sound.joints[0] in text for text in record.warnings)


def test_a_torque_that_lost_its_sign_is_known_of_the_record(sound):
    record = record_of(broken(sound, values("effort", np.abs, 0)))
    assert record.intake.signed.joints == sound.joints[:1]
    first, second = ({effect.name for effect in model.effects} for model in record.joints.models)
    assert second - first == {"backlash"}


def test_what_the_pressures_show_is_known_of_the_record():
    logs = logs_of([{}] * 3, seconds=6.0, joints=("a_knee", "b_knee", "c_knee"))

    def with_pressures(t):
        """Chambers that carry the torque; the sensor of the last joint shows a tenth more."""
        half = t.effort / (2.0 * 1e-5)
        return replace(t, effort=t.effort * [1.0, 1.0, 1.1], pressure_a=8e6 + half, pressure_b=8e6 - half)

    assert record_of(broken(logs, with_pressures)).measured == {("torque_scale", "c_knee")}


def shuffled(count):
    return np.random.default_rng(0).permutation(count)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.section(0, 500), "windows"),
        (rows(shuffled), "order"),
        (lambda t: replace(t, position_command=None), "position_command"),
    ],
)
def test_logs_that_cannot_be_judged_are_refused_with_their_name(sound, change, message):
    with pytest.raises(IdentificationError, match=f"^reference synthetic: .*{message}") as told:
        record_of(broken(sound, change))
    assert told.value.fix and Path(told.value.file) == sound.path
