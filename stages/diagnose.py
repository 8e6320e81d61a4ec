"""diagnose: where the gap lies on held-out trials, which effects cause it and how far it shrinks with them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator

from hqpipe.errors import near_match
from hqpipe.pipeline.config import StageParams
from hqpipe.stages.inputs.bounds import WindowChoice


def _known_effects(names: list[str]) -> list[str]:
    if not names:
        return names
    from hqpipe.layers import ONLY_IN_LAYERS
    from hqpipe.machine import EFFECTS  # half a second, because of numba; only where there is something to look up

    known = (*EFFECTS, *ONLY_IN_LAYERS)
    for name in names:
        if name not in known:
            text = f"no effect '{name[:80]}'{near_match(name[:80], known)} (known: {', '.join(known)})"
            raise ValueError(text)
    return names


class Params(StageParams):
    """Attributes:
    window_s: length of the free-running windows, s; null for what suits the logs.
    strict: refuse logs in which anything would have to be repaired.
    without: effects left out of the library.
    """

    window_s: WindowChoice = None
    strict: bool = False
    without: Annotated[list[str], AfterValidator(_known_effects)] = []


def run(context: Any) -> dict[str, Any]:
    from hqpipe.gap.diagnosis import LARGEST, diagnose, write_diagnosis
    from hqpipe.machine import EFFECTS
    from hqpipe.report.diagnosis_page import write_page
    from hqpipe.report.diagnosis_table import diagnosis_table
    from hqpipe.stages.inputs.earlier import REFERENCE, is_logs, read_earlier
    from hqpipe.stages.inputs.logs import read_logs, stated_travel
    from hqpipe.stages.output.terminal import show
    from hqpipe.stages.walks.closed_loop import close_loop, closed_loop_lines

    largest = LARGEST // 2 if is_logs(context) else LARGEST  # both are in memory
    log_set = read_logs(context, most=largest)
    diagnosis = diagnose(
        log_set,
        window_s=context.params.window_s,
        without=context.params.without,
        workers=context.workers,
        progress=context.progress,
        earlier=read_earlier(context, largest),
        travel=stated_travel(context, log_set),
    )
    write_diagnosis(diagnosis, context.output)
    loop = close_loop(context, log_set, diagnosis)
    left_out = f" --set 'without=[{', '.join(context.params.without)}]'" if context.params.without else ""
    since = f" --reference {diagnosis.content[REFERENCE]['path']}" if REFERENCE in context.inputs else ""
    write_page(
        context.output,
        provenance={"command": f"hqpipe diagnose --logs {log_set.path}{since}{left_out}"},
        effects=EFFECTS,
    )
    if (gap := diagnosis.content["gap"]) is not None:
        show(f"windows of {1e3 * gap['window_s']:.0f} ms: {gap['window_reason']}")
    show(diagnosis_table(diagnosis.content))
    if loop is not None:
        show(*closed_loop_lines(loop))
    return _metrics(diagnosis, loop)


def _metrics(diagnosis: Any, loop: Any) -> dict[str, Any]:
    from hqpipe.report.diagnosis_words import size_text

    gap, where, causes = (diagnosis.content[key] for key in ("gap", "where", "causes"))
    headline = diagnosis.verdict.replace("_", " ")
    if gap is not None:
        before, after, floor = (size_text(gap, name) for name in ("before", "after", "noise_floor"))
        headline += f", gap {before} → {after} over a floor of {floor}"
    if causes:
        since = " changed since the reference" if "reference" in diagnosis.content else ""
        headline += f"{since}: {', '.join(dict.fromkeys(cause['effect'] for cause in causes))}"
    return {
        "headline": headline,
        "verdict": diagnosis.verdict,
        "gap": gap,
        "where": where[:10],
        "causes": causes,
        "left_out": diagnosis.content["left_out"],
        "warnings": diagnosis.content["warnings"],
        "closed_loop": {name: loop.pooled(name) for name in loop.models} if loop is not None else None,
    }
