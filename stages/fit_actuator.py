"""fit-actuator: k1 … k4 from logs, per joint and shared, beside what any model must beat."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from hqpipe.pipeline.config import StageParams
from hqpipe.stages.fits.constants import write_constants
from hqpipe.stages.fits.judging import judge, write_data_curve
from hqpipe.stages.fits.paper_fits import FREE_RUNNING, SCOPES, both_models, joint_constants, paper_fits
from hqpipe.stages.fits.rivals import (
    EVERY,
    NAMES,
    TITLES,
    Fitted,
    Rival,
    Settings,
    fit_rivals,
    found_effects,
    rival_fits,
    stepped,
)
from hqpipe.stages.inputs.bounds import Iterations, WindowChoice, each_once, within
from hqpipe.stages.inputs.logs import FIT, read_logs

DataSeconds = Annotated[float, within(0.1, 1e6, "s; from a few windows to eleven days")]
MOST_LENGTHS = 100  # each costs a fit of every model
FOREIGN = "the joints are not those of the robot: R is 1, k1 in N·m/rad, and no effort limit holds"


class Params(StageParams):
    """Attributes:
    scope: which fit the later stages use; both are made. window_s: length of the free-running windows, s; null for what
        suits the logs.
    data_seconds: lengths of fit data, s, for the curve of error against data; none for no curve. Every length costs a fit of
        every model.
    rivals: models that the paper's is held against: itself with diagnosed effects, two chambers of oil, nets as in the paper,
        and strong_ with every advantage.
    net_iterations, strong_net_iterations: of their training.
    strict: refuse logs in which anything would have to be repaired.
    """

    scope: Literal["per_joint", "shared"] = "per_joint"
    window_s: WindowChoice = None
    data_seconds: Annotated[list[DataSeconds], Field(max_length=MOST_LENGTHS)] = []
    rivals: Annotated[list[Rival], each_once("rivals")] = list(EVERY)
    net_iterations: Iterations = 1000  # the paper's
    strong_net_iterations: Iterations = 1200
    strict: bool = False


def run(context: Any) -> dict[str, Any]:
    from hqpipe.identify.paper_model.fit_actuator import fit_actuator
    from hqpipe.identify.rivals.timing import timed
    from hqpipe.identify.window_choice import window_for
    from hqpipe.report.tables import coefficient_table
    from hqpipe.stages.output.figures import draw_fit
    from hqpipe.stages.output.terminal import show

    log_set = read_logs(context)
    constants = joint_constants(context.robot, log_set.joints)
    window = window_for(log_set, context.params.window_s)
    show(f"windows of {1e3 * window.seconds:.0f} ms: {window.reason}")
    options = {"window_s": window.seconds, **constants}
    fits, models, fit_s = {}, {}, {}
    total = len(SCOPES) + len(context.params.rivals) + 2
    for index, scope in enumerate(SCOPES):
        context.progress(index, total, scope.replace("_", " "))
        fits[scope], seconds = timed(lambda scope=scope: fit_actuator(log_set, scope=scope, **options))
        models |= both_models(fits[scope])
        fit_s[FREE_RUNNING.format(scope.replace("_", " "))] = seconds
        _save(fits[scope].model, fits[scope].posterior, context.output / scope)
    chosen = fits[context.params.scope]
    _save(chosen.model, chosen.posterior, context.output)
    show(coefficient_table(chosen.to_dict()))
    notes = [*([] if constants else [FOREIGN]), *chosen.warnings]
    show(*(f"warning: {text}" for text in notes))
    _write(context.output, log_set, fits, window)
    settings = _settings(context, constants, window.seconds)
    rivals = _rivals(context, log_set, settings, total)
    others = {title: rival.model for title, rival in rivals.items() if rival.model is not None}
    chambers = rivals.get(TITLES["two_chamber"])
    write_constants(context, log_set, chosen, chambers.joints if chambers else ())
    refused = [f"{title}: not fitted: {rival.reason}" for title, rival in rivals.items() if rival.reason]
    diagnosed = others.get(TITLES["diagnosed"])
    if diagnosed is not None:
        show(found_effects(diagnosed))
        refused += diagnosed.warnings
    show(*(f"warning: {text}" for text in refused))
    context.progress(total - 2, total, "held-out trials")
    fit_s |= {title: rivals[title].seconds for title in others}
    metrics = judge(context, log_set, models | others, fit_s, window.seconds)
    context.progress(total - 1, total, "figures")
    draw_fit(context.output, log_set, chosen.model, window.seconds)
    if context.params.data_seconds:
        with rival_fits(context.params.rivals, settings) as fits_of_rivals:
            write_data_curve(context, log_set, paper_fits(options) | fits_of_rivals, window.seconds)
    return {
        **_metrics(metrics, chosen),
        "effects": diagnosed.effects if diagnosed is not None else None,
        "warnings": [*log_set.warnings, *notes, *refused],
    }


def _rivals(context: Any, log_set: Any, settings: Settings, total: int) -> dict[str, Fitted]:
    """See `fit_rivals`; every model is saved into a folder of its name."""
    numbers = iter(range(len(SCOPES), total))
    found = fit_rivals(
        log_set, context.params.rivals, settings, lambda title: context.progress(next(numbers), total, title)
    )
    for title, rival in found.items():
        if rival.model is not None:
            _save(stepped(rival.model), rival.posterior, context.output / "rivals" / NAMES[title])
    return found


def _settings(context: Any, constants: dict[str, Any], window_s: float) -> Settings:
    p = context.params
    return Settings(
        effort_limit=constants.get("effort_limit", float("inf")),
        window_s=window_s,
        iterations=(p.net_iterations, p.strong_net_iterations),
        seed=context.seed,
        workers=context.workers,
    )


def _save(model: Any, posterior: Any, folder: Path) -> None:
    """Write a model into `folder`, with its posterior if it has one."""
    from hqpipe.actuators.files import save_actuator
    from hqpipe.actuators.posterior_file import save_posterior

    save_actuator(model, folder)
    if posterior is not None:
        save_posterior(posterior, model, folder)


def _write(output: Path, log_set: Any, fits: dict[str, Any], window: Any) -> None:
    report = {
        "logs": log_set.header(),
        "window": asdict(window),
        **{scope: fit.to_dict() for scope, fit in fits.items()},
    }
    (output / FIT).write_text(json.dumps(report, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _metrics(metrics: dict[str, Any], fit: Any) -> dict[str, Any]:
    """What `judge` found, with a headline about the model that the later stages use."""
    name = FREE_RUNNING.format(fit.scope.replace("_", " "))
    free_run = {model: errors["free_run"] for model, errors in metrics["held_out_rmse"].items()}
    return {
        "headline": (
            f"held-out free run {free_run[name]:.3g} N·m, persistence {free_run['persistence']:.3g}, "
            f"noise {metrics['noise_floor']:.2g}"
        ),
        **metrics,
        "nrmse": metrics["nrmse"][name],
    }
