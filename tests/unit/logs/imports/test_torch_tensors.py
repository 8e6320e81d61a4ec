"""Files of torch.save are read without unpickling: nothing in them ever runs."""

from __future__ import annotations

import builtins
import os
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
from damage import ANY_FILE, refuses_every, survives_flips
from torch_files import Call, dumped, write_program, write_torch

from hqpipe.logs.imports.recording import ImportLogError
from hqpipe.logs.imports.torch_tensors import read_tensors

ARRAYS = {
    "time": np.arange(7, dtype=np.float32),
    "q": np.arange(14, dtype=np.float64).reshape(7, 2),
    "count": np.arange(7, dtype=np.int64),
    "on": np.array([True, False] * 3 + [True]),
    "half": np.arange(7, dtype=np.float16),
}


def refused(path: Path) -> str:
    with pytest.raises(ImportLogError) as caught:
        read_tensors(path)
    return str(caught.value)


def test_what_torch_saves_comes_back(tmp_path: Path) -> None:
    write_torch(tmp_path / "log.pt", ARRAYS)
    found = read_tensors(tmp_path / "log.pt")
    assert list(found) == list(ARRAYS)
    for name, values in ARRAYS.items():
        np.testing.assert_array_equal(found[name], values.astype(np.float64))


def test_views_are_read_in_their_order(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    whole = torch.arange(24, dtype=torch.float32).reshape(4, 6)
    torch.save({"t": whole.T, "cut": whole[1:3, 2:5], "plain": whole[:, 3], "empty": whole[:0]}, tmp_path / "log.pt")
    found = read_tensors(tmp_path / "log.pt")
    np.testing.assert_array_equal(found["t"], whole.numpy().T)
    np.testing.assert_array_equal(found["cut"], whole.numpy()[1:3, 2:5])
    np.testing.assert_array_equal(found["plain"], whole.numpy()[:, 3])
    assert found["empty"].shape == (0, 6)


def test_other_values_are_passed_over(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    torch.save({"q": torch.zeros(3), "rate": 200, "kp": 20.5, "robot": "go2", "gains": {"a": 1}}, tmp_path / "log.pt")
    assert list(read_tensors(tmp_path / "log.pt")) == ["q"]


@pytest.mark.parametrize("protocol", [2, 3, 4])
@pytest.mark.parametrize(
    "values",
    [
        np.array([80.0, 120.5]),
        np.arange(6, dtype=np.int16).reshape(2, 3),
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.arange(3, dtype=">f4"),
        np.array(2.5),
        np.array([True, False]),
    ],
)
def test_numpy_arrays_beside_tensors_come_back(tmp_path: Path, protocol: int, values: np.ndarray) -> None:
    write_program(tmp_path / "log.pt", dumped({"kp": values, "again": values}, protocol))
    found = read_tensors(tmp_path / "log.pt")
    np.testing.assert_array_equal(found["kp"], values.astype(np.float64))
    np.testing.assert_array_equal(found["again"], values.astype(np.float64))


@pytest.mark.parametrize("values", [np.array([None, 1]), np.array(["a"]), np.zeros(2, "f4,i4"), np.zeros((2, 2, 2))])
def test_other_arrays_are_refused(tmp_path: Path, values: np.ndarray) -> None:
    write_program(tmp_path / "log.pt", dumped({"kp": values}))
    refused(tmp_path / "log.pt")


@pytest.mark.parametrize("protocol", [0, 1, 2, 4, 5])
@pytest.mark.parametrize("function", [os.system, builtins.eval, builtins.exec, builtins.getattr, __import__])
def test_calls_are_refused_and_do_not_happen(tmp_path: Path, function: object, protocol: int) -> None:
    mark = tmp_path / "ran"
    argument = f"touch {mark}" if function is os.system else f"open({str(mark)!r}, 'w')"
    program = dumped({"q": Call(function, argument)}, protocol)
    write_program(tmp_path / "log.pt", program)
    assert "only tensors" in refused(tmp_path / "log.pt")
    assert not mark.exists()


def test_the_attack_would_have_worked(tmp_path: Path) -> None:
    mark = tmp_path / "ran"
    pickle.loads(dumped(Call(os.system, f"touch {mark}")))
    assert mark.exists()


def test_a_call_hidden_in_state_is_refused(tmp_path: Path) -> None:
    for program in (
        b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n(ccollections\nOrderedDict\n)R.",
        b"\x80\x02}cbuiltins\neval\nb.",  # BUILD
        b"\x80\x02(S'x'\nios\nsystem\n.",  # INST
        b"\x80\x02(cos\nsystem\nS'x'\no.",  # OBJ
        b"\x80\x02cos\nsystem\n)\x81.",  # NEWOBJ
        b"\x80\x04\x8c\x02os\x8c\x06system\x93.",  # STACK_GLOBAL
        b"\x80\x02\x82\x01.",  # EXT1
    ):
        write_program(tmp_path / "log.pt", program)
        assert "only tensors" in refused(tmp_path / "log.pt") or "not a file of torch.save" in refused(
            tmp_path / "log.pt"
        )


def test_a_whole_model_is_refused(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    torch.save(torch.nn.Linear(2, 2), tmp_path / "log.pt")
    assert "torch.nn.modules.linear Linear" in refused(tmp_path / "log.pt")


def tensor_program(offset: int, size: tuple, stride: tuple, count: int = 8, kind: str = "FloatStorage") -> bytes:
    """A pickle with one tensor "q" of the storage "0"."""
    integer = lambda n: b"J" + n.to_bytes(4, "little", signed=True)  # noqa: E731
    text = lambda s: b"X" + len(s).to_bytes(4, "little") + s.encode()  # noqa: E731
    numbers = lambda each: b"(" + b"".join(map(integer, each)) + b"t"  # noqa: E731
    return (
        b"\x80\x02}"
        + text("q")
        + b"ctorch._utils\n_rebuild_tensor_v2\n((" + text("storage") + f"ctorch\n{kind}\n".encode()
        + text("0") + text("cpu") + integer(count) + b"tQ" + integer(offset) + numbers(size) + numbers(stride)
        + b"\x89ccollections\nOrderedDict\n)RtRs."
    )  # fmt: skip


def test_the_hand_made_program_is_sound(tmp_path: Path) -> None:
    write_program(tmp_path / "log.pt", tensor_program(1, (3,), (2,)), {"0": np.arange(8, dtype="<f4").tobytes()})
    np.testing.assert_array_equal(read_tensors(tmp_path / "log.pt")["q"], [1, 3, 5])


@pytest.mark.parametrize(
    ("offset", "size", "stride", "count"),
    [
        (0, (9,), (1,), 8),  # beyond the end
        (7, (2,), (1,), 8),
        (0, (2**30, 2**30), (0, 0), 8),  # one element shown a quintillion times
        (-1, (2,), (1,), 8),
        (0, (-2,), (1,), 8),
        (0, (2,), (-1,), 8),
        (0, (2, 2, 2), (4, 2, 1), 8),
        (0, (2,), (1, 1), 8),
        (0, (8,), (1,), 9),  # more than the archive has
        (0, (8,), (1,), 7),
        (0, (1,), (1,), -1),
    ],
)
def test_tensors_stay_within_their_storage(tmp_path: Path, offset: int, size: tuple, stride: tuple, count: int) -> None:
    write_program(tmp_path / "log.pt", tensor_program(offset, size, stride, count), {"0": bytes(32)})
    refused(tmp_path / "log.pt")


def test_compressed_and_foreign_archives_are_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "log.pt", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("log/data.pkl", tensor_program(0, (8,), (1,)))
        archive.writestr("log/data/0", bytes(10**7))
    assert "compressed" in refused(tmp_path / "log.pt")
    with zipfile.ZipFile(tmp_path / "log.pt", "w") as archive:
        archive.writestr("readme.txt", "no tensors")
    assert "no data.pkl" in refused(tmp_path / "log.pt")
    (tmp_path / "log.pt").write_bytes(dumped(Call(os.system, "true")))  # torch.save before 1.6
    refused(tmp_path / "log.pt")


def test_damaged_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.pt"
    write_torch(path, ARRAYS)
    refuses_every(ANY_FILE, lambda: read_tensors(path), path, exit_code=1)
    survives_flips(lambda: read_tensors(path), path, exit_code=1)
