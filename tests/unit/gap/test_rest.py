"""What is kept of a machine when some of its joints get another model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hqpipe.gap import rest as module
from hqpipe.gap.rest import Rest
from hqpipe.gap.row_model import RowModel, SpanRow


@pytest.fixture
def asked(monkeypatch):
    """Joints that the reference model was fitted to, in order."""
    joints = []
    monkeypatch.setattr(module, "replay_all", lambda machine, trials, steps: [])
    monkeypatch.setattr(module, "explain", lambda fit, heldout, j, pole: joints.append(j))
    monkeypatch.setattr(RowModel, "memory", np.zeros(3))
    return joints


class Logs:
    fit = heldout = ()


def explained(machine, other, asked):
    """Joints that have to be explained again under another model."""
    rest = Rest(machine, Logs(), 100)
    for j in range(3):
        rest.explained(j)
    asked.clear()
    later = rest.of(other)
    for j in range(3):
        later.explained(j)
    return asked


@pytest.mark.parametrize("mode", ["position", "torque"])
def test_joints_with_the_same_model_are_not_explained_again(asked, mode):
    machine = RowModel(("a", "b", "c"), np.full((3, 4), np.nan), mode, "logged")
    rows = machine.rows.copy()
    rows[1, 2] = 1.0
    assert explained(machine, replace(machine, rows=rows), asked) == [1]


def test_a_joint_with_a_stretch_of_its_own_is_explained_again(asked):
    machine = RowModel(("a", "b", "c"), np.zeros((3, 4)), "position", "logged")
    other = replace(machine, spans={2: SpanRow(np.zeros(4), {"t.parquet": (1.0, 2.0)})})
    assert explained(machine, other, asked) == [2]
    assert explained(other, machine, asked) == [2]
