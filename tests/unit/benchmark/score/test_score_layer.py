"""The gap of withheld cases in a layer: base model, windows, joints and scales of the case."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from hqpipe.benchmark.score import layer as blind_layer
from hqpipe.benchmark.score.layer import heldout_error, layer_gaps, layers_of, library_of, samples_scale
from hqpipe.benchmark.score.truth import Answer, TrueEffect, must_be_named, shown, true_shrink
from hqpipe.errors import IdentificationError, LogError
from hqpipe.gap.routing import Route
from hqpipe.identify.model import Effect, LayerJoints, Parameter, Samples

WINDOW_S = 0.2
MOTION = np.linspace(-1.0, 1.0, 200)


def samples(output: np.ndarray) -> Samples:
    half = len(output) // 2
    trial = np.repeat([0, 1], [half, len(output) - half])
    time = np.arange(len(output), dtype=float)
    return Samples(("a", "b"), trial, time, MOTION, MOTION, output, np.zeros(len(output)))


@dataclass
class Line:
    """A joint whose output is gain × motion + cube × motion³; the base model knows the gain alone."""

    joint: str
    gain: float
    cube: float
    heldout_too: bool = True
    unit: str = "N·m"
    dt: float = 0.01
    base: tuple = (Parameter("gain", "1", 1.0, np.inf, 0.0, 10.0),)
    effects: tuple = (
        Effect("hardening", (Parameter("cube", "1", 0.0, 1.0),)),
        Effect("shape", (Parameter("square", "1", 0.0, 1.0),), named=False, signal="position"),
    )
    noise: tuple = (0.0, 0.0)
    notes: tuple = ()
    fit: Samples = field(init=False)
    heldout: Samples = field(init=False)

    def __post_init__(self) -> None:
        output = self.gain * MOTION + self.cube * MOTION**3
        self.fit = samples(output)
        self.heldout = samples(output) if self.heldout_too else samples(output[:0])

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        gain, cube, square = values
        return gain * MOTION + cube * MOTION**3 + square * MOTION**2 - (self.heldout if heldout else self.fit).output


class ToyLayer:
    """Log sets are (list of joints) by folder."""

    NAME = "toy"
    sets: dict[Path, tuple[Line, ...]] = {}
    asked: list[tuple[Path, float | None]] = []

    def lacking(self, log_set: Path) -> list[str]:
        return [] if log_set in self.sets else ["q_des"]

    def joints(self, log_set: Path, window_s: float | None, without) -> LayerJoints:
        self.asked.append((log_set, window_s))
        if not self.sets[log_set]:
            raise IdentificationError("no joint can be judged")
        return LayerJoints("toy", "rmse", window_s or WINDOW_S, "", self.sets[log_set])


class OtherLayer(ToyLayer):
    NAME = "other"

    def lacking(self, log_set: Path) -> list[str]:
        return ["current"]


@pytest.fixture
def sets(monkeypatch) -> dict[Path, tuple[Line, ...]]:
    known: dict[Path, tuple[Line, ...]] = {}
    monkeypatch.setattr(ToyLayer, "sets", known)
    monkeypatch.setattr(ToyLayer, "asked", [])
    table = {"other": f"{__name__}:OtherLayer", "toy": f"{__name__}:ToyLayer"}
    monkeypatch.setattr(blind_layer, "LAYERS", table)
    monkeypatch.setattr(blind_layer, "load", lambda target: globals()[target.partition(":")[2]])
    monkeypatch.setattr(blind_layer, "read_log_set", lambda folder: folder)
    return known


def planted(layer: str = "toy", joints: tuple[str, ...] = ("elbow",)) -> TrueEffect:
    return TrueEffect("hardening", layer, joints, "joint", False, "typical", None, {})


def answer(machine: str, *effects: TrueEffect) -> Answer:
    return Answer("case_000", "single", effects, {"all": "truth"}, machine)


CASE, BARE = Path("case"), Path("truth")


def test_gap_is_what_the_base_model_cannot_follow(sets):
    sets[CASE] = (Line("shoulder", 2.0, 0.001), Line("elbow", 3.0, 0.5))
    sets[BARE] = (Line("shoulder", 2.0, 0.001), Line("elbow", 3.0, 0.001))
    gaps = layer_gaps({"with": CASE, "all": BARE}, ("toy",))
    # least squares of x³ on x over −1 … 1 leaves x³ − 0.6 x, of mean square 1/7 − 0.36/3
    left = (1.0 / 7.0 - 0.36 / 3.0) ** 0.5
    assert gaps["with"]["elbow"] == pytest.approx(0.5 * left, rel=0.05)
    assert gaps["all"]["elbow"] == pytest.approx(0.001 * left, rel=0.05)
    scale = {line.joint: samples_scale(line.fit) for line in sets[CASE]}
    pooled = np.mean([(gaps["with"][joint] / scale[joint]) ** 2 for joint in scale]) ** 0.5
    assert gaps["with"]["all"] == pytest.approx(pooled)
    assert true_shrink(gaps) == pytest.approx(1.0 - gaps["all"]["all"] / gaps["with"]["all"])
    effect = planted(joints=("shoulder", "elbow"))
    assert must_be_named(gaps, effect) and shown(gaps, effect) == {"elbow"}


def test_machines_without_effects_are_judged_in_the_windows_of_the_case(sets):
    sets[CASE] = sets[BARE] = (Line("elbow", 3.0, 0.5),)
    layer_gaps({"with": CASE, "all": BARE}, ("toy",))
    assert ToyLayer.asked == [(CASE, None), (BARE, WINDOW_S)]


def test_joints_that_one_set_cannot_judge_are_left_out_of_all(sets):
    sets[CASE] = (Line("shoulder", 2.0, 0.1), Line("elbow", 3.0, 0.5))
    sets[BARE] = (Line("elbow", 3.0, 0.1),)
    gaps = layer_gaps({"with": CASE, "all": BARE}, ("toy",))
    assert set(gaps["with"]) == set(gaps["all"]) == {"all", "elbow"}
    assert must_be_named(gaps, planted(joints=("shoulder",)))  # nothing is known of it
    sets[BARE] = (Line("elbow", 3.0, 0.1, heldout_too=False),)
    with pytest.raises(IdentificationError, match="no joint has held-out samples"):
        layer_gaps({"with": CASE, "all": BARE}, ("toy",))


def test_base_fit_leaves_effects_at_neutral(sets):
    assert heldout_error(Line("elbow", 3.0, 0.0)) == pytest.approx(0.0, abs=1e-9)
    assert heldout_error(Line("elbow", 3.0, 1.0)) == pytest.approx(1.0 / 7.0 - 0.36 / 3.0, rel=0.05)


def test_the_first_layer_that_the_logs_allow_counts(sets):
    sets[CASE] = (Line("elbow", 3.0, 0.5),)
    assert set(layer_gaps({"with": CASE}, ("other", "toy"))) == {"with"}
    with pytest.raises(LogError, match="layer other needs current"):
        layer_gaps({"with": CASE}, ("other",))


def test_layers_of_an_answer():
    assert layers_of(answer("quadruped", planted("actuator"))) == ()
    assert layers_of(answer("servo", planted("servo"))) == ("servo",)
    assert layers_of(answer("arm", planted("sensing"))) == ("joint_motion", "servo")
    assert layers_of(answer("arm", planted("servo"))) == ("servo", "joint_motion")
    assert layers_of(answer("cylinder")) == ("valve",)
    assert layers_of(answer("torque_cylinder", planted("torque"))) == ("torque",)
    assert layers_of(answer("crane")) == tuple(blind_layer.LAYERS)


def test_library_is_what_the_layers_ask_for_by_name(sets):
    sets[CASE] = (Line("shoulder", 2.0, 0.1), Line("elbow", 3.0, 0.5))
    assert library_of(CASE) == ("hardening",)
    sets[CASE] = ()
    assert library_of(CASE) == ()


@pytest.mark.parametrize("asked", [True, False])
def test_the_law_from_command_to_torque_is_asked_for_only_where_the_route_leads_to_it(sets, monkeypatch, asked):
    sets[CASE] = (Line("elbow", 3.0, 0.5),)
    monkeypatch.setattr(blind_layer, "LAYERS", {"actuator": blind_layer.LAYERS["toy"]})
    monkeypatch.setattr(blind_layer, "route", lambda log_set: Route(asked))
    assert library_of(CASE) == (("hardening",) if asked else ())
