"""The files of a log set, or the sections that are read of them, repaired together: they share channels and a rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hqpipe.errors import LogError
from hqpipe.logs.clocks import SAME_RATE, shared_dt
from hqpipe.logs.columns import TIME
from hqpipe.logs.repair.losses import leave_out, leave_out_far
from hqpipe.logs.repair.one_file import Repaired, Source, repair
from hqpipe.logs.repair.report import as_recorded, describe
from hqpipe.logs.trajectory import AsRecorded, Repair


@dataclass(frozen=True, eq=False)
class RepairedFiles:
    """What is left of the files.

    Attributes:
        sources, repaired: name → before and after, of those that hold a stretch. repairs: what was done.
        as_recorded: name → summary before the repair.
    """

    sources: dict[str, Source]
    repaired: dict[str, Repaired]
    repairs: list[Repair]
    as_recorded: dict[str, AsRecorded]


def repair_files(
    sources: Mapping[str, Source],
    *,
    command: str | None,
    stated_hz: float | None,
    strict: bool,
) -> RepairedFiles:
    """Leave out what is mostly missing, and bring the rest to one sound clock.

    Args:
        sources: name → as recorded.
        command: channel of the control mode. stated_hz: nominal rate, or None.
        strict: refuse different rates.

    Raises:
        LogError: nothing is left, or the rates differ and may not.
    """
    sources, repairs = leave_out(sources, command)
    dt = shared_dt([(source.clock.dt, source.rows) for source in sources.values()], stated_hz)
    if strict:
        _check_rates(sources, dt)
    sources, far = leave_out_far(sources, dt)
    repaired = {name: repair(source, dt) for name, source in sources.items()}
    repairs += [*far, *describe(sources, repaired, dt)]
    empty = [name for name, found in repaired.items() if not found.stretches]
    if len(empty) == len(repaired):
        raise _only_gaps(next(iter(sources.values())))
    if empty:
        repairs.append(Repair("trial", f"{', '.join(empty)}: no stretch without a long gap; left out", tuple(empty)))
    before = {name: as_recorded(sources[name], found) for name, found in repaired.items()}
    whole = {name: found for name, found in repaired.items() if found.stretches}
    return RepairedFiles({name: sources[name] for name in whole}, whole, repairs, before)


def _check_rates(sources: Mapping[str, Source], dt: float) -> None:
    for source in sources.values():
        if abs(source.clock.dt / dt - 1.0) > SAME_RATE:
            path = source.table.path
            raise LogError(
                f"{path}: runs at {1.0 / source.clock.dt:.6g} Hz, expected {1.0 / dt:.6g} Hz as the other trials",
                file=path,
                field=TIME,
                fix="record all trials at one rate, or make a log set of its own for each rate",
            )


def _only_gaps(source: Source) -> LogError:
    path = source.table.path
    what = "no stretch of ten samples without a gap that is too long to be bridged"
    return LogError(f"{path}: {what}", file=path, field=TIME, fix="record it again, or drop the trial")
