"""Streams on clocks of their own come onto one clock without crossing gaps."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from hqpipe.logs.imports.align import lag_of_velocity, onto
from hqpipe.logs.imports.clock import increasing, regularity
from hqpipe.logs.imports.convert import convert
from hqpipe.logs.imports.mapping import parse_map
from hqpipe.logs.imports.recording import ImportLogError, Recording, Stream

MAP = {
    "format": "hqpipe-log-map/1",
    "joints": {
        "knee": {
            "position": "/joints/position",
            "velocity": "/speed/velocity",
            "effort": "/load/force",
            "position_command": "/target/command",
        }
    },
}


def recording(delay: float = 0.0, gap: bool = False) -> Recording:
    """A 2 Hz sine on four streams of 200, 100, 50 and 250 Hz with clocks of their own."""
    rng = np.random.default_rng(0)
    w = 2 * np.pi * 2.0

    def clock(rate, start, end):
        return (
            1.7e9
            + np.arange(start, end, 1 / rate)
            + 0.1 / rate * rng.uniform(-1, 1, len(np.arange(start, end, 1 / rate)))
        )

    a, b, c, d = clock(200, 0, 10), clock(100, 0.5, 9.8), clock(50, -1, 12), clock(250, 0.2, 9.5)
    position = np.sin(w * (a - 1.7e9))
    if gap:
        a, position = (np.delete(x, slice(800, 900)) for x in (a, position))
    streams = (
        Stream("/joints", {"position": position}, time=a),
        Stream("/speed", {"velocity": w * np.cos(w * (b - delay - 1.7e9))}, time=b),
        Stream("/target", {"command": np.floor(10 * (c - 1.7e9))}, time=c),
        Stream("/load", {"force": 100 * np.cos(w * (d - 1.7e9))}, time=d),
    )
    return Recording(Path("a.mcap"), streams)


def test_the_clock_is_that_of_the_effort_and_the_overlap_alone_is_kept():
    found = convert(recording(), parse_map(MAP, Path("map.yaml")))
    time, w = found.columns["time"] + 0.5, 2 * np.pi * 2.0
    assert time[-1] < 9.5 and len(time) == pytest.approx(9 * 250, abs=3)
    np.testing.assert_allclose(found.columns["joint/knee/position"], np.sin(w * time), atol=0.06)
    lines = "\n".join(found.notes)
    assert "on the clock of stream '/load'" in lines and "stream '/target': 50" in lines and "outside of it" in lines


def test_commands_are_held_measurements_are_interpolated():
    columns = convert(recording(), parse_map(MAP, Path("map.yaml"))).columns
    assert set(np.unique(columns["joint/knee/position_command"] % 1)) == {0.0}
    assert len(np.unique(columns["joint/knee/position"])) > 2000


def test_a_gap_is_never_bridged():
    columns = convert(recording(gap=True), parse_map(MAP, Path("map.yaml"))).columns
    lost = np.isnan(columns["joint/knee/position"])
    assert lost.sum() == pytest.approx(0.5 * 250, abs=4) and np.isfinite(columns["joint/knee/effort"]).all()
    time = columns["time"][lost] + 0.5
    assert 3.98 < time[0] < 4.02 and 4.48 < time[-1] < 4.52


@pytest.mark.parametrize("delay", [0.02, -0.03])
def test_a_late_stream_is_reported_and_not_moved(delay):
    notes = "\n".join(convert(recording(delay), parse_map(MAP, Path("map.yaml"))).notes)
    (told,) = re.findall(r"joint/knee/velocity is (-?[\d.]+) ms later", notes)
    assert float(told) == pytest.approx(1e3 * delay, abs=1.5)
    time = np.arange(0, 10, 0.004)
    w = 4 * np.pi
    found = lag_of_velocity(time, np.sin(w * time), w * np.cos(w * (time - delay)))
    assert found == pytest.approx(delay, abs=1e-3)


def test_streams_in_step_are_not_called_late():
    assert "later than" not in "\n".join(convert(recording(), parse_map(MAP, Path("map.yaml"))).notes)


def test_another_stream_may_give_the_clock():
    content = MAP | {"clock": {"stream": "/joints"}}
    found = convert(recording(), parse_map(content, Path("map.yaml")))
    assert len(found.columns["time"]) == pytest.approx(9 * 200, abs=3)
    with pytest.raises(ImportLogError, match="did you mean '/joints'"):
        convert(recording(), parse_map(MAP | {"clock": {"stream": "/joint"}}, Path("map.yaml")))


def test_streams_that_never_run_together_are_refused():
    first, *rest = recording().streams
    late = Recording(Path("a.mcap"), (Stream("/joints", first.fields, time=first.time + 100.0), *rest))
    with pytest.raises(ImportLogError, match="no time in common"):
        convert(late, parse_map(MAP, Path("map.yaml")))


def test_a_field_in_several_streams_must_say_which():
    streams = tuple(Stream(n, {"q": np.arange(50.0)}, time=np.arange(50.0)) for n in ("/a", "/b"))
    content = {"format": "hqpipe-log-map/1", "joints": {"k": {"position": "q"}}}
    with pytest.raises(ImportLogError, match="in several streams \\('/a/q', '/b/q'\\)"):
        convert(Recording(Path("x"), streams), parse_map(content, Path("map.yaml")))


def test_clocks_of_their_own_in_fields():
    """Streams of a table format, one counts samples, one microseconds."""
    n = np.arange(400.0)
    streams = (
        Stream("a", {"i": n, "q": np.sin(n / 100)}),
        Stream("b", {"t": n[::2] * 1e4, "f": np.cos(n[::2] / 100)}),
    )
    content = {
        "format": "hqpipe-log-map/1",
        "clock": {"field": "t", "unit": "us"},
        "clocks": {"a": {"field": "i", "unit": "samples", "rate_hz": 100}},
        "joints": {"k": {"position": "a/q", "effort": "b/f"}},
    }
    columns = convert(Recording(Path("x"), streams), parse_map(content, Path("map.yaml"))).columns
    np.testing.assert_allclose(columns["time"], n[::2] / 100)
    np.testing.assert_allclose(columns["joint/k/position"], np.sin(columns["time"]), atol=1e-12)


def test_the_fewest_rows_are_dropped_from_a_disordered_clock():
    time = np.arange(100.0)
    time[50] = 1e9  # dropping all that follows would cost half of the rows
    time[70] = time[69]
    time[20] = np.nan
    keep, repeated, disordered = increasing(time)
    assert keep.sum() == 97 and not keep[50] and not keep[20]
    assert (repeated, disordered) == (1, 2) and (np.diff(time[keep]) > 0).all()


def test_jitter_leaves_gaps_out():
    runs = regularity(np.concatenate([np.arange(100), 150.0 + np.arange(100)]) * 0.01)
    assert runs.rate_hz == pytest.approx(100.0) and runs.jitter < 1e-6
    assert runs.gaps == 1 and runs.longest_s == pytest.approx(0.51)


def test_values_outside_and_at_the_ends():
    found = onto(np.array([-1.0, 0.0, 0.5, 3.0, 3.5]), np.arange(4.0), np.arange(4.0), held=False)
    np.testing.assert_array_equal(found, [np.nan, 0.0, 0.5, 3.0, np.nan])
