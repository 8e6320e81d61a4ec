"""Dead channels are found; a joint that sticks is not taken for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, plant_logs, values

from hqpipe.gap.checks.sanity_dead import dead_defects
from hqpipe.logs.differentiate import differentiate

LFK = 2


@pytest.mark.parametrize("channel", ["position", "velocity", "effort"])
@pytest.mark.parametrize("part", [(0.0, 1.0), (0.3, 0.7)], ids=["always", "for a while"])
def test_dead_channel(channel, part):
    def freeze(v):
        v = v.copy()
        start, stop = (int(share * len(v)) for share in part)
        v[start:stop] = v[start]
        return v

    found = dead_defects(broken(plant_logs(), values(channel, freeze, LFK), [1]), set())
    assert ("constant", channel, ("LFK",), ("t1.parquet",)) in [(d.kind, d.channel, d.joints, d.trials) for d in found]


def test_a_joint_that_sticks_while_its_speed_shows_a_count_or_two_is_not_dead():
    """As a servo does whose friction holds it against its command: the speed rests at one count instead of none."""

    def stuck(t):
        position, velocity, still = t.position.copy(), t.velocity.copy(), slice(t.samples // 3, 2 * t.samples // 3)
        count = velocity[:, LFK].std() / 40.0
        velocity[:, LFK] = np.round(velocity[:, LFK] / count) * count
        position[still, LFK], velocity[still, LFK] = position[still, LFK][0], 2.0 * count
        return replace(t, position=position, velocity=velocity)

    found = dead_defects(broken(plant_logs(), stuck), set())
    assert "constant" not in {d.kind for d in found if d.channel == "position"}, [d.message for d in found]


def without_speed(t):
    return replace(t, velocity=differentiate(t.position, t.dt), velocity_source="differentiated")


def resting(offset, toggles):
    """The joint sticks for a third of the trial, and the sensor of its speed reads an offset and toggles by a count."""
    rng = np.random.default_rng(0)

    def change(t):
        position, velocity, still = t.position.copy(), t.velocity.copy(), slice(t.samples // 3, 2 * t.samples // 3)
        count = velocity[:, LFK].std() / 20.0
        position[still, LFK] = position[still, LFK][0]
        rest = count * (offset + (rng.random(t.samples) < toggles))
        velocity[still, LFK] = rest[still]
        return replace(t, position=position, velocity=velocity)

    return change


@pytest.mark.parametrize(("offset", "toggles"), [(6.0, 0.0), (0.5, 0.02), (6.0, 0.3)])
def test_what_the_speed_reads_at_rest_is_no_motion(offset, toggles):
    found = dead_defects(broken(plant_logs(), resting(offset, toggles)), set())
    assert [d for d in found if d.channel == "position"] == []


@pytest.mark.parametrize("part", [(0.0, 1.0), (0.3, 0.7)], ids=["always", "for a while"])
def test_a_command_alone_is_no_proof_that_the_joint_moved(part):
    def stuck(t):
        position = t.position.copy()
        start, stop = (int(share * t.samples) for share in part)
        position[start:stop, LFK] = position[start, LFK]
        return without_speed(replace(t, position=position))

    (found,) = dead_defects(broken(plant_logs(), stuck, [1]), set())
    assert (found.kind, found.channel, found.joints, found.trials) == (
        "constant",
        "position",
        ("LFK",),
        ("t1.parquet",),
    )
    assert not found.fatal and "sticks or is held" in found.reason and "log the speed" in found.fix
