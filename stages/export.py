"""export: the policy as one ONNX graph, with everything that a runner needs beside it."""

from __future__ import annotations

from typing import Annotated, Any

from hqpipe.pipeline.config import StageParams
from hqpipe.stages.inputs.bounds import within


class Params(StageParams):
    """Attributes:
    parity_samples: observations on which the graph must agree with torch; they are kept for validate.
    """

    parity_samples: Annotated[int, within(1, 1_000_000, "each has some hundred numbers, all in memory")] = 512


def run(context: Any) -> dict[str, Any]:
    import numpy as np

    from hqpipe.rl.onnx_export import export_onnx, sample_observations, torch_actions
    from hqpipe.rl.onnx_session import parity
    from hqpipe.rl.parity_file import save_parity
    from hqpipe.rl.policy_io import load_policy

    spec, networks = load_policy(context.inputs["policy"])
    path = export_onnx(context.output, spec, networks)
    observations = sample_observations(spec, context.params.parity_samples, np.random.default_rng(context.seed))
    actions = torch_actions(spec, networks, observations)
    save_parity(context.output, observations, actions)
    difference = parity(path, observations, actions)
    return {
        "headline": f"obs {observations.shape[1]} → actions {actions.shape[1]}, parity {difference:.1e} rad",
        "parity_rad": difference,
        "bytes": path.stat().st_size,
    }
