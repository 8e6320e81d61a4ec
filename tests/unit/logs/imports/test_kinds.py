"""What the units of a mapping say of joints that slide."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from hqpipe.logs.imports.import_set import import_logs
from hqpipe.logs.imports.mapping import read_map
from hqpipe.logs.imports.sources import find_sources
from hqpipe.logs.log_set import read_log_set


@pytest.mark.parametrize(
    ("boom", "swing", "kinds"),
    [
        ("cm", "rad", {"boom": "prismatic", "swing": "revolute"}),
        ("deg", "rad", {}),
        ("mm", None, {"boom": "prismatic", "swing": "revolute"}),
    ],
)
def test_units_say_which_joints_slide(tmp_path, boom, swing, kinds):
    time = np.arange(3000) / 100.0
    table = np.stack([time, np.sin(3 * time), np.sin(time), np.cos(3 * time), np.cos(time)], axis=1)
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="t,b,s,bc,sc", comments="")
    joints = {
        "boom": {"position": {"field": "b", "unit": boom}, "valve_command": "bc"},
        "swing": {"position": {"field": "s"} | ({"unit": swing} if swing else {}), "valve_command": "sc"},
    }
    path = tmp_path / "map.yaml"
    path.write_text(
        yaml.safe_dump({"format": "hqpipe-log-map/1", "clock": {"field": "t", "unit": "s"}, "joints": joints})
    )
    import_logs(find_sources([tmp_path / "a.csv"]), read_map(path), path.read_text(), tmp_path / "logs")
    assert read_log_set(tmp_path / "logs").kinds == kinds
