"""The deployed policy as one ONNX graph."""

from __future__ import annotations

import logging
import warnings
from pathlib import Path

import numpy as np
import onnx
import torch
import yaml

from hqpipe.rl.controller import ACTIONS, ESTIMATE
from hqpipe.rl.networks import DeployedPolicy, LocomotionNetworks
from hqpipe.rl.onnx_metadata import deploy_description, runner_metadata
from hqpipe.rl.policy_spec import PolicySpec

OPSET = 18
MODEL, DEPLOY = "policy.onnx", "deploy.yaml"


def export_onnx(folder: Path, spec: PolicySpec, networks: LocomotionNetworks) -> Path:
    """Write policy.onnx and deploy.yaml; the same policy gives the same bytes.

    The graph maps obs (B, n) to actions (B, J) in rad, its first output, and to estimate (B, m), x̃_t in physical units.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / MODEL
    path.write_bytes(onnx_bytes(spec, networks))
    text = yaml.safe_dump(deploy_description(spec), sort_keys=False, allow_unicode=True)
    (folder / DEPLOY).write_text(text, encoding="utf-8")
    return path


def onnx_bytes(spec: PolicySpec, networks: LocomotionNetworks) -> bytes:
    """The serialised model, without anything that depends on where or when it was made."""
    example = torch.zeros(2, spec.observation.size)
    example[:, spec.observation.part("joint_position")] = torch.as_tensor(spec.nominal, dtype=torch.float32)
    # The exporter lists every optional package that is not installed.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        # The exporter warns about its own use of torch's tree utilities; nothing a caller could change.
        warnings.filterwarnings("ignore", message=".*LeafSpec.*", category=FutureWarning)
        program = torch.onnx.export(
            DeployedPolicy(spec, networks).eval(),
            (example,),
            dynamo=True,
            external_data=False,
            opset_version=OPSET,
            input_names=["obs"],
            output_names=[ACTIONS, ESTIMATE],
            dynamic_shapes=({0: torch.export.Dim("batch")},),
            verbose=False,
        )
    model = program.model_proto
    _strip(model)
    model.producer_name, model.producer_version, model.doc_string = "hqpipe", "", ""
    for key, value in runner_metadata(spec).items():
        model.metadata_props.add(key=key, value=value)
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString(deterministic=True)


def _strip(model: onnx.ModelProto) -> None:
    """Remove what the exporter notes about its own run: source paths, stack traces, Python names."""
    del model.metadata_props[:]
    graph = model.graph
    graph.doc_string = ""
    for item in (*graph.node, *graph.value_info, *graph.input, *graph.output, *graph.initializer):
        del item.metadata_props[:]
        item.doc_string = ""
    del graph.metadata_props[:]
    for function in model.functions:
        del function.metadata_props[:]
        for node in function.node:
            del node.metadata_props[:]
            node.doc_string = ""


def torch_actions(spec: PolicySpec, networks: LocomotionNetworks, observations: np.ndarray) -> np.ndarray:
    """(B, J) targets that the networks give for `observations` (B, n), rad: what the graph must reproduce."""
    with torch.no_grad():
        return DeployedPolicy(spec, networks).eval()(torch.as_tensor(observations))[0].numpy()


def sample_observations(spec: PolicySpec, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, n) observations spread around those of a walking robot, with a consistent clock."""
    layout = spec.observation
    noise = rng.standard_normal((count, layout.size)).astype(np.float32)
    seen = layout.offset + noise / layout.scale
    low, high = spec.command_range.T
    seen[:, layout.part("velocity_command")] = rng.uniform(low, high, size=(count, 3))
    if spec.has_clock:
        angle = rng.uniform(0.0, 2.0 * np.pi, count)
        seen[:, layout.part("clock")] = np.stack((np.sin(angle), np.cos(angle)), axis=1)
    return seen.astype(np.float32)
