"""Error measures of a torque prediction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PAPER_THRESHOLD = 50.0  # N·m, paper, section IV-A
_SMALL_MACHINE = 0.25  # assumption: of the joint's 99th percentile, where that is below the paper's threshold


@dataclass(frozen=True)
class ErrorStats:
    """Errors over some samples.

    Attributes:
        rmse: N·m, inf where a model diverged. nrmse: relative to the standard deviation of the measured torque of each joint.
        loaded_rmse: N·m, and loaded_mape: %, where |τ| exceeds the joint's threshold; None if it never does.
        samples, loaded_samples: how many.
    """

    rmse: float
    nrmse: float
    loaded_rmse: float | None
    loaded_mape: float | None
    samples: int
    loaded_samples: int


def loaded_threshold(effort: np.ndarray) -> float:
    """Torque above which relative errors mean something: 50 N·m as in the paper, less for small machines.

    Args:
        effort: (T,) measured torque of a joint, N·m.
    """
    return float(min(PAPER_THRESHOLD, _SMALL_MACHINE * np.quantile(np.abs(effort), 0.99)))


def error_stats(
    residual: np.ndarray,
    effort: np.ndarray,
    scale: np.ndarray,
    threshold: np.ndarray,
    observed: np.ndarray | None = None,
) -> ErrorStats:
    """Pool the errors of some samples and joints.

    Args:
        residual, effort: (T, J) N·m.
        scale: (J,) standard deviation of each joint's torque, N·m.
        threshold: (J,) N·m, see `loaded_threshold`.
        observed: (T, J) whether the torque was recorded; None if it always was.
    """
    observed = np.ones(effort.shape, dtype=bool) if observed is None else observed
    residual = np.where(np.isfinite(residual), residual, np.inf)  # what diverged is infinitely wrong, not undefined
    square = residual**2
    relative = (square / np.where(scale > 0, scale, np.inf) ** 2)[observed]
    loaded = (np.abs(effort) > threshold) & observed
    count = int(loaded.sum())
    return ErrorStats(
        rmse=float(np.sqrt(square[observed].mean())),
        nrmse=float(np.sqrt(relative.mean())),
        loaded_rmse=float(np.sqrt(square[loaded].mean())) if count else None,
        loaded_mape=float(100.0 * np.mean(np.abs(residual[loaded] / effort[loaded]))) if count else None,
        samples=int(observed.sum()),
        loaded_samples=count,
    )
