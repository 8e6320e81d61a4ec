"""Back-translation of the paper's coefficients."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.identify.constants.paper_constants import paper_constants, paper_quantities
from hqpipe.identify.paper_model.problem import COEFFICIENTS
from hqpipe.identify.paper_model.results import Coefficient, JointFit

STIFF, GAIN, DROOP, RADIUS, DT = 2e4, 25.0, 4e-3, 0.06, 1e-3


def test_exact_coefficients_of_a_linear_actuator_return_its_constants():
    rate = STIFF * DROOP
    share = -np.expm1(-rate * DT)
    k3 = share / rate * STIFF / RADIUS**2
    found = paper_constants(np.array([GAIN * k3, share, k3, 0.0]), RADIUS, DT, area=8e-4)
    assert found.stiffness == pytest.approx(STIFF)
    assert found.flow_gain == pytest.approx(GAIN)
    assert found.droop == pytest.approx(DROOP)
    assert found.loop_stiffness == pytest.approx(GAIN / DROOP)
    assert found.bulk_over_volume == pytest.approx(STIFF / (2 * (8e-4 * RADIUS) ** 2))
    assert found.full_force is None


def test_without_leakage_nothing_fades():
    found = paper_constants(np.array([1e5, 0.0, 4e3, 2.0]), RADIUS, DT)
    assert found.relaxation == 0.0 and found.droop == 0.0 and found.loop_stiffness == np.inf
    assert found.stiffness == pytest.approx(4e3 * RADIUS**2 / DT)
    assert found.full_force == pytest.approx(4e3 / (2.0 * DT)) and found.bulk_over_volume is None


K = np.array([1e5, 0.065, 3.9e3, 25.0])
SPREAD = np.array([0.02, 0.03, 0.02, 0.2]) * K
CORRELATED = np.array([[1.0, 0.5, 0.97, 0.1], [0.5, 1.0, 0.4, 0.0], [0.97, 0.4, 1.0, 0.1], [0.1, 0.0, 0.1, 1.0]])


def fit_of(k=K, missing=(), pressed=()) -> JointFit:
    coefficients = tuple(
        Coefficient(
            name, "", None if name in missing else value, None, 0.0, name not in missing, at_bound=name in pressed
        )
        for name, value in zip(COEFFICIENTS, k.tolist(), strict=True)
    )
    return JointFit("knee", coefficients, 1.0, 1.0, 200, 20_000, CORRELATED * np.outer(SPREAD, SPREAD), np.full(4, 1e6))


def test_intervals_are_those_of_draws_of_whole_sets():
    """The delta method against 200,000 draws; the spread is small enough for it to hold to 3 %, in F (20 % of k4) to 15 %."""
    fit = fit_of()
    draws = np.random.default_rng(0).multivariate_normal(K, fit.covariance, 200_000)
    draws = draws[draws[:, 3] > 0.0]
    known = {
        "hydraulic stiffness": "stiffness",
        "flow gain": "flow_gain",
        "leakage": "droop",
        "loop stiffness": "loop_stiffness",
        "impact force": "full_force",
    }
    found = {q.name: q for q in paper_quantities(fit, RADIUS, DT)}
    values = [paper_constants(k, RADIUS, DT) for k in draws[:20_000]]
    columns = {name: np.array([getattr(v, field) for v in values]) for name, field in known.items()}
    columns["leak time constant"] = np.array([1.0 / v.relaxation for v in values])
    assert columns.keys() == found.keys()
    for name, column in columns.items():
        low, high = np.quantile(column, (0.025, 0.975))
        within = 0.15 if name == "impact force" else 0.03
        assert found[name].half_width == pytest.approx(0.5 * (high - low), rel=within), name


def test_few_degrees_of_freedom_widen_the_interval():
    fit = fit_of()
    few = JointFit("knee", fit.coefficients, 1.0, 1.0, 200, 20_000, fit.covariance, np.array([5.0, 9.0, 5.0, 9.0]))
    for wide, plain in zip(paper_quantities(few, RADIUS, DT), paper_quantities(fit, RADIUS, DT), strict=True):
        quantile = 2.2622 if wide.name == "leak time constant" else 2.5706  # Student's, 9 and 5
        assert wide.half_width == pytest.approx(plain.half_width * quantile / 1.95996, rel=1e-3)


def test_what_the_logs_do_not_determine_is_left_out():
    without = {q.name for q in paper_quantities(fit_of(missing=("k4",)), RADIUS, DT)}
    assert without == {q.name for q in paper_quantities(fit_of(), RADIUS, DT)} - {"impact force"}
    assert {q.name for q in paper_quantities(fit_of(missing=("k1",)), RADIUS, DT)}.isdisjoint(
        {"flow gain", "loop stiffness"}
    )
    assert paper_quantities(fit_of(missing=("k2",)), RADIUS, DT) == ()
    assert paper_quantities(fit_of(K * [1, 0, 1, 1]), RADIUS, DT) == ()


def test_a_coefficient_on_its_bound_gives_no_interval():
    halves = {q.name: q.half_width for q in paper_quantities(fit_of(pressed=("k1",)), RADIUS, DT)}
    assert halves["flow gain"] is None and halves["loop stiffness"] is None and halves["leakage"] > 0.0
