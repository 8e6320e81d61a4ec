"""Effects that may be left out of the library: those that a diagnosis can name."""

from __future__ import annotations

import pytest

from hqpipe.layers import ONLY_IN_LAYERS
from hqpipe.stages.diagnose import Params


def test_effects_of_the_layers_may_be_left_out():
    names = [*ONLY_IN_LAYERS, "coulomb_friction"]
    assert Params(without=names).without == names


@pytest.mark.parametrize("name", ["ground_friction", "coulomb"])
def test_a_name_that_no_diagnosis_gives_is_refused(name):
    with pytest.raises(ValueError, match=f"no effect '{name}'"):
        Params(without=[name])
