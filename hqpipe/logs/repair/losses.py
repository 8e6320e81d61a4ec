"""Channels that are mostly missing: what of a log set they cost."""

from __future__ import annotations

from collections.abc import Mapping

from hqpipe.errors import LogError
from hqpipe.logs.clocks import is_near
from hqpipe.logs.columns import CHANNELS, joint_column, joints_of
from hqpipe.logs.findings import listed
from hqpipe.logs.repair.missing import MOST_MISSING
from hqpipe.logs.repair.one_file import Source
from hqpipe.logs.trajectory import Repair

_RECORD = "repair the sensor or its wiring, or drop the column"


def leave_out(sources: Mapping[str, Source], command: str | None) -> tuple[dict[str, Source], list[Repair]]:
    """Leave out channels, joints or trials of which more than half of the samples are missing.

    A joint without position, effort or the command of its control mode is left out if it lacks it for most of the time,
    else the trials are. A velocity can be had from the position; any other channel is dropped.

    Args:
        sources: file → as recorded. command: channel of the control mode.

    Raises:
        LogError: nothing would be left.
    """
    dead = {file: set(_dead(source)) for file, source in sources.items()}
    if not any(dead.values()):
        return dict(sources), []
    needed = {"position", command} | ({"effort"} if command != "valve_command" else set())
    total = sum(source.clock.seconds for source in sources.values())
    kept, repairs = dict(sources), []
    columns = sorted({name for names in dead.values() for name in names})
    lost_joints = {}
    for name in columns:
        if _channel(name) in needed:
            lacking = [file for file in sources if name in dead[file]]
            if sum(sources[file].clock.seconds for file in lacking) > MOST_MISSING * total:
                lost_joints.setdefault(name.split("/")[1], (name, lacking))
    for joint, (name, lacking) in lost_joints.items():
        kept = {file: source.without(_columns_of(source, joint)) for file, source in kept.items()}
        text = f"joint {joint} was left out: {_says(name, lacking, sources)}; {_RECORD}"
        repairs.append(Repair("joint", text, tuple(lacking), name, _share(name, lacking, sources)))
    if not any(joints_of(source.table.columns) for source in kept.values()):
        raise _nothing_left(lost_joints[next(iter(lost_joints))], sources)
    for name in columns:
        lacking = [file for file in kept if name in dead[file] and name in kept[file].table.columns]
        if not lacking:
            continue
        if _channel(name) in needed:
            if len(lacking) == len(kept):
                raise _nothing_left((name, lacking), sources)
            kept = {file: source for file, source in kept.items() if file not in lacking}
            what = f"{listed(lacking)} {'was' if len(lacking) == 1 else 'were'} left out"
            repairs.append(Repair("trial", f"{what}: {_says(name, lacking, sources)}; {_RECORD}", tuple(lacking), name))
        else:
            kept = _without_channel(kept, name, lacking)
            left = "had from the position" if _channel(name) == "velocity" else "left out"
            repairs.append(Repair("channel", f"{_says(name, lacking, sources)}: {left}", tuple(lacking), name))
    return kept, repairs


def leave_out_far(sources: Mapping[str, Source], dt: float) -> tuple[dict[str, Source], list[Repair]]:
    """Leave out trials whose rate is so far from that of the others that they must count time in another unit.

    Args:
        sources: file → as recorded. dt: sample time of the log set, s; one of theirs.
    """
    far = [file for file, source in sources.items() if not is_near(source.clock.dt, dt)]
    if not far:
        return dict(sources), []
    step = sources[far[0]].clock.dt
    text = (
        f"{listed(far)} {'was' if len(far) == 1 else 'were'} left out: time steps by {step:.4g} there and by {dt:.4g} in the "
        "other trials; write it in seconds"
    )
    kept = {file: source for file, source in sources.items() if file not in far}
    return kept, [Repair("trial", text, tuple(far))]


def _dead(source: Source) -> list[str]:
    return [name for name, count in source.missing.items() if count > MOST_MISSING * source.rows]


def _channel(column: str) -> str:
    """Channel of a joint's column; "" for any other column."""
    parts = column.split("/")
    return parts[2] if len(parts) == 3 and parts[0] == "joint" else ""


def _columns_of(source: Source, joint: str) -> list[str]:
    return [name for name in source.table.columns if name.startswith(f"joint/{joint}/")]


def _without_channel(sources: dict[str, Source], name: str, lacking: list[str]) -> dict[str, Source]:
    """Less one column; of a channel that all trials must have at all joints, less all its columns."""
    channel = _channel(name)
    if channel not in CHANNELS or channel == "velocity":
        return {file: s.without([name]) if file in lacking else s for file, s in sources.items()}
    return {
        file: s.without([joint_column(joint, channel) for joint in joints_of(s.table.columns)])
        for file, s in sources.items()
    }


def _share(name: str, files: list[str], sources: Mapping[str, Source]) -> float:
    return sum(sources[f].missing.get(name, 0) for f in files) / sum(sources[f].rows for f in files)


def _says(name: str, files: list[str], sources: Mapping[str, Source]) -> str:
    share = _share(name, files, sources)
    return f"{name} lacks {share:.0%} of its samples in {listed(files)}"


def _nothing_left(found: tuple[str, list[str]], sources: Mapping[str, Source]) -> LogError:
    name, files = found
    path = sources[files[0]].table.path
    return LogError(
        f"{path}: {_says(name, files, sources)}; nothing that can be used is left", file=path, field=name, fix=_RECORD
    )
