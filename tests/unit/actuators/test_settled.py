"""The stiffness that a held joint shows, where the equation says what it is."""

from __future__ import annotations

import numpy as np

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.settled import settled_stiffness


def test_of_the_paper_s_model_it_is_k1_over_k2():
    values = {"k1": [400.0, 700.0], "k2": [0.05, 0.02], "k3": 20.0, "k4": 0.3, "sprocket_radius": 1.0}
    model = Hydraulic.build(("hip", "knee"), dt=1e-3, effort_limit=np.inf, **values)
    found = settled_stiffness(model, np.array([0.3, -1.0]), np.array([50.0, -80.0]), 1e-3)
    np.testing.assert_allclose(found, [8_000.0, 35_000.0], rtol=1e-3)
