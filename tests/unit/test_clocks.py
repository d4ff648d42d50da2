"""Clocks that jump, stand still or are damaged, which the azimuth of the packets shows."""

import struct

import numpy as np
import pytest
from support.capture import as_bytes, pcap_head, record_list, spin, udp_frame, write

from velocal.packets.data import view
from velocal.points.stream import stream_points
from velocal.recording.identify import check_scanner
from velocal.recording.recording import open_recording
from velocal.recording.scan import inspect
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal

VLP16 = {"step": 79, "interval_us": 1327, "status": (0x37, 0x22)}
N = 800
AT = 404


def jumped(us, payloads=None):
    """Payloads whose device clock jumps before the packet `AT`."""
    changed = spin(N, **VLP16) if payloads is None else payloads.copy()
    stamps = view(changed)["timestamp"].astype(np.int64)
    stamps[AT:] += us
    view(changed)["timestamp"] = stamps % 3_600_000_000
    return changed


def caught(payloads, times_s) -> list[bytes]:
    """A pcap with these times of capture."""
    frames = [udp_frame(payload) for payload in as_bytes(payloads)]
    heads = [
        struct.pack("<IIII", int(t), round(t % 1 * 1e6) % 1_000_000, len(f), len(f))
        for t, f in zip(times_s, frames, strict=True)
    ]
    return [pcap_head(), *(head + frame for head, frame in zip(heads, frames, strict=True))]


def usual_times(n=N):
    return 1_400_000_000 + 1327e-6 * np.arange(n)


JUMPS = [1_500_000_000, -1_500_000_000, 3_000_000, -3_000_000, -50_000, 1_000_000_007]


@pytest.mark.parametrize("in_pcap", [False, True])
@pytest.mark.parametrize("us", JUMPS)
def test_a_jump_of_the_device_clock(us, in_pcap, tmp_path):
    payloads = jumped(us)
    content = caught(payloads, usual_times()) if in_pcap else record_list(payloads, 42)
    found, plain = (
        inspect(write(tmp_path, part)) for part in (content, record_list(spin(N, **VLP16), 42))
    )
    assert (found.gaps, found.packets_missing) == (0, 0)
    assert found.clock_jumps == ((AT, us / 1e6),)
    assert found.damaged_stamps == found.irregular == found.ledger.reordered == 0
    np.testing.assert_allclose(found.index.time_s, plain.index.time_s, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(found.index.complete, plain.index.complete)
    (remark,) = check_scanner(found, SCANNERS["VLP-16"], "x")
    assert f"the device clock jumps once, by {us * 1e-6:.6g} s before packet {AT}" in remark


@pytest.mark.parametrize("us", [50_000, 200_000])
def test_a_short_jump_is_known_by_the_capture(us, tmp_path):
    """The head turns about once, or four times, in that time: its azimuth tells nothing."""
    found = inspect(write(tmp_path, caught(jumped(us), usual_times())))
    assert (found.gaps, found.clock_jumps) == (0, ((AT, us / 1e6),))


@pytest.mark.parametrize("pause", [0.3, 30.0])
@pytest.mark.parametrize("in_pcap", [False, True])
def test_a_pause_is_no_jump(pause, in_pcap, tmp_path):
    """The head turns on: the azimuth goes on elsewhere, and the capture pauses as well."""
    packets = round(pause / 1327e-6)
    payloads = spin(AT + packets + 400, **VLP16)
    kept = np.r_[0:AT, AT + packets : AT + packets + 400]
    times = usual_times(len(payloads))[kept]
    content = caught(payloads[kept], times) if in_pcap else record_list(payloads[kept], 42)
    found = inspect(write(tmp_path, content))
    assert found.clock_jumps == ()
    assert found.packets_missing == pytest.approx(packets, abs=1)
    assert found.index.loss.gaps == 1
    assert found.duration_s == pytest.approx(1327e-6 * (len(payloads) - 1), abs=1e-3)


@pytest.mark.parametrize("bit", range(32))
def test_one_flipped_bit_of_a_time_stamp(bit, tmp_path):
    payloads = spin(240, **VLP16)
    view(payloads)["timestamp"][100] ^= np.uint32(1 << bit)
    found = inspect(write(tmp_path, record_list(payloads, 42)))
    assert (found.gaps, found.clock_jumps, found.irregular) == (0, (), 0)
    assert found.ledger.data.packets == 240
    assert found.ledger.reordered == 0
    assert found.duration_s == pytest.approx(239 * 1327e-6, abs=1e-9)
    assert found.damaged_stamps == (1 if bit >= 10 else 0)  # 2^9 us are less than half an interval


@pytest.mark.parametrize("us", [1_500_000_000, -3_000_000])
def test_times_of_points(us, tmp_path):
    """Every point has the time that it would have without the jump."""

    def times(payloads, rotations):
        recording = open_recording(write(tmp_path, record_list(payloads, 42)))
        parts = stream_points(recording, nominal(SCANNERS["VLP-16"]), rotations)
        return np.concatenate([part["time"] for part in parts])

    damaged = jumped(us)
    view(damaged)["timestamp"][200] ^= np.uint32(1 << 21)
    for rotations in ("all", slice(3, 15, 2), [10, 11]):
        np.testing.assert_allclose(
            times(damaged, rotations), times(spin(N, **VLP16), rotations), rtol=0, atol=1e-6
        )


# -- no device clock -------------------------------------------------------------------------------


def as_s1(n=N, lost=()):
    """As of an HDL-64E S1: text instead of a time stamp, 2500 packets/s at 10 Hz."""
    payloads = spin(n, step=24, paired=True)
    view(payloads)["timestamp"] = 0x20433134
    return np.delete(payloads, lost, axis=0)


def s1_times(n=N):
    return 1_400_000_000.25 + np.arange(n) / 2500.0


TIMES = {
    "coarse, 10 ms": (lambda t: np.floor(t * 100) / 100, "capture"),
    "coarse, 1 s": (np.floor, "none"),
    "coarse, one tick": (lambda t: np.floor(t + 0.6), "none"),
    "equal": (lambda t: np.full(len(t), t[0]), "none"),
    "zero": (np.zeros_like, "none"),
    "backward": (lambda t: t[::-1], "none"),
    "zero, then right": (lambda t: np.where(np.arange(len(t)) < 100, 0.0, t), "capture"),
    "a jump back": (lambda t: np.where(np.arange(len(t)) < 400, t, t - 5000.0), "capture"),
    "a jump forward": (lambda t: np.where(np.arange(len(t)) < 400, t, t + 5000.0), "capture"),
}


@pytest.mark.parametrize("name", TIMES)
def test_times_of_capture_that_tell_little(name, tmp_path):
    changed, clock = TIMES[name]
    path = write(
        tmp_path, caught(as_s1(lost=[50, 51, 300]), changed(np.delete(s1_times(), [50, 51, 300])))
    )
    recording = open_recording(path, "HDL-64E-S1")
    found = recording.scan()
    assert found.clock == clock
    assert (found.gaps, found.packets_missing) == (2, 3)
    assert found.index.complete.sum() == len(found.index) - 2
    rate_hz = recording.returns([1]).rotation_rate_hz
    assert rate_hz == pytest.approx(24 * 6 / 36_000 * 2500, rel=0.05)
    assert recording.remarks or name.startswith("coarse, 10")
    points = list(stream_points(recording, nominal(recording.scanner), [1]))
    assert sum(len(part["x"]) for part in points) > 0


def test_bare_records_without_a_clock_show_their_gaps(tmp_path):
    """Before, none was seen: 17 of 19 rotations of a damaged recording were complete."""
    lost = np.random.default_rng(1).random(N * 4) < 0.1
    lost[[0, -1]] = False
    found = inspect(write(tmp_path, record_list(as_s1(4 * N)[~lost], 0)))
    assert found.clock == "none"
    assert found.packets_missing == pytest.approx(lost.sum(), abs=2)
    assert found.index.complete.sum() < 5
