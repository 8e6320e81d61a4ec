"""From the columns of a file to a `Trajectory`."""

from __future__ import annotations

import numpy as np

from hqpipe.logs.checks import check_clock, check_values, clock
from hqpipe.logs.columns import CHANNELS, TIME, RawTable, check_names, joint_column, joints_of
from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.resample import resample
from hqpipe.logs.trajectory import Trajectory


def assemble(table: RawTable, *, uniform: bool = False, checked: bool = False) -> Trajectory:
    """Check a table and build the trial; nothing is half-read.

    Args:
        table: what a reader returned.
        uniform: interpolate onto a uniform clock.
        checked: the table is a part of one that has been checked as a whole.

    Raises:
        LogError: a column is missing or misspelt, holds samples without physical sense, or the clock is broken.
    """
    if not checked:
        check_names(table)
        check_values(table)
        check_clock(table.path, clock(table.columns[TIME]))
    if uniform:
        table = resample(table)
    columns = table.columns
    time = clock(columns[TIME])
    time = (time - time[0]).astype(np.float64)
    joints = _joint_order(table)
    channels: dict[str, np.ndarray] = {}
    for channel in CHANNELS:
        if joint_column(joints[0], channel) in columns:
            stacked = np.empty((len(time), len(joints)))
            for j, joint in enumerate(joints):
                stacked[:, j] = columns[joint_column(joint, channel)]
            channels[channel] = stacked
    source = "measured"
    if "velocity" not in channels:
        source = "differentiated"
        channels["velocity"] = differentiate(channels["position"], float(np.median(np.diff(time))))
    taken = {TIME, *(joint_column(j, c) for j in joints for c in CHANNELS)}
    extra = {name: np.asarray(values, np.float64) for name, values in columns.items() if name not in taken}
    return Trajectory(time=time, joints=joints, extra=extra, velocity_source=source, **channels)


def _joint_order(table: RawTable) -> tuple[str, ...]:
    """The order in the file's metadata if it names the same joints, else that of the columns."""
    found = joints_of(table.columns)
    stated = tuple(table.metadata.get("joints", "").split(","))
    return stated if sorted(stated) == sorted(found) else found
