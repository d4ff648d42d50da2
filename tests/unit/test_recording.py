"""A recording as one object: one scan, and returns of the rotations that are asked for."""

import numpy as np
import pytest
from support.capture import as_bytes, pcap, record_list, spin, two_returns, write
from support.chain import study_world
from support.containers import containers, ethernet, ip_packet, pcap_of

from velocal.errors import ConfigError, RecordingError
from velocal.io import schemas, storage
from velocal.packets.dual import LAST, ONLY, STRONGEST
from velocal.packets.firings import decode
from velocal.recording import recording as module
from velocal.recording.recording import open_recording
from velocal.recording.returns import write_returns
from velocal.scanner.models import SCANNERS
from velocal.simulation import capture, truth

N = 120


@pytest.fixture
def path(tmp_path):
    return write(tmp_path, record_list(spin(N), 42))


def test_it_is_scanned_once_and_not_before_it_must(path, monkeypatch):
    scans = []
    scan = module.inspect
    monkeypatch.setattr(module, "inspect", lambda *a, **k: scans.append(1) or scan(*a, **k))
    recording = open_recording(path)
    assert scans == []
    assert recording.ledger.unaccounted_bytes == 0
    assert recording.scanner is SCANNERS["HDL-32E"]
    assert len(recording.rotations) == 7
    assert recording.status.kind == "none"
    assert recording.remarks == []
    assert len(recording.returns([1])) == 32 * 240
    assert scans == [1]


def test_progress_of_the_scan(path):
    seen = []
    recording = open_recording(path)
    found = recording.scan(lambda done, total: seen.append((done, total)))
    assert seen[-1] == (path.stat().st_size,) * 2
    assert recording.scan() is found


@pytest.mark.parametrize("name", containers(spin(9)))
def test_returns_are_those_of_the_packets(name, tmp_path):
    """The same rows from every container, whether or not it can be read from the middle."""
    payloads = spin(N)
    recording = open_recording(write(tmp_path, containers(payloads)[name]))
    found = recording.returns("all")
    firings = decode(payloads, SCANNERS["HDL-32E"])
    np.testing.assert_array_equal(found.distance, firings.distance.reshape(-1))
    np.testing.assert_array_equal(found.laser_id, firings.laser_id().reshape(-1))
    assert (found.which == ONLY).all()
    assert found.scanner is SCANNERS["HDL-32E"]
    assert found.rotation_rate_hz == recording.rotations.rate_hz()
    assert len(found.seen) == np.count_nonzero(firings.distance)
    assert found.seen.distance.all()


def test_types_are_those_of_the_file(path, tmp_path):
    recording = open_recording(str(path), scanner="HDL-32E")
    found = recording.returns([1, 2])
    file = tmp_path / "returns.parquet"
    chosen = np.array([1, 2])
    write_returns(path, recording.rotations, chosen, recording.scanner, file)
    columns, facts = storage.read_table(file, schemas.RETURNS)
    assert list(found.columns()) == list(columns)
    for name, values in found.columns().items():
        assert values.dtype == columns[name].dtype
        np.testing.assert_array_equal(values, columns[name])
    assert found.rotation_rate_hz == facts["rotation_rate_hz"]


def test_rotations_that_are_meant(path):
    recording = open_recording(path)

    def chosen(rotations, length=None):
        return sorted(set(recording.returns(rotations, length=length).rotation.tolist()))

    assert chosen("beginning", 1) == [1]
    assert chosen("middle", 1) == [3]
    assert chosen("end", 1) == [5]
    assert chosen("all") == list(range(7))
    assert chosen(2) == [2]
    assert chosen([4, 2, 4]) == [2, 4]
    assert chosen(slice(-2, None)) == [5, 6]
    assert chosen(slice(None, None, -3)) == [0, 3, 6]


@pytest.mark.parametrize(
    ("rotations", "length", "what", "allowed"),
    [
        ("first", None, "unknown window 'first'", "all, beginning, middle, end"),
        ("middle", None, "5 complete rotations, too few", "at least 300"),
        (7, None, "rotation 7 does not exist", "0 to 6"),
        ([-1, 2], None, "rotation -1 does not exist", "0 to 6"),
        ([], None, "no rotation chosen", "0 to 6"),
        (slice(7, 9), None, "no rotation chosen", "0 to 6"),
    ],
)
def test_rotations_that_are_not_there(rotations, length, what, allowed, path):
    with pytest.raises(ConfigError, match=what) as caught:
        open_recording(path).returns(rotations, length=length)
    assert allowed in str(caught.value)
    assert str(path) in str(caught.value)


def test_two_returns(tmp_path):
    payloads = two_returns(spin(N, banks=2, interval_us=173))
    recording = open_recording(write(tmp_path, pcap(payloads)), scanner="HDL-64E")
    both = recording.returns([1], which="both")
    assert set(both.which) == {STRONGEST, LAST}
    for which, number in (("strongest", STRONGEST), ("last", LAST)):
        one = recording.returns([1], which=which)
        assert 2 * len(one) == len(both)
        assert set(one.which) == {number}
    with pytest.raises(ConfigError, match="unknown return 'first'"):
        recording.stream_returns([1], which="first")


def test_streaming_gives_the_same_in_parts(path, monkeypatch):
    monkeypatch.setattr("velocal.recording.returns.PACKETS", 7)
    recording = open_recording(path)
    parts = list(recording.stream_returns("all"))
    assert len(parts) > N // 7
    whole = recording.returns("all")
    np.testing.assert_array_equal(np.concatenate([p.distance for p in parts]), whole.distance)


def test_faults(path, tmp_path):
    with pytest.raises(ConfigError, match="unknown scanner 'HDL-16'"):
        open_recording(path, scanner="HDL-16")
    with pytest.raises(RecordingError, match="cannot be read"):
        open_recording(tmp_path / "absent")
    with pytest.raises(RecordingError, match="said to come from HDL-64E"):
        _ = open_recording(path, scanner="HDL-64E").scanner
    with pytest.raises(RecordingError, match="no data packets to port 5"):
        _ = open_recording(path, port=5).ledger
    slow = write(tmp_path, record_list(spin(N, interval_us=5530), 42), "slow")
    with pytest.raises(RecordingError, match="fit no known scanner") as caught:
        _ = open_recording(slow).scanner
    assert "HDL-64E, HDL-64E-S1" in str(caught.value)


def test_one_of_two_scanners_in_a_capture(tmp_path):
    one, other = spin(N), spin(N, seed=3)
    frames = [
        ethernet(ip_packet(payload, port=port))
        for pair in zip(as_bytes(one), as_bytes(other), strict=True)
        for payload, port in zip(pair, (2368, 2369), strict=True)
    ]
    path = write(tmp_path, pcap_of(frames))
    with pytest.raises(RecordingError, match="2 scanners"):
        _ = open_recording(path).ledger
    found = open_recording(path, port=2369).returns("all")
    expected = decode(other, SCANNERS["HDL-32E"]).distance
    np.testing.assert_array_equal(found.distance, expected.reshape(-1))


def test_embedded_calibration_of_a_simulated_recording(tmp_path):
    world = study_world()
    path = tmp_path / "recording.bin"
    with path.open("wb") as file:
        for block in capture.records(world, "HDL-64E", "P2", "x", 30):
            file.write(block)
    recording = open_recording(path)
    assert recording.scanner is SCANNERS["HDL-64E"]
    found = recording.status.calibration(str(path))
    factory = truth.factory_parameters(world, "HDL-64E")
    np.testing.assert_allclose(found.dl, factory.dl, rtol=0, atol=6e-4)
    assert len(set(recording.returns(1).laser_id.tolist())) == 64


REAL = {
    "hdl64e-s1-outdoor-wall.pcap": ("HDL-64E-S1", 306),
    "hdl32e-static-outdoor.pcap": ("HDL-32E", None),
    "vlp16-indoor-50-rotations.pcap": ("VLP-16", None),
}


@pytest.mark.parametrize("name", REAL)
def test_real_recordings(name, shared):
    scanner, packets = REAL[name]
    recording = open_recording(shared / "recordings" / name)
    assert recording.scanner.name == scanner
    assert recording.ledger.unaccounted_bytes == 0
    assert packets is None or recording.ledger.data.packets == packets
    found = recording.returns("all", which="both")
    known = recording.scanner
    rows = recording.ledger.data.packets * 12 * known.firings_per_block * known.lasers_per_firing
    assert len(found) == rows
    assert found.laser_id.max() == known.n_lasers - 1
