"""What a step of an actuator model costs: 400 robots of 12 joints in one call, on one core.

    python benchmarks/actuator_speed.py [--csv FILE]

Nanoseconds per robot and sample, the best of many; numpy, torch and ONNX Runtime do the same in the same run. Nets have the
paper's size (48, 64, 12), or are those for each joint that `fit-actuator` trains. `--csv` writes the rows to a file, which
`claim_figures.py` draws.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from hqpipe.actuators.augmented import Augmented
from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.gru import GRU
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.lstm import LSTM
from hqpipe.actuators.mlp import MLP
from hqpipe.actuators.net import NetActuator
from hqpipe.actuators.two_chamber import TwoChamber
from hqpipe.identify.rivals.nets.fit_net import JOINT_HIDDEN
from hqpipe.machine.layout import neutral_row, slot

ROBOTS, DT, HIDDEN = 400, 1e-3, 64
TAPS = (0, 10, 20)  # samples ago that an MLP for each joint reads, as `fit_strong_net` has it at 1 kHz
JOINTS = tuple(f"{leg}{joint}" for leg in ("LF", "RF", "LH", "RH") for joint in "RPK")
BASE = {"k1": 250.0, "k2": 0.06, "k3": 9.0, "k4": 0.4}  # about those of the reference plant, in joint space
COMMAND_SIDE = {
    ("command_delay", "delay_s"): 0.0034,
    ("valve_lag", "time_constant_s"): 0.003,
    ("valve_deadband", "half_width"): 0.005,
    ("orifice_flow", "effort_max_nm"): 1.0 / 984.0,
    ("supply_droop", "droop"): 0.02,
}
CHAMBERS = {
    "full_torque": 984.0,
    "stiffness": 19_000.0,
    "flow_gain": 28.0,
    "valve_lag": 0.0018,
    "leakage": 4.3,
    "null_opening": 1e-4,
    "volume_slope": 0.3,
    "coulomb_friction": 0.0,
    "viscous_friction": 0.0,
    "speed_limit": np.inf,
    "middle": 0.0,
    "sample_time": DT,
    "effort_limit": 900.0,
}
WITH_FRICTION = {
    key: value for key, value in COMMAND_SIDE.items() if key[0] not in ("valve_deadband", "supply_droop")
} | {
    ("coulomb_friction", "friction_nm"): 8.0,
    ("viscous_friction", "nm_s_per_rad"): 5.0,
}


def augmented(effects: dict[tuple[str, str], float]) -> Augmented:
    row = neutral_row()
    for name, value in BASE.items():
        row[slot("base", name)] = value
    for key, value in effects.items():
        row[slot(*key)] = value
    row[slot("setting", "effort_limit")] = 900.0
    return Augmented(JOINTS, np.tile(row, (len(JOINTS), 1)), DT)


def signals() -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(0)
    return tuple(size * rng.normal(size=(ROBOTS, len(JOINTS))) for size in (100.0, 0.1, 0.1, 1.0))


def best(call: Callable[[], object], calls: int = 300, rounds: int = 60) -> float:
    """Nanoseconds per robot; the first round warms up."""
    fastest = np.inf
    for _ in range(rounds):
        started = time.perf_counter()
        for _ in range(calls):
            call()
        fastest = min(fastest, (time.perf_counter() - started) / calls)
    return 1e9 * fastest / ROBOTS


def of_model(model: ActuatorModel, calls: int = 300) -> float:
    tau, q_des, q, qd = signals()
    memory = model.fresh_memory(ROBOTS)
    return best(lambda: model.step(tau, memory, q_des, q, qd, DT), calls)


def of_numpy() -> float:
    tau, q_des, q, qd = signals()
    k1, k2, k3, k4 = BASE.values()

    def step() -> None:
        error = q_des - q
        np.clip(
            k1 * error + (1.0 - k2) * tau - k3 * qd + k4 * error * np.maximum(-tau * np.sign(error), 0.0),
            -900.0,
            900.0,
            out=tau,
        )

    return best(step)


def of_torch() -> float:
    import torch

    torch.set_num_threads(1)
    tau, q_des, q, qd = (torch.from_numpy(s) for s in signals())
    k1, k2, k3, k4 = BASE.values()

    @torch.inference_mode()
    def step() -> None:
        error = q_des - q
        impact = k4 * error * (-tau * error.sign()).clamp(min=0.0)
        tau.copy_((k1 * error + (1.0 - k2) * tau - k3 * qd + impact).clamp(-900.0, 900.0))

    return best(step)


def net(kind: type[NetActuator], per_joint: bool = False) -> NetActuator:
    """Of the paper's size, or one for each joint, with random weights."""
    rng, taps = np.random.default_rng(1), TAPS if per_joint and kind is MLP else (0,)
    hidden = JOINT_HIDDEN[kind.NAME] if per_joint else HIDDEN
    shapes = kind.shapes(len(JOINTS), hidden, len(taps), per_joint)
    tensors = {name: 0.1 * rng.normal(size=shape) for name, shape in shapes.items()}
    tensors |= {name: np.ones_like(tensors[name]) for name in ("input_spread", "output_spread")}
    return kind.build(JOINTS, dt=DT, tensors=tensors, taps=taps, per_joint=per_joint, effort_limit=900.0)


def of_torch_mlp() -> float:
    """The MLP as a simulator on a processor would call it."""
    import torch
    from torch.nn.functional import linear, softsign

    torch.set_num_threads(1)
    t = {name: torch.tensor(value, dtype=torch.float32) for name, value in net(MLP).tensors.items()}
    rows = torch.from_numpy(np.concatenate(signals(), axis=1).astype(np.float32))

    @torch.inference_mode()
    def step() -> None:
        hidden = softsign(linear((rows - t["input_mean"]) / t["input_spread"], t["input_weight"], t["input_bias"]))
        torch.addcmul(t["output_mean"], t["output_spread"], linear(hidden, t["output_weight"], t["output_bias"]))

    return best(step, 50)


def of_onnxruntime(kind: str) -> float:
    """A net of the paper's size, "mlp", "lstm" or "gru"; the recurrent ones advance their state by one sample."""
    from onnx import helper, numpy_helper

    rng, inputs = np.random.default_rng(1), 4 * len(JOINTS)
    gates = {"mlp": 1, "lstm": 4, "gru": 3}[kind]
    sizes = {"w2": (HIDDEN, len(JOINTS)), "b2": (len(JOINTS),)}
    feeds = {"x": np.concatenate(signals(), axis=1).astype(np.float32)}
    outputs = {"y": [ROBOTS, len(JOINTS)]}
    if kind == "mlp":
        sizes |= {"w1": (inputs, HIDDEN), "b1": (HIDDEN,)}
        nodes = [helper.make_node("Gemm", ["x", "w1", "b1"], ["h"]), helper.make_node("Softsign", ["h"], ["s"])]
    else:
        states = ["state", "cell"][: 2 if kind == "lstm" else 1]
        sizes |= {"w": (1, gates * HIDDEN, inputs), "r": (1, gates * HIDDEN, HIDDEN), "b": (1, 2 * gates * HIDDEN)}
        feeds = {"x": feeds["x"][None]} | {name: np.zeros((1, ROBOTS, HIDDEN), np.float32) for name in states}
        outputs |= {f"next_{name}": [1, ROBOTS, HIDDEN] for name in states}
        wires = ["", *(f"next_{name}" for name in states)]
        options = {"hidden_size": HIDDEN} | ({"linear_before_reset": 1} if kind == "gru" else {})
        nodes = [helper.make_node(kind.upper(), ["x", "w", "r", "b", "", *states], wires, **options)]
        nodes.append(helper.make_node("Squeeze", ["next_state", "axis"], ["s"]))
    nodes.append(helper.make_node("Gemm", ["s", "w2", "b2"], ["y"]))
    tensors = [numpy_helper.from_array(0.1 * rng.normal(size=s).astype(np.float32), n) for n, s in sizes.items()]
    if kind != "mlp":
        tensors.append(numpy_helper.from_array(np.array([0], dtype=np.int64), "axis"))
    return of_graph(nodes, tensors, feeds, outputs)


def of_onnxruntime_per_joint(kind: str) -> float:
    """A net for each joint, whose inputs and states stand joint by joint, (J, N, …), as suits products of matrices."""
    from onnx import helper, numpy_helper

    rng, joints, hidden = np.random.default_rng(1), len(JOINTS), JOINT_HIDDEN[kind]
    gates, inputs = {"mlp": 1, "lstm": 4, "gru": 3}[kind], 4 * (len(TAPS) if kind == "mlp" else 1)
    sizes = {"w": (joints, inputs, gates * hidden), "b": (joints, 1, gates * hidden)}
    sizes |= {"w2": (joints, hidden, 1), "b2": (joints, 1, 1)}
    feeds = {"x": rng.normal(size=(joints, ROBOTS, inputs)).astype(np.float32)}
    outputs, nodes = {"y": [joints, ROBOTS, 1]}, []

    def node(operator: str, given: str, made: str, **attributes: int) -> None:
        nodes.append(helper.make_node(operator, given.split(), made.split(), **attributes))

    node("MatMul", "x w", "xw")
    node("Add", "xw b", "now")
    if kind == "mlp":
        node("Softsign", "now", "next_state")
    else:
        sizes |= {"r": (joints, hidden, gates * hidden), "rb": (joints, 1, gates * hidden)}
        states = ["state", "cell"][: 2 if kind == "lstm" else 1]
        feeds |= {name: np.zeros((joints, ROBOTS, hidden), np.float32) for name in states}
        outputs |= {f"next_{name}": [joints, ROBOTS, hidden] for name in states}
        node("MatMul", "state r", "sr")
        node("Add", "sr rb", "past")
        {"lstm": lstm_nodes, "gru": gru_nodes}[kind](node)
    node("MatMul", "next_state w2", "yw")
    node("Add", "yw b2", "y")
    tensors = [numpy_helper.from_array(0.1 * rng.normal(size=s).astype(np.float32), n) for n, s in sizes.items()]
    return of_graph(nodes, tensors, feeds, outputs)


def lstm_nodes(node: Callable[..., None]) -> None:
    node("Add", "now past", "sum")
    node("Split", "sum", "sum_i sum_f sum_g sum_o", axis=-1)
    for part, gate in (("i", "into"), ("f", "forget"), ("o", "out")):
        node("Sigmoid", f"sum_{part}", gate)
    node("Tanh", "sum_g", "new")
    node("Mul", "into new", "written")
    node("Mul", "forget cell", "kept")
    node("Add", "written kept", "next_cell")
    node("Tanh", "next_cell", "seen")
    node("Mul", "out seen", "next_state")


def gru_nodes(node: Callable[..., None]) -> None:
    node("Split", "now", "now_r now_z now_n", axis=-1)
    node("Split", "past", "past_r past_z past_n", axis=-1)
    for part, gate in (("r", "reset"), ("z", "update")):
        node("Add", f"now_{part} past_{part}", f"sum_{part}")
        node("Sigmoid", f"sum_{part}", gate)
    node("Mul", "reset past_n", "remembered")
    node("Add", "now_n remembered", "sum_n")
    node("Tanh", "sum_n", "new")
    node("Sub", "state new", "change")
    node("Mul", "update change", "held")
    node("Add", "new held", "next_state")


def of_graph(
    nodes: list[Any], tensors: list[Any], feeds: dict[str, np.ndarray], outputs: dict[str, list[int]]
) -> float:
    """An ONNX graph of these nodes, with weights `tensors`, on one thread."""
    import onnxruntime
    from onnx import TensorProto, helper

    wires = [helper.make_tensor_value_info(n, TensorProto.FLOAT, list(v.shape)) for n, v in feeds.items()]
    ends = [helper.make_tensor_value_info(n, TensorProto.FLOAT, shape) for n, shape in outputs.items()]
    graph = helper.make_graph(nodes, "net", wires, ends, tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
    return best(lambda: session.run(None, feeds), 50)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--csv", type=Path, help="write the rows to this file")
    options = parser.parse_args()
    k1, k2, k3, k4 = BASE.values()
    paper = Hydraulic.build(JOINTS, dt=DT, k1=k1, k2=k2, k3=k3, k4=k4, sprocket_radius=1.0, effort_limit=900.0)
    chambers = TwoChamber.build(JOINTS, dt=DT, **CHAMBERS)
    cases: dict[str, Callable[[], float]] = {
        "the paper's model": lambda: of_model(paper),
        "with delay, lag, dead band, orifice, supply": lambda: of_model(augmented(COMMAND_SIDE)),
        "with delay, lag, orifice, dry and viscous friction": lambda: of_model(augmented(WITH_FRICTION), 100),
        "two chambers of oil": lambda: of_model(chambers, 20),
        "the paper's model in numpy": of_numpy,
        "the paper's model in torch": of_torch,
        **{f"{kind.__name__} in hqpipe": lambda kind=kind: of_model(net(kind), 10) for kind in (MLP, LSTM, GRU)},
        "MLP in torch": of_torch_mlp,
        **{
            f"{kind.upper()} in ONNX Runtime": lambda kind=kind: of_onnxruntime(kind) for kind in ("mlp", "lstm", "gru")
        },
        **{
            f"{kind.__name__} for each joint in hqpipe": lambda kind=kind: of_model(net(kind, per_joint=True), 3)
            for kind in (MLP, LSTM, GRU)
        },
        **{
            f"{kind.upper()} for each joint in ONNX Runtime": lambda kind=kind: of_onnxruntime_per_joint(kind)
            for kind in ("mlp", "lstm", "gru")
        },
    }
    rows = {}
    for name, measured in cases.items():
        rows[name] = measured()
        print(f"{name:<52}{rows[name]:>8.0f} ns", flush=True)
    if options.csv:
        options.csv.parent.mkdir(parents=True, exist_ok=True)
        with options.csv.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerows([("model", "ns_per_robot"), *((name, f"{ns:.1f}") for name, ns in rows.items())])


if __name__ == "__main__":
    main()
