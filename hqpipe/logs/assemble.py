"""From the columns of a file to a `Trajectory`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hqpipe.logs.clocks import clock
from hqpipe.logs.columns import CHANNELS, TIME, RawTable, joint_column, joints_of
from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.trajectory import Trajectory

_MEASURED = ("position", "velocity", "effort")


def assemble(table: RawTable, observed: Mapping[str, np.ndarray] | None = None) -> Trajectory:
    """The trial of a table without missing values.

    Args:
        table: checked columns on a sound clock. A joint without velocity, or all of them, has it differentiated.
        observed: column → (T,) False where a measured value was not recorded, see `hqpipe.logs.repair.resample.Uniform`.
    """
    columns = table.columns
    time = clock(columns[TIME])
    time = (time - time[0]).astype(np.float64)
    joints = _joint_order(table)
    channels: dict[str, np.ndarray] = {}
    for channel in CHANNELS:
        present = [joint_column(joint, channel) in columns for joint in joints]
        if all(present) or (channel == "velocity" and any(present)):
            stacked = np.empty((len(time), len(joints)))
            for j, joint in enumerate(joints):
                stacked[:, j] = columns[joint_column(joint, channel)] if present[j] else np.nan
            channels[channel] = stacked
    source = "measured" if "velocity" in channels else "differentiated"
    slope = differentiate(channels["position"], float(np.median(np.diff(time)))) if _lacks_speed(channels) else None
    if slope is not None:
        velocity = channels.get("velocity", slope)
        channels["velocity"] = np.where(np.isnan(velocity), slope, velocity)
    taken = {TIME, *(joint_column(j, c) for j in joints for c in channels)}
    extra = {name: np.asarray(values, np.float64) for name, values in columns.items() if name not in taken}
    return Trajectory(
        time=time,
        joints=joints,
        extra=extra,
        velocity_source=source,
        observed=_observed(observed or {}, joints),
        **channels,
    )


def _lacks_speed(channels: dict[str, np.ndarray]) -> bool:
    return "velocity" not in channels or bool(np.isnan(channels["velocity"][0]).any())


def _observed(columns: Mapping[str, np.ndarray], joints: tuple[str, ...]) -> np.ndarray | None:
    """(T, J) whether every measured channel of a joint was recorded; None if all were."""
    found = None
    for j, joint in enumerate(joints):
        for channel in _MEASURED:
            seen = columns.get(joint_column(joint, channel))
            if seen is not None:
                found = np.ones((len(seen), len(joints)), dtype=bool) if found is None else found
                found[:, j] &= seen
    return found


def _joint_order(table: RawTable) -> tuple[str, ...]:
    """The order in the file's metadata if it names the same joints, else that of the columns."""
    found = joints_of(table.columns)
    stated = tuple(table.metadata.get("joints", "").split(","))
    return stated if sorted(stated) == sorted(found) else found
