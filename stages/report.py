"""report: a walk of the exported policy on film, and the results of the whole chain on one page."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from hqpipe.errors import ConfigError, UsageError
from hqpipe.pipeline.config import FieldError, StageParams
from hqpipe.stages.inputs.bounds import Speed, TrialSeconds, within
from hqpipe.stages.inputs.plant_overrides import Plant

RECORD = "manifest.json"
MOST_FRAMES = 600  # half a minute at 20 a second: below 500 MB of pictures in memory
# Seeds apart from those of collect and validate, so that the film shows a walk of its own.
SEED = 900


class Params(StageParams):
    """The walk of the exported policy on the plant, and its film.

    Attributes:
        seconds: length of the walk, s. vx, vy: order, m/s. wz: rad/s; null holds the heading.
        shown_seconds: how much of it the film shows: the last seconds, for the first are from standing to a steady gait.
        speed: seconds of the walk in a second of film; 0.5 is slow motion.
        frame_rate: frames a second. width, height: of the film, pixels.
        plant: as in collect.
    """

    seconds: TrialSeconds = 12.0
    vx: Speed = 1.0
    vy: Speed = 0.0
    wz: Speed | None = None
    shown_seconds: Annotated[float, within(0.1, 600.0, "s; of the walk")] = 8.0
    speed: Annotated[float, within(0.01, 100.0, "seconds of the walk in a second of film")] = 1.0
    frame_rate: Literal[10, 20, 25] = 20
    width: int = Field(default=640, ge=240, le=1280)
    height: int = Field(default=400, ge=120, le=960)
    plant: Plant = {}

    @model_validator(mode="after")
    def _film_is_short(self) -> Params:
        frames = min(self.seconds, self.shown_seconds) / self.speed * self.frame_rate
        if frames < 2.0:
            raise self._wrong("fewer than two frames", "raise shown_seconds or frame_rate, or lower speed")
        if frames > MOST_FRAMES:
            text = f"{frames:.0f} frames, expected at most {MOST_FRAMES}"
            raise self._wrong(text, "lower shown_seconds or frame_rate, or raise speed")
        return self

    @staticmethod
    def _wrong(what: str, fix: str) -> FieldError:
        error = ConfigError(f"the film would have {what}", field="shown_seconds", fix=fix)
        return FieldError(error, ("frame_rate", "speed", "seconds"))


def run(context: Any) -> dict[str, Any]:
    from hqpipe.report.chain_page import write_report
    from hqpipe.report.chain_parts import Chain
    from hqpipe.stages import STAGES
    from hqpipe.stages.output.terminal import show
    from hqpipe.stages.walks.filmed_walk import Order, film_walk

    p = context.params
    parts = _parts(context, STAGES)
    notes = [*_strangers(parts, STAGES), *_other_plants(parts, p.plant)]
    show(*(f"warning: {note}" for note in notes))
    walk = film_walk(context, Order(**p.model_dump(), seed=1000 * context.seed + SEED))
    stage = STAGES["report"]
    chain = Chain(
        walk=walk,
        parts=parts,
        commands={needed.artifact: _command(STAGES, needed.artifact, parts) for needed in stage.inputs},
        options={needed.artifact: needed.option for needed in stage.inputs},
        gap=_gap(context),
        notes=notes,
    )
    write_report(context.output, chain)
    ending = "" if walk.fall_time is None else f", fell after {walk.fall_time:.1f} s"
    absent = [needed.artifact for needed in stage.inputs if needed.artifact not in parts]
    lacking = f"; without {', '.join(absent)}" if absent else ""
    return {
        "headline": f"{walk.speed:.2f} m/s at {p.vx:g}{ending}{lacking}",
        "walk": {"speed": walk.speed, "seconds": walk.seconds, "fall_time": walk.fall_time, "shown": list(walk.shown)},
        "film_bytes": walk.film.stat().st_size,
        "missing": absent,
        "warnings": notes,
    }


def _parts(context: Any, stages: Any) -> dict[str, Any]:
    """Artifact → `Part`, of every input that was read, in the order of the chain."""
    from hqpipe.report.chain_parts import Part

    parts: dict[str, Any] = {}
    for name in sorted(context.inputs, key=stages.artifacts.index):
        folder = context.inputs[name]
        path = folder / RECORD
        record = _record(path) if path.is_file() else None
        shown = f"artifacts/{name}" if folder.parent.name == "store" else folder.name
        parts[name] = Part(name, folder, shown, f"hqpipe {stages.maker(name).name}", record)
    for name, part in parts.items():
        if part.record is not None and part.record["recipe"]["stage"] != stages.maker(name).name:
            raise UsageError(
                f"{part.folder}: made by {part.record['recipe']['stage']}, expected {part.command}",
                file=part.folder,
                field=stages.maker(name).name,
                fix=f"give a folder that {part.command} made",
            )
    if "diagnosis" in parts:
        from hqpipe.gap.answer.schema import read_diagnosis

        read_diagnosis(parts["diagnosis"].folder / "diagnosis.json")
    return parts


def _record(path: Any) -> dict[str, Any]:
    """A manifest as plain data; its hashes were compared before the stage began."""
    from hqpipe.files.documents import read_json
    from hqpipe.files.entries import Entry

    fix = "give the folder as hqpipe wrote it, or make it again"
    top = Entry(read_json(path, fix), path, fix, kind=UsageError).table()
    for name in ("recipe", "provenance", "metrics", "sources", "outputs"):
        if name not in top or not isinstance(top[name].value, dict):
            raise UsageError(f"{path}: {name}: expected an object", file=path, field=name, fix=fix)
    return {name: entry.value for name, entry in top.items()}


def _command(stages: Any, artifact: str, parts: Mapping[str, Any]) -> str:
    """What makes `artifact`, in the profile of the exported policy."""
    record = parts["onnx"].record
    profile = "" if record is None else f" --profile {record['provenance']['profile']}"
    return f"hqpipe {stages.maker(artifact).name}{profile}"


def _strangers(parts: Mapping[str, Any], stages: Any) -> list[str]:
    """A sentence for each result that was made from another one than the page shows."""
    notes = []
    for name, part in parts.items():
        if part.record is None:
            continue
        recipe = part.record["recipe"]
        for needed in stages.maker(name).inputs:
            other = parts.get(needed.artifact)
            if needed.name not in recipe["inputs"] or part.record["sources"][needed.name]["artifact"] is None:
                continue
            if other is None or other.record is None:
                continue
            if needed.content(other.record["outputs"]) != recipe["inputs"][needed.name]:
                notes.append(f"{part.shown} was made from another {needed.artifact} than the one on this page")
    return notes


def _other_plants(parts: Mapping[str, Any], plant: dict[str, Any]) -> list[str]:
    """A sentence for each result of a plant that is not the one of the film."""
    known = {name: parts[name].parameter("plant") for name in ("rollouts", "validation") if name in parts}
    return [
        f"the film shows another plant than {parts[name].shown}: --set 'plant={json.dumps(other)}' would show that one"
        for name, other in known.items()
        if other is not None and other != plant
    ]


def _gap(context: Any) -> Any:
    """gap.png of the diagnosis, beside a copy of its page; None without one."""
    from hqpipe.report.chain_sections import DIAGNOSIS_PAGE
    from hqpipe.report.diagnosis_read import read_files
    from hqpipe.report.gap_figures import gap_steps

    folder = context.inputs.get("diagnosis")
    if folder is None:
        return None
    if (folder / DIAGNOSIS_PAGE).is_file():
        shutil.copyfile(folder / DIAGNOSIS_PAGE, context.output / DIAGNOSIS_PAGE)
    content = read_files(folder).content
    return None if content["gap"] is None else gap_steps(content, context.output / "gap.png")
