"""A damaged checkpoint costs the iterations since the one before, never the training."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from hqpipe.rl.checkpoint import Progress, load_checkpoint, save_checkpoint
from hqpipe.rl.train import Trainer, train
from hqpipe.system import durable

sys.path.append(str(Path(__file__).parents[2]))
from file_operations import each_kill

NUMBERS, TENSORS = "numbers.json", "tensors.safetensors"


class Killed(Exception):
    pass


@pytest.fixture(scope="module")
def whole(robot, actuator, small):
    return train(robot, actuator, small, workers=1)


@pytest.fixture(scope="module")
def killed(robot, actuator, small, tmp_path_factory) -> Path:
    """The checkpoints of a training that was killed in its sixth iteration: after 2 and 4."""
    folder = tmp_path_factory.mktemp("killed")

    def kill(done: int, total: int, note: str) -> None:
        if done > 4 * small.rollout_size:
            raise Killed

    with pytest.raises(Killed):
        train(robot, actuator, small, scratch=folder, progress=kill, workers=1)
    assert [path.name for path in sorted(folder.iterdir())] == ["checkpoint_00000002", "checkpoint_00000004"]
    return folder


@pytest.fixture
def scratch(killed, tmp_path) -> Path:
    return shutil.copytree(killed, tmp_path / "scratch")


@pytest.fixture(scope="module")
def trainer(robot, actuator, small):
    made = Trainer(
        robot,
        actuator,
        small,
        control_mode="position",
        scratch=None,
        report=None,
        workers=1,
        posterior=None,
        stiffness=None,
    )
    made._begin()
    yield made
    made.close()


def flip(path: Path, position: int) -> None:
    data = bytearray(path.read_bytes())
    data[position] ^= 1
    path.write_bytes(data)


def flip_middle(folder: Path) -> None:
    flip(folder / TENSORS, (folder / TENSORS).stat().st_size // 2)


def cut(folder: Path) -> None:
    (folder / NUMBERS).write_bytes((folder / NUMBERS).read_bytes()[:100])


def remove_numbers(folder: Path) -> None:
    (folder / NUMBERS).unlink()


def empty(folder: Path) -> None:
    for path in folder.iterdir():
        path.write_bytes(b"")


def replace_by_folder(folder: Path) -> None:
    (folder / NUMBERS).unlink()
    (folder / NUMBERS).mkdir()


@pytest.mark.parametrize("damage", [flip_middle, cut, remove_numbers, empty, replace_by_folder])
def test_a_damaged_checkpoint_falls_back_to_the_one_before(robot, actuator, small, whole, scratch, capsys, damage):
    damage(scratch / "checkpoint_00000004")
    resumed = train(robot, actuator, small, scratch=scratch, workers=1)
    (line,) = capsys.readouterr().err.splitlines()
    assert "checkpoint_00000004 is damaged" in line and "goes on from the one before, iteration 2" in line
    assert resumed.resumed_from == 2 and resumed.rows == whole.rows


def test_with_both_damaged_the_training_starts_anew(robot, actuator, small, whole, scratch, capsys):
    for folder in scratch.iterdir():
        flip_middle(folder)
    resumed = train(robot, actuator, small, scratch=scratch, workers=1)
    (line,) = capsys.readouterr().err.splitlines()
    assert "checkpoint_00000002" in line and "checkpoint_00000004" in line and "starts anew" in line
    assert resumed.resumed_from == 0 and resumed.rows == whole.rows


def test_every_flipped_byte_is_noticed(scratch):
    folder = scratch / "checkpoint_00000004"
    assert durable.damage(folder) is None
    for path in sorted(folder.iterdir()):
        for position in range(0, path.stat().st_size, max(1, path.stat().st_size // 50)):
            flip(path, position)
            assert durable.damage(folder) is not None, (path.name, position)
            flip(path, position)
    assert durable.damage(folder) is None


NONSENSE = {
    "no iteration": (NUMBERS, lambda n: n.pop("iteration")),
    "an iteration that is text": (NUMBERS, lambda n: n.update(iteration="4")),
    "fewer rows than iterations": (NUMBERS, lambda n: n["rows"].pop()),
    "rows that are numbers": (NUMBERS, lambda n: n.update(rows=[1, 2, 3, 4])),
    "a learning rate of NaN": (NUMBERS, lambda n: n.update(learning_rate=float("nan"))),
    "negative counts": (NUMBERS, lambda n: n.update(updates=-1)),
    "a generator of another kind": (NUMBERS, lambda n: n["task_rng"].update(bit_generator="MT19937")),
    "a generator without state": (NUMBERS, lambda n: n.update(task_rng=[])),
    "an evaluation without commands": (NUMBERS, lambda n: n["baseline"].pop("commands")),
    "episodes that are numbers": (NUMBERS, lambda n: n.update(episodes=[1])),
    "a weight less": (TENSORS, lambda t: t.pop(next(k for k in t if k.startswith("policy/")))),
    "a weight of another shape": (TENSORS, lambda t: _reshape(t, "policy/")),
    "a moment of another shape": (TENSORS, lambda t: _reshape(t, "optimizer/")),
    "a best weight of another shape": (TENSORS, lambda t: _reshape(t, "best/")),
    "a random state of floats": (TENSORS, lambda t: t.update(torch_rng=torch.zeros(3))),
}


def _reshape(tensors: dict[str, torch.Tensor], prefix: str) -> None:
    name = next(k for k, v in tensors.items() if k.startswith(prefix) and v.dim())
    tensors[name] = torch.zeros(tensors[name].numel() + 1)


@pytest.mark.parametrize("wrong", NONSENSE)
def test_values_that_make_no_sense_are_passed_over(trainer, scratch, capsys, wrong):
    name, change = NONSENSE[wrong]
    folder = scratch / "checkpoint_00000004"
    shutil.rmtree(scratch / "checkpoint_00000002")
    if name == NUMBERS:
        numbers = json.loads((folder / NUMBERS).read_text())
        change(numbers)
        (folder / NUMBERS).write_text(json.dumps(numbers))
    else:
        tensors = load_file(folder / TENSORS)
        change(tensors)
        save_file(tensors, folder / TENSORS)
    durable.write_checksums(folder)
    before = {k: v.clone() for k, v in trainer.model.policy.state_dict().items()}
    generators = torch.get_rng_state(), trainer.task.rng.bit_generator.state
    assert load_checkpoint(scratch, trainer.fingerprint, trainer.model, trainer.task) is None
    assert "starts anew" in capsys.readouterr().err
    # Nothing of the damaged one is left in the training that starts anew.
    assert all(torch.equal(before[k], v) for k, v in trainer.model.policy.state_dict().items())
    assert torch.equal(generators[0], torch.get_rng_state()) and generators[1] == trainer.task.rng.bit_generator.state
    assert trainer.model.num_timesteps == 0


def test_a_kill_while_saving_leaves_a_checkpoint(trainer, scratch):
    progress = load_checkpoint(scratch, trainer.fingerprint, trainer.model, trainer.task)
    assert progress.iteration == 4
    progress.iteration = 5
    progress.rows = [*progress.rows, {}]
    copy = scratch.with_name("copy")

    def prepare() -> None:
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(scratch, copy)

    def save() -> None:
        save_checkpoint(copy, trainer.fingerprint, trainer.model, trainer.task, progress)

    seen = []
    for _ in each_kill(save, prepare):
        found = load_checkpoint(copy, trainer.fingerprint, trainer.model, trainer.task)
        seen.append(found.iteration)
        assert not list(copy.glob(".tmp-*"))
    assert seen == sorted(seen) and set(seen) == {4, 5} and len(seen) > 10
    assert [path.name for path in sorted(copy.iterdir())] == ["checkpoint_00000004", "checkpoint_00000005"]
    load_checkpoint(scratch, trainer.fingerprint, trainer.model, trainer.task)


def test_an_empty_folder_has_no_checkpoint(trainer, tmp_path, capsys):
    assert load_checkpoint(tmp_path / "none", trainer.fingerprint, trainer.model, trainer.task) is None
    assert capsys.readouterr().err == "" and Progress().iteration == 0
