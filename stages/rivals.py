"""What the paper's model is held against in fit-actuator: itself with more physics, another physical model and nets, fitted
to the same trials."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, get_args

if TYPE_CHECKING:
    from hqpipe.actuators.base import ActuatorModel

Rival = Literal["diagnosed", "two_chamber", "mlp", "lstm", "gru", "strong_mlp", "strong_lstm", "strong_gru"]
"""The paper's model with the effects of `hqpipe.gap.diagnosed`; nets as in the paper, and `strong_` with every advantage, see
`hqpipe.sysid.nets`."""
EVERY: tuple[Rival, ...] = get_args(Rival)
TITLES = {
    "diagnosed": "paper's model with diagnosed effects",
    "two_chamber": "two chambers of oil",
    **{kind: f"{kind.upper()}, as the paper" for kind in ("mlp", "lstm", "gru")},
    **{f"strong_{kind}": f"{kind.upper()}, every advantage" for kind in ("mlp", "lstm", "gru")},
}
NAMES = {title: name for name, title in TITLES.items()}


def fit_rivals(
    log_set: Any,
    names: Sequence[str],
    constants: Mapping[str, Any],
    window_s: float,
    iterations: tuple[int, int],
    seed: int,
    workers: int,
    told: Callable[[str], None],
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any], dict[str, float], list[str]]:
    """Fit models in `workers` processes; the result does not depend on their number.

    Args:
        log_set: only its fit trials are used. names: of `Rival`. constants: of the robot's joints, may be empty.
        window_s: of the free run of those that are not nets, s.
        iterations: of a net as in the paper, and with every advantage. seed: of the nets. told: called with each title.

    Returns:
        Title → model, title → posterior and title → reports of the joints of those that have them, and title → seconds of the
        fit, in the order of `names`; why others could not be fitted.
    """
    models, posteriors, reports, seconds, refused = {}, {}, {}, {}, []
    limit = constants.get("effort_limit", float("inf"))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max(1, min(workers, len(names))), mp_context=context) as pool:
        futures = {name: pool.submit(fit_rival, name, log_set, limit, window_s, iterations, seed) for name in names}
        try:
            for name, future in futures.items():
                model, posterior, joints, time_s, reason = future.result()
                told(TITLES[name])
                if model is None:
                    refused.append(f"{TITLES[name]}: not fitted: {reason}")
                else:
                    models[TITLES[name]], seconds[TITLES[name]] = model, time_s
                    if posterior is not None:
                        posteriors[TITLES[name]] = posterior
                    if joints:
                        reports[TITLES[name]] = joints
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return models, posteriors, reports, seconds, refused


@contextmanager
def rival_fits(
    names: Sequence[str],
    constants: Mapping[str, Any],
    window_s: float,
    iterations: tuple[int, int],
    seed: int,
    workers: int,
) -> Iterator[dict[str, Callable[[Any], Any]]]:
    """Title → fit in a process of its own, as `hqpipe.sysid.data_curve` asks for it; arguments as of `fit_rivals`."""
    from hqpipe.errors import IdentificationError

    limit = constants.get("effort_limit", float("inf"))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max(1, min(workers, len(names))), mp_context=context) as pool:

        def fitted(name: str, log_set: Any) -> Any:
            needed = replace(log_set, trials=tuple(log_set.fit))
            model, *_, reason = pool.submit(fit_rival, name, needed, limit, window_s, iterations, seed).result()
            if model is None:
                raise IdentificationError(reason)
            return model

        yield {TITLES[name]: partial(fitted, name) for name in names}


def fit_rival(
    name: str, log_set: Any, limit: Any, window_s: float, iterations: tuple[int, int], seed: int
) -> tuple[Any, Any, tuple[Any, ...], float, str]:
    """One model, its posterior and reports of its joints, if it has them, and the seconds of its fit; or None and why not."""
    from hqpipe.errors import IdentificationError
    from hqpipe.gap.diagnosed import fit_diagnosed
    from hqpipe.sysid.fit_chambers import fit_chambers
    from hqpipe.sysid.nets.fit_net import fit_paper_net, fit_strong_net
    from hqpipe.sysid.timing import timed

    def fit() -> tuple[Any, Any, tuple[Any, ...]]:
        if name == "diagnosed":
            return fit_diagnosed(log_set, window_s=window_s, effort_limit=limit), None, ()
        if name == "two_chamber":
            found = fit_chambers(log_set, effort_limit=limit)
            return found.model, found.posterior, found.fits
        train, count = (fit_strong_net, iterations[1]) if name.startswith("strong_") else (fit_paper_net, iterations[0])
        kind = name.removeprefix("strong_")
        return train(log_set, kind, iterations=count, seed=seed, effort_limit=limit).model, None, ()

    try:
        (model, posterior, joints), seconds = timed(fit)
    except IdentificationError as error:
        return None, None, (), 0.0, str(error)
    return model, posterior, joints, seconds, ""


def stepped(model: Any) -> ActuatorModel:
    """What the simulator steps of a model in the table: without what only the sensors add."""
    from hqpipe.actuators.base import ActuatorModel

    return model if isinstance(model, ActuatorModel) else model.actuator


def found_effects(model: Any) -> str:
    """The effects of a diagnosed model for the terminal."""
    joints = len(model.actuator.joints)
    parts = [
        f"{name} ({', '.join(where) if len(where) < joints else 'all joints'})" for name, where in model.effects.items()
    ]
    return f"{TITLES['diagnosed']}: {', '.join(parts) or 'none found'}"
