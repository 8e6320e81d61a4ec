"""constants.csv of fits that tell little."""

from __future__ import annotations

import csv
from types import SimpleNamespace

import numpy as np
import pytest

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.identify.paper_model.problem import COEFFICIENTS
from hqpipe.identify.paper_model.results import Coefficient, JointFit
from hqpipe.robots import robot_folder
from hqpipe.stages.fits.constants import CONSTANTS, write_constants


def written(folder, k: tuple[float, ...]) -> set[str]:
    """Quantities in the file for one joint that the robot does not have."""
    coefficients = tuple(
        Coefficient(n, "", v, None, v, at_bound=v == 0.0) for n, v in zip(COEFFICIENTS, k, strict=True)
    )
    fit = JointFit("hip", coefficients, 1.0, 1.0, 20, 2000, np.eye(4), np.full(4, 9.0))
    columns = dict(zip(COEFFICIENTS, k, strict=True))
    model = Hydraulic.build(["hip"], dt=1e-3, sprocket_radius=1.0, effort_limit=np.inf, **columns)
    context = SimpleNamespace(robot=robot_folder("hydraulic_quadruped"), output=folder)
    log_set = SimpleNamespace(joints=("hip",), control_mode="position")
    write_constants(context, log_set, SimpleNamespace(model=model, fits=(fit,), dt=1e-3), ())
    if not (folder / CONSTANTS).is_file():
        return set()
    with (folder / CONSTANTS).open(encoding="utf-8", newline="") as stream:
        return {row["quantity"] for row in csv.DictReader(stream)}


@pytest.mark.parametrize(
    ("k", "quantities"), [((0.0, 0.05, 0.0, 0.0), {"leak time constant"}), ((0.0, 0.0, 0.0, 0.0), set())]
)
def test_what_no_panel_shows_is_written_without_a_figure(tmp_path, k, quantities):
    """Where k1 and k3 lie on 0, all that is left is how fast the torque fades."""
    assert written(tmp_path, k) == quantities
    assert not (tmp_path / "constants.png").exists()


def test_what_a_panel_shows_is_drawn(tmp_path):
    assert "flow gain" in written(tmp_path, (400.0, 0.04, 8.0, 0.0))
    assert (tmp_path / "constants.png").stat().st_size > 5000
