"""Points as a bag of ROS 2 (mcap): one message sensor_msgs/PointCloud2 a rotation."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.calibration.rings import orders
from velocal.io.output import new_file, writing
from velocal.scanner.models import scanner_named
from velocal.scanner.parameters import nominal

#: As the drivers of ROS name it.
TOPIC = "/velodyne_points"
#: Name of the frame of the points, by their axes.
FRAME_IDS = {"ros": "velodyne", "velocal": "velodyne_velocal"}
#: Fields as those of the ROS driver; `time` is counted from the stamp of the message.
POINT = {"x": "<f4", "y": "<f4", "z": "<f4", "intensity": "<f4", "ring": "<u2", "time": "<f4"}
_SHIFT = {"shift": "<f4"}
#: Numbers of `sensor_msgs/PointField` for types.
_KINDS = {"<u2": 4, "<f4": 7}


@contextmanager
def bag(path: Path, names: Sequence[str], facts: Mapping[str, Any]) -> Iterator[Any]:
    """Write columns of points into a bag, as the other formats of `velocal.points.files`.

    `ring` numbers the lasers from the lowest up, by their nominal vertical angles. Messages are
    stamped with the time of their first point since the first packet, or with 0 without a clock.

    Parameters
    ----------
    path : Path
    names : sequence of str
        Fields of the points.
    facts : mapping
        With `scanner` and `frame`.

    Yields
    ------
    write : callable
        Takes columns; a rotation may come in several parts.
    """
    # Half a second that nobody else needs.
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    layout = {**POINT, **(_SHIFT if "shift" in names else {})}
    row = np.dtype(list(layout.items()))
    offsets = np.cumsum([0, *(np.dtype(each).itemsize for each in layout.values())])
    ring_of = rings(facts["scanner"])
    frame_id = FRAME_IDS[facts.get("frame", "velocal")]
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/PointCloud2"
    parts: list[NDArray[Any]] = []
    times: list[NDArray[np.float64]] = []
    current = -1

    def message() -> tuple[int, memoryview | bytes]:
        """The rotation that is complete."""
        points, time_s = np.concatenate(parts), np.concatenate(times)
        begin_s = float(time_s[0]) if np.isfinite(time_s[0]) else 0.0
        stamp_ns = round(begin_s * 1e9)
        points["time"] = time_s - stamp_ns * 1e-9
        types = store.types
        stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))
        fields = [
            types["sensor_msgs/msg/PointField"](name, int(offset), _KINDS[each], 1)
            for (name, each), offset in zip(layout.items(), offsets[:-1], strict=True)
        ]
        cloud = types[kind](
            header=types["std_msgs/msg/Header"](stamp, frame_id),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=row.itemsize,
            row_step=row.itemsize * len(points),
            data=points.view(np.uint8),
            is_dense=True,
        )
        return stamp_ns, store.serialize_cdr(cloud, kind)

    with new_file(path) as file, ExitStack() as stack:
        # The writer of rosbags needs a folder; faults of its files are faults of `path`.
        with writing(path):
            temporary = tempfile.TemporaryDirectory(
                dir=path.parent, prefix=".points-", ignore_cleanup_errors=True
            )
            folder = Path(stack.enter_context(temporary), "bag")
            bagged = stack.enter_context(ExitStack())
            writer = bagged.enter_context(
                Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
            )
            connection = writer.add_connection(TOPIC, kind, typestore=store)

        def write(columns: Mapping[str, NDArray[Any]]) -> None:
            nonlocal current
            rotation = columns["rotation"].astype(np.int64)
            for each in np.unique(rotation):
                if each != current and parts:
                    with writing(path):
                        writer.write(connection, *message())
                    parts.clear()
                    times.clear()
                current = int(each)
                chosen = rotation == each
                points = np.zeros(np.count_nonzero(chosen), dtype=row)
                points["ring"] = ring_of[columns["laser_id"][chosen]]
                for name in layout.keys() - {"ring", "time"}:
                    points[name] = columns[name][chosen]
                parts.append(points)
                times.append(columns["time"][chosen])

        yield write
        with writing(path):
            if parts:
                writer.write(connection, *message())
            bagged.close()
            with (folder / "bag.mcap").open("rb") as whole:
                shutil.copyfileobj(whole, file)


def rings(scanner: str) -> NDArray[np.uint16]:
    """Ring of every laser: its place among all, from the lowest nominal vertical angle up."""
    laser_of_ring = orders(nominal(scanner_named(scanner)).v)["from the lowest up"]
    return np.argsort(laser_of_ring).astype(np.uint16)
