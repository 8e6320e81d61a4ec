"""Withheld-effect cases: log sets to diagnose, and apart from them the answers."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hqpipe.errors import UsageError
from hqpipe.system import durable
from hqpipe.system.processes import in_processes

ROBOT = "hydraulic_quadruped"  # the cases are overrides of this machine
QUADRUPED, LEGGED = "quadruped", "legged"
FORMAT, ANSWERS = "hqpipe-blind/1", "answers.json"
TRUTH, HALF_MADE = "truth", ".half"
Progress = Callable[[float, float, str], None]


def make(
    count: int,
    seed: int,
    out: Path,
    workers: int,
    progress: Progress,
    kinds: Sequence[str] = (),
    machine: str = QUADRUPED,
) -> int:
    """Write `out/case_NNN`, `out/truth/case_NNN` and `out/answers.json`; complete cases are kept.

    Args:
        count: how many cases. seed: of everything. out: folder. workers: processes; the result does not depend on them.
        kinds: of `hqpipe.plant.cases`, or of `joint_cases` or `legged_cases` of `hqpipe.benchmark.cases`; none for the usual
            mixture.
        machine: "quadruped", "legged", or one of `hqpipe.benchmark.cases.joint_cases`.

    Returns:
        How many cases had to be made.

    Raises:
        UsageError: the folder holds other cases, or a kind does not exist.
    """
    planned, make_one = _plan(count, seed, kinds, machine)
    out.mkdir(parents=True, exist_ok=True)
    _write_answers(out, count, seed, kinds, planned, machine)
    shutil.rmtree(out / HALF_MADE, ignore_errors=True)
    missing = [case for case in planned if not (out / case.name).is_dir()]
    progress(count - len(missing), count, "")
    if missing:
        calls = {case.name: (case, out) for case in missing}
        in_processes(make_one, calls, workers, lambda done, name: progress(count - len(missing) + done, count, name))
    shutil.rmtree(out / HALF_MADE, ignore_errors=True)
    return len(missing)


def _plan(count: int, seed: int, kinds: Sequence[str], machine: str) -> tuple[Sequence[Any], Callable[..., None]]:
    """The cases, and what simulates one of them."""
    if machine == QUADRUPED:
        from hqpipe.plant.cases import cases

        return cases(count, seed, kinds), make_case
    if machine == LEGGED:
        from hqpipe.benchmark.cases.legged_cases import cases as legged_cases
        from hqpipe.stages.blind.legged import make_legged_case

        return legged_cases(count, seed, kinds), make_legged_case
    from hqpipe.benchmark.cases.joint_cases import cases as joint_cases
    from hqpipe.stages.blind.joints import make_joint_case

    return joint_cases(count, seed, machine, kinds), make_joint_case


def make_case(case: Any, out: Path) -> None:
    """Simulate one case and its machines without effects; nothing half-made is left under its name."""
    from hqpipe.robots import load_robot
    from hqpipe.stages.blind.machine import simulate

    robot, half = load_robot(ROBOT).folder, out / HALF_MADE / case.name
    gait = simulate(case, robot, half / "logs")
    for name, left_out in truth_sets(case).items():
        simulate(case, robot, half / TRUTH / name, left_out, gait)
    put_in_place(half, out, case.name)


def put_in_place(half: Path, out: Path, name: str) -> None:
    """Give a case that was simulated in `half` its name in `out`: truth sets first, as a case that has its name is complete."""
    truth = out / TRUTH / name
    if (half / TRUTH).is_dir():
        truth.parent.mkdir(parents=True, exist_ok=True)
        durable.move_into_place(half / TRUTH, truth)
    else:
        durable.remove(truth)
    durable.move_into_place(half / "logs", out / name)


def truth_sets(case: Any) -> dict[str, tuple[str, ...]]:
    """Folder name → effects left out: all of them; for mixtures each one, and all but each one."""
    names = tuple(planted.effect for planted in case.planted)
    if not names:
        return {}
    sets = {"all": names}
    if len(names) > 1:
        sets |= {f"without_{name}": (name,) for name in names}
    if len(names) > 2:  # of two, all but one is the other one left out
        sets |= {f"only_{name}": tuple(other for other in names if other != name) for name in names}
    return sets


def truth_folders(case: Any) -> dict[str, Any]:
    """What answers.json says of `truth_sets`: folders with all, one or all but one of the effects left out."""
    base, names = f"{TRUTH}/{case.name}", [planted.effect for planted in case.planted]
    if len(names) < 2:
        return {"all": f"{base}/all" if names else None, "without": {}, "only": {}}
    without = {name: f"{base}/without_{name}" for name in names}
    only = {name: f"{base}/only_{name}" for name in names}
    if len(names) == 2:
        only = {names[0]: without[names[1]], names[1]: without[names[0]]}
    return {"all": f"{base}/all", "without": without, "only": only}


def answer(case: Any) -> dict[str, Any]:
    """What is wrong in a case, JSON-able."""
    return {
        "case": case.name,
        "kind": case.kind,
        "excitation": case.excitation,
        "effort_source": case.effort_source,
        "pressures": case.pressures,
        "seed": case.seed,
        "effects": [
            {
                "effect": p.effect,
                "layer": p.layer,
                "outside": p.outside,
                "joints": list(p.joints),
                "scope": p.scope,
                "size": p.size,
                "span": list(p.span) if p.span else None,
                "parameters": p.parameters,
                **({} if p.factor is None else {"factor": p.factor}),
            }
            for p in case.planted
        ],
        "truth": truth_folders(case),
    }


def _write_answers(
    out: Path, count: int, seed: int, kinds: Sequence[str], planned: Sequence[Any], machine: str
) -> None:
    from hqpipe.stages.blind.joints import joint_answer
    from hqpipe.stages.blind.legged import legged_answer

    asked: dict[str, Any] = {"kinds": sorted(set(kinds))} if kinds else {}
    if machine != QUADRUPED:
        asked["machine"] = machine
    written = {QUADRUPED: answer, LEGGED: legged_answer}.get(machine, joint_answer)
    answers = [written(case) for case in planned]
    content = {"format": FORMAT, "cases": count, "seed": seed, **asked, "answers": answers}
    text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
    path = out / ANSWERS
    if path.is_file() and path.read_text(encoding="utf-8") != text:
        asked_for = "".join(f" --kind {kind}" for kind in sorted(set(kinds)))
        asked_for += "" if machine == QUADRUPED else f" --machine {machine}"
        message = f"{path} belongs to other cases than --cases {count} --seed {seed}{asked_for} of this version"
        raise UsageError(message, file=path, field="--out", fix="give another --out, or remove the folder")
    durable.write_file(path, text)
