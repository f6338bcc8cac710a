#!/usr/bin/env python3
"""Compares exported files with the recording they come from, read by other people's programs: `mcap`, OpenCV and NumPy.

    check_export.py RECORDING EXPORT

Every file of EXPORT/TOPIC/FRAME.{png,npy,pfm,ply,pcd} and of EXPORT/TOPIC.turbo/FRAME.png is read and compared with the message of that
topic on that frame. PNG and PFM are read by OpenCV, arrays by `numpy.load`; PLY and PCD as their headers say, by NumPy's structured types.
Colours are those of 0..40 by OpenCV's map; points are those from 2 to 30 m. Prints how many files there were of each format.
"""
import collections
import json
import pathlib
import sys

import cv2
import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from read_recording import floats as samples

if len(sys.argv) != 3:
    sys.exit(__doc__)
recording, export = map(pathlib.Path, sys.argv[1:])

with recording.open("rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    decoded = reader.iter_decoded_messages()
    # Viewers expect images and calibrations on other topics; a message's metadata names the topic in the plan.
    named = [(of.metadata.get("topic_in_plan", of.topic), at.log_time, message) for _, of, at, message in decoded]
    messages = [of for of in named if "/view/" not in of[0]]
    [about] = [record.metadata for record in reader.iter_metadata() if record.name == "depthloom"]
ids = {at: message.frame for topic, at, message in messages if topic.endswith("/commit")}
# Estimated and ground-truth disparities are both 16UC1; the plan distinguishes them.
outputs = [out for run in json.loads(about["plan"])["runs"] for of in [run["source"], *run["nodes"]] for out in of["outputs"]]
types = {out["topic"]: out["type"] for out in outputs}


def floats(topic, message):
    """A map in its own unit, NaN = none; what it is times for 16 bits."""
    shape = message.height, message.width
    if types[topic] in ("depth", "weight"):
        return samples(message), 65535 if types[topic] == "weight" else 256
    fixed = np.frombuffer(message.data, "<u2").reshape(shape)
    known = fixed / 256 if types[topic] == "ground-truth-disparity" else fixed / 16 + message.min_disparity_px - 1
    return np.where(fixed > 0, known, np.nan).astype(np.float32), 256


def pixels(message):
    shape = (message.height, message.width, 3) if message.encoding == "rgb8" else (message.height, message.width)
    return np.frombuffer(message.data, np.uint8).reshape(shape)


def calibration(at):
    [found] = [message for topic, time, message in messages if time == at and types.get(topic) == "calibration"]
    return found.K[0], found.K[2], found.K[5], found.baseline_m


def points(topic, at, values):
    """x, y, z and the colours of the pixels from 2 to 30 m."""
    f, cx, cy, baseline = calibration(at)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = values.astype(np.float64) if types[topic] == "depth" else f * baseline / values.astype(np.float64)
        row, column = np.nonzero((z >= 2) & (z <= 30))
    z = z[row, column]
    [left] = [message for of, time, message in messages if time == at and of.endswith("/source/left")]
    return np.stack([(column - cx) * z / f, (row - cy) * z / f, z], axis=1), pixels(left)[row, column]


def structured(file, last):
    """The header's lines up to the one that starts with `last`, and the bytes behind."""
    data = file.read_bytes()
    end = data.index(b"\n", data.index(last.encode())) + 1
    return [line.split() for line in data[:end].decode().splitlines()], data[end:]


def ply(file):
    head, data = structured(file, "end_header")
    assert head[:2] == [["ply"], ["format", "binary_little_endian", "1.0"]]
    kinds = {"float": "<f4", "uchar": "u1"}
    vertex = np.frombuffer(data, [(line[2], kinds[line[1]]) for line in head if line[0] == "property"])
    assert head[2] == ["element", "vertex", str(len(vertex))]
    return np.stack([vertex[axis] for axis in "xyz"], axis=1), np.stack([vertex[of] for of in ("red", "green", "blue")], axis=1)


def pcd(file):
    head, data = structured(file, "DATA binary")
    head = {line[0]: line[1:] for line in head if line[0] != "#"}
    fields = zip(head["FIELDS"], head["TYPE"], head["SIZE"], head["COUNT"])
    cloud = np.frombuffer(data, [(name, f"<{kind.lower()}{size}") for name, kind, size, count in fields if count == "1"])
    assert head["POINTS"] == head["WIDTH"] == [str(len(cloud))] and head["HEIGHT"] == ["1"]
    packed = np.ascontiguousarray(cloud["rgb"]).view("<u4")
    return np.stack([cloud[axis] for axis in "xyz"], axis=1), np.stack([packed >> 16 & 255, packed >> 8 & 255, packed & 255], axis=1)


def same(file, found, wanted):
    assert found.shape == wanted.shape and found.dtype == wanted.dtype, f"{file}: {found.shape} {found.dtype}"
    assert np.array_equal(found, wanted, equal_nan=found.dtype.kind == "f"), f"{file} holds other numbers"


def check(file, topic, at, message):
    ending = file.suffix[1:]
    if types[topic] in ("image", "mask"):
        wanted = pixels(message)
        if ending == "npy":
            return same(file, np.load(file), wanted if types[topic] == "image" else wanted > 0)
        found = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        return same(file, found[:, :, ::-1] if found.ndim == 3 else found, wanted)
    values, scale = floats(topic, message)
    known = ~np.isnan(values)
    if ending == "npy":
        same(file, np.load(file), values)
    elif ending == "pfm":
        same(file, cv2.imread(str(file), cv2.IMREAD_UNCHANGED), np.where(known, values, np.float32(np.inf)))
    elif ending in ("ply", "pcd"):
        (found, colours), (wanted, wanted_colours) = (ply if ending == "ply" else pcd)(file), points(topic, at, values)
        assert len(wanted) > 100, f"{file}: {len(wanted)} points are too few to tell"
        assert np.abs(found - wanted).max() <= 1e-5, f"{file} holds other points"
        assert np.array_equal(colours, wanted_colours), f"{file} holds other colours"
    else:
        scaled = np.floor(np.where(known, values, 0).astype(np.float64) * scale + 0.5)
        wanted = np.where(known & (values >= 0), np.clip(scaled, 1, 65535), 0).astype(np.uint16)
        same(file, cv2.imread(str(file), cv2.IMREAD_UNCHANGED), wanted)


def check_colours(file, topic, message):
    values, _ = floats(topic, message)
    steps = np.floor(np.clip(np.nan_to_num(values.astype(np.float64)) / 40, 0, 1) * 255 + 0.5).astype(np.uint8)
    wanted = np.where(np.isnan(values)[:, :, None], 0, cv2.applyColorMap(steps, cv2.COLORMAP_TURBO)).astype(np.uint8)
    same(file, cv2.imread(str(file), cv2.IMREAD_UNCHANGED), wanted)


counts, seen = collections.Counter(), set()
for topic, at, message in messages:
    if at not in ids or topic not in types:
        continue
    for file in sorted((export / topic[1:]).glob(f"{ids[at]}.*")):
        check(file, topic, at, message)
        counts[file.suffix[1:]] += 1
        seen.add(file)
    coloured = export / f"{topic[1:]}.turbo" / f"{ids[at]}.png"
    if coloured.exists():
        check_colours(coloured, topic, message)
        counts["turbo"] += 1
        seen.add(coloured)
others = {file for file in export.rglob("*") if file.is_file() and not file.name.startswith(".")} - seen
assert not others, f"files that belong to no message: {sorted(others)}"
print(json.dumps(counts))
