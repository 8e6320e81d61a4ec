"""compare: every controller with the same budget, finished ones kept when it is killed, and what the table adds up."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from compare_parent import TRAINING
from pydantic import ValidationError

from hqpipe.actuators.files import save_actuator
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.mlp import MLP
from hqpipe.actuators.posterior import Group, Posterior
from hqpipe.actuators.posterior_file import save_posterior
from hqpipe.errors import DivergedError, UsageError
from hqpipe.pipeline.tasks import Tasks
from hqpipe.rl import train as training
from hqpipe.robots import load_robot, robot_folder
from hqpipe.stages import STAGES, compare
from hqpipe.stages.compare import Params, run
from hqpipe.stages.comparison.controllers import TITLES, read_controllers
from hqpipe.stages.comparison.results import MEASURES, loop_closed, pooled
from hqpipe.stages.walks import scenarios

GAP = {"layer": "actuator", "metric": "free_run_rmse", "unit": "N·m", "window_s": 0.1, "before": 30.0, "after": 3.0}
GAP |= {"noise_floor": 1.0, "persistence": 100.0, "shrink": 0.93, "shrink_ci95": [0.9, 0.95]}


class Killed(Exception):
    pass


def hydraulic(k2: float = 0.06) -> Hydraulic:
    robot = load_robot("hydraulic_quadruped")
    columns = {"k1": 1.0e5, "k2": k2, "k3": 3.8e3, "k4": 20.0}
    return Hydraulic.build(robot.joints, dt=1e-3, sprocket_radius=0.06, effort_limit=1000.0, **columns)


def limp_net() -> MLP:
    """Without any torque, and so without a stiffness that a gait prior could compensate."""
    joints = load_robot("hydraulic_quadruped").joints
    tensors = {name: np.zeros(shape) for name, shape in MLP.shapes(len(joints), 2).items()}
    tensors |= {name: np.ones_like(tensors[name]) for name in ("input_spread", "output_spread")}
    return MLP.build(joints, dt=1e-3, tensors=tensors, effort_limit=1000.0)


@pytest.fixture
def models(tmp_path) -> Path:
    """The folders that compare reads: actuator with its nets, and a diagnosis."""
    save_actuator(hydraulic(), tmp_path / "actuator")
    save_actuator(limp_net(), tmp_path / "actuator" / "rivals" / "strong_mlp")
    save_actuator(hydraulic(k2=0.05), tmp_path / "diagnosis")
    content = {"gap": GAP, "verdict": "explained"}
    (tmp_path / "diagnosis" / "diagnosis.json").write_text(json.dumps(content), encoding="utf-8")
    return tmp_path


def context(models: Path, output: Path, *, diagnosis: bool = True, **params) -> SimpleNamespace:
    output.mkdir(parents=True, exist_ok=True)
    chosen = {"training": TRAINING, "scenarios": ["forward_10"], "walk_seeds": 2, **params}
    names = ("actuator", "diagnosis") if diagnosis else ("actuator",)
    return SimpleNamespace(
        params=Params(**chosen),
        inputs={name: models / name for name in names},
        output=output,
        scratch=models / "scratch",
        tasks=Tasks(models / "tasks", {"stage": "compare"}),
        robot=robot_folder("hydraulic_quadruped"),
        seed=3,
        workers=1,
        progress=lambda done, total, note: None,
    )


@pytest.fixture
def walked(monkeypatch) -> list[Path]:
    """The plant is replaced by a table: the policies that walked are written down, and torque control falls."""
    seen = []

    def run_scenarios(policy, robot, names, seeds, first_seed, plant, workers, progress, *, seconds=None):
        seen.append(policy)
        torque = json.loads((policy / "policy.json").read_text(encoding="utf-8"))["control_mode"] == "torque"
        rows = [
            {"seed": first_seed + i, "fell": torque, **dict.fromkeys(MEASURES, 0.1 * (i + 1)), "torque_rmse": None}
            | {"estimate_tilt": 0.2}
            for i in range(seeds)
        ]
        mean = {"drift": 0.15, "estimate_tilt": 0.2}
        head = {"walks": seeds, "falls": seeds * torque, "mean": mean, "worst": mean}
        return [{"scenario": name, **head, "seeds": rows} for name in names]

    monkeypatch.setattr(scenarios, "run_scenarios", run_scenarios)
    return seen


def test_every_controller_has_its_policy_its_curve_and_its_walks(models, walked, tmp_path, capsys):
    names = ["torque", "stiff_pd", "fitted", "diagnosed", "oracle", "mlp"]
    metrics = run(context(models, tmp_path / "out", controllers=names))
    report = json.loads((tmp_path / "out" / "comparison.json").read_text(encoding="utf-8"))
    assert [each["controller"] for each in report["controllers"]] == names
    assert [each["control_mode"] for each in report["controllers"]] == ["torque"] + 5 * ["position"]
    for each in report["controllers"]:
        folder = tmp_path / "out" / each["trainings"][0]["folder"]
        assert folder.name == "seed_3" and (folder / "policy.safetensors").is_file()
        assert len((folder / "metrics.csv").read_text(encoding="utf-8").splitlines()) == 3
        assert each["plant"]["policy"]["walks"] == each["plant"]["zero_action"]["walks"] == 2
    assert report["controllers"][0]["plant"]["policy"]["falls"] == 2
    for trial in report["trials"]:
        told = [trial["mean"], trial["worst"], *trial["seeds"]]
        assert ["estimate_tilt" in each for each in told] == 4 * [trial["actor"] == "policy"]
    assert len(walked) == 12 and len(set(walked)) == 12
    assert list(report["model_check"]["rmse"]) == names[1:]
    effects = {each["controller"]: each["effects"] for each in report["controllers"]}
    assert "valve_lag" in effects["oracle"] and effects["fitted"] == []
    for each in report["controllers"]:
        assert each["over_seeds"]["drift"] is None or each["over_seeds"]["drift"]["ci95"] is None
        assert (each["against_stiff_pd"] is None) == (each["controller"] == "stiff_pd")
    assert report["loop"]["gap"]["before"] == 30.0
    speed = metrics["speeds"]["fitted/seed_3"]
    assert speed["training_s"] > 0.0 and speed["step_s"] == 1.0 / speed["steps_per_second"]
    assert "steps_per_second" not in json.dumps(report)
    for name in ("learning_curves.png", "plant.png", "comparison.csv"):
        assert (tmp_path / "out" / name).stat().st_size > 300
    said = " ".join(capsys.readouterr().err.split())
    assert "30 N·m → 3 N·m over a floor of 1 N·m" in said and "from stiff_pd to diagnosed on the plant" in said


def test_a_net_is_trained_under_the_gait_prior_of_the_fitted_model(models, tmp_path):
    found, _ = read_controllers(context(models, tmp_path / "out"), ["fitted", "mlp"], "strong")
    fitted, net = found
    assert fitted.stiffness is None
    np.testing.assert_allclose(net.stiffness, 1.0e5 * 0.06**2 / 0.06)


def test_each_fitted_model_brings_the_posterior_beside_it(models, tmp_path):
    spread, upper = np.diag([1e3, 1e-3, 1e2, 1.0]) ** 2, np.array([np.inf, 1.0, np.inf, np.inf])
    for folder, k2 in (("actuator", 0.06), ("diagnosis", 0.05)):
        model = hydraulic(k2)
        mean = model.parameters[0, :4]
        groups = tuple(Group((joint,), mean, spread, None, 2, np.zeros(4), upper) for joint in model.joints)
        save_posterior(Posterior("hydraulic", ("k1", "k2", "k3", "k4"), groups), model, models / folder)
    found, _ = read_controllers(context(models, tmp_path / "out"), ["stiff_pd", "fitted", "diagnosed"], "strong")
    means = [each.posterior and each.posterior.groups[0].mean[1] for each in found]
    assert means == [None, 0.06, 0.05]
    reads = {given.name: given.files for given in STAGES["compare"].inputs}
    assert "posterior.json" in reads["diagnosis"]


def test_what_has_no_model_is_left_out_or_refused_before_a_training(models, tmp_path, monkeypatch, capsys):
    found, left_out = read_controllers(
        context(models, tmp_path / "a", diagnosis=False), ["fitted", "diagnosed"], "strong"
    )
    assert [each.name for each in found] == ["fitted"]
    assert left_out == [
        "position PID, diagnosed model: left out: no diagnosis is read: run hqpipe diagnose first, or name one with "
        "--diagnosis DIR"
    ]
    with pytest.raises(
        UsageError, match="rivals/mlp: no such actuator model: run hqpipe fit-actuator with 'mlp' among"
    ):
        run(context(models, tmp_path / "b", nets="paper"))
    assert not (models / "scratch").exists() and not (models / "tasks").exists()


def test_names_are_checked(tmp_path):
    with pytest.raises(ValidationError, match="unknown controller 'diagnosd' – did you mean 'diagnosed'"):
        Params(controllers=["diagnosd"])
    with pytest.raises(ValidationError, match="each once"):
        Params(controllers=["fitted", "fitted"])
    with pytest.raises(ValidationError, match="no scenario 'forward_11' – did you mean"):
        Params(scenarios=["forward_11"])
    assert Params(controllers=["gru", "torque"]).controllers == ["torque", "gru"]
    assert Params().controllers == list(TITLES)


def test_a_killed_compare_goes_on_where_it_was(models, walked, tmp_path, monkeypatch):
    names = ["torque", "stiff_pd"]
    whole = context(models, tmp_path / "whole", controllers=names)
    whole.tasks = Tasks(models / "other_tasks", {})
    run(whole)
    first = context(models, tmp_path / "first", controllers=names)

    def kill_in_the_second_training(done: float, total: float, note: str) -> None:
        if note.startswith(TITLES["stiff_pd"]):
            raise Killed

    first.progress = kill_in_the_second_training
    with pytest.raises(Killed):
        run(first)
    begun = []
    monkeypatch.setattr(training, "Trainer", counted(training.Trainer, begun))
    metrics = run(context(models, tmp_path / "second", controllers=names))
    assert len(begun) == 1 and begun[0].spec.control_mode == "position"
    assert metrics["speeds"]["stiff_pd/seed_3"]["resumed_from"] == 1
    files = sorted(path.relative_to(tmp_path / "whole") for path in (tmp_path / "whole").rglob("*") if path.is_file())
    for file in files:
        assert (tmp_path / "second" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes(), file
    assert not list((tmp_path / "second").rglob("report.json"))


def test_damaged_partial_results_are_made_again(models, walked, tmp_path, monkeypatch, capsys):
    run(context(models, tmp_path / "whole", controllers=["torque"]))
    (trained,) = (models / "tasks").glob("*/files/policy.safetensors")
    walked_files = (models / "tasks").glob("*/files/result.json")
    (prior,) = [path for path in walked_files if "estimate_tilt" not in path.read_text(encoding="utf-8")]
    for path in (trained, prior):
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    begun = []
    monkeypatch.setattr(training, "Trainer", counted(training.Trainer, begun))
    walked.clear()
    run(context(models, tmp_path / "again", controllers=["torque"]))
    err = capsys.readouterr().err
    assert (
        all(f"warning: {path.parent} is damaged" in err for path in (trained, prior)) and err.count("is damaged") == 2
    )
    assert len(begun) == 1 and len(walked) == 1
    for path in (tmp_path / "whole").rglob("*.json"):
        assert (tmp_path / "again" / path.relative_to(tmp_path / "whole")).read_bytes() == path.read_bytes()


def test_what_another_run_trained_and_walked_is_used_again(models, walked, tmp_path, monkeypatch):
    run(context(models, tmp_path / "first", controllers=["torque", "fitted"]))
    begun = []
    monkeypatch.setattr(training, "Trainer", counted(training.Trainer, begun))
    walked.clear()
    more = context(models, tmp_path / "more", controllers=["fitted", "stiff_pd"], seeds=2)
    more.params = more.params.model_copy(update={"scenarios": ["forward_10", "turn_05"]})
    run(more)
    assert sorted((each.task.world.actuator.NAME, each.config.seed) for each in begun) == [
        ("hydraulic", 4),
        ("stiff_pd", 3),
        ("stiff_pd", 4),
    ]
    assert len(walked) == 6  # the fitted policy and its prior walk the new scenario alone, as one call
    for name in ("policy.safetensors", "metrics.csv"):
        files = [tmp_path / run_ / "fitted" / "seed_3" / name for run_ in ("first", "more")]
        assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize("changed", ["actuator", "training", "plant"])
def test_a_task_is_done_again_when_what_decides_it_changes(models, walked, tmp_path, monkeypatch, changed):
    run(context(models, tmp_path / "first", controllers=["fitted"]))
    begun, params = [], {}
    monkeypatch.setattr(training, "Trainer", counted(training.Trainer, begun))
    walked.clear()
    if changed == "actuator":
        save_actuator(hydraulic(k2=0.07), models / "actuator")
    elif changed == "training":
        params["training"] = {**TRAINING, "episode_s": 0.3}
    else:
        params["plant"] = {"valve": {"overlap": 0.02}}
    run(context(models, tmp_path / "second", controllers=["fitted"], **params))
    assert len(begun) == (changed != "plant") and len(walked) == 2


def counted(trainer: type, begun: list) -> type:
    class Counted(trainer):
        def __init__(self, *arguments, **options) -> None:
            super().__init__(*arguments, **options)
            begun.append(self)

    return Counted


def test_seeds_are_trained_apart_and_their_prior_walks_once(models, walked, tmp_path):
    run(context(models, tmp_path / "out", controllers=["stiff_pd"], seeds=2))
    report = json.loads((tmp_path / "out" / "comparison.json").read_text(encoding="utf-8"))
    first, second = report["controllers"][0]["trainings"]
    assert (first["seed"], second["seed"]) == (3, 4) and first["reward"] != second["reward"]
    spread = report["controllers"][0]["over_seeds"]["reward"]
    assert spread["seeds"] == 2 and spread["ci95"][0] < min(first["reward"], second["reward"])
    assert [(trial["actor"], trial["training_seed"]) for trial in report["trials"]] == [
        ("policy", 3),
        ("policy", 4),
        ("zero_action", None),
    ]


def test_a_training_that_diverges_is_a_row_and_not_the_end(models, walked, tmp_path, monkeypatch, capsys):
    def diverge(*_, control_mode: str, **__):
        error = DivergedError("the training diverged: a gradient is not finite")
        error.rows = [{"time/total_timesteps": 40, "rollout/reward_mean": -1.0}]
        raise error

    monkeypatch.setattr(training, "train", diverge)
    metrics = run(context(models, tmp_path / "out", controllers=["torque"]))
    assert metrics["headline"] == "falls on the plant, of 0: torque diverged"
    report = json.loads((tmp_path / "out" / "comparison.json").read_text(encoding="utf-8"))
    assert report["controllers"][0]["trainings"][0]["reward"] == -1.0 and report["trials"] == []
    assert not (tmp_path / "out" / "plant.png").exists() and not walked
    assert "after 1 iterations: the training diverged" in " ".join(capsys.readouterr().err.split())


def row(controller: str, seed: int, fell: bool, value: float) -> dict:
    head = {"scenario": "forward_10", "training_seed": 1, "actor": "policy", "walk_seed": seed}
    return {**head, "controller": controller, "fell": fell, **dict.fromkeys(MEASURES, value), "torque_rmse": None}


def test_means_are_of_the_walks_that_did_not_fall():
    found = pooled([row("fitted", 1, False, 2.0), row("fitted", 2, True, 9.0)])
    assert (found["walks"], found["falls"], found["drift"], found["torque_rmse"]) == (2, 1, 2.0, None)
    assert pooled([row("fitted", 1, True, 9.0)])["drift"] is None


def test_the_loop_pairs_walks_that_neither_fell_in(tmp_path):
    rows = [row("stiff_pd", 1, False, 4.0), row("stiff_pd", 2, False, 9.0), row("stiff_pd", 3, True, 9.0)]
    rows += [row("fitted", 1, False, 1.0), row("fitted", 2, True, 7.0), row("fitted", 3, False, 7.0)]
    loop = loop_closed(rows, None)
    assert loop["gap"] is None and list(loop["controllers"]) == ["fitted"]
    found = loop["controllers"]["fitted"]
    assert (found["falls"], found["walks"], found["pairs"]) == ([1, 1], 3, 1)
    assert found["measures"]["drift"] == [4.0, 1.0] and found["measures"]["torque_rmse"] is None


def test_it_runs_by_its_own_name_only():
    assert STAGES["compare"].alone and STAGES["compare"] not in STAGES.between(None, None)
    assert compare.FORMAT == "hqpipe-comparison/2"
