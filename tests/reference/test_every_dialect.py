"""Every scanner x every dialect x every command that computes points: all agree.

Expected are the formulas of the programs, written out one by one (`dialect_formulas`).
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from reference.dialect_formulas import FORMULAS, Laser
from support.capture import record_list, spin, write

from velocal.calibration.applied import applied
from velocal.calibration.convert import convert, incompatibilities, max_point_distance
from velocal.calibration.dialects import DIALECTS, PAPER
from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.packets import data as packets
from velocal.packets.firings import decode
from velocal.points.stream import Settings, raw_returns, stream
from velocal.recording.inspection import Inspection
from velocal.recording.scan import inspect
from velocal.scanner.models import SCANNERS, Family, Scanner
from velocal.scanner.parameters import LaserParameters, nominal

RATE_HZ = 20.0
TICK = np.deg2rad(0.01)
NEAR = ("dist_correction_x", "dist_correction_y")
FLAG = "two_pt_correction_available"


def unit(scanner: Scanner) -> LaserParameters:
    """A unit with all that a file may hold; some lasers without two-point correction."""
    rng, n, design = np.random.default_rng(4), scanner.n_lasers, nominal(scanner)
    moved = {
        name: getattr(design, name) + rng.normal(0.0, size, n)
        for name, size in {"alpha": 0.01, "v": 0.004, "voff": 0.004, "hoff": 0.01}.items()
    }
    dl = rng.normal(0.3, 0.05, n)
    x, y = dl + rng.normal(0.04, 0.02, (2, n))
    off = np.arange(n) % 5 == 0
    x[off] = y[off] = 0.0
    carried = dict(zip((*NEAR, FLAG), (x, y, np.where(off, 0.0, 1.0)), strict=True))
    return replace(design, dl=dl, carried=carried, **moved)


@dataclass
class Recorded:
    """A short recording, and its returns decoded."""

    path: Path
    inspection: Inspection
    scanner: Scanner
    start: np.ndarray  # azimuth of the firing, radians
    laser: np.ndarray
    distance_m: np.ndarray

    @property
    def rate_hz(self) -> float:
        return self.inspection.index.rate_hz()


@pytest.fixture(scope="module", params=SCANNERS)
def recorded(request, tmp_path_factory) -> Recorded:
    """2.2 rotations at 20 Hz; every 40th return is kept, so that the formulas take no time."""
    scanner = SCANNERS[request.param]
    step = round(RATE_HZ * scanner.firing_cycle_s * 36_000)
    status = (0x37, scanner.factory_byte or 0x21)
    payloads = spin(
        round(2.2 / RATE_HZ * scanner.packet_rate_hz),
        step=step * scanner.firings_per_block,
        banks=len(scanner.flags),
        status=status,
        interval_us=round(1e6 / scanner.packet_rate_hz),
    )
    channels = packets.view(payloads)["blocks"]["channels"]["distance"]
    kept = np.random.default_rng(5).random(channels.shape) < 1 / 40
    channels[~kept] = 0
    channels[kept & (np.random.default_rng(6).random(channels.shape) < 0.7)] //= 8  # near ones
    path = write(tmp_path_factory.mktemp("every"), record_list(payloads, 42))
    firings = decode(payloads, scanner)
    width = scanner.lasers_per_firing
    distance = firings.distance.reshape(-1)
    some = distance > 0
    return Recorded(
        path,
        inspect(path),
        scanner,
        np.repeat(firings.azimuth, width)[some] * TICK,
        firings.laser_id().reshape(-1)[some],
        distance[some] * scanner.distance_tick_m,
    )


def by_formula(of: Recorded, name: str, parameters: LaserParameters) -> np.ndarray:
    """Points of the written-out formula, at azimuths that are not rounded."""
    ignored = name == "ros" and of.scanner.family is Family.VLS128
    delays = DIALECTS[name].delays_s(of.scanner)
    lasers = []
    for k in range(len(parameters)):
        near = [parameters.carried[key][k] for key in NEAR]
        flag = bool(parameters.carried[FLAG][k])
        if not flag and name in ("manual", "manual_s2"):
            near = [parameters.dl[k]] * 2  # a file of the factory has no flag
        lengths = [parameters.dl[k], *near, parameters.voff[k], parameters.hoff[k]]
        lengths = [0.0 if ignored else length for length in lengths]
        lasers.append(Laser(parameters.alpha[k], parameters.v[k], *lengths, flag and not ignored))
    phi = of.start + 2 * np.pi * of.rate_hz * delays[of.laser]
    rows = zip(of.distance_m, phi, of.laser, strict=True)
    return np.array([FORMULAS[name](d, a, lasers[k]) for d, a, k in rows])


@pytest.mark.parametrize("name", DIALECTS)
def test_commands_agree(recorded, name, tmp_path):
    scanner, dialect, numbers = recorded.scanner, DIALECTS[name], unit(recorded.scanner)
    if name == "paper":
        numbers = replace(numbers, carried={})
        wanted = by_formula(recorded, name, unit(scanner))
    else:
        wanted = by_formula(recorded, name, numbers)
    path = tmp_path / "a.json"
    formats.write(path, CalibrationFile(numbers, name, scanner.name, scanner.distance_tick_m))
    found = formats.read_for(path, scanner)
    # velocal points, with --before: float32 at up to 240 m.
    bound = 8 * np.finfo(np.float32).eps * np.abs(wanted).max()
    settings = Settings(scanner, found, nominal(scanner))
    every = np.arange(len(recorded.inspection.index))
    parts = [c for c, _ in stream(recorded.path, recorded.inspection, every, settings)]
    columns = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    xyz = np.column_stack([columns[axis] for axis in "xyz"]).astype(float)
    np.testing.assert_array_equal(columns["laser_id"], recorded.laser)
    np.testing.assert_allclose(xyz, wanted, rtol=0, atol=bound)
    beams = raw_returns(recorded.path, recorded.inspection, every, settings)
    before = beams.points(nominal(scanner))
    shift = np.linalg.norm(wanted - before, axis=1)
    np.testing.assert_allclose(columns["shift"], shift, rtol=1e-5, atol=2 * bound)
    # The picture of --before.
    use = applied(found, scanner, recorded.rate_hz)
    shown = use.points(beams.distance_m, beams.phi, beams.laser_id)
    np.testing.assert_allclose(shown, wanted, rtol=0, atol=1e-9)
    # velocal calibration diff: at the azimuths of a grid, which programs round.
    apart = max_point_distance(
        (dialect, numbers), (PAPER, use.model), (10.0,), scanner=scanner, rate_hz=recorded.rate_hz
    )
    rounding = 10.0 * TICK / 2.0 + 1e-9 if dialect.rounds and dialect.delays_s(scanner).any() else 0
    near = max((float(np.abs(e - numbers.dl).max()) for e in dialect.near(numbers)), default=0.0)
    if not use.has_near_points:
        assert apart.max() <= rounding + 1e-9
    else:
        assert 0.005 < apart.max() <= near + rounding
    # velocal calibration convert: the same points for the model of this project, if it is exact.
    reasons = incompatibilities(numbers, dialect, PAPER, scanner, recorded.rate_hz)
    unknown = scanner.firing_time_s is None and dialect.policy(scanner) is not PAPER.policy(scanner)
    assert bool(reasons) == (use.has_near_points or unknown)
    converted = convert(
        numbers, dialect, PAPER, scanner=scanner, rate_hz=recorded.rate_hz, inexact=True
    )
    if not use.has_near_points:
        again = beams.points(converted)
        np.testing.assert_allclose(again, wanted, rtol=0, atol=1e-9)
    # The workflow: parameters of the model, and near-point corrections beside them.
    start = formats.read_or_nominal(path, scanner)
    for key in ("dl", "v", "voff", "hoff"):
        np.testing.assert_allclose(getattr(start, key), getattr(use.model, key), atol=1e-12)
    assert any((each != start.dl).any() for each in DIALECTS["manual"].near(start)) == (
        use.has_near_points
    )
