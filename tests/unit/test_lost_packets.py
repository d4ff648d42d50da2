"""Lost packets, and fields of view that are limited at the scanner."""

import numpy as np
import pytest
from support.capture import record_list, scan, spin, write

from velocal.errors import ConfigError
from velocal.packets.data import view
from velocal.recording.recording import open_recording
from velocal.recording.scan import inspect
from velocal.recording.windows import read_index, window_rotations, write_index

#: As a VLP-16 at 19.8 Hz: 37.97 packets a rotation.
VLP16 = {"step": 79, "interval_us": 1327, "status": (0x37, 0x22)}
N = 1900


def spun(**changes):
    return spin(N, **(VLP16 | changes))


def first_azimuths(payloads):
    return view(payloads)["blocks"]["azimuth"][:, 0].astype(int)


def found_in(folder, payloads, **settings):
    return inspect(write(folder, record_list(payloads, 42)), **settings)


@pytest.mark.parametrize("share", [0.003, 0.01, 0.03])
def test_rotations_with_lost_packets_are_used(share, tmp_path):
    payloads = spun()
    lost = np.random.default_rng(2).random(N) < share
    lost[[0, -1]] = False
    found = found_in(tmp_path, payloads[~lost])
    assert found.packets_missing == lost.sum() > 0
    runs = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(int)])) == 1)
    assert found.gaps == len(runs)
    most = max(len(run) for run in np.split(lost, np.flatnonzero(~lost)))
    assert found.index.loss.largest == most - 1 if most > 1 else 1
    # More than three packets, and than 5 % of the azimuth, are missing in no rotation but perhaps
    # a few at a loss of 3 %.
    rotation = np.cumsum(np.diff(first_azimuths(payloads), prepend=0) < -18_000)
    bad = int((np.bincount(rotation[lost]) > 3).sum())
    whole = found_in(tmp_path, payloads)
    assert whole.index.complete.sum() - bad <= found.index.complete.sum()
    for window in ("beginning", "middle", "end"):
        assert len(window_rotations(found.index, window, 10, "x")) == 10
    assert found.index.rate_hz() == pytest.approx(whole.index.rate_hz(), rel=1e-3)


def test_the_share_that_may_be_missing(tmp_path):
    """Ten packets of the 37.97 of the rotation 3 are lost: 26.3 %."""
    payloads = np.delete(spun(), np.s_[120:130], axis=0)
    for max_missing, complete in ((0.0, False), (0.05, False), (0.26, False), (0.265, True)):
        found = found_in(tmp_path, payloads, max_missing=max_missing)
        assert bool(found.index.complete[3]) is complete
        assert np.flatnonzero(~found.index.complete[1:-1]).tolist() == ([] if complete else [2])


def test_the_error_names_the_gaps(tmp_path):
    payloads = np.delete(spun(), np.concatenate([np.arange(k, k + 9) for k in range(50, N, 35)]), 0)
    recording = open_recording(write(tmp_path, record_list(payloads, 42)))
    with pytest.raises(ConfigError, match="too few for three windows of 10") as caught:
        recording.select("middle", 10)
    assert "gaps: 53, about 477 packets missing, 9 in the largest" in str(caught.value)
    assert "windows: max_missing" in str(caught.value)
    kept = tmp_path / "rotations.parquet"
    write_index(kept, recording.rotations)
    assert read_index(kept).loss == recording.rotations.loss
    assert read_index(kept).mean_rate_hz == recording.rotations.mean_rate_hz


# -- fields of view -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("first", "last"), [(270, 90), (90, 270), (100, 200), (350, 330), (300, 60), (10, 350)]
)
def test_a_limited_field_of_view_is_no_loss(first, last, tmp_path):
    payloads = spun()
    azimuth = first_azimuths(payloads)
    inside = (azimuth - 100 * first) % 36_000 < 100 * ((last - first) % 360)
    whole = found_in(tmp_path, payloads)
    found = found_in(tmp_path, payloads[inside])
    assert (found.gaps, found.packets_missing) == (0, 0)
    ((begin, end),) = found.view_deg
    # Packets begin every 9.6 degrees, at other azimuths in every rotation.
    assert begin == pytest.approx(first, abs=1.0)
    assert end == pytest.approx(last, abs=1.0)
    assert found.view_text == f"{begin:.0f} to {end:.0f} deg"
    assert abs(found.index.complete.sum() - whole.index.complete.sum()) <= 1
    assert found.index.rate_hz() == pytest.approx(whole.index.rate_hz(), rel=2e-3)
    assert len(window_rotations(found.index, "middle", 10, "x")) == 10


def test_a_field_of_view_within_packets(tmp_path):
    """The scanner fills its packets, so that some hold blocks of both ends of the field of view."""
    payloads = spun()
    blocks = view(payloads)["blocks"].reshape(-1)
    azimuth = blocks["azimuth"].astype(int)
    inside = np.flatnonzero((azimuth >= 9000) & (azimuth < 27_000))
    n = len(inside) // 12
    kept = payloads[:n].copy()
    view(kept)["blocks"][:] = blocks[inside[: 12 * n]].reshape(n, 12)
    view(kept)["timestamp"][:] = 5_000_000 + np.rint(inside[: 12 * n : 12] * 1327 / 12)
    found = found_in(tmp_path, kept)
    assert (found.gaps, found.packets_missing) == (0, 0)
    ((first, last),) = found.view_deg
    assert first == pytest.approx(90, abs=1.0)
    assert last == pytest.approx(270, abs=1.0)
    assert found.index.rate_hz() == pytest.approx(79 / 36_000 * 12 / 1327e-6, rel=2e-3)
    assert found.index.complete.sum() >= 48


def test_loss_within_a_limited_field_of_view(tmp_path):
    payloads = spun()
    azimuth = first_azimuths(payloads)
    inside = (azimuth < 9000) | (azimuth >= 27_000)
    lost = inside & (np.random.default_rng(5).random(N) < 0.02)
    lost[[0, -1]] = False
    found = found_in(tmp_path, payloads[inside & ~lost])
    # A packet that is lost at the edge belongs to the gap of the field of view.
    assert 0.7 * lost.sum() <= found.packets_missing <= lost.sum()
    assert len(found.view_deg) == 1


def test_one_long_gap_is_no_field_of_view(tmp_path):
    found = found_in(tmp_path, np.delete(spun(), np.s_[100:140], axis=0))
    assert found.packets_missing == 40
    assert found.view_deg == ()


# -- real recordings ------------------------------------------------------------------------------


@pytest.fixture
def indoor(shared):
    return scan(shared / "recordings" / "vlp16-indoor-50-rotations.pcap")[0]


def test_loss_in_a_real_recording(indoor, tmp_path):
    for share in (0.003, 0.01, 0.03):
        kept = np.random.default_rng(2).random(len(indoor)) >= share
        kept[[0, -1]] = True
        found = found_in(tmp_path, indoor[kept])
        assert found.packets_missing == len(indoor) - kept.sum() > 5
        assert found.index.complete.sum() == 50
        assert found.index.rate_hz() == pytest.approx(19.829, abs=2e-3)


def test_field_of_view_in_a_real_recording(indoor, tmp_path):
    azimuth = first_azimuths(indoor)
    found = found_in(tmp_path, indoor[(azimuth < 9000) | (azimuth >= 27_000)])
    assert found.view_text == "270 to 90 deg"
    assert (found.index.complete.sum(), found.gaps) == (50, 0)
    assert found.index.rate_hz() == pytest.approx(19.83, abs=0.01)
