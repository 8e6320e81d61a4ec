"""A trial as MCAP: ROS 2 messages in CDR with their definitions, as Foxglove and PlotJuggler open them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.errors import UsageError
from hqpipe.logs.columns import unit_of
from hqpipe.logs.export.ros_topics import Topic, topics
from hqpipe.logs.trajectory import LogSet, Trial

EPOCH_S = 1_000_000_000
"""Unix time of the first sample of every trial, s: 2001-09-09 01:46:40 UTC. The logs hold no date; 0 means "no time" in ROS."""
METADATA = "hqpipe-log"
"""Name of the record that holds what the messages do not: trial, split, units, columns of each topic."""
_NS = 1_000_000_000


def write_mcap(path: Path, log_set: LogSet, trial: Trial) -> None:
    """Write one trial; what each topic holds is in `hqpipe.logs.export.ros_topics`.

    Args:
        path: of the new file. log_set: that the trial belongs to. trial: whose messages are written in the order of time.

    Raises:
        UsageError: a package of the extra `ros` is not installed.
    """
    writer_class, store = _packages()
    found = topics(trial.trajectory)
    stamps = EPOCH_S * _NS + np.round(trial.trajectory.time * _NS).astype(np.int64)
    with path.open("wb") as stream:
        writer = writer_class(stream)
        writer.start(profile="ros2", library="hqpipe")
        schemas: dict[str, int] = {}
        for kind in dict.fromkeys(topic.kind for topic in found):
            definition = store.generate_msgdef(kind, ros_version=2)[0].encode()
            schemas[kind] = writer.register_schema(kind, "ros2msg", definition)
        channels = [writer.register_channel(topic.name, "cdr", schemas[topic.kind]) for topic in found]
        for row, stamp in enumerate(stamps.tolist()):
            for topic, channel in zip(found, channels, strict=True):
                writer.add_message(
                    channel, log_time=stamp, publish_time=stamp, sequence=row, data=_encoded(store, topic, stamp, row)
                )
        writer.add_metadata(METADATA, _metadata(log_set, trial, found))
        writer.finish()


def _packages() -> tuple[Any, Any]:
    """The class that writes MCAP, and the types of ROS 2 messages."""
    try:
        from mcap.writer import Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise UsageError(
            f"MCAP cannot be written without the package {error.name}",
            field="--format",
            fix="pip install 'hqpipe[ros]'",
        ) from error
    return Writer, get_typestore(Stores.ROS2_HUMBLE)


def _encoded(store: Any, topic: Topic, stamp: int, row: int) -> bytes:
    types = store.types
    seconds, nanoseconds = divmod(stamp, _NS)
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](seconds, nanoseconds), topic.frame)
    return bytes(store.serialize_cdr(topic.message(types, header, row), topic.kind))


def _metadata(log_set: LogSet, trial: Trial, found: list[Topic]) -> dict[str, str]:
    columns = [name for topic in found for name in topic.columns]
    facts = {
        "format": log_set.format,
        "trial": trial.file,
        "robot": log_set.robot,
        "control_mode": log_set.control_mode,
        "effort_source": log_set.effort_source,
        "command": json.dumps(trial.command, sort_keys=True) if trial.command else None,
        "log_set_sha256": log_set.sha256,
        "epoch_s": str(EPOCH_S),
        "topics": json.dumps({topic.name: list(topic.columns) for topic in found}, ensure_ascii=False),
        "units": json.dumps({name: unit_of(name) for name in columns if unit_of(name)}, ensure_ascii=False),
    }
    return {key: value for key, value in facts.items() if value is not None}
