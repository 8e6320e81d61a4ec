"""PlantConfig: who gets which number, and what is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from damage import checked, field_damages

from hqpipe.errors import ConfigError
from hqpipe.plant.config import PlantConfig, check_base, select_joints
from hqpipe.plant.parameters import build_schedule
from hqpipe.plant.plant import Plant
from hqpipe.plant.schema import BY_PATH, FIELDS


def overlap(robot, overrides, span: int = 0) -> np.ndarray:
    return build_schedule(robot, PlantConfig(overrides))[span].joint["valve_overlap"]


def test_the_narrower_setting_wins(robot):
    values = overlap(
        robot,
        {
            "joints": {
                "LFK": {"valve": {"overlap": 0.04}},
                "LF": {"valve": {"overlap": 0.03}},
                "knee": {"valve": {"overlap": 0.02}},
            },
            "valve": {"overlap": 0.01},
        },
    )
    expected = np.full(12, 0.01)
    expected[[2, 5, 8, 11]] = 0.02
    expected[:3] = 0.03
    expected[2] = 0.04
    np.testing.assert_array_equal(values, expected)


def test_spans_switch_on_and_off(robot):
    raw = {"spans": [{"time": [1.0, 2.0], "joints": ["LFK", "RF"], "valve": {"overlap": 0.05}}]}
    schedule = build_schedule(robot, PlantConfig(raw))
    assert [entry.start for entry in schedule] == [-np.inf, 1.0, 2.0]
    assert overlap(robot, raw, 0).max() == 0.0
    np.testing.assert_array_equal(np.flatnonzero(overlap(robot, raw, 1)), [2, 3, 4, 5])
    assert overlap(robot, raw, 2).max() == 0.0


def test_a_span_takes_effect_in_the_running_plant_without_a_pressure_jump(robot):
    raw = {"spans": [{"time": [0.2, 0.4], "fluid": {"bulk_modulus": 0.3e9}, "cylinder": {"dead_volume_a": 2.0e-4}}]}
    plant = Plant(robot, PlantConfig(raw), base="fixed")
    trial = plant.run(lambda frame, command: robot.nominal_position, 0.5)
    for name in ("pressure_a", "pressure_b"):
        assert np.abs(np.diff(trial.truth[f"joint/LFK/{name}"])).max() < 2.0e4
    assert plant.parameters.joint["fluid_bulk_modulus"][0] == 0.7e9


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"valve": {"overlapp": 0.1}}, "unknown field 'valve.overlapp' – did you mean 'valve.overlap'"),
        ({"valvee": {}}, "unknown field 'valvee' – did you mean 'valve'"),
        ({"valve": {"overlap": 2.0}}, "plant.valve.overlap: expected 0 to 0.9 opening, got 2"),
        ({"valve": {"overlap": "0.1"}}, "expected a number in opening, got '0.1'"),
        ({"valve": {"overlap": float("nan")}}, "expected 0 to 0.9 opening, got nan"),
        ({"valve": {"overlap": 10**400}}, "expected 0 to 0.9 opening, got 1000"),
        ({"cylinder": {"viscous_friction": 1e300}}, r"expected 0 to 1e\+07 N·s/m"),
        ({"spans": 3}, "plant.spans: expected a list, got 3"),
        ({"spans": [{"time": ["a", 1.0]}]}, r"plant.spans\[0\].time: expected \[start, stop\]"),
        ({"spans": [{"time": [0.0, float("inf")]}]}, r"plant.spans\[0\].time: expected \[start, stop\]"),
        ({"spans": [{"time": [0.0, 1.0], "joints": {"a": 1}}]}, "expected the name of a joint"),
        ({"joints": {1: {}}}, "expected the name of a joint, got 1"),
        ({"joints": 1}, "plant.joints: expected a mapping"),
        ({"body": {"payloads": {"link": "trunk"}}}, "plant.body.payloads: expected a list"),
        ({"body": {"payloads": [{"link": "trunk", "mass": -5.0}]}}, "mass: expected 0 to 10000, got -5"),
        ({"body": {"links": {"trunk": {"mass_scale": 0.0}}}}, "mass_scale: expected 0.01 to 100, got 0"),
        ({"body": {"ground": {"friction": float("nan")}}}, "friction: expected 0 to 10, got nan"),
        ({"body": {"ground": {"roughness_seed": 0.5}}}, "expected a whole number, got 0.5"),
        ({"valve": {"overlap": True}}, "expected a number"),
        ({"joints": {"LFX": {}}}, "no joint 'LFX' – did you mean"),
        ({"joints": {"LFK": {"supply": {"pump_flow": 1e-3}}}}, "belongs to the whole machine"),
        ({"spans": [{"time": [2.0, 1.0]}]}, r"plant.spans\[0\].time: expected \[start, stop\]"),
        ({"spans": [{"time": [0.0, 1.0], "body": {}}]}, "unknown field 'body'"),
        ({"chain": {"mass": 0.2}}, "joint LFR: too stiff for substeps of 5e-05 s: chain"),
        ({"joints": {"RFP": {"cylinder": {"dead_volume_b": 1.0e-7}}}}, "expected 1e-06"),
        ({"joints": {"RFP": {"cylinder": {"piston_mass": 0.2}}}}, "joint RFP: too stiff .* piston"),
        ({"effort_source": "loadcell"}, "did you mean 'load_cell'"),
        ({"body": {"ground": {"frictoin": 0.2}}}, "did you mean 'friction'"),
        (
            {"body": {"ground": {"friction": "low"}}},
            "plant.body.ground.friction: expected a number, got 'low'",
        ),
        ({"body": {"payloads": [{"link": "trunc", "mass": 5.0}]}}, "no link 'trunc' – did you mean 'trunk'"),
        ({"body": {"payloads": [{"mass": 5.0}]}}, "missing field 'link'"),
        ({"body": {"links": {"LF_shank": {"com_offset": [0.1, 0.0]}}}}, "expected three numbers"),
    ],
)
def test_mistakes_are_named_with_the_near_match(robot, overrides, message):
    with pytest.raises(ConfigError, match=message) as caught:
        Plant(robot, PlantConfig(overrides))
    assert caught.value.fix and caught.value.field


def test_a_number_missing_from_robot_yaml_is_named(robot):
    hydraulics = {**robot.hydraulics, "chain": {"stiffness": 1.0e7}}
    broken = dataclasses.replace(robot, hydraulics=hydraulics)
    with pytest.raises(ConfigError, match=r"robot.yaml: hydraulics: missing field 'chain.damping' \(N·s/m"):
        build_schedule(broken, PlantConfig())


def test_every_wrong_number_of_robot_yaml_is_refused(robot):
    passed = set()
    for name, damaged in field_damages(robot.hydraulics):
        try:
            check_base(damaged, robot)
        except ConfigError as error:
            assert checked(error, robot.folder / "robot.yaml").field.startswith("hydraulics")
        else:
            passed.add(name)
    # What may be nothing: losses, noises, gains; what may be any temperature below 200 °C.
    allowed = {f"{field.path} = '0'" for field in FIELDS if field.lower <= 0.0} | {"fluid.temperature = '-1'"}
    assert passed <= allowed, passed - allowed


def test_merged_keeps_both(robot):
    first = PlantConfig({"valve": {"overlap": 0.02}, "spans": [{"time": [0.0, 1.0], "valve": {"delay": 0.01}}]})
    second = PlantConfig({"valve": {"stiction": 0.01}, "spans": [{"time": [1.0, 2.0], "valve": {"delay": 0.02}}]})
    both = first.merged(second)
    assert both.overrides["valve"] == {"overlap": 0.02, "stiction": 0.01}
    assert [entry.joint["valve_delay"][0] for entry in build_schedule(robot, both)] == [
        5e-4,
        0.01,
        0.02,
        5e-4,
    ]


def test_merged_replaces_vectors(robot):
    first = PlantConfig({"body": {"links": {"LF_shank": {"com_offset": [0.1, 0.0, 0.0]}}}})
    second = PlantConfig({"body": {"links": {"LF_shank": {"com_offset": [0.0, 0.2, 0.0]}}}})
    assert first.merged(second).body_changes().links["LF_shank"].com_offset == (0.0, 0.2, 0.0)


def test_yaml_file(robot, tmp_path):
    (tmp_path / "plant.yaml").write_text("effort_source: load_cell\njoints: {LFK: {chain: {slack: 0.002}}}\n")
    config = PlantConfig.from_yaml(tmp_path / "plant.yaml")
    assert config.effort_source == "load_cell"
    assert build_schedule(robot, config)[0].joint["chain_slack"][2] == 0.002
    (tmp_path / "list.yaml").write_text("- 1\n")
    with pytest.raises(ConfigError, match="list.yaml: expected a mapping"):
        PlantConfig.from_yaml(tmp_path / "list.yaml")


def test_selectors(robot):
    assert select_joints("all", robot) == tuple(range(12))
    assert select_joints("RH", robot) == (9, 10, 11)
    assert select_joints("roll", robot) == (0, 3, 6, 9)
    assert select_joints(["LFK", "LF"], robot) == (0, 1, 2)


def test_every_field_has_unit_meaning_and_a_default_in_range():
    assert len(BY_PATH) == len(FIELDS)
    for field in FIELDS:
        assert field.unit and field.meaning
        assert field.default is None or field.lower <= field.default <= field.upper
