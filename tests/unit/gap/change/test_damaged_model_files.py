"""fit.json, diagnosis.json and residuals.csv beside an actuator model, under every damage."""

from __future__ import annotations

import json

import pytest
from damage import ANY_FILE, JSON_FILE, TEXT_FILE, refuses_every, survives_fields, survives_flips, write_json

from hqpipe.actuators.augmented import Augmented
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.gap.change.model_files import left_of, variances
from hqpipe.machine.layout import neutral_row

FIT = {
    "per_joint": {
        "fits": [
            {
                "joint": "LFR",
                "free_run_rmse": 5.0,
                "noise": 1.0,
                "persistence_rmse": 50.0,
                "coefficients": [{"name": "k1", "ci95": [1.0, 2.0]}, {"name": "k2", "ci95": None}],
            }
        ]
    }
}
TABLE = "trial,joint,family,rmse,rmse_after,rmse_persistence\nall,LFR,all,9.0,5.0,50.0\n"


@pytest.fixture
def model():
    return Hydraulic.build(["LFR"], dt=1e-3, k1=1e5, k2=0.1, k3=1e3, k4=1.0, sprocket_radius=0.06, effort_limit=900.0)


@pytest.fixture
def fit(tmp_path):
    write_json(tmp_path / "fit.json", FIT)
    return tmp_path / "fit.json"


@pytest.fixture
def diagnosis(tmp_path):
    write_json(tmp_path / "diagnosis.json", {"gap": {"noise_floor": 1.0}})
    (tmp_path / "residuals.csv").write_text(TABLE)
    return tmp_path


def damages_of(table, *but):
    return {name: damage for name, damage in table.items() if name not in but}


def test_a_damaged_fit_is_refused(model, fit):
    # A model may have no fit.json, and one of another scope says nothing of this one.
    without = ("missing", "a link to itself", "an empty object", "an unknown field")
    for table in (ANY_FILE, JSON_FILE):
        damages = damages_of(table, *without)
        refuses_every(damages, lambda: (left_of(fit.parent, model), variances(fit.parent, model)), fit)


def test_every_wrong_field_of_a_fit_is_refused(model, fit):
    passed = survives_fields(
        json.loads(fit.read_text()), write_json, lambda: (left_of(fit.parent, model), variances(fit.parent, model)), fit
    )
    numbers = ("free_run_rmse", "noise", "persistence_rmse")
    wrong = ("'-1'", "'1e+300'", "'nan'", "'inf'", "'text'", "'True'")
    assert not {name for name in passed if any(n in name for n in numbers) and name.endswith(wrong)}, passed


def test_a_flipped_bit_is_refused_or_another_number(model, fit):
    survives_flips(lambda: (left_of(fit.parent, model), variances(fit.parent, model)), fit)


def test_a_damaged_diagnosis_is_refused(diagnosis):
    model = Augmented(("LFR",), neutral_row()[None], 1e-3)
    without = ("missing", "a folder", "a link to itself")  # a model may be without
    quiet = ("an empty object", "an unknown field")  # without a gap there is nothing left to say
    for table in (ANY_FILE, JSON_FILE):
        refuses_every(
            damages_of(table, *without, *quiet), lambda: left_of(diagnosis, model), diagnosis / "diagnosis.json"
        )
    behind_a_cell = ("cut at 0.5", "cut at 0.9")  # a whole table
    for table in (ANY_FILE, TEXT_FILE):
        refuses_every(
            damages_of(table, *without, *behind_a_cell), lambda: left_of(diagnosis, model), diagnosis / "residuals.csv"
        )
    survives_flips(lambda: left_of(diagnosis, model), diagnosis / "residuals.csv")


@pytest.mark.parametrize("cell", ["nan", "inf", "-1", "1e300", "x", "1e999"])
def test_an_error_without_sense_is_refused(diagnosis, cell):
    model = Augmented(("LFR",), neutral_row()[None], 1e-3)
    wrong = {"cell": lambda path: path.write_text(TABLE.replace("5.0", cell, 1))}
    refuses_every(wrong, lambda: left_of(diagnosis, model), diagnosis / "residuals.csv")
