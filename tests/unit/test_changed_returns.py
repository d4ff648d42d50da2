"""A recording in which the scanner is set from one to two returns, or back."""

import numpy as np
import pytest
from support.capture import record_list, spin, two_returns, write

from velocal.packets.dual import LAST, ONLY, STRONGEST
from velocal.packets.firings import decode
from velocal.points.stream import stream_points
from velocal.recording.recording import open_recording
from velocal.recording.returns import PACKETS
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal

N = 500
#: Step from firing to firing, banks, packets with one and with two returns, us; last bytes.
SENT = {
    "VLP-16": (79, 1, 1327, 664, 0x22),
    "HDL-32E": (17, 1, 553, 276, 0x21),
    "HDL-64E": (17, 2, 288, 173, 0x00),
}


def single_then_dual(name, back=False):
    step, banks, single_us, dual_us, product = SENT[name]
    first, then = (dual_us, single_us) if back else (single_us, dual_us)
    shots = 12 * N // banks // (2 if back else 1)
    one = spin(N, step=step, banks=banks, interval_us=first, status=(0x37, product))
    other = spin(
        N, step=step, banks=banks, interval_us=then, status=(0x37, product), seed=1,
        start=17_000 + step * shots, stamp_us=5_000_000 + first * N,
    )  # fmt: skip
    if back:
        one = two_returns(one, step=step)
    else:
        other = two_returns(other, start=17_000 + step * shots, step=step)
    return (one, other)


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("name", SENT)
def test_every_shot_counts_once(name, back, tmp_path, monkeypatch):
    """Rows are those of the two parts alone, whatever part is read together."""
    one, other = single_then_dual(name, back)
    monkeypatch.setattr("velocal.recording.returns.PACKETS", 64)
    assert PACKETS > 64
    recording = open_recording(write(tmp_path, record_list(np.concatenate([one, other]), 42)), name)
    for which, kind in (("strongest", STRONGEST), ("last", LAST)):
        found = recording.returns("all", which=which)
        parts = [decode(payloads, SCANNERS[name], which) for payloads in (one, other)]
        expected = np.concatenate([part.distance.reshape(-1) for part in parts])
        np.testing.assert_array_equal(found.distance, expected)
        assert set(found.which) == {ONLY, kind}
    assert len(recording.returns("all", which="both")) == 2 * N * 12 * 32
    assert (recording.scan().gaps, recording.scan().irregular) == (0, 0)
    assert recording.rotations.complete[1:-1].all()
    assert f"{N} of {2 * N} packets hold two returns a shot" in recording.remarks[-1]


@pytest.mark.parametrize("name", SENT)
def test_times_of_shots(name, tmp_path):
    """They are evenly spaced, before and after the change."""
    path = write(tmp_path, record_list(np.concatenate(single_then_dual(name)), 42))
    scanner = SCANNERS[name]
    parts = list(stream_points(open_recording(path, name), nominal(scanner), "all"))
    time_s, laser = (np.concatenate([part[k] for part in parts]) for k in ("time", "laser_id"))
    steps = np.diff(time_s[laser == 3])
    # A shot without a return gives no point; the stamps of packets are whole microseconds.
    steps = steps[steps < 1.5 * scanner.firing_cycle_s]
    cycle = {True: 57.6e-6, False: scanner.firing_cycle_s}
    for dual in (False, True):
        of = steps[: len(steps) // 3] if not dual else steps[-len(steps) // 6 :]
        expected = cycle[dual and scanner.paired]
        assert np.median(of) == pytest.approx(expected, abs=1e-7)
        assert of.min() > expected - 3e-6
