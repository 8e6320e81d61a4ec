"""Whether the posterior of a fit covers what other trials of the same machine give.

    python benchmarks/posterior_coverage.py --logs artifacts/rollouts [--scope per_joint]

Every held-out trial is fitted by itself, joint by joint. Printed is how many of its coefficients lie within 95 % of what
retraining would draw, within the intervals of the estimate alone, and within the hand-picked half-range of 20 %.
Coefficients that the trial does not determine, or that it puts on a bound, are left out.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.identify.paper_model.problem import COEFFICIENTS
from hqpipe.identify.paper_model.results import FitResult
from hqpipe.logs.log_set import read_log_set
from hqpipe.rl.config import ActuatorRandomisationConfig
from hqpipe.robots import robot_folder
from hqpipe.stages.fits.paper_fits import joint_constants

DRAWS = 4000
HALF_RANGE = ActuatorRandomisationConfig().half_range


def ranges(result: FitResult) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Name → lower and upper ends (J, 4)."""
    columns = slice(0, len(COEFFICIENTS))
    drawn = result.posterior.draw(result.model, DRAWS, np.random.default_rng(0))[..., columns]
    held = result.model.parameters[:, columns]
    ends = np.array([[c.ci95 or (np.nan, np.nan) for c in fit.coefficients] for fit in result.fits])
    ends = np.broadcast_to(ends, (len(held), *ends.shape[1:]))  # shared: one row for all
    low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    return {
        "posterior": (low, high),
        "estimate alone": (ends[..., 0], ends[..., 1]),
        "half-range": ((1.0 - HALF_RANGE) * held, (1.0 + HALF_RANGE) * held),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=Path, required=True)
    parser.add_argument("--robot", default="hydraulic_quadruped")
    parser.add_argument("--scope", choices=("per_joint", "shared"), default="per_joint")
    options = parser.parse_args()
    logs = read_log_set(options.logs)
    constants = joint_constants(robot_folder(options.robot), logs.joints)
    result = fit_actuator(logs, scope=options.scope, **constants)
    drawn = result.posterior.draw(result.model, DRAWS, np.random.default_rng(0))[..., : len(COEFFICIENTS)]
    shares = 100.0 * (drawn.std(axis=0) / drawn.mean(axis=0)).mean(axis=0)
    print(f"standard deviation of the draws: {', '.join(f'{s:.1f} %' for s in shares)}")
    spans = ranges(result)
    print(f"{'':<24}" + "".join(f"{name:>16}" for name in spans))
    for trial in logs.heldout:
        alone = fit_actuator(replace(logs, trials=(replace(trial, split="fit"),)), **constants)
        told = np.array([[c.identifiable and not c.at_bound for c in fit.coefficients] for fit in alone.fits])
        found = alone.model.parameters[:, : len(COEFFICIENTS)]
        counts = [int(((low <= found) & (found <= high))[told].sum()) for low, high in spans.values()]
        print(f"{trial.file:<24}" + "".join(f"{f'{count} of {told.sum()}':>16}" for count in counts), flush=True)


if __name__ == "__main__":
    main()
