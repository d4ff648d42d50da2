"""Clouds of points in files: every format is read, and faults are one clear message."""

import struct
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from reference.test_every_dialect import unit
from support import clouds
from support.capture import record_list, spin, write
from typer.testing import CliRunner

from velocal.calibration.applied import AppliedCalibration
from velocal.calibration.dialects import DIALECTS
from velocal.calibration.files import formats
from velocal.cli import app
from velocal.clouds.reading import open_cloud
from velocal.errors import ConfigError, RecordingError, StorageError
from velocal.recording.cloud import read_cloud
from velocal.recording.motion import check_cloud_standing
from velocal.recording.recording import open_recording
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
from velocal.study.samples import UnsurveyedSample, read_samples

#: Points in the axes of ROS, with the fields of the ROS driver.
RNG = np.random.default_rng(3)
N = 60
COLUMNS = {
    "x": RNG.normal(0, 20, N).astype("f4"),
    "y": RNG.normal(0, 20, N).astype("f4"),
    "z": RNG.normal(0, 2, N).astype("f4"),
    "intensity": RNG.integers(0, 256, N).astype("f4"),
    "ring": (np.arange(N) % 16).astype("u2"),
    "time": np.linspace(0, 0.1, N).astype("f4"),
}
FILES = {
    "ascii.pcd": clouds.pcd(COLUMNS, "ascii"),
    "binary.pcd": clouds.pcd(COLUMNS),
    "compressed.pcd": clouds.pcd(COLUMNS, "binary_compressed"),
    "ascii.ply": clouds.ply(COLUMNS, "ascii"),
    "little.ply": clouds.ply(COLUMNS),
    "big.ply": clouds.ply(COLUMNS, "binary_big_endian"),
    "scan.pcd.bin": np.stack(
        [COLUMNS[name].astype("<f4") for name in ("x", "y", "z", "intensity", "ring")], 1
    ).tobytes(),
}


def joined(path, topic=None):
    parts = list(open_cloud(path, topic).blocks())
    return {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("xyz", "laser", "intensity", "rotation", "time_s")
        if getattr(parts[0], name) is not None
    }


def check(found, times=1):
    xyz = np.stack([COLUMNS[axis] for axis in "xyz"], axis=-1)
    np.testing.assert_array_equal(found["xyz"], np.tile(xyz, (times, 1)))
    np.testing.assert_array_equal(found["laser"], np.tile(COLUMNS["ring"], times))
    np.testing.assert_array_equal(found["intensity"], np.tile(COLUMNS["intensity"], times))
    np.testing.assert_array_equal(found["rotation"], np.repeat(np.arange(times), N))
    if "time_s" in found:
        np.testing.assert_array_equal(found["time_s"], np.tile(COLUMNS["time"], times))


@pytest.mark.parametrize("name", FILES)
def test_files_of_others_are_read(name, tmp_path):
    path = tmp_path / name
    path.write_bytes(FILES[name])
    check(joined(path))


@pytest.mark.parametrize("suffix", [".pcd", ".pcd.bin"])
def test_a_folder_holds_a_scan_in_every_file(suffix, tmp_path):
    content = FILES["binary.pcd" if suffix == ".pcd" else "scan.pcd.bin"]
    for number in (10, 9, 8):
        (tmp_path / f"{number}{suffix}").write_bytes(content)
    check(joined(tmp_path), 3)


def test_a_scan_of_kitti_has_no_lasers(tmp_path):
    path = tmp_path / "000000.bin"
    shares = COLUMNS["intensity"] / 255
    path.write_bytes(
        np.stack([COLUMNS["x"], COLUMNS["y"], COLUMNS["z"], shares], 1).astype("<f4").tobytes()
    )
    found = joined(path)
    assert "laser" not in found
    np.testing.assert_array_equal(found["intensity"], COLUMNS["intensity"])
    assert open_cloud(path).frame == "ros"


@pytest.mark.parametrize(
    ("ros1", "storage", "height", "big"),
    [(True, "", 1, False), (False, "MCAP", 1, False), (False, "SQLITE3", 4, False),
     (False, "MCAP", 4, True), (True, "", 4, True)],
)  # fmt: skip
def test_bags_of_pointcloud2_are_read(ros1, storage, height, big, tmp_path):
    messages = [
        clouds.pointcloud2(COLUMNS, ros1=ros1, height=height, big=big, second=k) for k in range(2)
    ]
    path = tmp_path / ("a.bag" if ros1 else "a")
    clouds.write_bag(path, messages, ros1=ros1, storage=storage)
    check(joined(path), 2)
    file = open_cloud(path)
    list(file.blocks())
    assert np.diff(file.stamps_s) == [1.0]
    assert file.kind == "ROS bag, topic /velodyne_points"


def changed(**more):
    """Columns, of which some are replaced, or left out where they are None."""
    return {k: v for k, v in {**COLUMNS, **more}.items() if v is not None}


HEAD = clouds.pcd(COLUMNS).split(b"POINTS")[0]
FAULTS = {
    "huge.pcd": (clouds.pcd(COLUMNS, points=10**12), "announces 1000000000000 points"),
    "huge_ascii.pcd": (clouds.pcd(COLUMNS, "ascii", points=10**12), "announces 1000000000000"),
    "huge.ply": (clouds.ply(COLUMNS, points=10**12), "announces 1000000000000 points"),
    "digits.pcd": (clouds.pcd(COLUMNS, points=10**40), "POINTS: '1000"),
    "cut.pcd": (FILES["binary.pcd"][:-1], "1320 bytes; 1319 bytes follow"),
    "cut_ascii.pcd": (
        FILES["ascii.pcd"].rpartition(b"\n")[0].rpartition(b"\n")[0],
        "59 points of 6",
    ),
    "ragged_ascii.pcd": (FILES["ascii.pcd"][:-20] + b"\n", "columns changed from 6 to"),
    "word_ascii.pcd": (clouds.pcd(COLUMNS, "ascii")[:-9] + b" wall\n", "cannot be read"),
    "cut_compressed.pcd": (FILES["compressed.pcd"][:-50], "do not agree"),
    "damaged_compressed.pcd": (FILES["compressed.pcd"][:-40] + b"\xff" * 40, "are damaged"),
    "no_data.pcd": (HEAD, "no line 'DATA'"),
    "kinds.pcd": (FILES["binary.pcd"].replace(b"TYPE F", b"TYPE Q"), "field 'x' is of type 'Q'"),
    "fields.pcd": (FILES["binary.pcd"].replace(b"SIZE 4", b"SIZE"), "have 6, 5, 6 and 6 entries"),
    "layout.pcd": (FILES["binary.pcd"].replace(b"DATA binary", b"DATA base64"), "DATA: 'base64'"),
    "flat.pcd": (clouds.pcd(changed(z=None)), "has no field z"),
    "laser.pcd": (clouds.pcd(changed(ring=np.full(N, 300, "u2"))), "300 is no number of a laser"),
    "ring.pcd": (clouds.pcd(changed(ring=np.full(N, 1.5, "f4"))), "1.5 is no number of a laser"),
    "list.ply": (
        FILES["little.ply"].replace(b"property float x", b"property list uchar int x"),
        "property 'list uchar int x'",
    ),
    "edges.ply": (FILES["little.ply"].replace(b"vertex 60", b"edge 60"), "is not 'vertex'"),
    "format.ply": (FILES["little.ply"].replace(b"_little_", b"_middle_"), "binary_middle_endian"),
    "15.bin": (bytes(15), "has 15 bytes"),
    "empty.bin": (b"", "has 0 bytes"),
    "text.bin": (b"points of a wall" * 10, "of a point is"),
    "text.xyz": (b"1 2 3\n", "is no cloud of points"),
    "las.las": (b"LASF" + bytes(400), "cannot be read as LAS"),
    "own.parquet": (b"PAR1" + bytes(100) + b"PAR1", "cannot be read"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_one_message_with_the_file(name, tmp_path):
    content, message = FAULTS[name]
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises((RecordingError, StorageError), match=message) as caught:
        joined(path)
    assert str(path) in str(caught.value)


GOOD = clouds.pointcloud2(COLUMNS, ros1=False)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (GOOD[:12] + b"\xff\xff\xff\x7f" + GOOD[16:], "damaged text"),
        (GOOD[: len(GOOD) // 2], "cut short"),
        (GOOD[:40], "cut short"),
        (GOOD.replace(struct.pack("<II", 1, N), struct.pack("<II", 2**31, 2**31)), "do not fit"),
    ],
)
def test_a_damaged_message_is_counted_and_the_others_are_used(message, reason, tmp_path):
    path = clouds.write_bag(tmp_path / "a", [GOOD, message, GOOD], ros1=False)
    file = open_cloud(path)
    assert len(list(file.blocks())) == 2
    assert sum(file.lost.values()) == 1
    assert reason in next(iter(file.lost))


# -- raw values ------------------------------------------------------------------------------------


def recorded(folder, name):
    """A recording of 2 rotations, in which some lasers see nothing."""
    scanner = SCANNERS[name]
    payloads = spin(
        round(2.2 / 10 * scanner.packet_rate_hz),
        step=round(10 * scanner.firing_cycle_s * 36_000) * scanner.firings_per_block,
        banks=len(scanner.flags),
        status=(0x37, scanner.factory_byte or 0x21),
        interval_us=round(1e6 / scanner.packet_rate_hz),
    )
    payloads[:, 19:22] = 0
    return write(folder, record_list(payloads, 42))


def sorted_rows(table):
    rows = [table.rotation, table.azimuth, table.laser_id, table.distance, table.intensity]
    stacked = np.stack(rows).astype(np.int64)
    return stacked[:, np.lexsort(stacked)]


@pytest.mark.parametrize(
    ("scanner", "dialect", "suffix", "frame"),
    [
        ("VLP-16", "ros", ".pcd", "ros"),
        ("HDL-32E", "manual", ".parquet", "velocal"),
        ("HDL-64E", "veloview", ".ply", "velocal"),
        ("HDL-64E", "manual_s2", ".pcd", "ros"),
        ("VLS-128", "velodyne_decoder", ".ply", "ros"),
        ("VLP-32C", "mrpt", ".pcd", "velocal"),
    ],
)
def test_what_velocal_points_writes_is_read_back_as_the_same_ticks(
    scanner, dialect, suffix, frame, tmp_path
):
    path, known = recorded(tmp_path, scanner), SCANNERS[scanner]
    numbers = formats.CalibrationFile(unit(known), dialect, scanner, known.distance_tick_m)
    formats.write(tmp_path / "a.json", numbers)
    output = tmp_path / f"points{suffix}"
    command = ["points", str(path), "-o", str(output), "-c", str(tmp_path / "a.json")]
    done = CliRunner().invoke(app, [*command, "--scanner", scanner, "--frame", frame])
    assert done.exit_code == 0, done.output
    found = read_cloud(output, calibration=formats.read_for(tmp_path / "a.json", known))
    packets = open_recording(path, scanner).returns("all")
    np.testing.assert_array_equal(sorted_rows(found.returns.seen), sorted_rows(packets.seen))
    assert found.returns.rotation_rate_hz == packets.rotation_rate_hz
    assert (found.used, found.dialect, found.frame) == (found.points, dialect, frame)
    # What the file says is checked.
    with pytest.raises(ConfigError, match="another calibration"):
        read_cloud(output)
    other = "VLP-16" if scanner != "VLP-16" else "HDL-32E"
    with pytest.raises(ConfigError, match=f"recording of {scanner}, not of {other}"):
        read_cloud(output, other)


def scene(scanner, dialect, *, n=400, rate_hz=10.0):
    """Raw values of firings all around, and the points that a program makes of them."""
    known = SCANNERS[scanner]
    applied = AppliedCalibration(DIALECTS[dialect], nominal(known), known, rate_hz)
    tick = np.repeat(np.arange(n) * (36_000 // n), known.n_lasers)
    laser = np.tile(np.arange(known.n_lasers), n)
    distance = 1000 + 17 * (np.arange(len(laser)) % 501)
    phi = np.deg2rad(tick / 100) + 2 * np.pi * rate_hz * known.azimuth_delay_s[laser]
    xyz = applied.points(distance * known.distance_tick_m, phi, laser, rounded=True)
    return tick, laser, distance, xyz


@pytest.mark.parametrize("order", ["wire", "up", "down"])
@pytest.mark.parametrize("dialect", ["ros", "pcl"])
def test_the_order_of_the_lasers_is_found_by_the_points(order, dialect, tmp_path):
    tick, laser, distance, xyz = scene("VLP-16", dialect)
    v = nominal(SCANNERS["VLP-16"]).v
    rank = np.argsort(np.argsort(v))
    number = {"wire": laser, "up": rank[laser], "down": 15 - rank[laser]}[order]
    x, y, z = xyz.T
    axes = {"x": y, "y": -x, "z": z} if dialect == "ros" else {"x": x, "y": y, "z": z}
    columns = {k: v.astype("f4") for k, v in axes.items()} | {"ring": number.astype("u2")}
    path = tmp_path / "a.pcd"
    path.write_bytes(clouds.pcd(columns))
    found = read_cloud(path, "VLP-16", dialect=dialect)
    expect = np.stack([tick, laser, distance])
    seen = found.returns.seen
    rows = np.stack([seen.azimuth, seen.laser_id, seen.distance]).astype(np.int64)
    np.testing.assert_array_equal(rows[:, np.lexsort(rows)], expect[:, np.lexsort(expect)])
    assert found.lasers.endswith({"wire": "wire", "up": "lowest up", "down": "highest down"}[order])
    path.write_bytes(clouds.pcd({**columns, "z": columns["z"] + np.float32(1.7)}))
    with pytest.raises(RecordingError, match="lie on the cones of the lasers of a"):
        read_cloud(path, "VLP-16", dialect=dialect)


def test_points_that_no_raw_value_makes_are_counted(tmp_path):
    _, laser, _, xyz = scene("HDL-32E", "velodyne_decoder")
    x, y, z = xyz.T.astype("f4")
    columns = {"x": y, "y": -x, "z": z, "laser_id": laser.astype("u1")}
    columns["x"][:3], columns["z"][3:10], columns["x"][10] = np.nan, 9.0, 0.0
    columns["y"][10] = columns["z"][10] = 0.0
    path = tmp_path / "a.pcd"
    path.write_bytes(clouds.pcd(columns))
    near = replace(SCANNERS["HDL-32E"], min_range_m=2.2)
    found = read_cloud(path, near, dialect="velodyne_decoder", rotation_rate_hz=10.0)
    short = np.linalg.norm(xyz[11:], axis=1) <= 2.2
    assert found.left_out == {
        "have no finite coordinates": 3,
        "are nearer than the scanner measures": 1 + short.sum(),
        "lie on the cone of no laser": 7,
    }
    assert found.used == len(found.returns.seen) == len(laser) - 11 - short.sum()
    assert any("7 points lie on the cone of no laser" in remark for remark in found.remarks)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "does not say which scanner"),
        ({"scanner": "VLP-16"}, "does not say which program"),
        ({"scanner": "VLP-16", "dialect": "rviz"}, "unknown dialect 'rviz'"),
        ({"scanner": "VLP-16", "dialect": "ros", "frame": "enu"}, "unknown frame 'enu'"),
        (
            {"scanner": "VLP-16", "dialect": "ros", "calibration": nominal(SCANNERS["HDL-32E"])},
            "32 lasers",
        ),
    ],
)
def test_wrong_calls(arguments, message, tmp_path):
    path = tmp_path / "a.pcd"
    path.write_bytes(FILES["binary.pcd"])
    with pytest.raises(ConfigError, match=message):
        read_cloud(path, **arguments)


@pytest.mark.parametrize("numbered", ["ring", "laser_id", None])
def test_angles_and_offsets_are_found_in_a_cloud(numbered, tmp_path):
    """Of a unit that is not nominal; the highest ring has no point."""
    known = SCANNERS["VLP-16"]
    design, rng = nominal(known), np.random.default_rng(1)
    unit = replace(
        design, v=design.v + rng.normal(0, 0.002, 16), voff=design.voff + rng.normal(0, 0.01, 16)
    )
    rank = np.argsort(np.argsort(design.v))
    laser = np.repeat(np.argsort(-design.v)[1:], 300)
    phi = np.tile(-np.linspace(0, 2 * np.pi, 300, endpoint=False) - 1e-3, 15)
    applied = AppliedCalibration(DIALECTS["paper"], unit, known, 10.0)
    x, y, z = applied.points(rng.uniform(4, 30, len(phi)), phi, laser).T.astype("f4")
    columns = {"x": y, "y": -x, "z": z}
    if numbered:
        columns[numbered] = (rank[laser] if numbered == "ring" else laser).astype("u1")
    path, output = tmp_path / "a.pcd", tmp_path / "b.json"
    path.write_bytes(clouds.pcd(columns))
    command = ["calibration", "from-cloud", str(path), "-o", str(output), "--scanner", "VLP-16"]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    found = formats.read_for(output, known).parameters
    seen = np.unique(laser)
    np.testing.assert_allclose(found.v[seen], unit.v[seen], atol=1e-5)
    np.testing.assert_allclose(found.voff[seen], unit.voff[seen], atol=1e-4)
    top = np.argmax(design.v)
    assert found.v[top] == design.v[top]
    assert read_cloud(path, known, found, dialect="paper", frame="ros").used == len(laser)


# -- in a study ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ("VLP-16\ta.pcd\tnominal\trviz\t", "row 2: dialect: unknown dialect 'rviz'"),
        ("VLP-16\ta.pcd\tnominal\tros\tenu", "frame: 'enu' (allowed: velocal, ros"),
        ("VLP-16\ta.pcap\tnominal\t\tros", "frame: is said of packets"),
        (
            "HDL-64E\ta.pcd\tembedded\tros\t",
            "calibration: 'embedded', but the recording is a cloud",
        ),
    ],
)
def test_what_a_sample_table_says_wrongly_of_a_cloud(cells, message, tmp_path):
    path = tmp_path / "samples.tsv"
    head = "sample\tscanner\trecording\tcalibration\tdialect\tframe\n"
    path.write_text(f"{head}one\t{cells}\n")
    with pytest.raises(ConfigError) as caught:
        read_samples(path, UnsurveyedSample)
    assert message in str(caught.value)
    path.write_text(
        f"{head}one\tVLP-16\ta.pcd\tnominal\tros\tros\ntwo\tVLP-16\ta.pcap\tnominal\t\t\n"
    )
    found = read_samples(path, UnsurveyedSample)
    assert [each.is_cloud for each in found.values()] == [True, False]


def test_init_writes_the_program_into_the_sample_table(tmp_path):
    cloud = tmp_path / "a.pcd"
    cloud.write_bytes(FILES["binary.pcd"])
    command = ["init", str(tmp_path / "s"), "--scanner", "VLP-16", "--dialect", "ros"]
    refused = CliRunner().invoke(app, command)
    assert "a dialect without clouds" in str(refused.exception)
    done = CliRunner().invoke(app, [*command, "--recording", str(cloud)])
    assert done.exit_code == 0, done.output
    rows = read_samples(tmp_path / "s/samples.tsv", UnsurveyedSample)
    assert {each.dialect for each in rows.values()} == {"ros"}


@pytest.mark.parametrize("moves", [False, True])
def test_a_cloud_of_a_moving_scanner_is_refused(moves, tmp_path):
    """Two scans; in the second one everything may be half a metre farther."""
    known = SCANNERS["VLP-16"]
    applied = AppliedCalibration(DIALECTS["ros"], nominal(known), known, 10.0)
    laser, phi = np.tile(np.arange(16), 720), np.repeat(np.linspace(0, 6.28, 720), 16)
    for scan in (0, 1):
        distance = np.full(len(phi), 8.0 + 0.5 * scan * moves)
        x, y, z = applied.points(distance, phi, laser).T.astype("f4")
        columns = {"x": y, "y": -x, "z": z, "laser_id": laser.astype("u1")}
        (tmp_path / f"{scan}.pcd").write_bytes(clouds.pcd(columns))
    found = read_cloud(tmp_path, known, dialect="ros")
    if not moves:
        check_cloud_standing(found.returns, "here")
        return
    with pytest.raises(RecordingError, match="here: the scanner moves: 100 %"):
        check_cloud_standing(found.returns, "here")


# -- points of another program ---------------------------------------------------------------------


def test_velodyne_decoder_gives_back_what_it_decoded(shared, tmp_path):
    """Its own points of a real HDL-32E: the distances of all, the azimuths of nearly all.

    It finds the rotation rate anew in every packet, so that some azimuths differ by one tick.
    """
    decoder = pytest.importorskip("velodyne_decoder")
    recording = shared / "recordings/hdl32e-static-outdoor.pcap"
    config = decoder.Config()
    config.model = decoder.Model.HDL32E
    for number, (_, points) in enumerate(decoder.read_pcap(recording, config, as_pcl_structs=True)):
        names = ("x", "y", "z", "intensity", "ring", "time")
        columns = {name: np.ascontiguousarray(points[name]) for name in names}
        (tmp_path / f"{number}.pcd").write_bytes(clouds.pcd(columns))
    found = read_cloud(tmp_path, "HDL-32E", dialect="velodyne_decoder")
    seen = found.returns.seen
    packets = open_recording(recording, "HDL-32E").returns("all").seen
    assert found.used == found.points == len(packets)

    def counted(table, *names):
        return Counter(zip(*(getattr(table, name).tolist() for name in names), strict=True))

    by_distance = ("laser_id", "distance")
    assert counted(seen, *by_distance) == counted(packets, *by_distance)
    everything = (*by_distance, "azimuth")
    same = counted(seen, *everything) & counted(packets, *everything)
    assert same.total() > 0.999 * len(packets)


def test_messages_that_are_damaged_are_counted_once(tmp_path):
    """The file is read twice where its times have to tell the rotation rate."""
    _, laser, _, xyz = scene("VLP-16", "ros")
    x, y, z = xyz.T.astype("f4")
    columns = {"x": y, "y": -x, "z": z, "laser_id": laser.astype("u1")}
    messages = [clouds.pointcloud2(columns, ros1=False, second=k) for k in range(3)]
    messages[1] = messages[1][:-400]
    path = clouds.write_bag(tmp_path / "a", messages, ros1=False)
    found = read_cloud(path, "VLP-16", dialect="ros")
    assert found.lost == {"message cut short": 1}
    assert found.points == 2 * len(laser)
    assert np.unique(found.returns.rotation).tolist() == [0, 1]
