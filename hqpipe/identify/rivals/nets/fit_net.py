"""Neural rivals from logs: as the paper trained them, and with every advantage we know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hqpipe.actuators import ACTUATOR_MODELS
from hqpipe.actuators.net import NetActuator
from hqpipe.errors import UsageError, near_match
from hqpipe.identify.free_run import WINDOW_S, window_samples
from hqpipe.identify.paper_model.fit_actuator import PerJoint, per_joint
from hqpipe.identify.rivals.nets.data import NetData, net_data
from hqpipe.logs.trajectory import LogSet

if TYPE_CHECKING:
    from hqpipe.identify.rivals.nets.modules import Net
    from hqpipe.identify.rivals.nets.optimise import Course

KINDS = ("mlp", "lstm", "gru")
HIDDEN = 64  # paper: size (48, 64, 12)
# Units of a net for one joint. Assumption: on what the reference plant's fit trials set aside, an MLP of 16, 32 and 64 units
# leaves 7.1, 5.6 and 4.9 N·m, a GRU of 16 and 32 leaves 3.2 and 2.4; a step of 12 GRUs of 32 takes 27 µs, of 64 it takes 56.
JOINT_HIDDEN = {"mlp": 64, "lstm": 32, "gru": 32}
ITERATIONS = 1000  # paper
BATCH = 4096  # samples in an iteration; assumption: the paper does not say, a fifth of its 20 s
SEQUENCE_S = 0.1  # of a recurrent net in one-step training; assumption: the window of the free run
HISTORY_S = (0.0, 0.01, 0.02)  # Hwangbo et al. 2019
CONTEXT_S = 0.05  # logged, before a recurrent net runs free; assumption: ten times the lag of a servo valve


@dataclass(frozen=True, eq=False)
class NetFit:
    """A trained net.

    Attributes:
        model: stepped without torch. losses: of every iteration, one-step ones first.
        stopping: (iteration, free-running RMSE in N·m on the end of the fit trials), empty without early stopping.
        best: iteration whose weights the model has.
        trials: files it was trained on.
    """

    model: NetActuator
    losses: tuple[float, ...]
    stopping: tuple[tuple[int, float], ...]
    best: int
    trials: tuple[str, ...]


def fit_paper_net(
    log_set: LogSet,
    kind: str,
    *,
    iterations: int = ITERATIONS,
    learning_rate: float = 3e-3,
    hidden: int = HIDDEN,
    batch: int = BATCH,
    seed: int = 0,
    effort_limit: PerJoint = np.inf,
) -> NetFit:
    """Train a net as the paper says: the next torque from this sample, Adam, 1,000 iterations, all of the fit trials.

    What the paper leaves open is ours: an iteration is one step on a random batch.

    Args:
        log_set: with `position_command` and `effort`; its held-out trials are not looked at.
        kind: mlp, lstm or gru. learning_rate: of Adam; assumption: on the reference plant's
            held-out trial, hence in the nets' favour, the best of 1e-3, 3e-3 and 1e-2 one step ahead for LSTM and GRU.
        hidden: units. batch: samples in an iteration. effort_limit: N·m, or joint → N·m, of the model.

    Raises:
        IdentificationError: channels are missing, rates differ, trials are too short, or it diverged.
        UsageError: an unknown kind, or a number below 1.
    """
    _check(kind, iterations=iterations, hidden=hidden, batch=batch)
    from hqpipe.identify.rivals.nets import modules, optimise

    data = net_data(log_set.fit)
    limit = per_joint(effort_limit, data.joints, "effort_limit")
    length = 1 if kind == "mlp" else _steps(data, SEQUENCE_S)
    course, rng = optimise.Course(), np.random.default_rng(seed)
    with optimise.one_thread(seed):
        net = modules.NETS[kind](data, hidden)
        sequences = optimise.Sequences(data, length + 1, max(1, batch // length), rng)
        optimise.fit_one_step(net, sequences, iterations, learning_rate, 0, course)
        course.best = iterations
        return _fitted(log_set, data, net, limit, course)


def fit_strong_net(
    log_set: LogSet,
    kind: str,
    *,
    warm_up: int = 400,
    iterations: int = 1200,
    learning_rate: float = 3e-3,
    hidden: int | None = None,
    windows: int = 32,
    window_s: float = WINDOW_S,
    history_s: tuple[float, ...] = HISTORY_S,
    every: int = 40,
    patience: int = 10,
    seed: int = 0,
    effort_limit: PerJoint = np.inf,
) -> NetFit:
    """Train a net with every advantage: on what it is judged by, and stopped where it is best on trials' ends set aside.

    Each joint has a net of its own: one for all learns how the joints of a gait move together, which holds nowhere else. It
    predicts the change of the torque, and learns on the position error in the place of the target. After a warm-up on one-step
    errors the error of whole free-running windows is followed back through time, as the paper's model is fitted in
    `fit_actuator`; recurrent nets see logged context before each window, an MLP past inputs. The learning rate falls; the
    last fifth of every fit trial is kept for early stopping.

    Args:
        log_set, kind, learning_rate, effort_limit: as in `fit_paper_net`. hidden: units of each net; None for `JOINT_HIDDEN`.
        warm_up, iterations: one-step and free-running iterations. windows: in one of the latter.
        window_s: s. history_s: how long ago the MLP reads its inputs, s.
        every, patience: iterations between two looks at what is set aside, and looks without a gain before it ends.

    Raises:
        IdentificationError, UsageError: as in `fit_paper_net`.
    """
    _check(kind, warm_up=warm_up, iterations=iterations, windows=windows, every=every, patience=patience)
    hidden = JOINT_HIDDEN[kind] if hidden is None else hidden
    _check(kind, hidden=hidden)
    from hqpipe.identify.rivals.nets import modules, optimise

    data = net_data(log_set.fit, delta=True, errors=True, stopping=True)
    limit = per_joint(effort_limit, data.joints, "effort_limit")
    steps = window_samples(data.dt, window_s)
    taps = tuple(sorted({round(ago / data.dt) for ago in (0.0, *history_s)})) if kind == "mlp" else (0,)
    context = taps[-1] if kind == "mlp" else _steps(data, CONTEXT_S)
    row = _steps(data, SEQUENCE_S)
    course, rng = optimise.Course(), np.random.default_rng(seed)
    with optimise.one_thread(seed):
        net = modules.NETS[kind](data, hidden, taps, per_joint=True)
        sequences = optimise.Sequences(data, taps[-1] + row + 1, max(1, BATCH // row), rng)
        free = optimise.Sequences(data, context + steps + 1, windows, rng)
        validation = optimise.Validation(data, context, steps)
        optimise.fit_one_step(net, sequences, warm_up, learning_rate, taps[-1], course)
        optimise.fit_free_run(
            net,
            free,
            validation,
            iterations,
            learning_rate,
            context,
            course,
            spread=data.tensors["input_spread"][: len(data.joints)],
            every=every,
            patience=patience,
        )
        return _fitted(log_set, data, net, limit, course)


def _check(kind: str, **numbers: int) -> None:
    if kind not in KINDS:
        raise UsageError(f"kind is '{kind}'{near_match(kind, KINDS)}, expected one of {', '.join(KINDS)}")
    for name, value in numbers.items():
        if value < 1:
            raise UsageError(f"{name} is {value}, expected at least 1")


def _steps(data: NetData, seconds: float) -> int:
    return max(1, round(seconds / data.dt))


def _fitted(log_set: LogSet, data: NetData, net: Net, limit: np.ndarray, course: Course) -> NetFit:
    from hqpipe.identify.rivals.nets.modules import actuator_of

    return NetFit(
        model=actuator_of(net, ACTUATOR_MODELS[net.KIND], data, limit),
        losses=tuple(course.losses),
        stopping=tuple(course.stopping),
        best=course.best,
        trials=tuple(trial.file for trial in log_set.fit),
    )
