"""The three nets in torch, in standardised numbers: teacher-forced and free-running.

Sequences are (L, B, 4 J), time first; the J columns in front are the torque. `first` is the first step whose output counts;
step k predicts the torque of row k + 1.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import linear, softsign

from hqpipe.actuators.net import NetActuator
from hqpipe.identify.rivals.nets.data import NetData, for_targets


class Net(nn.Module, ABC):
    """What the kinds have in common: the output layer and what an output means.

    Args:
        data: gives sizes and scaling. hidden: units. taps: samples ago at which inputs are read.
    """

    KIND = ""

    def __init__(self, data: NetData, hidden: int, taps: Sequence[int] = (0,)) -> None:
        super().__init__()
        self.joints, self.taps, self.delta = len(data.joints), tuple(taps), data.delta
        self.first_layer(hidden)
        self.output = nn.Linear(hidden, self.joints)
        t = data.tensors
        torque, spread = t["input_mean"][: self.joints], t["input_spread"][: self.joints]
        shift = t["output_mean"] / spread if data.delta else (t["output_mean"] - torque) / spread
        self.register_buffer("shift", torch.tensor(shift, dtype=torch.float32))
        self.register_buffer("ratio", torch.tensor(t["output_spread"] / spread, dtype=torch.float32))

    @abstractmethod
    def first_layer(self, hidden: int) -> None:
        """Make what lies before the output layer."""

    @abstractmethod
    def outputs(self, x: Tensor, first: int) -> Tensor:
        """(L − 1 − first, B, J) outputs on the logged torque."""

    @abstractmethod
    def free_run(self, x: Tensor, first: int) -> Tensor:
        """(L − 1 − first, B, J) torques from row `first` on, on the net's own; before it on the logged one."""

    def wanted(self, x: Tensor, first: int) -> Tensor:
        """The outputs that would be right."""
        torque = x[..., : self.joints]
        change = torque[first + 1 :] - torque[first:-1] if self.delta else torque[first + 1 :]
        return (change - self.shift) / self.ratio

    def following(self, torque: Tensor, out: Tensor) -> Tensor:
        """Torque after a sample."""
        value = torch.addcmul(self.shift, self.ratio, out)
        return torque + value if self.delta else value

    @abstractmethod
    def matrices(self) -> dict[str, Tensor]:
        """Tensors before the output layer under their names in `hqpipe.actuators.net`."""

    def tensors(self) -> dict[str, np.ndarray]:
        """The fitted tensors as float64."""
        found = self.matrices() | {"output_weight": self.output.weight, "output_bias": self.output.bias}
        return {name: value.detach().numpy().astype(np.float64) for name, value in found.items()}


class MLP(Net):
    """See `hqpipe.actuators.mlp`."""

    KIND = "mlp"

    def first_layer(self, hidden: int) -> None:
        self.input = nn.Linear(4 * self.joints * len(self.taps), hidden)

    def outputs(self, x: Tensor, first: int) -> Tensor:
        last = len(x) - 1
        read = torch.cat([x[first - tap : last - tap] for tap in self.taps], dim=-1)
        return self.output(softsign(self.input(read)))

    def free_run(self, x: Tensor, first: int) -> Tensor:
        """The logged inputs of all steps pass the first layer at once; only the torque has to wait for its turn."""
        last, joints = len(x) - 1, self.joints
        weight = self.input.weight.reshape(-1, len(self.taps), 4 * joints)
        logged = torch.cat([x[first - tap : last - tap, :, joints:] for tap in self.taps], dim=-1)
        drive = linear(logged, weight[:, :, joints:].flatten(1), self.input.bias)
        back = weight[:, :, :joints].flatten(1).t()
        torque = list(x[: first + 1, :, :joints])
        for k in range(first, last):
            past = torch.cat([torque[k - tap] for tap in self.taps], dim=-1) if len(self.taps) > 1 else torque[k]
            hidden = softsign(torch.addmm(drive[k - first], past, back))
            torque.append(self.following(torque[k], self.output(hidden)))
        return torch.stack(torque[first + 1 :])

    def matrices(self) -> dict[str, Tensor]:
        return {"input_weight": self.input.weight, "input_bias": self.input.bias}


class Recurrent(Net):
    """A net whose state starts at zero with the sequence."""

    CELL: type[nn.RNNBase]

    def first_layer(self, hidden: int) -> None:
        self.cell = self.CELL(4 * self.joints, hidden)

    @abstractmethod
    def advance(self, x: Tensor, state: Tensor | tuple[Tensor, Tensor]) -> Tensor | tuple[Tensor, Tensor]:
        """State after one sample."""

    def outputs(self, x: Tensor, first: int) -> Tensor:
        return self.output(self.cell(x[:-1])[0][first:])

    def free_run(self, x: Tensor, first: int) -> Tensor:
        _, state = self.cell(x[:first])
        state = tuple(part[0] for part in state) if isinstance(state, tuple) else state[0]
        torque, found = x[first, :, : self.joints], []
        for row in x[first:-1, :, self.joints :]:
            state = self.advance(torch.cat([torque, row], dim=-1), state)
            hidden = state[0] if isinstance(state, tuple) else state
            torque = self.following(torque, self.output(hidden))
            found.append(torque)
        return torch.stack(found)

    def matrices(self) -> dict[str, Tensor]:
        names = ("input_weight", "recurrent_weight", "input_bias", "recurrent_bias")
        return dict(zip(names, self.cell.all_weights[0], strict=True))


class LSTM(Recurrent):
    """See `hqpipe.actuators.lstm`."""

    KIND, CELL = "lstm", nn.LSTM

    def advance(self, x: Tensor, state: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
        return torch.lstm_cell(x, state, *self.cell.all_weights[0])


class GRU(Recurrent):
    """See `hqpipe.actuators.gru`."""

    KIND, CELL = "gru", nn.GRU

    def advance(self, x: Tensor, state: Tensor) -> Tensor:
        return torch.gru_cell(x, state, *self.cell.all_weights[0])


NETS: dict[str, type[Net]] = {net.KIND: net for net in (MLP, LSTM, GRU)}


def actuator_of(net: Net, model: type[NetActuator], data: NetData, effort_limit: float | np.ndarray) -> NetActuator:
    """The net as the actuator model that is stepped without torch."""
    tensors = data.tensors | net.tensors()
    tensors["input_weight"] = for_targets(tensors["input_weight"], data)
    return model.build(
        data.joints, dt=data.dt, effort_limit=effort_limit, tensors=tensors, taps=net.taps, delta=net.delta
    )
