"""Dialects against the formulas of the programs, and velodyne-decoder itself."""

import importlib.util
import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reference.dialect_formulas import FORMULAS, Laser

from velocal.calibration import convert as conversion
from velocal.calibration import dialects
from velocal.calibration.dialects import DIALECTS, MANUAL, PAPER
from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.errors import DialectError
from velocal.packets import data as packets
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters

HDL64E = ("64e_s2.1-sztaki.xml", "64e_s3-xiesc.yaml")
#: On both sides of every limit, by ticks.
RAW_M = np.array([0.9, 2.0, 2.4, 3.0, 10.0, 24.998, 25.0, 25.002, 25.038, 25.04, 25.042, 80.0])


def some_lasers(rng: np.random.Generator, n: int = 40) -> LaserParameters:
    """Lasers with everything other than zero; some without two-point flag, some with one zero."""
    dl = rng.normal(1.4, 0.05, n)
    x, y = dl + rng.normal(0.0, 0.03, (2, n))
    x[::7], y[::5] = 0.0, 0.0
    return LaserParameters(
        dl=dl,
        alpha=rng.normal(0.0, 0.08, n),
        v=rng.uniform(-0.45, 0.2, n),
        voff=rng.uniform(0.1, 0.2, n),
        hoff=np.where(np.arange(n) % 2, -0.026, 0.026),
        carried={
            "dist_correction_x": x,
            "dist_correction_y": y,
            "two_pt_correction_available": np.ones(n),
        },
    )


def test_every_dialect_has_its_formula():
    assert set(FORMULAS) == set(DIALECTS)


@pytest.mark.parametrize("name", DIALECTS)
def test_points_are_those_of_the_formula(name):
    parameters = some_lasers(np.random.default_rng(3))
    off = np.arange(len(parameters)) % 3 == 0
    if name == "ros":  # the only one that knows the flag
        parameters.carried["two_pt_correction_available"][off] = 0.0
    columns = [parameters.alpha, parameters.v, parameters.dl, *parameters.carried.values()][:5]
    flag = parameters.carried["two_pt_correction_available"]
    phi = np.deg2rad(np.arange(0.0, 360.0, 14.37))
    cases = list(itertools.product(range(len(parameters)), RAW_M, phi))
    laser, raw, azimuth = map(np.array, zip(*cases, strict=True))
    found = DIALECTS[name].points(raw, azimuth, laser, parameters)
    wanted = [
        FORMULAS[name](
            distance,
            angle,
            Laser(
                *(column[k] for column in columns),
                parameters.voff[k],
                parameters.hoff[k],
                bool(flag[k]),
            ),
        )
        for k, distance, angle in cases
    ]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)


EXACT = [
    ("paper", name) for name in ("manual", "manual_s2", "ros", "libvelodyne", "veloview", "pcl")
] + [("ros", "paper"), ("veloview", "ros"), ("libvelodyne", "veloview"), ("mrpt", "paper")]


@pytest.mark.parametrize(("source", "target"), EXACT)
def test_exact_conversions_give_the_same_points(source, target):
    parameters = replace(some_lasers(np.random.default_rng(4)), carried={})
    one, other = DIALECTS[source], DIALECTS[target]
    found = conversion.convert(parameters, one, other)
    assert conversion.max_point_distance((one, parameters), (other, found)).max() < 1e-12
    back = conversion.convert(found, other, one) if source != "mrpt" else parameters
    for name in ("dl", "alpha", "v", "voff", "hoff"):
        np.testing.assert_allclose(getattr(back, name), getattr(parameters, name), atol=1e-15)


@pytest.mark.parametrize(("source", "target"), [("manual_s2", "ros"), ("ros", "manual_s2")])
def test_two_point_correction_converts_where_it_is_the_same(source, target):
    parameters = some_lasers(np.random.default_rng(5))
    one, other = DIALECTS[source], DIALECTS[target]
    found = conversion.convert(parameters, one, other)
    assert np.abs(found.dl - parameters.dl).max() > 0.01
    assert conversion.max_point_distance((one, parameters), (other, found)).max() < 1e-12


@pytest.mark.parametrize(
    ("source", "target", "why"),
    [
        ("manual", "paper", "paper does not read near-point corrections: points differ by up to"),
        ("manual", "ros", "ros interpolates near-point corrections in another way"),
        ("manual", "velodyne_decoder", "velodyne_decoder interpolates near-point"),
        ("paper", "mrpt", "mrpt ignores rotational corrections"),
    ],
)
def test_what_cannot_be_converted_is_refused_and_quantified(source, target, why):
    parameters = some_lasers(np.random.default_rng(6))
    one, other = DIALECTS[source], DIALECTS[target]
    with pytest.raises(DialectError, match=rf"{why}(.|\n)* cm at 80 m(.|\n)*Hint: .*--inexact"):
        conversion.convert(parameters, one, other)
    found = conversion.convert(parameters, one, other, inexact=True)
    assert conversion.max_point_distance((one, parameters), (other, found)).max() > 1e-3


@pytest.mark.parametrize("name", ["ros", "veloview", "manual", "velodyne_decoder", "pcl"])
def test_exported_sets_give_every_reader_the_points_of_the_model(name):
    """Whatever near-point corrections the factory's file carried: the set has one dl."""
    refined = some_lasers(np.random.default_rng(12)).corrected({"dl": np.full(40, 0.02)})
    found = conversion.for_program(refined, name)
    assert conversion.max_point_distance((PAPER, refined), (DIALECTS[name], found)).max() < 1e-12


def test_the_distance_of_mrpt_has_a_pole():
    """Where sin^2 v = cos v, moving along the beam undoes what the offset does."""
    pole = np.arccos((np.sqrt(5.0) - 1.0) / 2.0)
    parameters = replace(some_lasers(np.random.default_rng(7), 1), v=np.array([pole]))
    parameters = replace(parameters, alpha=np.zeros(1), carried={})
    with pytest.raises(DialectError, match="mrpt cannot express the offset of laser 0"):
        conversion.convert(parameters, PAPER, DIALECTS["mrpt"])


@pytest.mark.parametrize("scanner", ["HDL-64E", "HDL-32E"])
def test_interpolation_within_a_firing_goes_into_alpha_at_one_rate(scanner):
    parameters = replace(some_lasers(np.random.default_rng(8), 64), carried={})
    n, target = SCANNERS[scanner].n_lasers, {"HDL-64E": "velodyne_decoder", "HDL-32E": "ros"}
    parameters = LaserParameters(*(getattr(parameters, k)[:n] for k in ("dl", "alpha", "v")), *(
        getattr(parameters, k)[:n] for k in ("voff", "hoff")
    ))  # fmt: skip
    other = DIALECTS[target[scanner]]
    with pytest.raises(DialectError, match=r"interpolate azimuths differently.*\(at 10 Hz\)"):
        conversion.convert(parameters, PAPER, other, scanner=SCANNERS[scanner])
    found = conversion.convert(parameters, PAPER, other, scanner=SCANNERS[scanner], rate_hz=10.0)
    apart = conversion.max_point_distance(
        (PAPER, parameters), (other, found), (80.0,), scanner=SCANNERS[scanner], rate_hz=10.0
    )
    # Left is the rounding to half of 0.01 deg: 7 mm at 80 m.
    assert apart.max() < 0.0075
    worst = conversion.max_point_distance(
        (PAPER, parameters), (other, found), (80.0,), scanner=SCANNERS[scanner], rate_hz=5
    )
    assert worst.max() > 0.05


# -- velodyne-decoder itself -----------------------------------------------------------------------


def decoded(path: Path, scanner: str, payloads: np.ndarray) -> np.ndarray:
    vd = pytest.importorskip("velodyne_decoder")
    model = {
        "HDL-64E": vd.Model.HDL64E_S2,
        "HDL-64E-S3": vd.Model.HDL64E_S3,
        "HDL-32E": vd.Model.HDL32E,
        "VLP-16": vd.Model.VLP16,
        "VLP-16-Hi-Res": vd.Model.PuckHiRes,
        "VLP-32C": vd.Model.VLP32C,
    }
    config = vd.Config(
        model=model[scanner],
        calibration=vd.Calibration.read(str(path)),
        min_range=0.0,
        max_range=1000.0,
    )
    decoder, clouds = vd.ScanDecoder(config), []
    for number, payload in enumerate(payloads):
        packet = vd.PacketVector()
        packet.append(vd.VelodynePacket(1.0 + number, payload.tobytes()))
        clouds.append(np.asarray(decoder.decode(packet)[1], dtype=np.float64)[:, :3])
    forward, left, up = np.concatenate(clouds).T
    return np.column_stack([-left, forward, up])


#: Ticks from firing to firing, so that no laser's azimuth falls midway between two ticks.
STEP = {
    "HDL-64E": 16,
    "HDL-64E-S3": 16,
    "HDL-32E": 16,
    "VLP-16": 24,
    "VLP-16-Hi-Res": 24,
    "VLP-32C": 24,
}


def spinning(scanner: str, n_packets: int = 60) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Packets of a head that turns at exactly one rate; ticks of azimuth and distance."""
    known, rng = SCANNERS[scanner], np.random.default_rng(9)
    firings = n_packets * (6 if known.paired else 12 * known.firings_per_block)
    azimuth = (np.arange(firings) * STEP[scanner] % 36000).astype(np.uint16)
    distance = rng.integers(450, 45_000, (firings, known.n_lasers)).astype(np.uint16)
    intensity = np.full_like(distance, 7, dtype=np.uint8)
    shape = (n_packets, packets.BLOCKS)
    of_block = azimuth[:: known.firings_per_block]  # a block with two firings has one azimuth
    payloads = packets.encode(
        np.tile(np.array(known.flags, np.uint16), n_packets * 12 // len(known.flags)).reshape(
            shape
        ),
        np.repeat(of_block, len(known.flags)).reshape(shape),
        distance.reshape(*shape, 32),
        intensity.reshape(*shape, 32),
        np.arange(n_packets, dtype=np.uint32) * 576,
        np.full((n_packets, 2), (0x37, known.factory_byte or 0), np.uint8),
    )
    return payloads, azimuth, distance


@pytest.mark.parametrize("file", HDL64E)
@pytest.mark.parametrize("dialect", ["paper", "ros", "velodyne_decoder"])
def test_velodyne_decoder_gives_the_points_of_its_dialect(shared, tmp_path, file, dialect):
    """Its points of a file that we wrote, whatever dialect that is for, are those predicted."""
    parameters = formats.read(shared / "calibrations" / file, 64)
    written = conversion.convert(parameters, MANUAL, DIALECTS[dialect], inexact=True)
    formats.write(tmp_path / "a.yaml", CalibrationFile(written, dialect=dialect))
    payloads, azimuth, distance = spinning("HDL-64E")
    rate = STEP["HDL-64E"] * 0.01 / 360 / 48e-6
    laser = np.tile(np.arange(64), len(azimuth))
    other = DIALECTS["velodyne_decoder"]
    phi = other.azimuths(
        np.deg2rad(np.repeat(azimuth, 64) * 0.01), laser, SCANNERS["HDL-64E"], rate_hz=rate
    )
    ours = other.points(distance.ravel() * 0.002, phi, laser, written)
    theirs = decoded(tmp_path / "a.yaml", "HDL-64E", payloads)
    assert len(theirs) == len(ours)
    far = np.linalg.norm(ours - theirs, axis=1)
    # Single precision: 2^-24 of 90 m, some steps of it.
    assert far.max() < 1e-4  # single precision: 0.03 mm measured, 0.06 mm for the VLP-16
    # Whatever the dialect: the points are those of the file, not of the factory.
    apart = np.abs(written.voff - parameters.voff).max()
    assert apart > 0.005 if dialect == "ros" else apart < 1e-15


@pytest.mark.parametrize("scanner", ["HDL-32E", "VLP-16", "VLP-16-Hi-Res", "VLP-32C", "HDL-64E-S3"])
def test_velodyne_decoder_of_the_other_scanners(scanner, tmp_path):
    known = SCANNERS[scanner]
    n = known.n_lasers
    parameters = replace(
        some_lasers(np.random.default_rng(10), n), v=known.vertical_rad, carried={}
    )
    other = DIALECTS["velodyne_decoder"]
    formats.write(
        tmp_path / "a.yaml",
        CalibrationFile(parameters, dialect=other.name, tick_m=known.distance_tick_m),
    )
    payloads, azimuth, distance = spinning(scanner)
    laser = np.tile(np.arange(n), len(azimuth))
    rate = STEP[scanner] * 0.01 / 360 / known.firing_cycle_s
    phi = other.azimuths(np.deg2rad(np.repeat(azimuth, n) * 0.01), laser, known, rate_hz=rate)
    ours = other.points(distance.ravel() * known.distance_tick_m, phi, laser, parameters)
    far = np.linalg.norm(ours - decoded(tmp_path / "a.yaml", scanner, payloads), axis=1)
    # Single precision: 0.03 mm measured, 0.06 mm for the VLP-16; twice that at twice the range.
    assert far.max() < 1e-4 * known.distance_tick_m / 0.002


def test_points_of_the_model_are_the_dialect_of_the_paper():
    from velocal.scanner import beam as beam_model

    parameters = some_lasers(np.random.default_rng(11))
    laser = np.arange(40).repeat(5)
    raw, phi = np.linspace(1, 80, 200), np.linspace(0, 6, 200)
    np.testing.assert_allclose(
        dialects.PAPER.points(raw, phi, laser, parameters),
        beam_model.points(raw, phi, laser, parameters),
        rtol=0,
        atol=1e-13,
    )


# -- the tables of the document --------------------------------------------------------------------


@pytest.fixture(scope="module")
def benchmark(root):
    spec = importlib.util.spec_from_file_location("dialect_tables", root / "benchmarks/dialects.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_what_exports_leave_stands_in_the_document(benchmark):
    text = benchmark.DOC.read_text()
    assert benchmark.inserted(text, "leftovers", benchmark.tables([])["leftovers"]) == text


def test_differences_of_real_units_stand_in_the_document(benchmark, shared):
    """Programs differ by 1 to 27 cm (mrpt, which ignores rotational corrections, by metres)."""
    text = benchmark.DOC.read_text()
    table = benchmark.tables([shared / "calibrations" / name for name in HDL64E])["differences"]
    assert benchmark.inserted(text, "differences", table) == text
    rows = [
        line for line in table.splitlines() if " / " in line and not line.startswith("| mrpt |")
    ]
    largest = [float(size) for line in rows for size in re.findall(r"/ ([\d.]+)", line)]
    assert len(largest) == 2 * 10 * 4
    assert 26.0 < max(largest) < 27.0
    assert np.mean([size >= 1.0 for size in largest]) > 0.8


def test_every_dialect_is_described(benchmark):
    text = benchmark.DOC.read_text()
    for name, dialect in DIALECTS.items():
        (line,) = re.findall(rf"^\| `{name}` .*", text, re.MULTILINE)
        assert all(part in line for part in re.findall(r"[\w/]+\.(?:cc|cpp|cxx)", dialect.source))
