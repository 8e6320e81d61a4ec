"""What the units of a mapping say of joints that slide."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from hqpipe.logs.imports.import_set import import_logs
from hqpipe.logs.imports.mapping import read_map
from hqpipe.logs.imports.sources import find_sources
from hqpipe.logs.log_set import read_log_set

SLIDING = {"boom": "prismatic", "swing": "revolute"}


@pytest.mark.parametrize(
    ("boom", "more", "swing", "kinds"),
    [
        ({"unit": "cm"}, {}, "rad", SLIDING),
        ({"unit": "deg"}, {}, "rad", {}),
        ({"unit": "mm"}, {}, None, SLIDING),
        ({"unit": "m", "scale": 25e-6}, {}, "rad", SLIDING),
        ({"unit": "m", "scale": 25e-6}, {"effort": {"field": "s", "unit": "N", "scale": 0.2}}, "rad", SLIDING),
        ({"unit": "m", "scale": 12.0}, {"effort": {"field": "s", "unit": "N·m"}}, "rad", {}),
        ({"unit": "m", "scale": 12.0}, {"type": "revolute"}, "rad", {}),
        ({"unit": "V", "scale": 0.1}, {}, "rad", {}),
        ({"unit": "V", "scale": 0.1}, {"type": "prismatic"}, "rad", SLIDING),
    ],
)
def test_units_or_a_type_say_which_joints_slide(tmp_path, boom, more, swing, kinds):
    time = np.arange(3000) / 100.0
    table = np.stack([time, np.sin(3 * time), np.sin(time), np.cos(3 * time), np.cos(time)], axis=1)
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="t,b,s,bc,sc", comments="")
    joints = {
        "boom": {"position": {"field": "b"} | boom, "valve_command": "bc"} | more,
        "swing": {"position": {"field": "s"} | ({"unit": swing} if swing else {}), "valve_command": "sc"}
        | ({"effort": "s"} if "effort" in more else {}),
    }
    path = tmp_path / "map.yaml"
    path.write_text(
        yaml.safe_dump({"format": "hqpipe-log-map/1", "clock": {"field": "t", "unit": "s"}, "joints": joints})
    )
    import_logs(find_sources([tmp_path / "a.csv"]), read_map(path), path.read_text(), tmp_path / "logs")
    assert read_log_set(tmp_path / "logs").kinds == kinds
