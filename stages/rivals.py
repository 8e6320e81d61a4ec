"""What the paper's model is held against in fit-actuator: a physical model and neural ones, fitted to the same trials."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Literal, get_args

Rival = Literal["two_chamber", "mlp", "lstm", "gru", "strong_mlp", "strong_lstm", "strong_gru"]
"""Nets as in the paper, and `strong_` with every advantage, see `hqpipe.sysid.nets`."""
EVERY: tuple[Rival, ...] = get_args(Rival)
TITLES = {
    "two_chamber": "two chambers of oil",
    **{kind: f"{kind.upper()}, as the paper" for kind in ("mlp", "lstm", "gru")},
    **{f"strong_{kind}": f"{kind.upper()}, every advantage" for kind in ("mlp", "lstm", "gru")},
}
NAMES = {title: name for name, title in TITLES.items()}


def fit_rivals(
    log_set: Any,
    names: Sequence[str],
    constants: Mapping[str, Any],
    iterations: tuple[int, int],
    seed: int,
    workers: int,
    told: Callable[[str], None],
) -> tuple[dict[str, Any], dict[str, Any], dict[str, float], list[str]]:
    """Fit models in `workers` processes; the result does not depend on their number.

    Args:
        log_set: only its fit trials are used. names: of `Rival`. constants: of the robot's joints, may be empty.
        iterations: of a net as in the paper, and with every advantage. seed: of the nets. told: called with each title.

    Returns:
        Title → model, title → posterior of those that have one, and title → seconds of the fit, in the order of `names`; why
        others could not be fitted.
    """
    models, posteriors, seconds, refused = {}, {}, {}, []
    limit = constants.get("effort_limit", float("inf"))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max(1, min(workers, len(names))), mp_context=context) as pool:
        futures = {name: pool.submit(fit_rival, name, log_set, limit, iterations, seed) for name in names}
        try:
            for name, future in futures.items():
                model, posterior, time_s, reason = future.result()
                told(TITLES[name])
                if model is None:
                    refused.append(f"{TITLES[name]}: not fitted: {reason}")
                else:
                    models[TITLES[name]], seconds[TITLES[name]] = model, time_s
                    if posterior is not None:
                        posteriors[TITLES[name]] = posterior
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return models, posteriors, seconds, refused


def fit_rival(
    name: str, log_set: Any, limit: Any, iterations: tuple[int, int], seed: int
) -> tuple[Any, Any, float, str]:
    """One model with its posterior, if it has one, and the time of its fit, s; or None and why the logs do not allow it."""
    from hqpipe.errors import IdentificationError
    from hqpipe.sysid.fit_chambers import fit_chambers
    from hqpipe.sysid.nets.fit_net import fit_paper_net, fit_strong_net
    from hqpipe.sysid.timing import timed

    def fit() -> Any:
        if name == "two_chamber":
            return fit_chambers(log_set, effort_limit=limit)
        train, count = (fit_strong_net, iterations[1]) if name.startswith("strong_") else (fit_paper_net, iterations[0])
        kind = name.removeprefix("strong_")
        return train(log_set, kind, iterations=count, seed=seed, effort_limit=limit)

    try:
        found, seconds = timed(fit)
    except IdentificationError as error:
        return None, None, 0.0, str(error)
    return found.model, found.posterior if name == "two_chamber" else None, seconds, ""
