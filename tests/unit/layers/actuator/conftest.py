"""Two joints with a position loop, and the model of the first."""

from __future__ import annotations

import pytest
from position_loop_logs import planted_logs

from hqpipe.layers.actuator import Actuator


@pytest.fixture(scope="module")
def logs():
    return planted_logs({}, {}, seconds=3.0, fit=1)


@pytest.fixture(scope="module")
def model(logs):
    return Actuator().joints(logs).models[0]
