"""What a model knows to within a tolerance only, and is no cause: how far it moves the numbers of a fit, and how unsure it
leaves them.

Both sides of a cylinder are meant to be alike, and are so to within a tolerance. In a search that could vary them they would
stand for small causes. So they are left out of it, and the numbers of the answer are corrected afterwards: by the step of least
squares in which they are free within their tolerance, and in their covariance by what the errors leave open of them
(corrections for systematic effects, JCGM 100:2008, 3.2).
"""

from __future__ import annotations

import numpy as np

from hqpipe.identify.least_squares import lengths
from hqpipe.identify.sampling import scaled_inverse
from hqpipe.identify.search import Known, Search

_MOST = np.sqrt(3.0)  # deviations of a number that is anywhere between two limits, from its middle to one of these


def corrections(search: Search, known: Known) -> tuple[np.ndarray, np.ndarray]:
    """(F,) what is added to the free parameters of a set, and (F, F) what is added to their covariance.

    The errors weigh as much as those of the set say beside a prior, see `hqpipe.identify.sampling.covariance`.
    """
    solution, count = known.solution, len(known.solution.free)
    # Of its class: a model that wraps another one does not have the samples of that.
    tolerances = getattr(type(search.model), "tolerances", None)
    columns = np.zeros((0, 0)) if tolerances is None else tolerances(search.model, solution.values)
    if not columns.size or not np.isfinite(columns).all() or not np.isfinite(solution.square):
        return np.zeros(count), np.zeros((count, count))
    variance = known.covariance.alike * known.covariance.noise
    jacobian = solution.jacobian
    normal = jacobian.T @ jacobian + np.diag(variance * search.fitter.precision(solution.values, solution.free))
    scale = lengths(normal)
    taken_up = scaled_inverse(normal, np.outer(scale, scale)) @ (
        jacobian.T @ columns
    )  # (F, K) of the numbers, by each thing
    left = columns - jacobian @ taken_up
    sure = np.linalg.inv(left.T @ left / variance + np.eye(columns.shape[1]))  # (K, K) covariance that is left of them
    off = np.clip(-sure @ (left.T @ solution.error) / variance, -_MOST, _MOST)
    return -taken_up @ off, taken_up @ sure @ taken_up.T
