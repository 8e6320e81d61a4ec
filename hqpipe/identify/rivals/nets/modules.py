"""The three nets in torch, in standardised numbers: teacher-forced and free-running.

One net reads all J joints, or each joint has a net of its own; N such nets are run side by side, each with its j = J/N joints.
Sequences are (N, L, B, 4 j), time after the nets; the j columns in front are the torque. `first` is the first step whose output
counts; step k predicts the torque of row k + 1.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import softsign

from hqpipe.actuators.net import NetActuator
from hqpipe.identify.rivals.nets.data import NetData, for_targets

CHANNELS = 4  # torque, target or position error, position, velocity


class Affine(nn.Module):
    """N maps side by side, x W + b, with the first weights of `torch.nn.Linear`, or within ±`bound`."""

    def __init__(self, nets: int, inputs: int, outputs: int, bound: float | None = None) -> None:
        super().__init__()
        bound = 1.0 / math.sqrt(inputs) if bound is None else bound
        self.weight = nn.Parameter(torch.empty(nets, outputs, inputs).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(nets, outputs).uniform_(-bound, bound))

    def forward(self, x: Tensor) -> Tensor:
        """(N, …, inputs) → (N, …, outputs)."""
        out = torch.baddbmm(self.bias[:, None], x.flatten(1, -2), self.weight.mT)
        return out.unflatten(1, x.shape[1:-1])


class Net(nn.Module, ABC):
    """What the kinds have in common: the output layer and what an output means.

    Args:
        data: gives sizes and scaling. hidden: units of a net. taps: samples ago at which inputs are read.
        per_joint: a net for each joint instead of one for all.
    """

    KIND = ""

    def __init__(self, data: NetData, hidden: int, taps: Sequence[int] = (0,), per_joint: bool = False) -> None:
        super().__init__()
        self.per_joint, self.nets = per_joint, len(data.joints) if per_joint else 1
        self.joints, self.hidden = len(data.joints) // self.nets, hidden
        self.taps, self.delta = tuple(taps), data.delta
        self.first_layer()
        self.output = Affine(self.nets, hidden, self.joints)
        t, every = data.tensors, len(data.joints)
        torque, spread = t["input_mean"][:every], t["input_spread"][:every]
        shift = t["output_mean"] / spread if data.delta else (t["output_mean"] - torque) / spread
        self.register_buffer("shift", self._by_net(shift))
        self.register_buffer("ratio", self._by_net(t["output_spread"] / spread))

    def _by_net(self, values: np.ndarray) -> Tensor:
        """(N, 1, j) of (J,)."""
        return torch.tensor(values.reshape(self.nets, 1, self.joints), dtype=torch.float32)

    def sequence(self, x: Tensor) -> Tensor:
        """(N, L, B, 4 j) of the rows (L, B, 4 J) of all joints."""
        rows = x.unflatten(-1, (CHANNELS, self.nets, self.joints))
        return rows.movedim(3, 0).flatten(-2)

    def for_joints(self, torque: Tensor) -> Tensor:
        """(L, B, J) of (N, L, B, j)."""
        return torque.movedim(0, -2).flatten(-2)

    @abstractmethod
    def first_layer(self) -> None:
        """Make what lies before the output layer."""

    @abstractmethod
    def outputs(self, x: Tensor, first: int) -> Tensor:
        """(N, L − 1 − first, B, j) outputs on the logged torque."""

    @abstractmethod
    def free_run(self, x: Tensor, first: int) -> Tensor:
        """(N, L − 1 − first, B, j) torques from row `first` on, on the net's own; before it on the logged one."""

    def wanted(self, x: Tensor, first: int) -> Tensor:
        """The outputs that would be right."""
        torque = x[..., : self.joints]
        change = torque[:, first + 1 :] - torque[:, first:-1] if self.delta else torque[:, first + 1 :]
        return (change - self.shift[:, None]) / self.ratio[:, None]

    def following(self, torque: Tensor, out: Tensor) -> Tensor:
        """(N, B, j) torque after a sample."""
        value = torch.addcmul(self.shift, self.ratio, out)
        return torque + value if self.delta else value

    @abstractmethod
    def matrices(self) -> dict[str, Tensor]:
        """Tensors before the output layer under their names in `hqpipe.actuators.net`, the nets in front."""

    def tensors(self) -> dict[str, np.ndarray]:
        """The fitted tensors as float64, the nets in front."""
        found = self.matrices() | {"output_weight": self.output.weight, "output_bias": self.output.bias}
        return {name: value.detach().numpy().astype(np.float64) for name, value in found.items()}


class MLP(Net):
    """See `hqpipe.actuators.mlp`."""

    KIND = "mlp"

    def first_layer(self) -> None:
        self.input = Affine(self.nets, CHANNELS * self.joints * len(self.taps), self.hidden)

    def outputs(self, x: Tensor, first: int) -> Tensor:
        return self.output(softsign(self.input(self._read(x, first))))

    def _read(self, x: Tensor, first: int) -> Tensor:
        """(N, L − 1 − first, B, …) the columns of `x` at every tap."""
        last = x.shape[1] - 1
        return torch.cat([x[:, first - tap : last - tap] for tap in self.taps], dim=-1)

    def free_run(self, x: Tensor, first: int) -> Tensor:
        """The logged inputs of all steps pass the first layer at once; only the torque has to wait for its turn."""
        joints = self.joints
        weight = self.input.weight.unflatten(-1, (len(self.taps), CHANNELS * joints))
        logged = self._read(x[..., joints:], first)
        of_logged = torch.baddbmm(
            self.input.bias[:, None], logged.flatten(1, -2), weight[..., joints:].flatten(-2).mT
        ).unflatten(1, logged.shape[1:-1])
        back = weight[..., :joints].flatten(-2).mT
        torque = list(x[:, : first + 1, :, :joints].unbind(1))
        for k, drive in enumerate(of_logged.unbind(1), start=first):
            past = torch.cat([torque[k - tap] for tap in self.taps], dim=-1) if len(self.taps) > 1 else torque[k]
            torque.append(self.following(torque[k], self.output(softsign(torch.baddbmm(drive, past, back)))))
        return torch.stack(torque[first + 1 :], dim=1)

    def matrices(self) -> dict[str, Tensor]:
        return {"input_weight": self.input.weight, "input_bias": self.input.bias}


class Recurrent(Net):
    """A net whose state starts at zero with the sequence; the first weights are those of `torch.nn.RNN`.

    Its state is (N, B, H), or two of them.
    """

    GATES = 1

    def first_layer(self) -> None:
        bound, rows = 1.0 / math.sqrt(self.hidden), self.GATES * self.hidden
        self.input = Affine(self.nets, CHANNELS * self.joints, rows, bound)
        self.recurrent = Affine(self.nets, self.hidden, rows, bound)

    @abstractmethod
    def advance(self, driven: Tensor, state: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
        """State after one sample, whose inputs gave `driven` (N, B, rows); the first part is the output of the layer."""

    def rest(self, x: Tensor) -> tuple[Tensor, ...]:
        """The state before the first sample."""
        return (x.new_zeros(self.nets, x.shape[2], self.hidden),)

    def _run(self, x: Tensor) -> tuple[list[Tensor], tuple[Tensor, ...]]:
        """Outputs of the layer on every row of `x`, and the state after them."""
        state, found = self.rest(x), []
        for driven in self.input(x).unbind(1) if x.shape[1] else ():
            state = self.advance(driven, state)
            found.append(state[0])
        return found, state

    def outputs(self, x: Tensor, first: int) -> Tensor:
        return self.output(torch.stack(self._run(x[:, :-1])[0][first:], dim=1))

    def free_run(self, x: Tensor, first: int) -> Tensor:
        _, state = self._run(x[:, :first])
        torque, found = x[:, first, :, : self.joints], []
        for row in x[:, first:-1, :, self.joints :].unbind(1):
            state = self.advance(self.input(torch.cat([torque, row], dim=-1)), state)
            torque = self.following(torque, self.output(state[0]))
            found.append(torque)
        return torch.stack(found, dim=1)

    def matrices(self) -> dict[str, Tensor]:
        return {
            "input_weight": self.input.weight,
            "input_bias": self.input.bias,
            "recurrent_weight": self.recurrent.weight,
            "recurrent_bias": self.recurrent.bias,
        }


class LSTM(Recurrent):
    """See `hqpipe.actuators.lstm`."""

    KIND, GATES = "lstm", 4

    def rest(self, x: Tensor) -> tuple[Tensor, ...]:
        return (*super().rest(x), *super().rest(x))

    def advance(self, driven: Tensor, state: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
        into, forget, new, out = (driven + self.recurrent(state[0])).chunk(4, dim=-1)
        cell = torch.sigmoid(forget) * state[1] + torch.sigmoid(into) * torch.tanh(new)
        return torch.sigmoid(out) * torch.tanh(cell), cell


class GRU(Recurrent):
    """See `hqpipe.actuators.gru`."""

    KIND, GATES = "gru", 3

    def advance(self, driven: Tensor, state: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
        (hidden,) = state
        reset, update, new = driven.chunk(3, dim=-1)
        past_reset, past_update, past_new = self.recurrent(hidden).chunk(3, dim=-1)
        new = torch.tanh(torch.addcmul(new, torch.sigmoid(reset + past_reset), past_new))
        return (torch.lerp(new, hidden, torch.sigmoid(update + past_update)),)


NETS: dict[str, type[Net]] = {net.KIND: net for net in (MLP, LSTM, GRU)}


def actuator_of(net: Net, model: type[NetActuator], data: NetData, effort_limit: float | np.ndarray) -> NetActuator:
    """The net as the actuator model that is stepped without torch."""
    scaling = {name: _by_net(value.reshape(-1, net.nets, net.joints)) for name, value in data.tensors.items()}
    tensors = scaling | net.tensors()
    tensors["input_weight"] = for_targets(tensors["input_weight"], data)
    if not net.per_joint:
        tensors = {name: value[0] for name, value in tensors.items()}
    return model.build(
        data.joints,
        dt=data.dt,
        effort_limit=effort_limit,
        tensors=tensors,
        taps=net.taps,
        delta=net.delta,
        per_joint=net.per_joint,
    )


def _by_net(values: np.ndarray) -> np.ndarray:
    """(N, C j) of (C, N, j): channel after channel for each net."""
    return values.swapaxes(0, 1).reshape(values.shape[1], -1)
