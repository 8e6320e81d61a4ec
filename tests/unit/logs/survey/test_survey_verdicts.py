"""Verdicts on channels, clocks and motion, each on a log that is known to have what the verdict says."""

from __future__ import annotations

import numpy as np
import pytest
from log_builders import make_columns

from hqpipe.logs.assemble import assemble
from hqpipe.logs.columns import RawTable
from hqpipe.logs.repair.one_file import look_through, repair
from hqpipe.logs.repair.report import as_recorded
from hqpipe.logs.survey.channel import channel_verdicts
from hqpipe.logs.survey.clock import trial_verdict
from hqpipe.logs.survey.end_stop import end_stops
from hqpipe.logs.survey.excitation import excitations


def trajectory(tmp_path, columns=None):
    return assemble(RawTable(tmp_path / "a.parquet", columns or make_columns()))


def verdicts(tmp_path, **changes):
    columns = make_columns()
    for name, values in changes.items():
        columns[f"joint/hip/{name}"] = values(columns[f"joint/hip/{name}"])
    found = channel_verdicts("a.parquet", [trajectory(tmp_path, columns)])
    return {v.channel: v for v in found if v.joint == "hip"}


def clock_of(tmp_path, columns):
    source = look_through(RawTable(tmp_path / "a.parquet", columns))
    before = as_recorded(source, repair(source, source.clock.dt))
    return trial_verdict("a.parquet", "fit", [trajectory(tmp_path)], [before])


def test_sound_channels_are_ok(tmp_path):
    assert {v.verdict for v in verdicts(tmp_path).values()} == {"ok"}


@pytest.mark.parametrize(
    ("channel", "change", "verdict"),
    [
        ("effort", lambda x: 0.0 * x, "constant"),
        ("effort", lambda x: np.clip(x, -150, 150), "saturated"),
        ("effort", lambda x: np.round(x / 20.0) * 20.0, "coarse"),
        ("position_command", lambda x: np.repeat(x[::8], 8), "held"),
    ],
)
def test_what_is_odd_about_a_channel(tmp_path, channel, change, verdict):
    found = verdicts(tmp_path, **{channel: change})
    assert found.pop(channel).verdict == verdict
    assert {v.verdict for v in found.values()} == {"ok"}


def test_a_command_has_neither_noise_nor_coarseness(tmp_path):
    found = verdicts(tmp_path, position_command=lambda x: np.sign(x))
    assert found["position_command"].flags == () and found["position_command"].noise is None


def test_saturation_says_where_and_holding_for_how_long(tmp_path):
    found = verdicts(tmp_path, effort=lambda x: np.minimum(x, 150), position_command=lambda x: np.repeat(x[::8], 8))
    assert found["effort"].limit == 150.0
    assert found["position_command"].held_samples == 8


@pytest.mark.parametrize(
    ("time", "verdict", "clock"),
    [
        (np.arange(2000) * 1e-3, "ok", "uniform"),
        (np.arange(2000) * 1e-3 + 2e-5 * np.sin(np.arange(2000)), "ok", "jitter"),
        (np.arange(2000) * 1e-3 + 2e-4 * np.sin(np.arange(2000)), "jitter", "jitter"),
        (np.arange(2000) * 1e-3 + 0.1 * (np.arange(2000) > 900), "gaps", "gaps"),
    ],
)
def test_clocks(tmp_path, time, verdict, clock):
    found = clock_of(tmp_path, make_columns() | {"time": time})
    assert (found.verdict, found.clock) == (verdict, clock)
    assert found.gaps == (1 if clock == "gaps" else 0)
    assert found.rate_hz == pytest.approx(1000, rel=0.02)


def test_samples_that_are_missing_are_counted(tmp_path):
    columns = make_columns()
    columns["joint/hip/effort"][:200] = np.nan
    found = clock_of(tmp_path, columns)
    assert found.missing == pytest.approx(200 / (2000 * 9))


def moving(position, command, rate=200.0):
    """A one-joint trial."""
    time = np.arange(len(position)) / rate
    columns = {"time": time, "joint/arm/position": position, "joint/arm/position_command": command}
    return assemble(RawTable(__file__, columns))


SLOW = 0.5 * np.sin(2 * np.pi * 0.4 * np.arange(2000) / 200.0)


def test_a_joint_that_stands_while_its_command_goes_on_is_at_its_end_stop():
    (stop,) = end_stops([("a.parquet", moving(np.minimum(SLOW, 0.3), SLOW))])
    assert stop.position == pytest.approx(0.3) and stop.beyond == pytest.approx(0.2) and stop.files == ("a.parquet",)
    (stop,) = end_stops([("a.parquet", moving(np.maximum(SLOW, -0.3), SLOW))])
    assert stop.position == pytest.approx(-0.3)


@pytest.mark.parametrize(
    ("position", "command"),
    [
        (SLOW, SLOW),
        (0.7 * SLOW, SLOW),  # droops
        (0.0 * SLOW, np.maximum(SLOW, 0.0)),  # does not move
        (np.clip(SLOW, -0.46, 0.46), SLOW),  # sticks at the turning points
        (
            np.minimum(SLOW, 0.3),
            np.where(SLOW > 0.3, 0.5, SLOW),
        ),  # the command stands still: the load may hold the joint
    ],
)
def test_other_rests_are_no_end_stop(position, command):
    assert end_stops([("a.parquet", moving(position, command))]) == []


def test_a_single_stall_is_no_end_stop():
    assert end_stops([("a.parquet", moving(np.minimum(SLOW, 0.3)[:500], SLOW[:500]))]) == []


def test_the_motion_of_a_sine_is_recovered():
    position = 0.5 * np.sin(2 * np.pi * 2.0 * np.arange(4000) / 200.0)
    (found,) = excitations([moving(position, position)])
    assert found.travel == pytest.approx(1.0, rel=1e-3)
    assert found.reversals == pytest.approx(2 * 2.0 * 20.0, abs=1)
    assert found.speed_rms == pytest.approx(0.5 * 2 * np.pi * 2.0 / np.sqrt(2), rel=0.02)
    assert found.bandwidth_hz == pytest.approx(2.0, abs=0.3)
    assert found.rest_share < 0.05


def test_noise_makes_no_reversals_and_rests_count():
    position = np.interp(np.arange(4000), [0, 1000, 3000, 4000], [0.0, 1.0, 1.0, 0.0])
    noisy = position + 1e-3 * np.random.default_rng(0).normal(size=4000)
    (found,) = excitations([moving(noisy, position)])
    assert found.reversals == 1
    (found,) = excitations([moving(position, position)])
    assert found.rest_share == pytest.approx(0.5, abs=0.02)


def test_a_joint_that_stands_still_has_no_bandwidth():
    still = np.zeros(2000)
    (found,) = excitations([moving(still, still)])
    assert (found.travel, found.reversals, found.bandwidth_hz) == (0.0, 0, None)
