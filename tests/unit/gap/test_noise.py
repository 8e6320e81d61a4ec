"""The noise floor against noise of known size."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.gap.noise import free_run_floor, repeats, separate
from hqpipe.gap.replay import memory, replay
from hqpipe.sysid.noise import noise_floor


def prepare(logs, model):
    replays = [replay(t, model, 0.1) for t in logs.heldout]
    bound = np.array([noise_floor(logs.heldout, j).value for j in logs.joints]) ** 2
    return replays, bound, memory(replays[0], model)


def test_memory_is_the_models_own_decay(make_logs, right_model):
    logs = make_logs(seconds=3.0)
    kept = prepare(logs, right_model(logs))[2]
    assert kept[:, 0] == pytest.approx(0.95 ** np.arange(1, 101), rel=1e-6)


@pytest.mark.parametrize("sensor,drive", [(2.0, 0.0), (1.0, 1.5), (3.0, 0.5)])
def test_sensor_and_drive_noise_are_told_apart(make_logs, right_model, sensor, drive):
    logs = make_logs(noise=sensor, drive_noise=drive)
    replays, bound, kept = prepare(logs, right_model(logs))
    found_sensor, found_drive = separate(replays, bound, kept[0])
    assert np.sqrt(found_sensor) == pytest.approx(sensor, rel=0.1)
    assert np.sqrt(found_drive) == pytest.approx(drive, rel=0.1, abs=0.1)


def test_floor_is_the_error_of_the_right_model(make_logs, right_model):
    logs = make_logs(noise=1.0, drive_noise=1.0, seconds=12.0)
    replays, bound, kept = prepare(logs, right_model(logs))
    error = np.mean(replays[0].targets(replays[0].residual) ** 2, axis=(0, 1))
    assert free_run_floor(replays, bound, kept) == pytest.approx(error, rel=0.25)


def test_a_wrong_model_does_not_raise_the_floor(make_logs, right_model):
    logs = make_logs(effect=lambda e, v, t: 0.9 * e)
    replays, bound, kept = prepare(logs, right_model(logs))
    right = 4.0 * (1.0 + np.mean(kept**2, axis=0))
    assert free_run_floor(replays, bound, kept) == pytest.approx(right, rel=0.25)
    assert np.mean(replays[0].residual ** 2) > 100 * right[0]


def test_repeats_cancel_the_models_error(make_logs, right_model):
    logs = make_logs(noise=0.0, effect=lambda e, v, t: 0.9 * e)
    replays, bound, kept = prepare(logs, right_model(logs))
    rng = np.random.default_rng(0)
    pair = [
        type(r)(
            r.file,
            r.trajectory,
            r.steps,
            r.predicted + 5.0 * rng.standard_normal(r.predicted.shape),
            r.one_step,
        )
        for r in replays * 2
    ]
    assert repeats(pair) == [(0, 1)] and repeats(replays) == []
    assert free_run_floor(pair, bound, kept) == pytest.approx(25.0, rel=0.1)
