"""MDF files, written with asammdf."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from damage import ANY_FILE, flips, refused_or_read, refuses_every

asammdf = pytest.importorskip("asammdf")

from hqpipe.logs.imports.mdf import MdfReader  # noqa: E402
from hqpipe.logs.imports.recording import ImportLogError  # noqa: E402

FAST, SLOW = 0.5 + 0.001 * np.arange(200), 0.75 + 0.1 * np.arange(5)
ANGLE = np.sin(FAST)
COUNTS = np.arange(200, dtype=np.uint16)


def write(path: Path, version: str, *more: object) -> None:
    with asammdf.MDF(version=version) as file:
        angle = asammdf.Signal(ANGLE, FAST, name="angle", unit="deg")
        current = asammdf.Signal(COUNTS, FAST, name="current", unit="A", conversion={"a": 0.01, "b": -1.0})
        file.append([angle, current], acq_name="fast", comment="fast")
        file.append([asammdf.Signal(np.arange(5.0), SLOW, name="oil", unit="°C")], acq_name="slow", comment="slow")
        for signal in more:
            file.append([signal], acq_name="more", comment="more")
        file.save(path, overwrite=True)


@pytest.fixture(params=["4.10", "3.30"])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    made = tmp_path / ("log.mf4" if request.param.startswith("4") else "log.mdf")
    write(made, request.param)
    return made


def test_arrays_units_and_masters_come_back(path: Path) -> None:
    (recording,) = MdfReader.read(path)
    fast, slow = recording.streams
    np.testing.assert_array_equal(fast.fields["angle"], ANGLE)
    np.testing.assert_allclose(fast.fields["current"], 0.01 * COUNTS - 1.0, rtol=1e-15)
    assert fast.units == {"angle": "deg", "current": "A"}
    assert slow.units == {"oil": "°C"}
    np.testing.assert_allclose(fast.time, FAST - 0.5, atol=1e-12)
    np.testing.assert_allclose(slow.time, SLOW - 0.5, atol=1e-12)
    assert "time" not in fast.fields


def test_groups_are_named(tmp_path: Path) -> None:
    write(tmp_path / "log.mf4", "4.10")
    assert [stream.name for stream in MdfReader.read(tmp_path / "log.mf4")[0].streams] == ["fast", "slow"]


def test_text_is_left_out(tmp_path: Path) -> None:
    text = asammdf.Signal(np.array([b"on", b"off"]), np.array([0.0, 1.0]), name="state", encoding="utf-8")
    write(tmp_path / "log.mf4", "4.10", text)
    (recording,) = MdfReader.read(tmp_path / "log.mf4")
    assert "more: left out state (no numbers)" in recording.notes
    assert len(recording.streams) == 2


def test_states_with_names_keep_their_numbers(tmp_path: Path) -> None:
    names = {f"val_{i}": i for i in range(3)} | {f"text_{i}": text for i, text in enumerate((b"off", b"on", b"fault"))}
    state = asammdf.Signal(np.array([0, 2, 1], np.uint8), np.arange(3.0), name="state", conversion=names)
    write(tmp_path / "log.mf4", "4.10", state)
    np.testing.assert_array_equal(MdfReader.read(tmp_path / "log.mf4")[0].streams[2].fields["state"], [0, 2, 1])


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_formulas_are_not_evaluated(tmp_path: Path, version: str) -> None:
    formula = asammdf.Signal(np.arange(3.0), np.arange(3.0), name="power", conversion={"formula": "X1 * 2"})
    path = tmp_path / ("log.mf4" if version.startswith("4") else "log.mdf")
    write(path, version, formula)
    (recording,) = MdfReader.read(path)
    assert any("left out power (its conversion is a formula" in note for note in recording.notes)


def test_invalid_samples_are_missing(tmp_path: Path) -> None:
    invalid = np.array([False, True, False])
    signal = asammdf.Signal(np.arange(3.0), np.arange(3.0), name="speed", invalidation_bits=invalid)
    write(tmp_path / "log.mf4", "4.10", signal)
    np.testing.assert_array_equal(
        MdfReader.read(tmp_path / "log.mf4")[0].streams[2].fields["speed"], [0.0, np.nan, 2.0]
    )


def test_arrays_of_channels_become_components(tmp_path: Path) -> None:
    pairs = np.rec.fromarrays([np.arange(6.0).reshape(3, 2)], dtype=np.dtype([("q", "(2,)<f8")]))
    signal = asammdf.Signal(pairs, np.arange(3.0), name="q", unit="rad")
    write(tmp_path / "log.mf4", "4.10", signal)
    fields = MdfReader.read(tmp_path / "log.mf4")[0].streams[2].fields
    assert set(fields) == {"q[0]", "q[1]"}
    np.testing.assert_array_equal(fields["q[1]"], [1, 3, 5])


def test_a_file_without_numbers_is_refused(tmp_path: Path) -> None:
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(np.array([b"on"]), np.array([0.0]), name="state", encoding="utf-8")])
        file.save(tmp_path / "log.mf4")
    with pytest.raises(ImportLogError, match="no channel of numbers"):
        MdfReader.read(tmp_path / "log.mf4")


def test_other_files_with_the_suffix_are_not_claimed(path: Path, tmp_path: Path) -> None:
    (tmp_path / "table.dat").write_text("1 2 3\n")
    assert MdfReader.claims_file(path)
    assert not MdfReader.claims_file(tmp_path / "table.dat")
    assert not MdfReader.claims_file(tmp_path / "missing.dat")


def test_damaged_files_are_refused(path: Path) -> None:
    refuses_every(ANY_FILE, lambda: MdfReader.read(path), path, exit_code=1)
    kept = path.read_bytes()
    for _, content in flips(path, 3):  # each takes a process; some of them end asammdf by a signal
        path.write_bytes(content)
        refused_or_read(lambda: MdfReader.read(path), path, exit_code=1)
    path.write_bytes(kept)


def test_a_reader_that_crashes_is_an_error(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.executable", "/bin/false")
    with pytest.raises(ImportLogError, match="asammdf stopped"):
        MdfReader.read(path)
