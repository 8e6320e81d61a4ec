"""Damaged and hostile files of the table formats are refused in one line, or read where they are sound."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
from damage import ANY_FILE, refuses_every, survives_flips
from foreign_tables import WRITERS, as_recorded, machine

from hqpipe.logs.imports import FOREIGN_READERS
from hqpipe.logs.imports.hdf5 import Hdf5Reader
from hqpipe.logs.imports.mat import MatReader
from hqpipe.logs.imports.npz import NpzReader
from hqpipe.logs.imports.packages import needed
from hqpipe.logs.imports.recording import ImportLogError

READER = {
    "a.csv": "csv",
    "a.npz": "npz",
    "a.mat": "mat",
    "b.mat": "mat",
    "a.h5": "hdf5",
    "a.parquet": "parquet",
}


@pytest.fixture(params=list(READER))
def file(request, tmp_path):
    path = tmp_path / request.param
    WRITERS[request.param](path, as_recorded(machine(samples=60)))
    return path


def test_whatever_happens_to_a_file(file):
    damages = dict(ANY_FILE)
    if file.suffix == ".csv":  # a table that was cut is a shorter table
        damages = {name: damage for name, damage in damages.items() if not name.startswith("cut")}
    refuses_every(damages, lambda: FOREIGN_READERS[READER[file.name]].read(file), file, exit_code=1)


def test_flipped_bits(file):
    survives_flips(lambda: FOREIGN_READERS[READER[file.name]].read(file), file, exit_code=1)


def test_arrays_that_need_pickle_are_left_out_and_never_loaded(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, t=np.arange(9.0), evil=np.array([{"a": 1}], dtype=object))
    (recording,) = NpzReader.read(path)
    assert list(recording.streams[0].fields) == ["t"] and "needs pickle" in recording.notes[0]


def test_an_archive_that_declares_more_than_the_memory_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("q.npy", b"\0" * 50_000_000)
    monkeypatch.setattr("hqpipe.logs.imports.decoding.memory_bytes", lambda: 100_000_000)
    with pytest.raises(ImportLogError, match="GiB of memory"):
        NpzReader.read(path)


def test_an_hdf5_file_that_declares_more_than_the_memory_is_refused(tmp_path):
    import h5py

    path = tmp_path / "huge.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("q", shape=(10**13,), dtype="f8", chunks=(1024,))
    assert path.stat().st_size < 10_000
    with pytest.raises(ImportLogError, match="GiB of memory"):
        Hdf5Reader.read(path)


def test_links_out_of_an_hdf5_file_are_not_followed(tmp_path):
    import h5py

    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["q"] = np.arange(10.0)
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["t"] = np.arange(10.0)
        file["stolen"] = h5py.ExternalLink("secret.h5", "/q")
        file.create_dataset("raw", shape=(4,), dtype="f8", external=[(str(tmp_path / "secret.h5"), 0, 32)])
        layout = h5py.VirtualLayout(shape=(10,), dtype="f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "q", shape=(10,))
        file.create_virtual_dataset("virtual", layout)
    (recording,) = Hdf5Reader.read(path)
    assert [list(s.fields) for s in recording.streams] == [["t"]]


def test_groups_that_are_alike_are_recordings(tmp_path):
    import h5py

    path = tmp_path / "demos.h5"
    with h5py.File(path, "w") as file:
        for i in range(3):
            file[f"data/demo_{i}/obs/q"] = np.zeros((20 + i, 2))
            file[f"data/demo_{i}/time"] = np.arange(20.0 + i)
            file[f"data/demo_{i}/time"].attrs["units"] = "s"
    recordings = Hdf5Reader.read(path)
    assert [r.name for r in recordings] == ["demo_0", "demo_1", "demo_2"]
    assert set(recordings[2].streams[0].fields) == {"obs/q[0]", "obs/q[1]", "time"}
    assert recordings[0].streams[0].units == {"time": "s"}


def test_groups_of_other_lengths_are_streams(tmp_path):
    import h5py

    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["joints/t"], file["joints/q"] = np.arange(50.0), np.zeros(50)
        file["pressures/t"], file["pressures/pa"] = np.arange(20.0), np.zeros(20)
    (recording,) = Hdf5Reader.read(path)
    assert {s.name: set(s.fields) for s in recording.streams} == {"joints": {"t", "q"}, "pressures": {"t", "pa"}}


def test_structs_and_simulinks_structure_with_time(tmp_path):
    from scipy.io import savemat

    path = tmp_path / "a.mat"
    signals = np.array([(np.zeros((30, 1)), "q_knee"), (np.ones((30, 1)), "")], dtype=[("values", "O"), ("label", "O")])
    log = {"time": np.arange(30.0)[:, None], "signals": signals}
    savemat(path, {"log": log, "name": "rig", "gain": 3.0})
    (recording,) = MatReader.read(path)
    assert set(recording.streams[0].fields) == {"log/time", "log/signals/q_knee/values", "log/signals[1]/values"}
    assert any("gain" in note for note in recording.notes)


def test_a_missing_package_is_named_with_its_extra(tmp_path):
    with pytest.raises(ImportLogError) as caught:
        needed("no_such_package_here.sub", "hdf5", tmp_path / "a.h5")
    assert caught.value.fix == "pip install 'hqpipe[hdf5]'" and "no_such_package_here" in str(caught.value)
