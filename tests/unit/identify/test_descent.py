"""The one loop of all fits, on problems whose minimum is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from hqpipe.identify.descent import FAILURES, descended, stepped, stopped


@dataclass(frozen=True)
class Place:
    values: np.ndarray
    cost: float


class Curve:
    """y = a (1 − e^(−b x)), with exact sensitivities; its parameters may be measured in another unit."""

    exact = True
    x = np.linspace(0.0, 4.0, 60)
    y = 3.0 * (1.0 - np.exp(-0.8 * x))

    def __init__(self, high=np.inf, unit=(1.0, 1.0)):
        self.unit, self.free = np.array(unit), np.arange(2)
        self.low, self.high = np.zeros(2), np.array([np.inf, high]) / self.unit

    def at(self, values, last):
        a, b = values * self.unit
        return Place(values, float(np.sum((a * (1.0 - np.exp(-b * self.x)) - self.y) ** 2)))

    def slopes(self, point):
        a, b = point.values * self.unit
        decay = np.exp(-b * self.x)
        return np.stack([1.0 - decay, a * self.x * decay], axis=1) * self.unit

    def followed(self, slopes, last, now):
        return self.slopes(now)

    def equations(self, slopes, point):
        a, b = point.values * self.unit
        error = a * (1.0 - np.exp(-b * self.x)) - self.y
        return slopes.T @ slopes, slopes.T @ error


def found(problem, start):
    return descended(problem, problem.at(np.array(start) / problem.unit, None), 1e-12)[0].values * problem.unit


@pytest.mark.parametrize("start", [(1.0, 0.1), (10.0, 3.0), (0.1, 1.0)])
def test_the_minimum_is_found_from_afar(start):
    assert found(Curve(), start) == pytest.approx([3.0, 0.8], rel=1e-6)


def test_units_do_not_matter():
    assert found(Curve(unit=(1e6, 1e-4)), (1.0, 0.1)) == pytest.approx(found(Curve(), (1.0, 0.1)), rel=1e-9)


def test_a_bound_holds_and_the_other_parameter_does_its_best():
    a, b = found(Curve(high=0.5), (1.0, 0.1))
    shape = 1.0 - np.exp(-0.5 * Curve.x)
    assert b == 0.5 and a == pytest.approx(shape @ Curve.y / (shape @ shape), rel=1e-6)


def test_nothing_moves_where_everything_is_stopped():
    low, high, values = np.zeros(2), np.ones(2), np.array([0.0, 1.0])
    slope = np.array([1.0, -1.0])
    assert stopped(slope, values, low, high).all() and not stopped(-slope, values, low, high).any()
    assert stepped(np.eye(2), slope, values, np.arange(2), low, high, 0.0) is values


def test_an_undamped_step_solves_a_linear_problem_and_keeps_what_is_not_free():
    normal, slope = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([1.0, -1.0])
    ends = np.full(3, np.inf)
    after = stepped(normal, slope, np.array([1.0, 7.0, 1.0]), np.array([0, 2]), -ends, ends, 0.0)
    assert after[[0, 2]] == pytest.approx(1.0 - np.linalg.solve(normal, slope)) and after[1] == 7.0


class Followed(Curve):
    """The curve with sensitivities that are followed along the steps; after the first step some fail."""

    exact = False

    def __init__(self, failing):
        super().__init__()
        self.failing, self.tried, self.taken_at = failing, 0, []

    def at(self, values, last):
        self.tried += 1
        return Place(values, np.inf) if 1 < self.tried <= 1 + self.failing else super().at(values, last)

    def slopes(self, point):
        self.taken_at.append(self.tried)
        return super().slopes(point)

    def followed(self, slopes, last, now):
        return slopes.copy()


@pytest.mark.parametrize(("failing", "anew"), [(FAILURES - 1, False), (FAILURES, True)])
def test_sensitivities_are_taken_anew_after_several_steps_that_do_not_help(failing, anew):
    problem = Followed(failing)
    descended(problem, Curve().at(np.array([2.9, 0.75]), None), 1e-12, rounds=2)
    assert (1 + FAILURES in problem.taken_at) is anew
