"""Adam on one-step and on free-running errors of a net."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from hqpipe.errors import IdentificationError
from hqpipe.identify.rivals.nets.data import NetData
from hqpipe.identify.rivals.nets.modules import Net

STEEPEST = 1.0  # norm beyond which a gradient through time is cut (Pascanu et al. 2013; the value is an assumption)
LAST_RATE = 0.01  # share of the learning rate that is left at the end of the decay; assumption


@dataclass
class Course:
    """How a training went.

    Attributes:
        losses: of every iteration. stopping: (iteration, free-running RMSE in N·m on what was set aside).
        best: iteration whose weights were kept.
    """

    losses: list[float] = field(default_factory=list)
    stopping: list[tuple[int, float]] = field(default_factory=list)
    best: int = 0


@contextmanager
def one_thread(seed: int) -> Iterator[None]:
    """Torch with one thread and a seed of its own; both are as before afterwards."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            yield
    finally:
        torch.set_num_threads(threads)


class Sequences:
    """Random sequences of `length` rows of what is trained on, `count` at a time."""

    def __init__(self, data: NetData, length: int, count: int, rng: np.random.Generator) -> None:
        self._table = torch.tensor(data.inputs, dtype=torch.float32)
        self._starts, self._steps = data.starts(data.stretches, length), np.arange(length)[:, None]
        self._count, self._rng = count, rng

    def draw(self) -> Tensor:
        """(length, count, 4 J)."""
        starts = self._rng.choice(self._starts, self._count)
        return self._table[torch.from_numpy(starts + self._steps)]


def fit_one_step(net: Net, data: Sequences, iterations: int, rate: float, first: int, course: Course) -> None:
    """Mean squared error of the outputs on the logged torque, at a steady rate."""

    def loss(rows: Tensor) -> Tensor:
        x = net.sequence(rows)
        return torch.mean((net.outputs(x, first) - net.wanted(x, first)) ** 2)

    adam = torch.optim.Adam(net.parameters(), lr=rate)
    for _ in range(iterations):
        _descend(adam, net, loss(data.draw()), course)


class Validation:
    """Free-running RMSE over all joints, N·m, on what was set aside for early stopping."""

    def __init__(self, data: NetData, first: int, steps: int) -> None:
        rows = data.starts(data.stopping, first + steps + 1, every=steps)
        self._windows = torch.tensor(data.inputs[np.arange(first + steps + 1)[:, None] + rows], dtype=torch.float32)
        self._first, self._spread = first, torch.tensor(data.tensors["input_spread"][: len(data.joints)])

    def rmse(self, net: Net) -> float:
        with torch.no_grad():
            error = _free_run_error(net, self._windows, self._first) * self._spread
        return float(torch.sqrt(torch.mean(error**2)))


def _free_run_error(net: Net, rows: Tensor, first: int) -> Tensor:
    """(L − 1 − first, B, J) standardised error of the torques from row `first` on."""
    x = net.sequence(rows)
    return net.for_joints(net.free_run(x, first) - x[:, first + 1 :, :, : net.joints])


def fit_free_run(
    net: Net,
    data: Sequences,
    validation: Validation,
    iterations: int,
    rate: float,
    first: int,
    course: Course,
    *,
    spread: np.ndarray,
    every: int,
    patience: int,
) -> None:
    """Mean squared error in (N·m)² over whole windows, through time; the best weights on what was set aside are kept.

    Args:
        rate: of Adam; it falls along half a cosine. first: steps of logged context before a window.
        spread: (J,) of the torque, N·m. every: iterations between two looks at what was set aside; after `patience` looks
            without a gain it ends.
    """
    weight = torch.tensor(spread / np.sqrt(np.mean(spread**2)), dtype=torch.float32)

    def loss(rows: Tensor) -> Tensor:
        return torch.mean((_free_run_error(net, rows, first) * weight) ** 2)

    adam = torch.optim.Adam(net.parameters(), lr=rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, max(iterations, 1), LAST_RATE * rate)
    keeper = _Keeper(net, course, validation.rmse)
    for iteration in range(iterations):
        _descend(adam, net, loss(data.draw()), course)
        schedule.step()
        last = iteration == iterations - 1
        if ((iteration + 1) % every == 0 or last) and keeper.look() >= patience:
            break
    keeper.restore()


class _Keeper:
    """Remembers the weights that were best on what was set aside."""

    def __init__(self, net: Net, course: Course, rmse: Callable[[Net], float]) -> None:
        self._net, self._course, self._rmse = net, course, rmse
        self._lowest, self._since = math.inf, 0
        self._weights = copy.deepcopy(net.state_dict())
        self.look()

    def look(self) -> int:
        """Judge the net as it is; returns for how many looks it has not become better."""
        rmse, iteration = self._rmse(self._net), len(self._course.losses)
        self._course.stopping.append((iteration, rmse))
        if rmse < self._lowest:
            self._lowest, self._since = rmse, 0
            self._course.best = iteration
            self._weights = copy.deepcopy(self._net.state_dict())
        else:
            self._since += 1
        return self._since

    def restore(self) -> None:
        self._net.load_state_dict(self._weights)


def _descend(adam: torch.optim.Adam, net: Net, loss: Tensor, course: Course) -> None:
    value = loss.item()
    if not math.isfinite(value):
        raise IdentificationError(
            f"the {net.KIND} net diverged after {len(course.losses)} iterations; train it with a smaller learning_rate"
        )
    adam.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(net.parameters(), STEEPEST)
    adam.step()
    course.losses.append(value)
