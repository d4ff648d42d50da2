"""Every reader of files that others make: seeds made by the project's own code, and what must hold.

A reader may refuse a file with an error of `velocal.errors`. Any other exception is a finding, and
so is a ledger whose bytes do not add up, or a number that is not finite where a reader promises it.
"""

import bz2
import gzip
import json
import lzma
import sqlite3
import struct
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from zlib import crc32

import numpy as np
from support import clouds
from support.capture import as_bytes, record_list, spin, two_returns, udp_frame
from support.containers import (
    ethernet,
    ethernet6,
    fragments,
    frames_of,
    ip6_packet,
    ip_packet,
    labelled,
    pcap_of,
    pcapng,
    ros1_scan,
    ros2_scan,
    tagged,
)

from velocal.arrays import rows_of
from velocal.calibration.applied import AppliedCalibration
from velocal.calibration.dialects import DIALECTS
from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.capture.ledger import Ledger, NothingUsableError
from velocal.capture.reading import open_capture
from velocal.clouds.reading import open_cloud
from velocal.errors import VelocalError
from velocal.evaluation.plan_task import of_sketch
from velocal.geometry.planes import Patch, Plane
from velocal.io import storage
from velocal.packets.data import PAYLOAD_BYTES, check_payloads
from velocal.packets.firings import decode
from velocal.packets.status import TRAILING, StatusReader
from velocal.points.files import cloud_writer
from velocal.recording.cloud import read_cloud
from velocal.recording.identify import candidates
from velocal.recording.returns import returns_of
from velocal.recording.scan import inspect
from velocal.recording.windows import read_index, write_index
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
from velocal.study.config import StudyConfig
from velocal.study.model import validated
from velocal.study.reading import read_yaml
from velocal.study.samples import SurveyedSample, read_samples
from velocal.study.sketch import TEMPLATE, read_sketch
from velocal.survey.station import read_station
from velocal.survey.targets import read_targets

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Reader:
    """A reader and what it is tried with.

    Attributes
    ----------
    suffix : str
        Of the file that it is given.
    make : callable
        Makes files that it reads.
    check : callable
        Reads a file, and checks what comes out.
    share : int
        Cases of `make test`.
    """

    suffix: str
    make: Callable[[], list[bytes]]
    check: Callable[[Path], None]
    share: int

    @cached_property
    def seeds(self) -> list[bytes]:
        return self.make()

    def read(self, content: bytes, folder: Path) -> str:
        """Read one case: "read", or the name of the error with which it was refused."""
        path = folder / f"case{self.suffix}"
        path.write_bytes(content)
        try:
            self.check(path)
        except VelocalError as error:
            if isinstance(error, NothingUsableError):
                balanced(error.ledger)
            return type(error).__name__
        return "read"


# -- captures --------------------------------------------------------------------------------------


def balanced(ledger: Ledger) -> None:
    """Every byte is counted once, and nothing is negative."""
    assert ledger.unaccounted_bytes == 0, ledger
    parts = [ledger.data, ledger.position, *ledger.rejected.values()]
    assert all(part.packets >= 0 and part.bytes >= 0 for part in parts), ledger


def capture(path: Path) -> None:
    """Read a capture; of every eighth case, scan and decode its rotations as well.

    What follows after reading takes most of the time, and the bytes of a container seldom change
    it.
    """
    if crc32(path.read_bytes()) % 8:
        reading = open_capture(path).read()
        n = sum(len(chunk) for chunk in reading)
        balanced(reading.ledger)
        assert reading.ledger.data.packets == n
        return
    found = inspect(path)
    balanced(found.ledger)
    n = int(found.index.packet[-1])
    assert found.ledger.data.packets == n > 0
    assert (np.diff(found.index.packet * 12 + found.index.block) > 0).all()
    json.dumps(storage.finite(found.as_dict()), allow_nan=False)
    fits = candidates(found)
    scanner = fits[0] if fits else SCANNERS["HDL-64E"]
    index = found.index
    for part in returns_of(path, index, np.arange(len(index)), scanner, returns="both"):
        assert (part.azimuth < 36_000).all()
        assert len(part.laser_id) == len(part.distance)


PAYLOADS = spin(8, step=1500)
SLOW_CLOCK = spin(8, step=1500, interval_us=0, stamp_us=4_000_000_000)


def kinds_of_payloads() -> np.ndarray:
    """Packets of different scanners and modes."""
    paired = spin(2, step=1500, paired=True)
    four = spin(2, step=1500, banks=4)
    return np.concatenate(
        [PAYLOADS[:2], paired, two_returns(PAYLOADS[:2]), two_returns(four), four]
    )


def pcaps() -> list[bytes]:
    plain = frames_of(PAYLOADS)
    bare = as_bytes(PAYLOADS[:3])
    position = udp_frame(b"\0" * 206 + b"$GPRMC,102030,A,4912.34,N*5C".ljust(306, b"\0"))
    mixed = [
        plain[0],
        position,
        tagged(ip_packet(bare[1]), 0x8100),
        labelled(ip_packet(bare[1])),
        *[ethernet(piece) for piece in fragments(ip_packet(bare[2]), 1)],
        plain[3],
    ]
    raw = pcap_of(frames_of(PAYLOADS[:4], bytes), link=101, order=">", ticks=10**9)
    six = pcap_of([ethernet6(ip6_packet(payload)) for payload in as_bytes(PAYLOADS[:5])])
    return [pcap_of(plain), pcap_of(mixed), raw, six, pcap_of(frames_of(SLOW_CLOCK))]


def pcapngs() -> list[bytes]:
    plain = frames_of(PAYLOADS[:5])
    return [pcapng(plain), pcapng(plain[:2], order=">", resolution=9) + pcapng(plain[2:])]


def records() -> list[bytes]:
    return [b"".join(record_list(PAYLOADS, header)) for header in (0, 42)] + [
        b"".join(record_list(kinds_of_payloads(), 42))
    ]


def packed() -> list[bytes]:
    short = pcap_of(frames_of(PAYLOADS[:3]))
    return [
        gzip.compress(short, mtime=0),
        gzip.compress(short, 0, mtime=0),
        gzip.compress(short[:2000], mtime=0) + gzip.compress(short[2000:], mtime=0),
        bz2.compress(short),
        lzma.compress(short),
    ]


def ros1_record(data: bytes, **fields: bytes) -> bytes:
    parts = [name.encode() + b"=" + value for name, value in fields.items()]
    header = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def ros1() -> list[bytes]:
    name = b"/velodyne_packets"
    about = [b"topic=" + name, b"type=velodyne_msgs/VelodyneScan"]
    connection = ros1_record(
        b"".join(struct.pack("<I", len(part)) + part for part in about),
        op=b"\7", conn=bytes(4), topic=name,
    )  # fmt: skip
    scans = [as_bytes(PAYLOADS[:2]), as_bytes(PAYLOADS[2:4])]
    messages = [
        ros1_record(ros1_scan(scan, k), op=b"\2", conn=bytes(4), time=struct.pack("<II", k, 9))
        for k, scan in enumerate(scans)
    ]
    plain = connection + messages[0]
    chunk = ros1_record(plain, op=b"\5", compression=b"none", size=struct.pack("<I", len(plain)))
    squeezed = ros1_record(
        bz2.compress(messages[1]), op=b"\5", compression=b"bz2",
        size=struct.pack("<I", len(messages[1])),
    )  # fmt: skip
    head = ros1_record(b" " * 30, op=b"\3", index_pos=bytes(8), conn_count=bytes(4))
    body = b"#ROSBAG V2.0\n" + head + chunk + squeezed
    indexed = body.replace(b"index_pos=" + bytes(8), b"index_pos=" + struct.pack("<Q", len(body)))
    info = ros1_record(bytes(4) + b"\2\0\0\0", op=b"\6", count=b"\1\0\0\0")
    return [body, indexed + connection + info]


def mcap_record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def mcap() -> list[bytes]:
    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    schema = mcap_record(3, b"\1\0" + text("velodyne_msgs/msg/VelodyneScan") + text("ros2msg") * 2)
    channel = mcap_record(4, b"\1\0\1\0" + text("/velodyne_packets") + text("cdr") + bytes(4))
    messages = [
        mcap_record(5, struct.pack("<HIQQ", 1, k, k, k) + ros2_scan(as_bytes(PAYLOADS[k : k + 2])))
        for k in (0, 2)
    ]
    inner = schema + channel + messages[0]
    chunk = mcap_record(
        6,
        struct.pack("<QQQI", 0, 9, len(inner), 0)
        + text("")
        + struct.pack("<Q", len(inner))
        + inner,
    )
    magic = b"\x89MCAP0\r\n"
    data = magic + mcap_record(1, text("ros2") + text("x")) + chunk + messages[1]
    statistics = mcap_record(11, bytes(42) + struct.pack("<IHQ", 10, 1, 2))
    footer = mcap_record(2, struct.pack("<QQI", len(data), 0, 0)) + magic
    return [data, data + schema + channel + statistics + footer]


def db3() -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.db3"
        with sqlite3.connect(path) as made:
            made.execute("PRAGMA page_size = 512")
            made.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
            made.execute(
                "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)"
            )
            made.execute("INSERT INTO topics VALUES (1, '/v', 'velodyne_msgs/msg/VelodyneScan')")
            for k in (0, 2):
                scan = ros2_scan(as_bytes(PAYLOADS[k : k + 2]))
                made.execute("INSERT INTO messages VALUES (?, 1, ?, ?)", (k, k, scan))
        made.close()
        return [path.read_bytes()]


def payload(path: Path) -> None:
    """Decode packets as every scanner, whatever they hold behind their flags."""
    content = np.frombuffer(path.read_bytes(), np.uint8)
    payloads = content[: len(content) // PAYLOAD_BYTES * PAYLOAD_BYTES].reshape(-1, PAYLOAD_BYTES)
    flags, azimuths = check_payloads(payloads)
    payloads = payloads[flags & azimuths]
    status = StatusReader()
    status.consume(payloads[:, -TRAILING.itemsize :])
    json.dumps(storage.finite(status.result().as_dict()), allow_nan=False)
    status.result().lines()
    if len(payloads) == 0:
        return
    for name in ("HDL-64E", "VLP-16", "VLS-128"):
        firings = decode(payloads, SCANNERS[name], "both")
        assert (firings.azimuth < 36_000).all()
        assert firings.distance.shape == firings.intensity.shape


# -- clouds of points ------------------------------------------------------------------------------

VLP16 = SCANNERS["VLP-16"]
#: Points of the ROS driver: each lies on the cone of its laser.
RIGHT, FORWARD, UP = (
    AppliedCalibration(DIALECTS["ros"], nominal(VLP16), VLP16, 10.0)
    .points(np.linspace(2, 9, 24), np.linspace(0, 6, 24), np.arange(24) % 16)
    .T.astype("f4")
)
CLOUD = {
    "x": FORWARD,
    "y": -RIGHT,
    "z": UP,
    "intensity": np.arange(24, dtype="f4"),
    "ring": (np.arange(24) % 16).astype("u2"),
    "time": np.linspace(0, 0.1, 24),
}


def pcds() -> list[bytes]:
    return [clouds.pcd(CLOUD, layout) for layout in ("ascii", "binary", "binary_compressed")]


def plys() -> list[bytes]:
    layouts = ("ascii", "binary_little_endian", "binary_big_endian")
    return [clouds.ply(CLOUD, layout) for layout in layouts]


def kittis() -> list[bytes]:
    names = ("x", "y", "z", "intensity")
    return [np.stack([CLOUD[name].astype("<f4") for name in names], axis=1).tobytes()]


def bag_of_clouds(kind: str) -> list[bytes]:
    messages = [
        clouds.pointcloud2(CLOUD, ros1=kind == "ros1", height=height, second=height)
        for height in (1, 4)
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a"
        clouds.write_bag(path, messages, ros1=kind == "ros1", storage="MCAP")
        return [(path if kind == "ros1" else next(path.glob("*.mcap"))).read_bytes()]


def own_clouds(suffix: str) -> list[bytes]:
    columns = {name: CLOUD[name] for name in "xyz"} | {
        "intensity": np.arange(24, dtype="u1"),
        "laser_id": (np.arange(24) % 16).astype("u1"),
        "rotation": np.arange(24, dtype="u4") // 12,
        "time": CLOUD["time"],
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"x{suffix}"
        with cloud_writer(path, shift=False, facts={"scanner": "VLP-16"}) as write:
            write(columns)
        return [path.read_bytes()]


def cloud(path: Path) -> None:
    """Read a cloud, and compute raw values if it is one of a VLP-16."""
    n = 0
    for block in open_cloud(path).blocks():
        n += len(block)
        assert block.xyz.shape == (len(block), 3)
        assert block.laser is None or (block.laser >= 0).all()
    found = read_cloud(path, "VLP-16", dialect="ros", rotation_rate_hz=10.0)
    assert found.points == n
    assert 0 < found.used <= n
    assert (found.returns.azimuth < 36_000).all()
    json.dumps(storage.finite(found.as_dict()), allow_nan=False)


# -- calibrations, tables, our own files -----------------------------------------------------------


def calibration_seeds(suffix: str) -> list[bytes]:
    found = nominal(SCANNERS["VLP-16"])
    if suffix == ".yaml":  # the pure Python parser of YAML takes long
        found = rows_of(found, slice(0, 2))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"x{suffix}"
        formats.write(path, CalibrationFile(found))
        return [path.read_bytes()]


def calibration(path: Path) -> None:
    found = formats.read_calibration(path)
    for name in ("dl", "alpha", "v", "voff", "hoff"):
        assert np.isfinite(getattr(found.parameters, name)).all()
    formats.dialect_of(found, path)


def targets() -> list[bytes]:
    head = "target,plane,x_m,y_m,z_m,std_x_mm,std_y_mm,std_z_mm\n"
    rows = [f"w{k},wall,{k}.5,{2 * k},-1.25,1,1,2.5\n" for k in range(4)]
    return [(head + "".join(rows)).encode(), (head + "# a comment\n" + rows[0]).encode()]


def read_some_targets(path: Path) -> None:
    found = read_targets(path, "plane")
    assert np.isfinite(found.xyz).all()
    assert (found.std > 0).all()


def samples() -> list[bytes]:
    lines = (ROOT / "config/samples.tsv").read_bytes().splitlines(keepends=True)
    return [b"".join(lines[:4])]


def read_some_samples(path: Path) -> None:
    read_samples(path, SurveyedSample)


def configurations() -> list[bytes]:
    return [(ROOT / "config/unsurveyed.yaml").read_bytes()]


def configuration(path: Path) -> None:
    validated(StudyConfig, read_yaml(path), str(path))


def sketches() -> list[bytes]:
    return [TEMPLATE.encode()]


def sketch(path: Path) -> None:
    of_sketch(read_sketch(path), path.parent)


def stations() -> list[bytes]:
    from support.station import write_station

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "station.json"
        corners = np.array([[0.0, 5, 0], [1, 5, 0], [1, 5, 1], [0, 5, 1]])
        plane = Plane(np.array([0.0, 1.0, 0.0]), -5.0, np.zeros((4, 4)))
        write_station(path, "P1", "HDL-64E", [Patch("wall", plane, corners)])
        return [path.read_bytes()]


def station(path: Path) -> None:
    read_station(path)


def indices() -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        recording, path = Path(folder) / "x.pcap", Path(folder) / "x.parquet"
        recording.write_bytes(pcaps()[0])
        write_index(path, inspect(recording).index)
        return [path.read_bytes()]


def index(path: Path) -> None:
    read_index(path)


def csv(path: Path) -> None:
    storage.read_csv(path, ("plane",))


READERS = {
    "records": Reader("", records, capture, 4000),
    "pcap": Reader("", pcaps, capture, 5000),
    "pcapng": Reader("", pcapngs, capture, 4000),
    "compressed": Reader("", packed, capture, 4000),
    "ros1": Reader(".bag", ros1, capture, 3000),
    "mcap": Reader(".mcap", mcap, capture, 3000),
    "db3": Reader(".db3", db3, capture, 1000),
    "pcd": Reader(".pcd", pcds, cloud, 900),
    "ply": Reader(".ply", plys, cloud, 500),
    "kitti": Reader(".bin", kittis, cloud, 200),
    "clouds_ros1": Reader(".bag", lambda: bag_of_clouds("ros1"), cloud, 400),
    "clouds_mcap": Reader(".mcap", lambda: bag_of_clouds("mcap"), cloud, 500),
    "own_parquet": Reader(".parquet", lambda: own_clouds(".parquet"), cloud, 200),
    "own_las": Reader(".las", lambda: own_clouds(".las"), cloud, 200),
    "own_laz": Reader(".laz", lambda: own_clouds(".laz"), cloud, 100),
    "packets": Reader("", lambda: [kinds_of_payloads().tobytes()], payload, 2500),
    "xml": Reader(".xml", lambda: calibration_seeds(".xml"), calibration, 2000),
    "yaml": Reader(".yaml", lambda: calibration_seeds(".yaml"), calibration, 2000),
    "csv": Reader(".csv", lambda: calibration_seeds(".csv"), calibration, 4000),
    "json": Reader(".json", lambda: calibration_seeds(".json"), calibration, 5000),
    "targets": Reader(".csv", targets, read_some_targets, 500),
    "samples": Reader(".tsv", samples, read_some_samples, 500),
    "configuration": Reader(".yaml", configurations, configuration, 1500),
    "sketch": Reader(".yaml", sketches, sketch, 500),
    "station": Reader(".json", stations, station, 3500),
    "rotations": Reader(".parquet", indices, index, 700),
    "own_csv": Reader(".csv", targets, csv, 300),
}
