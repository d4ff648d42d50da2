"""One cloud of points in every format: bytes put together by other code than the library's."""

import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from support.capture import FIRST_SECOND

Columns = Mapping[str, np.ndarray]
_PLY = {"f4": "float", "f8": "double", "u1": "uchar", "u2": "ushort", "u4": "uint", "i4": "int"}
_FIELD = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def rows_of(columns: Columns, order: str = "<", gap: int = 0) -> np.ndarray:
    """Points as packed rows, with bytes of no use behind each of them."""
    kind = [(name, order + values.dtype.str[1:]) for name, values in columns.items()]
    if gap:
        kind.append(("gap", f"V{gap}"))
    rows = np.zeros(len(next(iter(columns.values()))), kind)
    for name, values in columns.items():
        rows[name] = values
    return rows


def lines_of(columns: Columns) -> bytes:
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return "".join(" ".join(repr(value) for value in row) + "\n" for row in rows).encode()


def lzf(data: bytes) -> bytes:
    """Pack as LZF: copies of what came four bytes before, and literal runs."""
    packed, at, literal = bytearray(), 0, bytearray()

    def flush() -> None:
        for k in range(0, len(literal), 32):
            packed.append(len(literal[k : k + 32]) - 1)
            packed.extend(literal[k : k + 32])
        literal.clear()

    while at < len(data):
        length = 0
        while (
            at >= 4
            and length < 264
            and data[at + length : at + length + 1]
            == data[at + length - 4 : at + length - 3]
            != b""
        ):
            length += 1
        if length < 3:
            literal.append(data[at])
            at += 1
            continue
        flush()
        at += length
        packed.extend([(length - 2) << 5] if length < 9 else [7 << 5, length - 9])
        packed.append(3)
    flush()
    return bytes(packed)


def pcd(columns: Columns, layout: str = "binary", *, points: int | None = None) -> bytes:
    kinds = [values.dtype.str[1:] for values in columns.values()]
    number = len(next(iter(columns.values())))
    head = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(columns)}",
        f"SIZE {' '.join(kind[1:] for kind in kinds)}",
        f"TYPE {' '.join(kind[0].upper() for kind in kinds)}",
        f"COUNT {' '.join('1' for _ in kinds)}",
        f"WIDTH {number}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {number if points is None else points}",
        f"DATA {layout}",
    ]
    if layout == "ascii":
        body = lines_of(columns)
    elif layout == "binary":
        body = rows_of(columns).tobytes()
    else:
        by_field = b"".join(np.ascontiguousarray(values).tobytes() for values in columns.values())
        packed = lzf(by_field)
        body = struct.pack("<II", len(packed), len(by_field)) + packed
    return ("\n".join(head) + "\n").encode() + body


def ply(
    columns: Columns, layout: str = "binary_little_endian", *, points: int | None = None
) -> bytes:
    number = len(next(iter(columns.values()))) if points is None else points
    head = ["ply", f"format {layout} 1.0", "comment somebody", f"element vertex {number}"]
    head += [f"property {_PLY[v.dtype.str[1:]]} {name}" for name, v in columns.items()]
    head += ["element face 0", "property list uchar int vertex_indices", "end_header"]
    order = ">" if layout == "binary_big_endian" else "<"
    body = lines_of(columns) if layout == "ascii" else rows_of(columns, order).tobytes()
    return ("\n".join(head) + "\n").encode() + body


def pointcloud2(
    columns: Columns,
    *,
    ros1: bool,
    height: int = 1,
    big: bool = False,
    second: int = 0,
    gap: int = 3,
) -> bytes:
    """A message of the type sensor_msgs/PointCloud2, with gaps between points and rows."""
    out = bytearray(b"" if ros1 else b"\0\1\0\0")

    def put(form: str, value: int) -> None:
        if not ros1:
            out.extend(bytes(-(len(out) - 4) % struct.calcsize(form)))
        out.extend(struct.pack("<" + form, value))

    def text(value: str) -> None:
        content = value.encode() + (b"" if ros1 else b"\0")
        put("I", len(content))
        out.extend(content)

    if ros1:
        put("I", 7)
    put("I", FIRST_SECOND + second)
    put("I", 100_000_000)
    text("velodyne")
    rows = rows_of(columns, ">" if big else "<", gap)
    width = len(rows) // height
    put("I", height)
    put("I", width)
    put("I", len(columns))
    for name, values in columns.items():
        text(name)
        put("I", rows.dtype.fields[name][1])
        put("B", _FIELD[values.dtype.str[1:]])
        put("I", 1)
    put("B", int(big))
    lines = [row.tobytes() + bytes(5) for row in rows.reshape(height, width)]
    put("I", rows.dtype.itemsize)
    put("I", len(lines[0]))
    put("I", sum(map(len, lines)))
    out.extend(b"".join(lines))
    put("B", 1)
    return bytes(out)


def write_bag(path: Path, messages: list[bytes], *, ros1: bool, storage: str = "MCAP") -> Path:
    """A bag of such messages, written by the package rosbags; a ROS 2 bag is a folder."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        writer = Writer1(path)
    else:
        writer = Writer2(path, version=9, storage_plugin=StoragePlugin[storage])
    with writer:
        connection = writer.add_connection(
            "/velodyne_points", "sensor_msgs/msg/PointCloud2", typestore=store
        )
        for number, message in enumerate(messages):
            writer.write(connection, 10**9 * (number + 1), message)
    return path
