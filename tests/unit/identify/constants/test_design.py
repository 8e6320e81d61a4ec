"""What a joint should show by its design, against numbers worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hqpipe.identify.constants.design import Design, chamber_expected, oil_quantities, paper_expected
from hqpipe.identify.constants.quantity import Quantity

DESIGN = Design(
    radius=0.05,
    area=1e-3,
    bulk_modulus=1e9,
    volume_a=1e-4,
    volume_b=1e-4,
    strand_stiffness=1e7,
    tooth_stiffness=4e7,
    leakage=2e-11,
    pressure=2e7,
    valve_gain=1e-7,
    null_opening=0.02,
    opening=0.1,
    valve_delay=3e-3,
    gain=2.0,
)


def test_by_hand():
    oil, chain = 2e9 * 1e-6 * 0.05**2 / 1e-4, 0.05**2 / (1 / 2e7 + 1 / 4e7)  # 50,000 and 33,333 N·m/rad
    found = chamber_expected(DESIGN)
    assert found["hydraulic stiffness"] == pytest.approx(1.0 / (1.0 / oil + 1.0 / chain)) == pytest.approx(20_000)
    assert found["full torque"] == pytest.approx(1000.0) and found["give"] == pytest.approx(0.05)
    assert found["flow gain"] == pytest.approx(2.0 * 1e-7 * np.sqrt(1e7) / 5e-5)
    assert found["leakage"] == pytest.approx(2e-11 / 2.5e-9)
    assert found["null opening"] == pytest.approx(0.005)
    assert found["volume slope"] == pytest.approx(0.5 * 20_000 / oil)


def test_slope_of_the_valve_is_that_of_its_lands():
    """Numerical derivative of the flow through the lands with respect to the pressure difference, at one opening."""

    def flow(difference: float, spool: float) -> float:
        a, b = 1e7 + difference / 2, 1e7 - difference / 2
        opened, shut = (0.5 * (z + np.hypot(z, DESIGN.null_opening)) for z in (spool, -spool))
        into = opened * np.sqrt(2e7 - a) - shut * np.sqrt(a)
        out = opened * np.sqrt(b) - shut * np.sqrt(2e7 - b)
        return 0.5 * DESIGN.valve_gain * (into + out)

    for spool in (0.0, 0.1):
        slope = -(flow(1e3, spool) - flow(-1e3, spool)) / 2e3
        design = replace(DESIGN, opening=float(np.hypot(spool, DESIGN.null_opening)))
        assert design.slope == pytest.approx(slope / design.swept**2, rel=1e-6)
        droop = paper_expected(design)["leakage"]
        assert droop == pytest.approx(chamber_expected(design)["leakage"] + design.slope)


def test_off_the_middle_both_chambers_are_stiffer_together():
    moved = replace(DESIGN, volume_a=1.3e-4, volume_b=0.7e-4)
    assert moved.volume == pytest.approx(2 / (1 / 1.3e-4 + 1 / 0.7e-4))
    assert chamber_expected(moved)["hydraulic stiffness"] > chamber_expected(DESIGN)["hydraulic stiffness"]


def test_bulk_modulus_comes_back_out_of_the_stiffness_with_its_derivative():
    def oil(stiffness: float) -> Quantity:
        return oil_quantities([Quantity("hydraulic stiffness", "N·m/rad", stiffness, 100.0, "")], DESIGN)[0]

    assert oil(20_000.0).value == pytest.approx(1e9)
    slope = (oil(20_001.0).value - oil(19_999.0).value) / 2.0
    assert oil(20_000.0).half_width == pytest.approx(100.0 * slope, rel=1e-5)


def test_leak_comes_back_out_of_the_leakage():
    (leak,) = oil_quantities([Quantity("leakage", "rad/s per N·m", 8e-3, None, "")], DESIGN)
    assert leak.value == pytest.approx(2e-11) and leak.half_width is None


@pytest.mark.parametrize("stiffness", [33_334.0, 1e6])
def test_no_bulk_modulus_for_a_joint_stiffer_than_its_chain(stiffness):
    assert oil_quantities([Quantity("hydraulic stiffness", "N·m/rad", stiffness, 1.0, "")], DESIGN) == ()


def test_nothing_is_guessed():
    blank = Design(radius=0.05)
    assert np.isnan([*paper_expected(blank).values(), *chamber_expected(blank).values()]).all()
    found = [
        Quantity("hydraulic stiffness", "N·m/rad", 2e4, 1.0, ""),
        Quantity("leakage", "rad/s per N·m", 8e-3, 1.0, ""),
    ]
    assert oil_quantities(found, blank) == ()
    no_area = chamber_expected(replace(DESIGN, area=float("nan")))
    assert np.isnan(no_area["hydraulic stiffness"]) and no_area["null opening"] == pytest.approx(0.005)
