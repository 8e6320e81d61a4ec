"""Recordings of ROS 1 (.bag) and ROS 2 (a folder with metadata.yaml, or a lone .db3), read without ROS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hqpipe.logs.imports.decoding import decoding
from hqpipe.logs.imports.packages import needed
from hqpipe.logs.imports.recording import Recording
from hqpipe.logs.imports.ros_types import refusal
from hqpipe.logs.imports.stamps import recording_of
from hqpipe.logs.imports.topics import LARGEST_MESSAGE, Topic

_MARK = "metadata.yaml"  # in every folder that ros2 bag writes


class RosbagReader:
    """Numbers of every topic; images, point clouds and other blobs are not decoded."""

    suffixes = (".bag", ".db3")
    extra = "ros"

    @staticmethod
    def claims_folder(folder: Path) -> bool:
        """Whether a folder is one recording of ROS 2."""
        return (folder / _MARK).is_file()

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """One recording with a stream per topic.

        Raises:
            ImportLogError: no bag, damaged, truncated, not indexed, or without a number; or a package is missing.
        """
        needed("rosbags", "ros", path)
        fix = (
            "rebuild its index with 'rosbag reindex'" if path.suffix == ".bag" else "rebuild it with 'ros2 bag reindex'"
        )
        topics: dict[str, Topic] = {}
        with decoding(path, "a bag of ROS", f"{fix}, or copy it again", streamed=True):
            notes = _read(path, topics)
        return [recording_of(path, list(topics.values()), notes)]


def _read(path: Path, topics: dict[str, Topic]) -> list[str]:
    """Fill `topics`; returns what was not read."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    notes: dict[str, None] = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as bag:
        wanted = []
        for connection in bag.connections:
            if reason := _reason(bag.typestore, connection):
                notes[f"{connection.topic}: not read ({reason})"] = None
            else:
                wanted.append(connection)
        for connection, log_time, data in bag.messages(wanted) if wanted else ():
            topic = topics.setdefault(connection.topic, Topic(connection.topic))
            if len(data) > LARGEST_MESSAGE:
                topic.skip_large()
            else:
                topic.add(bag.deserialize(data, connection.msgtype), log_time)
    return list(notes)


def _reason(store: Any, connection: Any) -> str | None:
    """Why the messages of a connection are not decoded, or None."""
    try:
        return refusal(store, connection.msgtype)
    except KeyError:
        return f"the bag does not define {connection.msgtype}"
