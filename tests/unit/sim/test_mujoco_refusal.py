from __future__ import annotations

import pytest

from hqpipe.errors import ConfigError
from hqpipe.sim.mujoco_refusal import named


def test_what_mujoco_refuses_names_the_file_and_the_fix():
    mujoco = pytest.importorskip("mujoco")
    with pytest.raises(ConfigError, match="robot.urdf: MuJoCo cannot make a body of it .*rgba") as caught:
        with named("robot.urdf", "correct what it names"):
            mujoco.MjSpec.from_string('<robot name="r"><material name="m"><color/></material><link name="a"/></robot>')
    assert (caught.value.file, caught.value.fix) == ("robot.urdf", "correct what it names")
