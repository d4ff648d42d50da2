"""Every field of a packet comes back from its bytes."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from support.capture import spin, two_returns

from velocal.packets import data as packets
from velocal.packets import dual
from velocal.packets.dual import LAST, STRONGEST
from velocal.packets.firings import decode
from velocal.scanner.models import FLAG_LOWER, FLAG_UPPER, SCANNERS

counts = st.integers(min_value=1, max_value=4)


@st.composite
def fields(draw: st.DrawFn, flags: tuple[int, ...] = (FLAG_UPPER, FLAG_LOWER)):
    n = draw(counts)

    def array(dtype, shape, **limits):
        return draw(hnp.arrays(dtype, shape, elements=hnp.from_dtype(np.dtype(dtype), **limits)))

    # Independent draws of thousands of numbers are slow; a seed fills the channels.
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    distance = rng.integers(0, 65_536, (n, 12, 32)).astype(np.uint16)
    distance[rng.random(distance.shape) < 0.2] = draw(st.sampled_from([0, 1, 65_535]))
    return {
        "flag": draw(hnp.arrays(np.uint16, (n, 12), elements=st.sampled_from(flags))),
        "azimuth": array(np.uint16, (n, 12), max_value=35_999),
        "distance": distance,
        "intensity": rng.integers(0, 256, (n, 12, 32)).astype(np.uint8),
        "timestamp": array(np.uint32, n),
        "status": array(np.uint8, (n, 2)),
    }


@given(fields())
def test_view_is_the_inverse_of_encode(sent):
    payloads = packets.encode(**sent)
    assert payloads.shape == (len(sent["timestamp"]), 1206)
    seen = packets.view(payloads)
    for name, values in (
        ("flag", seen["blocks"]["flag"]),
        ("azimuth", seen["blocks"]["azimuth"]),
        ("distance", seen["blocks"]["channels"]["distance"]),
        ("intensity", seen["blocks"]["channels"]["intensity"]),
        ("timestamp", seen["timestamp"]),
        ("status", seen["status"]),
    ):
        np.testing.assert_array_equal(values, sent[name], err_msg=name)
    flags_known, in_turn = packets.check_payloads(payloads)
    assert flags_known.all()
    assert in_turn.all()


@given(fields())
def test_encode_follows_the_manuals(sent):
    """Packed once more, a block after the other, as the manuals draw it."""
    expected = b""
    for number in range(len(sent["timestamp"])):
        for block in range(12):
            at = (number, block)
            expected += struct.pack("<HH", sent["flag"][at], sent["azimuth"][at])
            for pair in zip(sent["distance"][at], sent["intensity"][at], strict=True):
                expected += struct.pack("<HB", *pair)
        expected += struct.pack("<I", sent["timestamp"][number]) + bytes(sent["status"][number])
    assert packets.encode(**sent).tobytes() == expected


@pytest.mark.parametrize("name", [n for n in SCANNERS if not n.startswith("VLP-16")])
@given(data=st.data())
def test_decode_of_one_firing_a_block(name, data):
    scanner = SCANNERS[name]
    sent = data.draw(fields(scanner.flags))
    firings = decode(packets.encode(**sent), scanner)
    n = len(sent["timestamp"])
    assert len(firings) == 12 * n
    np.testing.assert_array_equal(firings.azimuth, sent["azimuth"].reshape(-1))
    np.testing.assert_array_equal(firings.distance, sent["distance"].reshape(-1, 32))
    np.testing.assert_array_equal(firings.intensity, sent["intensity"].reshape(-1, 32))
    np.testing.assert_array_equal(firings.timestamp, np.repeat(sent["timestamp"], 12))
    for row, flag in enumerate(sent["flag"].reshape(-1)):
        first = {0xEEFF: 0, 0xDDFF: 32, 0xCCFF: 64, 0xBBFF: 96}[int(flag)]
        assert firings.first_laser[row] == first
        assert list(firings.laser_id()[row]) == list(range(first, first + 32))
    dtypes = [a.dtype for a in (firings.azimuth, firings.distance, firings.intensity)]
    assert dtypes == [np.uint16, np.uint16, np.uint8]


@given(fields((FLAG_UPPER,)))
def test_decode_of_two_firings_a_block(sent):
    firings = decode(packets.encode(**sent), SCANNERS["VLP-16"])
    n = len(sent["timestamp"])
    assert len(firings) == 24 * n
    np.testing.assert_array_equal(firings.azimuth[::2], sent["azimuth"].reshape(-1))
    both = sent["distance"].reshape(-1, 2, 16)
    np.testing.assert_array_equal(firings.distance[::2], both[:, 0])
    np.testing.assert_array_equal(firings.distance[1::2], both[:, 1])
    strength = sent["intensity"].reshape(-1, 2, 16)
    np.testing.assert_array_equal(firings.intensity[::2], strength[:, 0])
    np.testing.assert_array_equal(firings.intensity[1::2], strength[:, 1])
    np.testing.assert_array_equal(firings.timestamp, np.repeat(sent["timestamp"], 24))
    np.testing.assert_array_equal(firings.laser_id(), np.tile(np.arange(16), (24 * n, 1)))


@given(
    start=st.integers(0, 35_999),
    step=st.integers(1, 2_000),
    odd=st.integers(0, 10),
    jump=st.integers(0, 20_000),
    dual=st.booleans(),
)
def test_azimuth_of_a_second_firing(start, step, odd, jump, dual):
    """Half a step after the first, whatever one lost packet's worth of jump is among them."""
    steps = np.full(11, step)
    if dual:  # both returns of a firing are sent, so blocks share their azimuth in pairs
        steps[::2] = 0
    else:
        steps[odd] += jump
    azimuth = (start + np.concatenate([[0], np.cumsum(steps)])) % 36_000
    payloads = packets.encode(
        np.full((1, 12), FLAG_UPPER, np.uint16),
        azimuth[None].astype(np.uint16),
        np.zeros((1, 12, 32), np.uint16),
        np.zeros((1, 12, 32), np.uint8),
        np.zeros(1, np.uint32),
        np.zeros((1, 2), np.uint8),
    )
    found = decode(payloads, SCANNERS["VLP-16"]).azimuth.astype(int)
    late = (found[1::2] - found[::2]) % 36_000
    assert set(late) <= {step // 2, (step + 1) // 2}
    assert len(set(late)) == 1
    assert found.max() < 36_000


@given(azimuth=hnp.arrays(np.uint16, (3, 12), elements=st.integers(0, 35_999)))
def test_the_median_step_is_one_of_the_steps(azimuth):
    found = packets.median_azimuth_step(azimuth)
    for row, step in zip(azimuth.astype(int), found, strict=True):
        steps = sorted(d for d in np.diff(row) % 36_000 if d)
        assert step == (steps[len(steps) // 2] if steps else 0)


def test_a_full_turn_is_zero():
    """A VLP-16 was seen to send 36000."""
    sent = {
        "flag": np.full((1, 12), FLAG_UPPER, np.uint16),
        "azimuth": np.arange(36_000 - 11 * 40, 36_001, 40, dtype=np.uint16)[None],
        "distance": np.ones((1, 12, 32), np.uint16),
        "intensity": np.ones((1, 12, 32), np.uint8),
        "timestamp": np.zeros(1, np.uint32),
        "status": np.zeros((1, 2), np.uint8),
    }
    payloads = packets.encode(**sent)
    assert [bool(a[0]) for a in packets.check_payloads(payloads)] == [True, True]
    azimuth = decode(payloads, SCANNERS["VLP-16"]).azimuth
    assert list(azimuth[-4:]) == [35_960, 35_980, 0, 20]
    sent["azimuth"][0, 3] = 36_001
    assert [bool(a[0]) for a in packets.check_payloads(packets.encode(**sent))] == [True, False]


@pytest.mark.parametrize("flag", [0x0000, 0xFFEE, 0xEEFE, 0xAAFF])
def test_an_unknown_flag_is_not_sound(flag):
    payloads = packets.encode(
        np.full((2, 12), FLAG_UPPER, np.uint16),
        np.zeros((2, 12), np.uint16),
        np.zeros((2, 12, 32), np.uint16),
        np.zeros((2, 12, 32), np.uint8),
        np.zeros(2, np.uint32),
        np.zeros((2, 2), np.uint8),
    )
    packets.view(payloads)["blocks"]["flag"][1, 11] = flag
    known, _ = packets.check_payloads(payloads)
    assert list(known) == [True, False]


# -- two returns -----------------------------------------------------------------------------------

PAIRS = {
    1: [(0, 1), (2, 3), (4, 5), (6, 7), (8, 9), (10, 11)],
    2: [(0, 2), (1, 3), (4, 6), (5, 7), (8, 10), (9, 11)],
    4: [(0, 1), (2, 3), (4, 5), (6, 7)],
}


def shots_by_hand(payload: bytes, pairs) -> list[tuple[int, int, list, list]]:
    """Flag, azimuth and the channels of both blocks of every pair."""
    found = []
    for one, other in pairs:
        heads = [struct.unpack_from("<HH", payload, 100 * block) for block in (one, other)]
        assert heads[0] == heads[1]
        channels = [
            [struct.unpack_from("<HB", payload, 100 * block + 4 + 3 * k) for k in range(32)]
            for block in (one, other)
        ]
        found.append((*heads[0], *channels))
    return found


@pytest.mark.parametrize("name", [name for name in SCANNERS if name != "HDL-64E-S1"])
@given(n=st.integers(1, 4), seed=st.integers(0, 2**31), zero=st.booleans())
def test_one_of_two_returns(name, n, seed, zero):
    scanner = SCANNERS[name]
    payloads = two_returns(spin(n, banks=len(scanner.flags), seed=seed))
    if zero:
        packets.view(payloads)["blocks"]["channels"]["distance"][:, 1] = 0
    assert packets.check_payloads(payloads)[0].all()
    both = decode(payloads, scanner)
    kinds = {LAST: [], STRONGEST: []}
    for which in kinds:
        rows = both[both.which == which]
        kinds[which] = rows.distance.reshape(-1)
    chosen = {r: decode(payloads, scanner, r) for r in ("last", "strongest")}
    expected = {"last": [], "strongest": []}
    lasers, stated = [], {LAST: [], STRONGEST: []}
    for payload in payloads:
        for flag, azimuth, one, other in shots_by_hand(bytes(payload), PAIRS[len(scanner.flags)]):
            lasers += [32 * scanner.flags.index(flag) + k % scanner.n_lasers for k in range(32)]
            # HDL-64E: the strongest comes first; all others: the last.
            last, strong = (other, one) if scanner.paired else (one, other)
            stated[LAST] += [distance for distance, _ in last]
            stated[STRONGEST] += [distance for distance, _ in strong]
            for a, b in zip(strong, last, strict=True):
                expected["last"].append(max(a[0], b[0]))
                power = [intensity if distance else -1 for distance, intensity in (a, b)]
                expected["strongest"].append(a[0] if power[0] >= power[1] else b[0])
            assert azimuth < 36_000
    for which, distance in stated.items():
        np.testing.assert_array_equal(kinds[which], distance)
    for returns, firings in chosen.items():
        np.testing.assert_array_equal(firings.distance.reshape(-1), expected[returns])
        np.testing.assert_array_equal(firings.laser_id().reshape(-1), lasers)
    assert set(lasers) == set(range(scanner.n_lasers))


def test_a_head_that_stands_still_tells_nothing():
    payloads = spin(3, step=0)
    assert not dual.two_returns(*packets.flags_and_azimuths(packets.view(payloads))).any()


def test_empty_blocks_of_a_vls128():
    payloads = two_returns(spin(3, banks=4))
    blocks = packets.view(payloads)["blocks"]
    for empty in (0x0000, 0xFFFF):
        blocks["flag"][:, 8:] = empty
        blocks["azimuth"][:, 8:] = empty
        assert packets.check_payloads(payloads)[0].all()
        assert packets.check_payloads(payloads)[1].all()
        assert len(decode(payloads, SCANNERS["VLS-128"])) == 3 * 8
    blocks["azimuth"][1, 7] = 36_001
    blocks["flag"][2, 9] = FLAG_UPPER  # neither full nor empty
    known, turn = packets.check_payloads(payloads)
    assert (list(known), list(turn)) == ([True, True, False], [True, False, False])
