"""What of the error of a joint's prediction counts when sets of effects are fitted and compared.

A model whose predictions start from measured values, as a free run does, can say what is left of its error without the noise of
these. Otherwise a law that forgets soon where it began errs less for no other reason. What is reported is the error itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hqpipe.identify.model import JointModel

Measure = Callable[[JointModel, np.ndarray, bool], np.ndarray]
"""Of a model, values and whether the held-out samples are meant."""


def prediction_error(model: JointModel, values: np.ndarray, heldout: bool = False) -> np.ndarray:
    """(N,) `JointModel.error`."""
    return model.error(values, heldout)


def misfit(model: JointModel, values: np.ndarray, heldout: bool = False) -> np.ndarray:
    """(N,) at the samples of `fit` or `heldout`; see `JointModel.error`, which it is where a model does not say."""
    # Of its class: a model that wraps another one does not have the misfit of that.
    own = getattr(type(model), "misfit", None)
    return model.error(values, heldout) if own is None else own(model, values, heldout)


def misfit_noise(model: JointModel) -> tuple[float, float]:
    """(fit, held-out) root mean square that sensor noise alone leaves in it."""
    return model.misfit_noise if hasattr(type(model), "misfit") else model.noise


def floor_of(model: JointModel, heldout: bool = False) -> float:
    """Sum of its squares that sensor noise alone leaves at the samples of `fit` or `heldout`."""
    samples = model.heldout if heldout else model.fit
    return len(samples.trial) * misfit_noise(model)[int(heldout)] ** 2
