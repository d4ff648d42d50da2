"""Points of recordings: the slow formula agrees, and files are read back by other code."""

import sys
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from rosbags.highlevel import AnyReader
from support.capture import pcap, record_list, spin, write
from typer.testing import CliRunner

from velocal.calibration.files import formats
from velocal.cli import app
from velocal.errors import ConfigError
from velocal.packets.firings import decode
from velocal.points import stream as placing
from velocal.points.files import HEADER_BYTES, cloud_writer, fields
from velocal.points.stream import Settings, raw_returns, stream
from velocal.recording.scan import inspect
from velocal.scanner import beam as beam_model
from velocal.scanner import parameters
from velocal.scanner.models import SCANNERS

#: n packets of a scanner at 10 Hz: step in ticks and interval in microseconds of the firings.
SPINS = {
    "HDL-64E": {"paired": True, "step": 17, "interval_us": 288},
    "HDL-32E": {"step": 17, "interval_us": 553},
    "VLP-16": {"step": 40, "interval_us": 1327},
}
PACKETS = 700  # more than two of the pieces in which packets are placed


def calibration(scanner, seed=1):
    """Every parameter of every laser differs, by far more than in life."""
    rng = np.random.default_rng(seed)
    n = scanner.n_lasers
    return replace(
        parameters.nominal(scanner),
        **{name: rng.normal(0.0, 0.1, n) for name in ("dl", "alpha", "v", "voff", "hoff")},
    )


def recording(folder, name, n=PACKETS, **more):
    payloads = spin(n, **(SPINS[name] | more))
    payloads[:, 19:22] = 0  # a laser of the first block without a return, in every packet
    return payloads, write(folder, record_list(payloads, 42))


def everything(path, settings, rotations=None):
    found = inspect(path)
    chosen = np.arange(len(found.index)) if rotations is None else np.array(rotations)
    parts = [columns for columns, _ in stream(path, found, chosen, settings)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def expected(path, payloads, settings, parameter_set):
    """Points by the functions that the adjustment uses, in double precision."""
    scanner = settings.scanner
    firings = decode(payloads, scanner)
    laser = firings.laser_id().reshape(-1)
    azimuth = np.repeat(firings.azimuth, scanner.lasers_per_firing)
    kept = firings.distance.reshape(-1) > 0
    rate = 2 * np.pi * inspect(path).index.rate_hz()
    phi = beam_model.angle_from_ticks(azimuth, laser, scanner, rate)
    distance = beam_model.distance_from_ticks(firings.distance.reshape(-1), 0.002)
    xyz = beam_model.points(distance[kept], phi[kept], laser[kept], parameter_set)
    return xyz, laser[kept], firings.intensity.reshape(-1)[kept]


def stacked(columns):
    return np.column_stack([columns[name] for name in "xyz"]).astype(float)


@pytest.mark.parametrize("name", SPINS)
def test_points_are_those_of_the_model(name, tmp_path):
    payloads, path = recording(tmp_path, name)
    scanner = SCANNERS[name]
    settings = Settings(scanner, calibration(scanner), calibration(scanner, 2))
    columns = everything(path, settings)
    xyz, laser, intensity = expected(path, payloads, settings, settings.parameters)
    assert len(xyz) < payloads.size / 1206 * 384  # the zeros are left out
    # Half a dozen roundings of numbers up to the range, in single precision.
    bound = 6 * np.finfo(np.float32).eps * np.linalg.norm(xyz, axis=1).max()
    np.testing.assert_allclose(stacked(columns), xyz, rtol=0, atol=bound)
    np.testing.assert_array_equal(columns["laser_id"], laser)
    np.testing.assert_array_equal(columns["intensity"], intensity)
    before, *_ = expected(path, payloads, settings, settings.before)
    moved = np.linalg.norm(xyz - before, axis=1)
    np.testing.assert_allclose(columns["shift"], moved, rtol=1e-5, atol=1e-5)


def test_banks_may_follow_in_any_order_and_pieces_have_any_size(tmp_path, monkeypatch):
    """The constants of the firings are kept while the order of banks stays the same."""
    payloads, _ = recording(tmp_path, "HDL-64E")
    flags = payloads[:, :1200].reshape(-1, 12, 100)[..., 1]
    swapped = np.random.default_rng(1).random(len(flags)) < 0.1
    flags[swapped] = np.where(flags[swapped] == 0xEE, 0xDD, 0xEE)
    path = write(tmp_path, record_list(payloads, 42))
    scanner = SCANNERS["HDL-64E"]
    settings = Settings(scanner, calibration(scanner))
    columns = everything(path, settings)
    xyz, laser, _ = expected(path, payloads, settings, settings.parameters)
    bound = 6 * np.finfo(np.float32).eps * np.linalg.norm(xyz, axis=1).max()
    np.testing.assert_array_equal(columns["laser_id"], laser)
    np.testing.assert_allclose(stacked(columns), xyz, rtol=0, atol=bound)
    monkeypatch.setattr(placing, "DECODED", 100)
    monkeypatch.setattr(placing, "PACKETS", 37)
    found = inspect(path)
    parts = list(stream(path, found, np.arange(len(found.index)), settings))
    assert [packets for _, packets in parts] == 7 * [37, 37, 26]
    for name, values in columns.items():
        pieces = np.concatenate([part[name] for part, _ in parts])
        np.testing.assert_array_equal(pieces, values, strict=True)


def test_axes_of_ros(tmp_path):
    _, path = recording(tmp_path, "VLP-16")
    settings = Settings(SCANNERS["VLP-16"], calibration(SCANNERS["VLP-16"]))
    ours, theirs = (everything(path, replace(settings, frame=f)) for f in placing.FRAMES)
    np.testing.assert_array_equal(theirs["x"], ours["y"])
    np.testing.assert_array_equal(theirs["y"], -ours["x"])
    np.testing.assert_array_equal(theirs["z"], ours["z"])


def test_limits_of_range_are_of_the_corrected_distance(tmp_path):
    _, path = recording(tmp_path, "HDL-64E")
    scanner = SCANNERS["HDL-64E"]
    settings = Settings(
        scanner, replace(calibration(scanner), voff=np.zeros(64), hoff=np.zeros(64))
    )
    every = everything(path, settings)
    some = everything(path, replace(settings, min_range_m=5.0, max_range_m=60.0))
    length = np.linalg.norm(stacked(every), axis=1)
    inside = (length >= 5.0) & (length <= 60.0)
    sure = np.abs(length - 5.0) > 1e-4
    sure &= np.abs(length - 60.0) > 1e-4
    assert 0.2 < inside.mean() < 0.8
    assert abs(len(some["x"]) - inside.sum()) <= (~sure).sum()
    assert np.linalg.norm(stacked(some), axis=1).min() > 5.0 - 1e-4


@pytest.mark.parametrize("name", SPINS)
def test_time_of_every_shot(name, tmp_path):
    """On the device clock, over its hour; packets at their stamps, lasers as they fire."""
    interval = SPINS[name]["interval_us"]
    payloads, path = recording(tmp_path, name, stamp_us=3_600_000_000 - 300 * interval)
    scanner = SCANNERS[name]
    columns = everything(path, Settings(scanner, calibration(scanner)))
    packet = np.repeat(np.arange(PACKETS), 384)[decode(payloads, scanner).distance.ravel() > 0]
    within = columns["time"] - packet * interval * 1e-6
    assert within.min() == pytest.approx(0, abs=1e-9)
    assert within.max() < 1.01e-6 * interval
    first = columns["laser_id"] == columns["laser_id"].min()
    assert len(np.unique(within[first].round(8))) == 12 * scanner.firings_per_block / len(
        scanner.flags
    )


def test_without_a_device_clock_times_are_of_the_capture(tmp_path):
    payloads = spin(PACKETS, **SPINS["HDL-32E"])
    payloads[:, 1200:1204] = np.frombuffer(b"TEXT", dtype=np.uint8)
    path = write(tmp_path, pcap(payloads), "x.pcap")
    assert inspect(path).clock == "capture"
    columns = everything(path, Settings(SCANNERS["HDL-32E"], calibration(SCANNERS["HDL-32E"])), [2])
    start = inspect(path).index.time_s[2]
    assert columns["time"][0] == pytest.approx(start, abs=6e-4)
    bare = write(tmp_path, record_list(payloads, 0), "x.bin")
    columns = everything(bare, Settings(SCANNERS["HDL-32E"], calibration(SCANNERS["HDL-32E"])))
    assert np.isnan(columns["time"]).all()
    assert np.isfinite(columns["x"]).all()


def test_chosen_rotations_are_the_rows_of_all(tmp_path):
    _, path = recording(tmp_path, "HDL-32E", 1500)
    scanner = SCANNERS["HDL-32E"]
    settings = Settings(scanner, calibration(scanner))
    every = everything(path, settings)
    assert every["rotation"].max() >= 6
    some = everything(path, settings, [1, 3, 4])
    rows = np.isin(every["rotation"], [1, 3, 4])
    for name in ("laser_id", "rotation", "intensity"):
        np.testing.assert_array_equal(some[name], every[name][rows])
    np.testing.assert_allclose(some["time"], every["time"][rows], atol=1e-9)
    # The rate is that of the rotations chosen.
    np.testing.assert_allclose(stacked(some), stacked(every)[rows], atol=1e-3)


def test_raw_returns_are_those_of_the_points(tmp_path):
    _, path = recording(tmp_path, "HDL-64E")
    scanner = SCANNERS["HDL-64E"]
    settings = Settings(scanner, calibration(scanner), min_range_m=3.0)
    found = inspect(path)
    beams = raw_returns(path, found, np.array([1]), settings)
    columns = everything(path, settings, [1])
    xyz = beams.points(settings.parameters)
    np.testing.assert_allclose(stacked(columns), xyz, atol=1e-4)


# -- files -----------------------------------------------------------------------------------------

NUMPY_OF_PLY = {"float": "<f4", "double": "<f8", "uchar": "u1", "uint": "<u4"}


def read_ply(path):
    """PLY as its description of 1994 says, and nothing of the library's."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in head.decode("ascii").split("\n")]
    assert lines[0] == ["ply"]
    assert lines[1] == ["format", "binary_little_endian", "1.0"]
    (count,) = [int(words[2]) for words in lines if words[:2] == ["element", "vertex"]]
    row = np.dtype([(w[2], NUMPY_OF_PLY[w[1]]) for w in lines if w and w[0] == "property"])
    assert len(body) == count * row.itemsize
    return np.frombuffer(body, dtype=row)


def read_pcd(path):
    head, _, body = path.read_bytes().partition(b"DATA binary\n")
    entries = dict(
        line.split(" ", 1) for line in head.decode("ascii").split("\n") if line and line[0] != "#"
    )
    assert entries["VERSION"] == "0.7"
    assert entries["HEIGHT"] == "1"
    kinds = [
        {"F": "<f", "U": "<u"}[kind] + size
        for kind, size in zip(entries["TYPE"].split(), entries["SIZE"].split(), strict=True)
    ]
    row = np.dtype(list(zip(entries["FIELDS"].split(), kinds, strict=True)))
    assert set(entries["COUNT"].split()) == {"1"}
    assert int(entries["WIDTH"]) == int(entries["POINTS"])
    assert len(body) == int(entries["POINTS"]) * row.itemsize
    return np.frombuffer(body, dtype=row)


def read_las(path):
    las = pytest.importorskip("laspy").read(path)
    assert (np.asarray(las.return_number) == 1).all()
    columns = {name: np.asarray(las[name]) for name in ("x", "y", "z", "laser_id", "rotation")}
    if "shift" in las.point_format.extra_dimension_names:
        columns["shift"] = np.asarray(las["shift"])
    assert (np.asarray(las.intensity) % 256 == 0).all()
    return columns | {
        "intensity": np.asarray(las.intensity) // 256,
        "time": np.asarray(las.gps_time),
    }


def read_parquet(path):
    table = pq.read_table(path)
    return {name: table[name].to_numpy() for name in table.column_names}


READERS = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".las": read_las,
    ".laz": read_las,
    ".parquet": read_parquet,
}


@pytest.mark.parametrize("shift", [False, True])
@pytest.mark.parametrize("suffix", READERS)
def test_files_are_read_back(suffix, shift, tmp_path):
    _, path = recording(tmp_path, "HDL-64E", 300)
    scanner = SCANNERS["HDL-64E"]
    settings = Settings(scanner, calibration(scanner), calibration(scanner, 2) if shift else None)
    expect = everything(path, settings)
    found = inspect(path)
    out = tmp_path / f"points{suffix}"
    with cloud_writer(out, shift=shift, facts={"scanner": scanner.name}) as write_columns:
        for columns, _ in stream(path, found, np.arange(len(found.index)), settings):
            write_columns(columns)
    again = out.with_name(f"again{suffix}")
    with cloud_writer(again, shift=shift, facts={"scanner": scanner.name}) as write_columns:
        for columns, _ in stream(path, found, np.arange(len(found.index)), settings):
            write_columns(columns)
    assert again.read_bytes() == out.read_bytes()
    columns = READERS[suffix](out)
    for name in fields(shift=shift):
        tolerance = 0.000501 if suffix in (".las", ".laz") and name in "xyz" else 0
        np.testing.assert_allclose(columns[name], expect[name], rtol=0, atol=tolerance)
    assert len(columns["x"]) == len(expect["x"]) > 100_000
    assert sorted(p.name for p in out.parent.glob("*.*")) == [again.name, out.name]


@pytest.mark.parametrize("shift", [False, True])
def test_a_bag_is_read_back_by_rosbags(shift, tmp_path):
    scanner = SCANNERS["HDL-32E"]
    _, path = recording(tmp_path, scanner.name, 300)
    settings = Settings(
        scanner, calibration(scanner), calibration(scanner, 2) if shift else None, frame="ros"
    )
    expect, found = everything(path, settings), inspect(path)
    facts = {"scanner": scanner.name, "frame": "ros"}
    for out in (tmp_path / "a.mcap", tmp_path / "b.mcap"):
        with cloud_writer(out, shift=shift, facts=facts) as write_columns:
            for columns, _ in stream(path, found, np.arange(len(found.index)), settings):
                write_columns(columns)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    clouds, starts, ids = [], [], set()
    with AnyReader([tmp_path / "a.mcap"]) as reader:
        for connection, time_ns, raw in reader.messages():
            cloud = reader.deserialize(raw, connection.msgtype)
            stamp = cloud.header.stamp
            assert time_ns == stamp.sec * 10**9 + stamp.nanosec
            kinds = {4: "<u2", 7: "<f4"}
            row = np.dtype([(f.name, kinds[f.datatype]) for f in cloud.fields])
            assert [row.fields[f.name][1] for f in cloud.fields] == [f.offset for f in cloud.fields]
            clouds.append(cloud.data.view(row))
            assert len(clouds[-1]) == cloud.width == cloud.row_step // cloud.point_step
            starts.append(np.full(cloud.width, time_ns * 1e-9))
            ids.add((connection.topic, cloud.header.frame_id))
    assert ids == {("/velodyne_points", "velodyne")}
    assert len(clouds) == len(set(expect["rotation"]))
    points = np.concatenate(clouds)
    assert list(points.dtype.names) == ["x", "y", "z", "intensity", "ring", "time"] + (
        ["shift"] if shift else []
    )
    for name in {*points.dtype.names} - {"ring", "time"}:
        np.testing.assert_array_equal(points[name], expect[name])
    # Half a nanosecond of the stamp, and single precision of a tenth of a second.
    np.testing.assert_allclose(
        np.concatenate(starts) + points["time"], expect["time"], rtol=0, atol=2e-8
    )
    # Rings count from the lowest laser up.
    angle = parameters.nominal(scanner).v[expect["laser_id"]]
    assert (np.diff(angle[np.argsort(points["ring"], kind="stable")]) >= 0.0).all()
    assert set(points["ring"]) == set(range(32))


def test_nothing_is_left_of_a_bag_that_failed(tmp_path):
    with (
        pytest.raises(ValueError, match="stop"),
        cloud_writer(tmp_path / "x.mcap", shift=False, facts={"scanner": "VLP-16"}),
    ):
        raise ValueError("stop")
    assert not list(tmp_path.iterdir())


def test_coordinates_may_be_views_of_one_array_or_not(tmp_path):
    both = np.arange(200, dtype=np.float32).view(np.complex64)
    rest = {
        name: np.arange(100, dtype=kind)
        for name, kind in (
            ("z", "f4"), ("intensity", "u1"), ("laser_id", "u1"), ("rotation", "u4"), ("time", "f8")
        )
    }  # fmt: skip
    for number, (x, y) in enumerate(
        [
            (both.real, both.imag),
            (both.real.copy(), both.imag.copy()),
            (both.imag, both.real),
            (both.real[::-1], both.imag[::-1]),
            (both.view(np.float32)[:100], both.view(np.float32)[100:]),
        ]
    ):
        path = tmp_path / f"{number}.ply"
        with cloud_writer(path, shift=False, facts={}) as write_columns:
            write_columns({"x": x, "y": y, **rest})
        columns = read_ply(path)
        for name, values in {"x": x, "y": y, **rest}.items():
            np.testing.assert_array_equal(columns[name], values)


def test_parquet_states_limits_only_of_columns_that_are_searched(tmp_path):
    _, path = recording(tmp_path, "VLP-16", 300)
    scanner = SCANNERS["VLP-16"]
    out, found = tmp_path / "points.parquet", inspect(path)
    with cloud_writer(out, shift=False, facts={"scanner": scanner.name}) as write_columns:
        settings = Settings(scanner, calibration(scanner))
        for columns, _ in stream(path, found, np.arange(len(found.index)), settings):
            write_columns(columns)
    group = pq.read_metadata(out).row_group(0)
    limits = [group.column(n) for n in range(group.num_columns)]
    stated = [each.path_in_schema for each in limits if each.is_stats_set]
    assert stated == ["rotation", "time"]


def test_headers_are_padded_to_one_length(tmp_path):
    for suffix, end in ((".ply", b"end_header\n"), (".pcd", b"DATA binary\n")):
        with cloud_writer(tmp_path / f"x{suffix}", shift=True, facts={}):
            pass
        content = (tmp_path / f"x{suffix}").read_bytes()
        assert len(content) == HEADER_BYTES
        assert content.endswith(end)


def test_nothing_is_left_of_a_file_that_failed(tmp_path):
    def fail(suffix):
        with cloud_writer(tmp_path / f"x{suffix}", shift=False, facts={}):
            raise ValueError(suffix)

    for suffix in READERS:
        with pytest.raises(ValueError, match=suffix):
            fail(suffix)
    assert not list(tmp_path.iterdir())


def test_las_without_laspy_is_one_clear_message(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "laspy", None)
    with (
        pytest.raises(ConfigError, match=r"laspy\[lazrs\]"),
        cloud_writer(tmp_path / "x.laz", shift=False, facts={}),
    ):
        pass


# -- the command -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    folder = tmp_path_factory.mktemp("points")
    _, path = recording(folder, "HDL-32E", 1500)
    for number in (1, 2):
        formats.write(folder / f"{number}.csv", calibration(SCANNERS["HDL-32E"], number))
    return path


def run(*arguments):
    return CliRunner().invoke(app, ["points", *map(str, arguments)])


def test_command(capture, tmp_path):
    out, picture = tmp_path / "o.ply", tmp_path / "o.png"
    files = [capture.with_name(f"{number}.csv") for number in (1, 2)]
    done = run(
        capture, "-o", out, "-c", files[0], "--before", files[1], "--picture", picture,
        "--rotations", "1:6", "--every", 2, "--frame", "ros", "--max-range", 50,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    rows = read_ply(out)
    assert set(rows["rotation"]) == {1, 3, 5}
    assert f"{len(rows)} points of 3 rotations (HDL-32E" in done.output
    assert rows["shift"].mean() > 0.05
    assert picture.stat().st_size > 10_000
    assert picture.with_suffix(".svg").is_file()


def test_a_factory_file_is_applied_with_its_near_points(tmp_path):
    """Against the same file without them: centimetres, which were left out silently."""
    _, path = recording(tmp_path, "HDL-64E")
    scanner = SCANNERS["HDL-64E"]
    design = replace(parameters.nominal(scanner), dl=np.full(64, 1.0))
    near = {"dist_correction_x": np.full(64, 1.06), "dist_correction_y": np.full(64, 1.06)}
    formats.write(tmp_path / "db.xml", replace(design, carried=near))
    formats.write(tmp_path / "far.csv", design)
    files = "-c", tmp_path / "db.xml", "--before", tmp_path / "far.csv"
    done = run(path, "-o", tmp_path / "o.ply", *files, "--max-range", 6, "--scanner", "HDL-64E")
    assert done.exit_code == 0, done.output
    rows = read_ply(tmp_path / "o.ply")
    # 6 cm at the near points, which fade to nothing at 25 m.
    assert 0.03 < rows["shift"].mean() < 0.06
    # A file for another program is applied as that program does, up to what is said.
    turned = formats.CalibrationFile(design, "veloview")
    formats.write(tmp_path / "view.xml", turned)
    done = run(path, "-o", tmp_path / "p.ply", "-c", tmp_path / "view.xml", "--scanner", "HDL-64E")
    assert "veloview rounds azimuths to 0.01 deg: left out, up to 0.7 cm at 80 m" in done.output
    assert "nominal values are used" not in done.output
    done = run(path, "-o", tmp_path / "q.ply", "--scanner", "HDL-64E")
    assert done.exit_code == 0
    assert "nominal values are used: every HDL-64E has a calibration of its own" in done.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "x.xyz"], "unknown suffix '.xyz'"),
        (["-o", "x.ply", "--rotations", "5"], "is not a range"),
        (["-o", "x.ply", "--rotations", "900:"], "holds no rotation"),
        (["-o", "x.ply", "--picture", "x.png"], "together with --before"),
        (["-o", "x.ply", "--frame", "enu"], "allowed: velocal, ros"),
        (["-o", "x.ply", "-c", "gone.xml"], "gone.xml"),
        (["-o", "x.ply", "--min-range", 5, "--max-range", 2], "from 5 to 2 m there is no point"),
    ],
)
def test_wrong_calls(capture, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    done = run(capture, *arguments)
    assert message in str(done.exception)
    assert not list(tmp_path.iterdir())
