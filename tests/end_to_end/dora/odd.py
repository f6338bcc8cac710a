"""A node `process` that refuses some depths."""

import zlib

import depthloom


@depthloom.node(inputs={"depth": "depth"}, outputs={"depth": "depth"})
def odd(depth):
    if zlib.crc32(depth.tobytes()) % 3 == 0:
        raise ValueError("these depths are odd")
    return depth


depthloom.serve(odd)
