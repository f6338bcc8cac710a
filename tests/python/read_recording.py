#!/usr/bin/env python3
"""Reads a recording as a stranger would: Python's `mcap` and `mcap-protobuf-support`, no code of depthloom's.

    read_recording.py RECORDING [--messages | --unfinished]

Prints one JSON object: of each topic its schema, how many messages it has, its first and last time, and a CRC-32 of what
the messages decode to, one after the other: of images and maps all pixels (or the compressed file), of the rest all texts
and numbers, little-endian, in the order of the fields. Of maps of floats also the sum of its finite numbers and how many are NaN and
infinite. `depthloom_recording::digest` computes the same object; tests compare the two.
`--messages` adds the messages themselves, pixels left out (of 16UC1 the smallest and largest number), and the names of attachments
and metadata. `--unfinished` counts instead the messages that are read of a file that has no end: `by_default`, and `from_start`.

Every checksum of the file is verified, once reading from start to end and once through the summary's indexes, and the two
ways must give the same. `requirements.txt` names the packages.
"""
import array
import json
import math
import struct
import sys
import zlib

import numpy as np
import zstandard

from google.protobuf.json_format import MessageToDict
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

CURVE_NUMBERS = ("loss", "validation", "learning_rate")
FORMS = {"foxglove.RawImage", "depthloom.FloatMap"}


def floats(message):
    """The samples of a depthloom.FloatMap, which has them as they are or as the differences of their bits."""
    count = message.width * message.height
    if message.data:
        samples = np.frombuffer(message.data, "<f4")
    else:
        codes = np.frombuffer(zstandard.decompress(message.codes), np.uint8)
        classes, rest = codes[: (count + 3) // 4], codes[(count + 3) // 4 :]
        classes = (classes[:, None] >> [0, 2, 4, 6] & 3).ravel()[:count]
        few, many = (classes == 2).sum(), (classes == 3).sum()
        middles = (rest[: (few + 1) // 2, None] >> [0, 4] & 15).ravel()[:few]
        lower, upper = rest[(few + 1) // 2 :].reshape(2, many)
        differences = np.zeros(count, np.uint32)
        differences[classes > 0] = np.frombuffer(message.lows, "<u2")
        differences[classes == 2] |= middles.astype(np.uint32) << 16
        differences[classes == 3] |= (upper.astype(np.uint32) << 8 | lower) << 16
        samples = np.cumsum(differences >> 1 ^ -(differences & 1), dtype=np.uint32).view(np.float32)
    return samples.reshape(message.height, message.width)


def content(schema, message):
    """What a decoded message holds, as bytes."""
    if schema in ("foxglove.RawImage", "foxglove.CompressedImage", "foxglove.PointCloud"):
        return message.data
    if schema == "depthloom.FloatMap":
        return floats(message).astype("<f4").tobytes() + message.inverse
    if schema == "foxglove.CameraCalibration":
        numbers = [*message.D, *message.K, *message.R, *message.P, message.baseline_m]
        # Absent where it is 0.
        numbers += [message.doffs_px] if getattr(message, "doffs_px", 0.0) else []
        return struct.pack(f"<II{len(numbers)}d", message.width, message.height, *numbers)
    if schema == "foxglove.FrameTransform":
        at, turned = message.translation, message.rotation
        numbers = struct.pack("<7d", at.x, at.y, at.z, turned.x, turned.y, turned.z, turned.w)
        return (message.parent_frame_id + message.child_frame_id).encode() + numbers
    if schema == "depthloom.Score":
        texts = (message.frame + message.set + message.zone).encode()
        numbers = [field.name for field in message.DESCRIPTOR.fields if field.type == field.TYPE_DOUBLE]
        told = [struct.pack("<3Q", message.pixels, message.truth, message.valid)]
        told += [struct.pack("<d?", getattr(message, name), message.HasField(name)) for name in numbers]
        return texts + b"".join(told)
    if schema == "depthloom.Commit":
        told = [struct.pack("<IQ", message.run, message.index), (message.frame + message.source_key).encode()]
        told += [struct.pack("<I", of.node) + of.key.encode() for of in message.keys]
        told += [struct.pack("<?I", of.HasField("node"), of.node) + of.what.encode() for of in message.failures]
        told += [struct.pack("<I", message.crc32_before)]
        return b"".join(told)
    if schema == "depthloom.CurvePoint":
        numbers = (getattr(message, number) if message.HasField(number) else 0.0 for number in CURVE_NUMBERS)
        present = (message.HasField(number) for number in CURVE_NUMBERS)
        return struct.pack("<Q3d3?", message.step, *numbers, *present)
    raise SystemExit(f"read_recording.py: {schema} is not a schema of a recording")


def add_numbers(topic, data):
    numbers = array.array("f", data)
    if sys.byteorder == "big":
        numbers.byteswap()
    total, nan, infinite = topic.get("sum", 0.0), 0, 0
    # One after the other: `sum` compensates for rounding in some versions and not in others.
    for number in numbers:
        if math.isfinite(number):
            total += number
        elif number != number:
            nan += 1
        else:
            infinite += 1
    topic.update(sum=total, nan=topic.get("nan", 0) + nan, infinite=topic.get("infinite", 0) + infinite)


def read(reader, keep):
    topics = {}
    for schema, channel, record, message in reader.iter_decoded_messages():
        first = dict(schema=schema.name, count=0, first_ns=record.log_time, crc32=0)
        topic = topics.setdefault(channel.topic, first)
        # Disparities may have two forms.
        assert {topic["schema"], schema.name} in ({schema.name}, FORMS), f"{channel.topic} has two schemas"
        assert record.log_time == record.publish_time, f"{channel.topic} has two times"
        topic.update(count=topic["count"] + 1, last_ns=record.log_time)
        topic["crc32"] = zlib.crc32(content(schema.name, message), topic["crc32"])
        if schema.name == "foxglove.RawImage":
            assert len(message.data) == message.step * message.height, f"{channel.topic} has rows that are cut"
            if message.encoding == "32FC1":
                add_numbers(topic, message.data)
        if schema.name == "depthloom.FloatMap":
            add_numbers(topic, floats(message).astype("<f4").tobytes())
        if keep:
            told = MessageToDict(message, preserving_proto_field_name=True)
            for name in ("data", "codes", "lows", "inverse"):
                told.pop(name, None)
            if schema.name == "foxglove.RawImage" and message.encoding == "16UC1":
                # As the encoding says: 16 bits without a sign.
                numbers = struct.unpack(f"<{message.width * message.height}H", message.data)
                told.update(smallest=min(numbers), largest=max(numbers))
            topic.setdefault("messages", []).append(told)
    for topic in topics.values():
        if "sum" in topic:
            # As text: readers of JSON do not agree on the last bit of a number.
            topic["sum"] = f"{topic['sum']:.9f}"
    return topics


def count(messages):
    """How many messages come before the end, or before an error."""
    counted = 0
    try:
        for _ in messages:
            counted += 1
    except McapError:
        pass
    return counted


def main():
    arguments = [argument for argument in sys.argv[1:] if not argument.startswith("--")]
    keep = "--messages" in sys.argv
    if len(arguments) != 1:
        sys.exit(__doc__)
    if "--unfinished" in sys.argv:
        with open(arguments[0], "rb") as file:
            by_default = count(make_reader(file).iter_messages())
        with open(arguments[0], "rb") as file:
            from_start = count(NonSeekingReader(file).iter_messages(log_time_order=False))
        print(json.dumps(dict(by_default=by_default, from_start=from_start)))
        return
    with open(arguments[0], "rb") as file:
        from_start = read(NonSeekingReader(file, validate_crcs=True, decoder_factories=[DecoderFactory()]), keep)
    with open(arguments[0], "rb") as file:
        reader = SeekingReader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        topics = read(reader, keep)
        assert from_start == topics, "the indexes lead to other messages than there are"
        summary = reader.get_summary()
        counted = {name: 0 for name in topics}
        for number, channel in summary.channels.items():
            topic = topics[channel.topic]
            counted[channel.topic] += summary.statistics.channel_message_counts[number]
            last = reader.iter_messages(topics=[channel.topic], start_time=topic["last_ns"])
            assert {found.topic for _, found, _ in last} == {channel.topic}, f"{channel.topic} cannot be sought"
        for name, topic in topics.items():
            assert counted[name] == topic["count"], f"{name}: the statistics count other messages"
        attachments = {of.name: len(of.data) for of in reader.iter_attachments()}
        metadata = [of.name for of in reader.iter_metadata()]
    told = dict(topics=topics)
    if keep:
        told.update(attachments=attachments, metadata=metadata)
    print(json.dumps(told, indent=1, allow_nan=False))


if __name__ == "__main__":
    main()
