"""All checks together: silent on sound logs, one defect named once on broken ones."""

from __future__ import annotations

import numpy as np
import pytest
from plant_logs import broken, log_set, plant_logs, real, recorded, rows, values

from hqpipe.gap.checks.defect import KINDS
from hqpipe.gap.checks.sanity import check_logs, too_short


@pytest.mark.parametrize("seeds", [(0, 1), (2, 3)])
@pytest.mark.parametrize("source", ["pressure", "load_cell"])
def test_sound_logs(seeds, source):
    assert check_logs(plant_logs(seeds, source)) == []


@pytest.mark.parametrize(
    "change",
    [
        '{"firmware": {"command_delay": 0.01}, "valve": {"overlap": 0.08, "stiction": 0.1}}',
        '{"valve": {"asymmetry": 0.3, "crosstalk": 0.3}}',
        '{"sensors": {"effort_bias": 40.0, "effort_scale": 1.3, "position_bias": 0.05, "effort_delay": 0.005}}',
        '{"bus": {"drop_rate": 3.0}, "supply": {"ripple_pressure": 2.0e6}}',
    ],
)
def test_an_effect_is_no_defect(change):
    assert check_logs(plant_logs((6, 7), changes=change)) == []


def test_real_machines():
    assert check_logs(real("emps")) == []
    found = {d.kind: d for d in check_logs(real("so101"))}
    assert set(found) == {"unsigned", "velocity_mismatch"}
    assert len(found["unsigned"].joints) == 6
    assert found["velocity_mismatch"].joints == ("Jaw",)


@pytest.mark.parametrize(
    ("change", "kind", "channel"),
    [
        (rows(lambda n: np.random.default_rng(0).permutation(n)), "rows_out_of_order", None),
        (rows(lambda n: np.random.default_rng(0).permutation(n), "effort"), "rows_out_of_order", "effort"),
        (values("effort", lambda v: v[:, ::-1], 2, 5), "swapped", "effort"),
        (values("velocity", lambda v: v[:, ::-1], 2, 5), "swapped", "velocity"),
        (values("effort", np.negative, 2), "sign_flipped", "effort"),
        (values("velocity", lambda v: 57.2958 * v), "velocity_mismatch", "velocity"),
        (values("effort", np.abs), "unsigned", "effort"),
        (values("velocity", np.abs), "unsigned", "velocity"),
        (values("effort", lambda v: 0.0 * v, 2), "constant", "effort"),
    ],
)
def test_one_defect_is_named_once(change, kind, channel):
    found = check_logs(broken(plant_logs(), change))
    assert [(d.kind, d.channel, d.fatal) for d in found] == [(kind, channel, True)], [d.message for d in found]
    assert found[0].kind in KINDS and found[0].message.count("\n") == 0


def test_too_short_says_what_is_missing():
    logs = broken(plant_logs(), lambda t: t.section(0, 501))
    texts = [d.message for d in too_short(logs)]
    assert texts == [
        "1 fit trials last 0.5 s: 5 windows of 0.1 s, expected at least 20; record at least 1.5 s more",
        "1 held-out trials last 0.5 s: 5 windows of 0.1 s, expected at least 20; record at least 1.5 s more",
    ]
    assert {d.kind for d in check_logs(logs)} == {"too_short"}
    assert "0 fit trials last 0 s" in too_short(log_set([recorded(0)]))[0].message


def test_the_worst_comes_first():
    logs = broken(plant_logs(), rows(lambda n: np.arange(n) - (np.arange(n) % 50 == 49), "position"))
    found = check_logs(broken(logs, values("effort", np.negative, 2)))
    assert [d.fatal for d in found] == sorted((d.fatal for d in found), reverse=True)
    assert {d.kind for d in found} == {"sign_flipped", "held_samples"}
