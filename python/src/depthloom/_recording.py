"""A recording's file: where its messages lie, and the messages.

It is an MCAP file of protobuf messages. A frame is some chunks of values and then one chunk with its `depthloom.Commit`; all of its messages have its time, and its
index in the source as `sequence`. What stands behind the last commit of a file that was not finished belongs to no frame.
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

#: The formats that are read: in 2, maps of floats are images; 4 and 5 are stored alike.
KNOWN_FORMATS = ("2", "4", "5")

_MAGIC = b"\x89MCAP0\r\n"
_COMMIT = "depthloom.Commit"
#: Opcode and length.
_RECORD_HEAD = struct.Struct("<BQ")
_PIECE = 1 << 20


class _Place(NamedTuple):
    """Where a chunk lies, and of what it holds messages."""

    offset: int
    time_ns: int
    channels: frozenset[int]


@dataclass
class _Index:
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    chunks: list[_Place] = field(default_factory=list)
    #: By name, where attachments lie.
    attachments: dict[str, int] = field(default_factory=dict)

    def is_commit(self, channel: int) -> bool:
        return self.schemas[self.channels[channel].schema_id].name == _COMMIT


class Commit(NamedTuple):
    """What closes a frame."""

    #: The stage run, as an index into those of the plan.
    run: int
    #: The frame's id.
    frame: str
    time_ns: int
    #: The frame's index in its source, which all of its messages have.
    sequence: int
    #: What failed on the frame.
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
                raise RecordingError(f"{path} holds no plan: it is not a recording of depthloom, or one that was cut at its beginning")
            if about.get("format") not in KNOWN_FORMATS:
                known = ", ".join(KNOWN_FORMATS)
                raise RecordingError(f"{path} is of format {about.get('format')}; this package knows {known}")
            #: Whether the run came to its end.
            self.is_whole = indexed is not None and "depthloom.ended" not in self._index.metadata
            #: The plan as JSON.
            self.plan = about["plan"]
            #: By topic in the plan, the channels that hold its values.
            self.channels: dict[str, list[int]] = {}
            for channel in self._index.channels.values():
                if "beside" not in channel.metadata:
                    topic = channel.metadata.get("topic_in_plan", channel.topic)
                    self.channels.setdefault(topic, []).append(channel.id)
            self._chunks: dict[tuple[int, int], list[int]] = {}
            for place in self._index.chunks:
                for of in place.channels:
                    self._chunks.setdefault((of, place.time_ns), []).append(place.offset)
            #: Of all frames, in the order in which they were written.
            self.commits = list(self._commits(file))
            times = Counter((commit.run, commit.time_ns) for commit in self.commits)
            #: The times that several frames of a stage have.
            self._ambiguous = {time_ns for (_, time_ns), count in times.items() if count > 1}

    def has(self, topic: str, time_ns: int, sequence: int) -> bool:
        """Whether a topic has messages on a frame."""
        is_there = any((of, time_ns) in self._chunks for of in self.channels.get(topic, ()))
        if is_there and time_ns in self._ambiguous:
            # The index knows times alone: of which frame the messages are, they say themselves.
            return any(True for _ in self.messages(topic, time_ns, sequence))
        return is_there

    def messages(self, topic: str, time_ns: int, sequence: int) -> Iterator[tuple[str, Any]]:
        """The messages of a topic on a frame, each with its schema's name."""
        wanted = [(of, offset) for of in self.channels.get(topic, ()) for offset in self._chunks.get((of, time_ns), ())]
        if not wanted:
            return
        with self.path.open("rb") as file:
            for of, offset in wanted:
                yield from (decoded for at, decoded in self._of_chunk(file, offset, of) if at.sequence == sequence)

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
            for of in filter(self._index.is_commit, place.channels):
                for at, (_, commit) in self._of_chunk(file, place.offset, of):
                    yield Commit(
                        run=commit.run,
                        frame=commit.frame,
                        time_ns=at.log_time,
                        sequence=at.sequence,
                        failures=tuple(failure.what for failure in commit.failures),
                    )

    def _of_chunk(self, file: IO[bytes], offset: int, channel: int) -> Iterator[tuple[Message, tuple[str, Any]]]:
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
        """The index of a file without an end, up to the last commit before which every byte is what was written."""
        index, kept = _Index(), 0
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
            wanted = opcode in _SCANNED
            payload, left = bytearray(), length
            while left and (piece := file.read(min(left, _PIECE))):
                crc, left = zlib.crc32(piece, crc), left - len(piece)
                if wanted:
                    payload += piece
            if left:
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
                        of = MessageIndex.read(stream).channel_id
                        place = index.chunks[-1]
                        index.chunks[-1] = place._replace(channels=place.channels | {of})
                        if index.is_commit(of):
                            if not self._closes(index, of, chunk, crc_before):
                                break
                            kept = len(index.chunks)
            except (McapError, ValueError, KeyError, struct.error):
                break
        del index.chunks[kept:]
        return index

    def _closes(self, index: _Index, channel: int, chunk: Chunk, crc_before: int) -> bool:
        """Whether a chunk is a commit of just the bytes that stand before it."""
        _, decode = self._decoder(index, channel)
        messages = [record for record in breakup_chunk(chunk, validate_crc=True) if isinstance(record, Message)]
        return bool(messages) and all(decode(message.data).crc32_before == crc_before for message in messages)


#: The records that a scan looks into.
_SCANNED = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.METADATA)


def _indexed(file: IO[bytes]) -> _Index | None:
    """The index that stands at the end of a file; `None` where there is none."""
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
                _Place(of.chunk_start_offset, of.message_start_time, frozenset(of.message_index_offsets))
                for of in sorted(summary.chunk_indexes, key=lambda of: of.chunk_start_offset)
            ],
            attachments={of.name: of.offset for of in summary.attachment_indexes},
        )
    except (McapError, ValueError, OSError, struct.error):
        return None
