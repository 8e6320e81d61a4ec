"""How fit-actuator judges models: on held-out trials, on stress trials, and against the data that they need."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from hqpipe.stages.inputs.logs import read_stress


def judge(
    context: Any, log_set: Any, models: Mapping[str, Any], fit_s: Mapping[str, float], window_s: float
) -> dict[str, Any]:
    """Compare models beside the baselines; writes comparison.csv, comparison.json and figures, and shows the table.

    Args:
        context: of the stage; its parameters have `strict`. window_s: of the free run.
        log_set: with held-out trials. models: name → any model of `hqpipe.identify.free_run`.
        fit_s: wall time of the fits, s, of any of the models. Times are told, and are in no file, so that the same seed
            gives the same bytes.

    Returns:
        held_out_rmse, and stress_rmse where there are stress trials: model → one_step and free_run, N·m, None where it
        diverged; noise_floor, N·m; nrmse: model → free run over the torque's standard deviation; fit_s; step_us.
    """
    from hqpipe.identify.rivals.compare import ALL, HELDOUT, STRESS, compare_models
    from hqpipe.identify.rivals.score_files import finite, long_rows, score_tree
    from hqpipe.identify.rivals.timing import step_time
    from hqpipe.report.tables import comparison_table
    from hqpipe.stages.fits.rivals import stepped
    from hqpipe.stages.inputs.training import write_rows
    from hqpipe.stages.output.figures import draw_comparison
    from hqpipe.stages.output.terminal import show

    rows = compare_models(log_set, models, window_s=window_s, stress=read_stress(context, log_set))
    longest = max((trial.trajectory for trial in log_set.heldout), key=lambda t: t.samples)
    step_us = {name: 1e6 * step_time(longest, stepped(model), window_s) for name, model in models.items()}
    plain = [asdict(row) for row in rows]
    show(comparison_table(plain, fit_s, step_us))
    write_rows(context.output / "comparison.csv", long_rows(rows))
    _write_json(context, "comparison.json", score_tree(rows, window_s))
    draw_comparison(context.output, plain, models)
    pooled = {(row.logs, row.model): row for row in rows if row.joint == row.trial == ALL}

    def errors(logs: str) -> dict[str, Any]:
        found = {name: row for (which, name), row in pooled.items() if which == logs}
        return {
            name: {"one_step": finite(row.one_step.rmse), "free_run": finite(row.free_run.rmse)}
            for name, row in found.items()
        }

    return {
        "held_out_rmse": errors(HELDOUT),
        "stress_rmse": errors(STRESS),
        "noise_floor": rows[0].noise_floor,
        "nrmse": {name: finite(row.free_run.nrmse) for (logs, name), row in pooled.items() if logs == HELDOUT},
        "fit_s": dict(fit_s),
        "step_us": step_us,
    }


def write_data_curve(context: Any, log_set: Any, fits: Mapping[str, Callable[[Any], Any]], window_s: float) -> None:
    """data_curve.json and data_curve.png: held-out errors of models that were fitted to `data_seconds` of data.

    Args:
        context: of the stage; its parameters have `data_seconds`. window_s: of the free run.
        log_set: with fit and held-out trials. fits: name → fit, see `hqpipe.identify.rivals.data_curve`.
    """
    from hqpipe.identify.rivals.data_curve import data_curve
    from hqpipe.identify.rivals.score_files import finite
    from hqpipe.stages.output.figures import draw_data_curve
    from hqpipe.stages.output.terminal import show

    p = context.params
    curve = data_curve(log_set, fits, p.data_seconds, window_s=window_s, workers=context.workers)
    for point in curve.points:
        if point.reason:
            show(f"warning: {point.model} from {point.seconds:g} s of data: {point.reason}")
    content = asdict(curve)
    for point in content["points"]:
        point |= {name: finite(point[name]) for name in ("one_step", "free_run")}
    _write_json(context, "data_curve.json", content)
    draw_data_curve(context.output, curve)


def _write_json(context: Any, name: str, content: Any) -> None:
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    (context.output / name).write_text(text + "\n", encoding="utf-8")
