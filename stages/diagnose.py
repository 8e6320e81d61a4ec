"""diagnose: where the model misses the machine on held-out trials."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pydantic import PositiveFloat

from hqpipe.pipeline.config import StageParams


class Params(StageParams):
    """Attributes:
    window_s: length of the free-running windows, s.
    resample: interpolate trials whose clock jitters onto a uniform one.
    """

    window_s: PositiveFloat = 0.1
    resample: bool = False


def run(context: Any) -> dict[str, Any]:
    from hqpipe.gap.diagnosis import diagnose, write_diagnosis
    from hqpipe.report.tables import summary_lines, where_table
    from hqpipe.stages.figures import draw_gap
    from hqpipe.stages.logs import foreign_fit, model_for, read_logs
    from hqpipe.stages.terminal import show

    log_set = read_logs(context)
    told = {f"warning: {text}" for text in log_set.warnings}
    log_set = replace(log_set, warnings=(*log_set.warnings, *foreign_fit(context, log_set)))
    model = model_for(context, log_set.joints)
    diagnosis = diagnose(log_set, model, window_s=context.params.window_s)
    write_diagnosis(diagnosis, context.output)
    if gap := diagnosis.content["gap"]:
        draw_gap(context.output, log_set, model, context.params.window_s, gap["noise_floor"])
    show(*(line for line in summary_lines(diagnosis.content) if line not in told))
    if diagnosis.content["where"]:
        show(where_table(diagnosis.content))
    return _metrics(diagnosis)


def _metrics(diagnosis: Any) -> dict[str, Any]:
    gap, where = diagnosis.content["gap"], diagnosis.content["where"]
    headline = diagnosis.verdict.replace("_", " ")
    if gap is not None:
        headline += f", gap {gap['before']:.3g} N·m over a floor of {gap['noise_floor']:.2g}"
    if where:
        headline += f", most at {where[0]['joint']} {where[0]['regime']}"
    return {
        "headline": headline,
        "verdict": diagnosis.verdict,
        "gap": gap,
        "where": where[:10],
        "warnings": diagnosis.content["warnings"],
    }
