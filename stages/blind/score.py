"""Diagnose withheld-effect cases, then open the answers and score."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

from hqpipe.errors import UsageError, near_match
from hqpipe.system import durable
from hqpipe.system.failures import system_failure
from hqpipe.system.processes import in_processes

DIAGNOSIS, ORACLE, FAILED, CONTENT = "diagnosis", "oracle", "failed.json", "diagnosis.json"
GAPS, LIBRARY = "true_gaps.json", "library.json"
SCORE, PAGE = "score.json", "score.html"
Progress = Callable[[float, float, str], None]


def score_folder(folder: Path, without: Sequence[str], workers: int, progress: Progress) -> dict[str, Any]:
    """Diagnose the cases that lack a diagnosis, score all, write score.json and score.html.

    Args:
        folder: of `hqpipe blind make`. without: effects left out of the library; only the cases that have one of them
            are diagnosed and scored, and no faint ones. workers: processes.

    Raises:
        LogError, UsageError: not such a folder, or no case has the effects.
    """
    from hqpipe.benchmark.score.all_cases import ORACLE_KINDS, score
    from hqpipe.benchmark.score.limit import KIND as FAINT
    from hqpipe.benchmark.score.truth import CHANGE, read_answers
    from hqpipe.report.blind_page import write_page

    answers = read_answers(folder)
    if without:
        _check_names(without, answers)
        answers = [answer for answer in answers if answer.names & set(without) and answer.kind != FAINT]
    _check_made(folder, answers)
    results = folder / "_".join([DIAGNOSIS, *(["without", *sorted(without)] if without else [])])
    diagnose_all([_job(folder, a, results, tuple(without)) for a in answers], workers, progress)
    libraries = _libraries(folder, answers, workers, progress)
    known = {a.case: all_but(a.names, libraries[a.case]) for a in answers if a.kind in ORACLE_KINDS}
    asked = [_job(folder, a, folder / ORACLE, known[a.case]) for a in answers if a.case in known]
    diagnose_all(asked, workers, progress, "diagnosed by the oracle")
    gaps = _gaps(folder, [a for a in answers if a.kind != CHANGE], workers, progress)

    def judged(answer: Any, place: Path, left_out: tuple[str, ...]) -> Any:
        return _judged(answer, place, gaps.get(answer.case), left_out, libraries[answer.case])

    result = score(
        [judged(answer, results, tuple(without)) for answer in answers],
        [judged(answer, folder / ORACLE, known[answer.case]) for answer in answers if answer.case in known],
    )
    result |= {"without": sorted(without), "folder": folder.name}
    suffix = "".join(f"_without_{name}" for name in sorted(without))
    _write(folder / SCORE.replace(".json", f"{suffix}.json"), result)
    write_page(folder / PAGE.replace(".html", f"{suffix}.html"), result)
    return result


def _check_made(folder: Path, answers: Sequence[Any]) -> None:
    needed = [place for a in answers for place in (a.case, a.reference) if place is not None]
    if incomplete := [place for place in needed if not (folder / place).is_dir()]:
        text = f"{folder}: {len(incomplete)} cases are not made, the first is {incomplete[0]}"
        fix = "run the same hqpipe blind make again, it goes on from there"
        raise UsageError(text, file=folder / incomplete[0], fix=fix)


def _job(folder: Path, answer: Any, results: Path, without: tuple[str, ...]) -> tuple[Any, ...]:
    """Arguments of `diagnose_case`."""
    earlier = () if answer.reference is None else (folder / answer.reference,)
    return (folder / answer.case, results / answer.case, without, *earlier)


def diagnose_all(jobs: Sequence[tuple[Any, ...]], workers: int, progress: Progress, text: str = "diagnosed") -> None:
    """Diagnose every case that has no diagnosis yet; an error is kept as failed.json and tried again.

    Args:
        jobs: arguments of `diagnose_case`. workers: processes. text: what is reported after each.
    """
    for results in {job[1].parent for job in jobs}:
        durable.remove_leftovers(results)
    missing = [job for job in jobs if _read(job[1] / CONTENT) is None]
    started = len(jobs) - len(missing)
    calls = {job[0].name: job for job in missing}
    in_processes(diagnose_case, calls, workers, lambda done, name: progress(started + done, len(jobs), text))


def all_but(effects: Collection[str], library: Collection[str] = ()) -> tuple[str, ...]:
    """The library without all effects but these: what an oracle that knows them does not ask for.

    Args:
        effects: to keep. library: names that such logs are asked for besides those of the actuator's chain.
    """
    from hqpipe.machine import EFFECTS

    return tuple(name for name in dict.fromkeys((*EFFECTS, *library)) if name not in effects)


def diagnose_case(case: Path, output: Path, without: tuple[str, ...], reference: Path | None = None) -> None:
    """One diagnosis, from the case's own folder alone; with earlier logs of the machine, of what changed since."""
    from hqpipe.gap.diagnosis import diagnose, write_diagnosis
    from hqpipe.logs.log_set import read_log_set

    half = durable.new_folder(output)
    try:
        earlier = None if reference is None else _earlier(reference)
        write_diagnosis(diagnose(read_log_set(case), without=without, earlier=earlier), half)
    except Exception as error:  # one case that cannot be diagnosed is a miss of the score, not its end
        if system_failure(error):
            raise
        _write(half / FAILED, {"error": f"{type(error).__name__}: {error}"})
    durable.move_into_place(half, output)


def _earlier(reference: Path) -> Any:
    """The earlier record of a machine, as `hqpipe diagnose --reference` takes it from logs."""
    from hqpipe.gap.change.since import EarlierLogs
    from hqpipe.logs.log_set import read_log_set

    return EarlierLogs(read_log_set(reference))


def truth_gaps(
    folder: Path, case: str, sets: dict[str, str], layers: Sequence[str] = ()
) -> dict[str, dict[str, float]]:
    """Base gaps of a case ("with") and of its machines without effects, kept in truth/<case>/true_gaps.json.

    Args:
        folder: of the cases. case: name. sets: name of a set as in `hqpipe.benchmark.score.truth.Gaps` → its log set.
        layers: the first that the logs allow gives the base model; none for the paper's four coefficients.
    """
    from hqpipe.benchmark.score.layer import layer_gaps
    from hqpipe.benchmark.score.truth import base_gap, scales
    from hqpipe.errors import IdentificationError

    path = folder / "truth" / case / GAPS
    if kept := _read(path):
        return kept
    places = {name: folder / place for name, place in {"with": case, **sets}.items()}
    if layers:
        try:
            gaps = layer_gaps(places, layers)
        except IdentificationError:  # the layer cannot judge one of the machines: there is no gap to compare
            gaps = {}
    else:
        scale = scales(folder / case)
        gaps = {name: base_gap(place, scale) for name, place in places.items()}
    _write(path, gaps)
    return gaps


def case_library(folder: Path, case: str) -> list[str]:
    """Effects that the layers ask for in the logs of a case, kept in truth/<case>/library.json."""
    from hqpipe.benchmark.score.layer import library_of

    path = folder / "truth" / case / LIBRARY
    if (kept := _read(path)) is None:
        _write(path, kept := list(library_of(folder / case)))
    return kept


def gap_sets(truth: dict[str, Any]) -> dict[str, str]:
    """Set name → folder, from the field `truth` of an answer."""
    from hqpipe.benchmark.score.truth import alone, lacking

    return (
        {"all": truth["all"]}
        | {lacking(name): path for name, path in truth["without"].items()}
        | {alone(name): path for name, path in truth["only"].items()}
    )


def _gaps(folder: Path, answers: Sequence[Any], workers: int, progress: Progress) -> dict[str, Any]:
    from hqpipe.benchmark.score.layer import layers_of

    calls = {a.case: (folder, a.case, gap_sets(a.truth), layers_of(a)) for a in answers if a.truth["all"]}
    found = in_processes(truth_gaps, calls, workers, lambda done, name: progress(done, len(calls), "true gaps"))
    return dict(zip(calls, found, strict=True))


def _libraries(folder: Path, answers: Sequence[Any], workers: int, progress: Progress) -> dict[str, tuple[str, ...]]:
    """Case → effects that its logs are asked for: those of the actuator's chain, or of the layers that judge its logs."""
    from hqpipe.benchmark.score.layer import layers_of
    from hqpipe.machine import EFFECTS

    calls = {a.case: (folder, a.case) for a in answers if layers_of(a)}
    found: Sequence[list[str]] = ()
    if calls:
        found = in_processes(case_library, calls, workers, lambda done, name: progress(done, len(calls), "libraries"))
    layered = dict(zip(calls, found, strict=True))
    return {a.case: tuple(layered.get(a.case, EFFECTS)) for a in answers}


def _judged(answer: Any, results: Path, gaps: Any, without: tuple[str, ...], library: Collection[str]) -> Any:
    from hqpipe.benchmark.score.case import Judged
    from hqpipe.gap.diagnosis import errors_left

    place = results / answer.case
    content = _read(place / CONTENT)
    if content is None:
        return Judged(answer, None, _read(place / FAILED)["error"], gaps, without, library=frozenset(library))
    return Judged(answer, content, "", gaps, without, errors_left(place), frozenset(library))


def _check_names(without: Sequence[str], answers: Sequence[Any]) -> None:
    from hqpipe.benchmark.score.limit import KIND as FAINT

    known = sorted({e.effect for a in answers if a.kind != FAINT for e in a.effects if not e.outside})
    for name in without:
        if name not in known:
            raise UsageError(
                f"--without {name[:80]}{near_match(name[:80], known)}: no case has this effect "
                f"(they have: {', '.join(known) or 'none'})",
                field="--without",
                fix="name one that they have",
            )


def _read(path: Path) -> Any:
    """The content of a JSON file; None if it is absent or no JSON, so that it is made again."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError, RecursionError):
        return None


def _write(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    durable.write_file(path, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def missed_aims(result: dict[str, Any]) -> list[str]:
    """The aims that were not reached, as text."""
    from hqpipe.report.blind_table import reached_text

    return [f"{row['measure']}: {reached_text(row)}, aim {row['aim']}" for row in result["aims"] if row["met"] is False]
