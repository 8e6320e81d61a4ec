"""What the paper's model is held against in fit-actuator: itself with more physics, another physical model and nets, fitted
to the same trials."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, get_args

from hqpipe.system.processes import WorkerPool, in_processes

if TYPE_CHECKING:
    from hqpipe.actuators.base import ActuatorModel

Rival = Literal["diagnosed", "two_chamber", "mlp", "lstm", "gru", "strong_mlp", "strong_lstm", "strong_gru"]
"""The paper's model with the effects of `hqpipe.gap.diagnosed`; nets as in the paper, and `strong_` with every advantage, see
`hqpipe.identify.rivals.nets`."""
EVERY: tuple[Rival, ...] = get_args(Rival)
TITLES = {
    "diagnosed": "paper's model with diagnosed effects",
    "two_chamber": "two chambers of oil",
    **{kind: f"{kind.upper()}, as the paper" for kind in ("mlp", "lstm", "gru")},
    **{f"strong_{kind}": f"{kind.upper()}, every advantage" for kind in ("mlp", "lstm", "gru")},
}
NAMES = {title: name for name, title in TITLES.items()}


@dataclass(frozen=True)
class Settings:
    """How rivals are fitted.

    Attributes:
        effort_limit: N·m, or joint → N·m. window_s: of the free run of those that are not nets, s.
        iterations: of a net as in the paper, and with every advantage. seed: of the nets.
        workers: processes; the result does not depend on their number.
    """

    effort_limit: Any
    window_s: float
    iterations: tuple[int, int]
    seed: int
    workers: int


@dataclass(frozen=True)
class Fitted:
    """A rival with the seconds of its fit, its posterior and reports of its joints if it has them; or why there is none."""

    model: Any = None
    posterior: Any = None
    joints: tuple[Any, ...] = ()
    seconds: float = 0.0
    reason: str = ""


def fit_rivals(
    log_set: Any, names: Sequence[str], settings: Settings, told: Callable[[str], None]
) -> dict[str, Fitted]:
    """Title → rival, in the order of `names`.

    Args:
        log_set: only its fit trials are used. names: of `Rival`. told: called with each title.
    """
    calls = {TITLES[name]: (name, log_set, settings) for name in names}
    found = in_processes(fit_rival, calls, settings.workers, lambda done, title: told(title))
    return dict(zip(calls, found, strict=True))


@contextmanager
def rival_fits(names: Sequence[str], settings: Settings) -> Iterator[dict[str, Callable[[Any], Any]]]:
    """Title → fit in a process of its own, as `hqpipe.identify.rivals.data_curve` asks for it."""
    from hqpipe.errors import IdentificationError

    with WorkerPool(min(settings.workers, len(names))) as pool:

        def fitted(name: str, log_set: Any) -> Any:
            needed = replace(log_set, trials=tuple(log_set.fit))
            found = pool.call(TITLES[name], fit_rival, name, needed, settings)
            if found.model is None:
                raise IdentificationError(found.reason)
            return found.model

        yield {TITLES[name]: partial(fitted, name) for name in names}


def fit_rival(name: str, log_set: Any, settings: Settings) -> Fitted:
    """One of them."""
    from hqpipe.errors import IdentificationError
    from hqpipe.gap.diagnosed import fit_diagnosed
    from hqpipe.identify.rivals.fit_chambers import fit_chambers
    from hqpipe.identify.rivals.nets.fit_net import fit_paper_net, fit_strong_net
    from hqpipe.identify.rivals.timing import timed

    limit = settings.effort_limit

    def fit() -> Fitted:
        if name == "diagnosed":
            return Fitted(fit_diagnosed(log_set, window_s=settings.window_s, effort_limit=limit))
        if name == "two_chamber":
            found = fit_chambers(log_set, window_s=settings.window_s, effort_limit=limit)
            return Fitted(found.model, found.posterior, found.fits)
        strong = name.startswith("strong_")
        train = fit_strong_net if strong else fit_paper_net
        kind, count = name.removeprefix("strong_"), settings.iterations[strong]
        return Fitted(train(log_set, kind, iterations=count, seed=settings.seed, effort_limit=limit).model)

    try:
        found, seconds = timed(fit)
    except IdentificationError as error:
        return Fitted(reason=str(error))
    return replace(found, seconds=seconds)


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
