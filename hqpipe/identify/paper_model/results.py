"""What a fit of the paper's model returns."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.posterior import Posterior


@dataclass(frozen=True)
class Coefficient:
    """One fitted number.

    Attributes:
        name, unit: as in `Hydraulic.FIELDS`.
        value: None if the logs do not determine it; the model then holds 0. What a single window decides has one.
        ci95: 95 % interval, or None. Robust against residuals that are correlated in time; it covers the
            estimate's scatter, not the error of the model's form.
        one_step: the paper's one-step least squares within the bounds; biased by torque noise.
        identifiable: False with the `reason`.
        at_bound: the estimate lies on a physical bound.
    """

    name: str
    unit: str
    value: float | None
    ci95: tuple[float, float] | None
    one_step: float
    identifiable: bool = True
    reason: str | None = None
    at_bound: bool = False


@dataclass(frozen=True)
class JointFit:
    """The fit of one joint, or of all sharing the coefficients (`joint` is then "all").

    Attributes:
        free_run_rmse: on the fit trials, N·m. noise: noise floor of their torque, N·m.
        windows: how many; samples: predicted samples in them, over all joints that share the coefficients.
        covariance: (4, 4) of the coefficients, as their intervals use it; 0 where not identifiable, None with too few windows.
        freedom: (4,) degrees of freedom of its diagonal.
        persistence_rmse: of holding the torque at every window's start, N·m: how much these logs move.
    """

    joint: str
    coefficients: tuple[Coefficient, ...]
    free_run_rmse: float
    noise: float
    windows: int
    samples: int
    covariance: np.ndarray | None = field(default=None, compare=False, repr=False)
    freedom: np.ndarray | None = field(default=None, compare=False, repr=False)
    persistence_rmse: float | None = None

    def __getitem__(self, name: str) -> Coefficient:
        return next(c for c in self.coefficients if c.name == name)


@dataclass(frozen=True, eq=False)
class FitResult:
    """Coefficients, and the models that follow from them.

    Attributes:
        model: free-running fit. one_step_model: the paper's one-step fit.
        fits: one per joint, or a single one for shared coefficients.
        dt: sample time that the coefficients belong to, s.
        posterior: of the coefficients; None where the windows are too few for it.
    """

    model: Hydraulic
    one_step_model: Hydraulic
    fits: tuple[JointFit, ...]
    scope: str
    window_s: float
    dt: float
    trials: tuple[str, ...]
    warnings: tuple[str, ...]
    posterior: Posterior | None

    def to_dict(self) -> dict[str, Any]:
        """JSON-able summary; the models are saved apart."""
        return {
            "model": self.model.NAME,
            "scope": self.scope,
            "dt": self.dt,
            "window_s": self.window_s,
            "trials": list(self.trials),
            "fits": [_plain(fit) for fit in self.fits],
            "warnings": list(self.warnings),
        }


def _plain(fit: JointFit) -> dict[str, Any]:
    """Without the covariance, which the posterior has."""
    return {name: value for name, value in asdict(fit).items() if name not in ("covariance", "freedom")}
