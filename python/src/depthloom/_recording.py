"""The file of a recording: its index, and its messages.

It is an MCAP file of protobuf messages. A frame consists of chunks of values and a final chunk with its `depthloom.Commit`. All messages of a frame have its time, and
its index in the source as `sequence`. In an unfinished file, data after the last commit do not belong to a frame.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Message, MessageIndex, Metadata, Schema
from mcap.stream_reader import breakup_chunk
from mcap.well_known import MessageEncoding
from mcap_protobuf.decoder import DecoderFactory

from ._errors import RecordingError

#: The format that is read.
FORMAT = "10"

_MAGIC = b"\x89MCAP0\r\n"
_COMMIT = "depthloom.Commit"
#: Opcode and length.
_RECORD_HEAD = struct.Struct("<BQ")
_PIECE = 1 << 20


class _Place(NamedTuple):
    """The position of a chunk, and the channels of its messages."""

    offset: int
    time_ns: int
    channels: frozenset[int]


@dataclass
class _Index:
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    chunks: list[_Place] = field(default_factory=list)
    #: The offsets of attachments, by name.
    attachments: dict[str, int] = field(default_factory=dict)

    def is_commit(self, channel: int) -> bool:
        return self.schemas[self.channels[channel].schema_id].name == _COMMIT


class Commit(NamedTuple):
    """The record that completes a frame."""

    #: The stage run, as an index into those of the plan.
    run: int
    #: The frame's id.
    frame: str
    time_ns: int
    #: The frame's index in its source, which all of its messages contain.
    sequence: int
    #: The failures on the frame.
    failures: tuple[str, ...]


class Recording:
    """A recording, opened by its index; its file is open only while something is read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._decoders = DecoderFactory()
        with path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise RecordingError(f"{path} is not a recording")
            indexed = _indexed(file)
            self._index = indexed or self._scanned(file)
            about = self._index.metadata.get("depthloom")
            if about is None:
                raise RecordingError(f"{path} does not contain a plan: it is not a recording of depthloom, or it was truncated near its start")
            if about.get("format") != FORMAT:
                raise RecordingError(f"{path} has recording format {about.get('format')}, but this version of depthloom reads format {FORMAT} only")
            #: Whether the run finished.
            self.is_complete = indexed is not None and "depthloom.ended" not in self._index.metadata
            #: The plan as JSON.
            self.plan = about["plan"]
            #: The channels with the values of a topic, by topic in the plan.
            self.channels: dict[str, list[int]] = {}
            for channel in self._index.channels.values():
                if "beside" not in channel.metadata:
                    topic = channel.metadata.get("topic_in_plan", channel.topic)
                    self.channels.setdefault(topic, []).append(channel.id)
            self._chunks: dict[tuple[int, int], list[int]] = {}
            for place in self._index.chunks:
                for channel_id in place.channels:
                    self._chunks.setdefault((channel_id, place.time_ns), []).append(place.offset)
            #: The commits of all frames, in the order in which they were written.
            self.commits = list(self._commits(file))
            times = Counter((commit.run, commit.time_ns) for commit in self.commits)
            #: Times that several frames of a stage share.
            self._ambiguous = {time_ns for (_, time_ns), count in times.items() if count > 1}

    def has(self, topic: str, time_ns: int, sequence: int) -> bool:
        """Whether a topic has messages on a frame."""
        is_there = any((channel, time_ns) in self._chunks for channel in self.channels.get(topic, ()))
        if is_there and time_ns in self._ambiguous:
            # The index contains only times; the messages themselves contain the frame's index.
            return any(True for _ in self.messages(topic, time_ns, sequence))
        return is_there

    def messages(self, topic: str, time_ns: int, sequence: int) -> Iterator[tuple[str, Any]]:
        """The messages of a topic on a frame, each with its schema's name."""
        chunks = [(channel, offset) for channel in self.channels.get(topic, ()) for offset in self._chunks.get((channel, time_ns), ())]
        if not chunks:
            return
        with self.path.open("rb") as file:
            for channel, offset in chunks:
                yield from (decoded for message, decoded in self._messages_in(file, offset, channel) if message.sequence == sequence)

    def attachment(self, name: str) -> bytes | None:
        """An attached file."""
        offset = self._index.attachments.get(name)
        if offset is None:
            return None
        with self.path.open("rb") as file:
            file.seek(offset + _RECORD_HEAD.size)
            data: bytes = Attachment.read(ReadDataStream(file)).data
        return data

    def _commits(self, file: IO[bytes]) -> Iterator[Commit]:
        for place in self._index.chunks:
            for channel in filter(self._index.is_commit, place.channels):
                for message, (_, commit) in self._messages_in(file, place.offset, channel):
                    yield Commit(
                        run=commit.run,
                        frame=commit.frame,
                        time_ns=message.log_time,
                        sequence=message.sequence,
                        failures=tuple(failure.what for failure in commit.failures),
                    )

    def _messages_in(self, file: IO[bytes], offset: int, channel: int) -> Iterator[tuple[Message, tuple[str, Any]]]:
        file.seek(offset + _RECORD_HEAD.size)
        try:
            chunk = Chunk.read(ReadDataStream(file))
            records = breakup_chunk(chunk, validate_crc=True)
        except (McapError, ValueError, struct.error) as error:
            raise RecordingError(f"{self.path} is damaged at byte {offset}: {error}") from error
        schema, decode = self._decoder(self._index, channel)
        for record in records:
            if isinstance(record, Message) and record.channel_id == channel:
                yield record, (schema, decode(record.data))

    def _decoder(self, index: _Index, channel: int) -> tuple[str, Callable[[bytes], Any]]:
        schema = index.schemas[index.channels[channel].schema_id]
        decode = self._decoders.decoder_for(MessageEncoding.Protobuf, schema)
        if decode is None:
            raise RecordingError(f"{self.path}: messages of {schema.name} are not protobuf")
        return schema.name, decode

    def _scanned(self, file: IO[bytes]) -> _Index:
        """The index of an unfinished file, up to the last commit whose checksum matches all bytes before it."""
        index, complete = _Index(), 0
        # CRC-32 of all bytes so far, and of all before the last chunk.
        crc = crc_before = zlib.crc32(_MAGIC)
        file.seek(len(_MAGIC))
        chunk: Chunk | None = None
        while len(head := file.read(_RECORD_HEAD.size)) == _RECORD_HEAD.size:
            offset = file.tell() - len(head)
            opcode, length = _RECORD_HEAD.unpack(head)
            if opcode == Opcode.CHUNK:
                crc_before = crc
            crc = zlib.crc32(head, crc)
            is_scanned = opcode in _SCANNED
            payload, remaining = bytearray(), length
            while remaining and (piece := file.read(min(remaining, _PIECE))):
                crc, remaining = zlib.crc32(piece, crc), remaining - len(piece)
                if is_scanned:
                    payload += piece
            if remaining:
                break
            stream = ReadDataStream(BytesIO(payload))
            try:
                match opcode:
                    case Opcode.SCHEMA:
                        schema = Schema.read(stream)
                        index.schemas[schema.id] = schema
                    case Opcode.CHANNEL:
                        channel = Channel.read(stream)
                        index.channels[channel.id] = channel
                    case Opcode.METADATA:
                        metadata = Metadata.read(stream)
                        index.metadata.setdefault(metadata.name, metadata.metadata)
                    case Opcode.CHUNK:
                        chunk = Chunk.read(stream)
                        index.chunks.append(_Place(offset, chunk.message_start_time, frozenset()))
                    case Opcode.MESSAGE_INDEX if chunk is not None:
                        indexed = MessageIndex.read(stream).channel_id
                        place = index.chunks[-1]
                        index.chunks[-1] = place._replace(channels=place.channels | {indexed})
                        if index.is_commit(indexed):
                            if not self._closes(index, indexed, chunk, crc_before):
                                break
                            complete = len(index.chunks)
            except (McapError, ValueError, KeyError, struct.error):
                break
        del index.chunks[complete:]
        return index

    def _closes(self, index: _Index, channel: int, chunk: Chunk, crc_before: int) -> bool:
        """Whether a chunk is a commit whose checksum matches the bytes before it."""
        _, decode = self._decoder(index, channel)
        messages = [record for record in breakup_chunk(chunk, validate_crc=True) if isinstance(record, Message)]
        return bool(messages) and all(decode(message.data).crc32_before == crc_before for message in messages)


#: The records that a scan looks into.
_SCANNED = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.METADATA)


def _indexed(file: IO[bytes]) -> _Index | None:
    """The index at the end of a finished file; `None` without an index."""
    try:
        file.seek(-len(_MAGIC), 2)
        if file.read() != _MAGIC:
            return None
        file.seek(0)
        reader = SeekingReader(file)
        summary = reader.get_summary()
        if summary is None:
            return None
        return _Index(
            channels=summary.channels,
            schemas=summary.schemas,
            metadata={metadata.name: metadata.metadata for metadata in reader.iter_metadata()},
            chunks=[
                _Place(chunk.chunk_start_offset, chunk.message_start_time, frozenset(chunk.message_index_offsets))
                for chunk in sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
            ],
            attachments={attachment.name: attachment.offset for attachment in summary.attachment_indexes},
        )
    except (McapError, ValueError, OSError, struct.error):
        return None
