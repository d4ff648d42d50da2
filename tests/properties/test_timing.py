"""Whatever stamps, azimuths and times of capture a recording holds, it is told without a fault."""

import struct
import tempfile
import warnings
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from support.capture import as_bytes, pcap_head, record_list, spin, udp_frame, write

from velocal.errors import VelocalError
from velocal.packets.data import view
from velocal.recording.recording import open_recording

STAMPS = {
    "as sent": lambda rng, t: t,
    "any": lambda rng, t: rng.integers(0, 2**32, len(t)),
    "text": lambda rng, t: np.full(len(t), 0x20433134),
    "flipped": lambda rng, t: t ^ (rng.random(len(t)) < 0.1) * (1 << int(rng.integers(0, 32))),
    "a jump": lambda rng, t: t + (np.arange(len(t)) > len(t) // 2) * int(rng.integers(0, 2**32)),
    "slow": lambda rng, t: t // int(rng.integers(1, 5000)),
}
CAPTURED = {
    "none": None,
    "as sent": lambda rng, t: t,
    "zero": lambda rng, t: 0 * t,
    "any": lambda rng, t: rng.uniform(0, 4e9, len(t)),
    "coarse": lambda rng, t: np.floor(t * 10) / 10,
    "backward": lambda rng, t: t[::-1],
}
seeds = st.integers(0, 10_000)
steps = st.sampled_from([0, 1, 9, 17, 79, 500, -79])
intervals = st.sampled_from([288, 553, 1327])


@given(st.sampled_from(sorted(STAMPS)), st.sampled_from(sorted(CAPTURED)), seeds, steps, intervals)
def test_any_times(stamps, captured, seed, step, interval_us):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 120))
    start = int(rng.integers(0, 3_600_000_000))
    payloads = spin(
        n, step=step, interval_us=interval_us, paired=bool(rng.integers(2)), stamp_us=start,
        status=(0x37, int(rng.choice([0x21, 0x22]))),
    )  # fmt: skip
    sent = view(payloads)["timestamp"].astype(np.int64)
    view(payloads)["timestamp"] = STAMPS[stamps](rng, sent) % 2**32
    view(payloads)["blocks"]["azimuth"][rng.random(n) < 0.05] = rng.integers(0, 36_000)
    kept = np.flatnonzero(rng.random(n) >= rng.choice([0.0, 0.1, 0.5]))
    payloads = payloads[kept] if len(kept) else payloads
    content = record_list(payloads, 0)
    times = CAPTURED[captured]
    if times is not None:
        usual = 1_400_000_000 + 1e-6 * interval_us * np.arange(len(payloads))
        heads = [
            struct.pack("<IIII", int(t), int(t % 1 * 1e6), 1248, 1248) for t in times(rng, usual)
        ]
        frames = zip(heads, as_bytes(payloads), strict=True)
        content = [pcap_head(), *(head + udp_frame(payload) for head, payload in frames)]
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        recording = open_recording(write(Path(folder), content))
        try:
            found = recording.scan()
        except VelocalError:
            return  # the framing is not known from so few packets
        loss = found.index.loss
        assert 0 <= loss.gaps <= loss.packets
        assert 0 <= loss.largest <= loss.packets
        assert found.ledger.unaccounted_bytes == 0
        told = found.facts()
        assert all("nan" not in fact.text for fact in told)
        try:
            returns = recording.returns("all")
        except VelocalError:
            return  # no known scanner, or more than one
        assert np.isfinite(returns.rotation_rate_hz)
        assert recording.motion_remarks() == [] or recording.rotations.complete.sum() > 1
