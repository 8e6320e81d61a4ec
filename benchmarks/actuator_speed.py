"""What a step of an actuator model costs: 400 robots of 12 joints in one call, on one core.

    python benchmarks/actuator_speed.py

Nanoseconds per robot and sample, the best of many; numpy, torch and ONNX Runtime do the same in the same run.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from hqpipe.actuators.augmented import Augmented
from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.effects.layout import neutral_row, slot

ROBOTS, DT = 400, 1e-3
JOINTS = tuple(f"{leg}{joint}" for leg in ("LF", "RF", "LH", "RH") for joint in "RPK")
BASE = {"k1": 250.0, "k2": 0.06, "k3": 9.0, "k4": 0.4}  # about those of the reference plant, in joint space
COMMAND_SIDE = {
    ("command_delay", "delay_s"): 0.0034,
    ("valve_lag", "time_constant_s"): 0.003,
    ("valve_deadband", "half_width"): 0.005,
    ("orifice_flow", "effort_max_nm"): 1.0 / 984.0,
    ("supply_droop", "droop"): 0.02,
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


def of_onnxruntime() -> float:
    """An MLP of the paper's size."""
    import onnxruntime
    from onnx import TensorProto, helper, numpy_helper

    rng, joints = np.random.default_rng(1), len(JOINTS)
    sizes = {"w1": (4 * joints, 64), "b1": (64,), "w2": (64, joints), "b2": (joints,)}
    tensors = [numpy_helper.from_array(0.1 * rng.normal(size=s).astype(np.float32), n) for n, s in sizes.items()]
    nodes = [
        helper.make_node("Gemm", ["x", "w1", "b1"], ["h"]),
        helper.make_node("Softsign", ["h"], ["s"]),
        helper.make_node("Gemm", ["s", "w2", "b2"], ["y"]),
    ]
    x, y = (
        helper.make_tensor_value_info(n, TensorProto.FLOAT, [ROBOTS, c]) for n, c in (("x", 4 * joints), ("y", joints))
    )
    opset = [helper.make_opsetid("", 17)]
    model = helper.make_model(helper.make_graph(nodes, "mlp", [x], [y], tensors), opset_imports=opset, ir_version=9)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
    rows = np.concatenate(signals(), axis=1).astype(np.float32)
    return best(lambda: session.run(None, {"x": rows}), 50)


def main() -> None:
    k1, k2, k3, k4 = BASE.values()
    paper = Hydraulic.build(JOINTS, dt=DT, k1=k1, k2=k2, k3=k3, k4=k4, sprocket_radius=1.0, effort_limit=900.0)
    rows = {
        "the paper's model": of_model(paper),
        "with delay, lag, dead band, orifice, supply": of_model(augmented(COMMAND_SIDE)),
        "with delay, lag, orifice, dry and viscous friction": of_model(augmented(WITH_FRICTION), 100),
        "the paper's model in numpy": of_numpy(),
        "the paper's model in torch": of_torch(),
        "MLP (48, 64, 12) in ONNX Runtime": of_onnxruntime(),
    }
    for name, nanoseconds in rows.items():
        print(f"{name:<52}{nanoseconds:>8.0f} ns")


if __name__ == "__main__":
    main()
