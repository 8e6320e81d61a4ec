"""MCAP files with messages of ROS 1, ROS 2, protobuf or JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hqpipe.logs.imports.decoding import decoding
from hqpipe.logs.imports.packages import needed
from hqpipe.logs.imports.recording import ImportLogError, Recording
from hqpipe.logs.imports.ros_types import decoder, refusal, typestore_of
from hqpipe.logs.imports.stamps import recording_of
from hqpipe.logs.imports.topics import LARGEST_MESSAGE, Topic

_LARGEST_RECORD = 2**30  # bytes, also of an unpacked chunk; assumption: recorders write chunks of some megabytes
_FIX = "repair it with 'mcap recover', or copy it again"


class McapReader:
    """Numbers of every topic; images, point clouds and other blobs are not decoded."""

    suffixes = (".mcap",)
    extra = "ros"

    @staticmethod
    def read(path: Path) -> list[Recording]:
        """One recording with a stream per topic.

        Raises:
            ImportLogError: no MCAP file, damaged, truncated, or without a number; or a package is missing.
        """
        needed("mcap", "ros", path)
        channels = _Channels(path)
        with decoding(path, "an MCAP file", _FIX, streamed=True), path.open("rb") as stream:
            _read(stream, channels)
        return [recording_of(path, list(channels.topics.values()), list(channels.notes))]


class _Channels:
    """Decoders and topics, made when the first message of a channel comes; several channels may write one topic."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, Topic] = {}
        self.notes: dict[str, None] = {}
        self._decoders: dict[int, Callable[[bytes], Any] | None] = {}

    def wanted(self, schema: Any, channel: Any) -> bool:
        """Whether messages of a channel are decoded."""
        return self._decoder(schema, channel) is not None

    def take(self, schema: Any, channel: Any, message: Any) -> None:
        """Decode a message and add it to its topic."""
        decode = self._decoder(schema, channel)
        if decode is None:
            return
        topic = self.topics.setdefault(channel.topic, Topic(channel.topic))
        if len(message.data) > LARGEST_MESSAGE:
            topic.skip_large()
        else:
            topic.add(decode(message.data), message.log_time)

    def _decoder(self, schema: Any, channel: Any) -> Callable[[bytes], Any] | None:
        if channel.id not in self._decoders:
            decode, reason = _decoder_of(self.path, schema, channel.message_encoding)
            self._decoders[channel.id] = decode
            if decode is None:
                self.notes[f"{channel.topic}: not read ({reason})"] = None
        return self._decoders[channel.id]


def _read(stream: Any, channels: _Channels) -> None:
    from mcap.reader import NonSeekingReader, SeekingReader

    reader = SeekingReader(stream, validate_crcs=True, record_size_limit=_LARGEST_RECORD)
    summary = reader.get_summary()
    topics = None
    if summary is None or not summary.channels:  # then only the chunks themselves define the channels
        stream.seek(0)
        reader = NonSeekingReader(stream, validate_crcs=True, record_size_limit=_LARGEST_RECORD)
    else:
        _check_chunks(channels.path, summary.chunk_indexes)
        known = [(summary.schemas.get(channel.schema_id), channel) for channel in summary.channels.values()]
        topics = {channel.topic for schema, channel in known if channels.wanted(schema, channel)}
        if not topics:
            return
    for schema, channel, message in reader.iter_messages(topics, log_time_order=False):
        channels.take(schema, channel, message)


def _check_chunks(path: Path, chunks: list[Any]) -> None:
    size = path.stat().st_size
    for chunk in chunks:
        if chunk.uncompressed_size > _LARGEST_RECORD or chunk.chunk_length > size:
            sizes = f"{chunk.chunk_length} bytes, {chunk.uncompressed_size} unpacked"
            what = f"{path}: a chunk declares {sizes}; the file has {size}, and {_LARGEST_RECORD} are the most"
            raise ImportLogError(what, file=path, fix=_FIX)


def _decoder_of(path: Path, schema: Any, encoding: str) -> tuple[Callable[[bytes], Any] | None, str]:
    """Bytes → message; or None, and the reason."""
    if encoding == "json":
        return json.loads, ""
    kind = (encoding, schema.encoding if schema else "")
    if kind in (("ros1", "ros1msg"), ("cdr", "ros2msg"), ("cdr", "ros2idl")):
        needed("rosbags", "ros", path)
        store, name = typestore_of(schema.data.decode(), schema.name, idl=kind[1] == "ros2idl")
        reason = refusal(store, name)
        return (None, reason) if reason else (decoder(store, name, ros1=encoding == "ros1"), "")
    if kind == ("protobuf", "protobuf"):
        return _protobuf_decoder(path, schema), ""
    return None, f"messages in {encoding or 'no known encoding'} with a schema in {kind[1] or 'none'}"


def _protobuf_decoder(path: Path, schema: Any) -> Callable[[bytes], Any]:
    needed("google.protobuf", "ros", path)
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    files = {each.name: each for each in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file}

    def add(name: str) -> None:
        each = files.pop(name, None)
        if each is not None:
            for dependency in each.dependency:
                add(dependency)
            pool.Add(each)

    while files:
        add(next(iter(files)))
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name)).FromString
