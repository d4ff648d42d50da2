"""Order of packets: duplicates and late packets."""

import numpy as np
import pytest
from support.capture import record_list, scan, spin, write

from velocal.capture import framing
from velocal.io import schemas, storage
from velocal.packets.data import view
from velocal.recording.scan import inspect
from velocal.recording.windows import read_index, read_rotations, write_index

N = 240
PAYLOADS = spin(N)


def in_order(order, tmp_path, payloads=PAYLOADS):
    records = record_list(payloads, 42)
    return write(tmp_path, [records[number] for number in order])


def moved(number: int, to: int) -> list[int]:
    order = list(range(N))
    order.insert(to, order.pop(number))
    return order


SWAPPED = [number ^ 1 for number in range(N)]
BACKWARDS = [20 * (n // 20) + 19 - n % 20 for n in range(N)]
SHUFFLED = list(np.argsort(np.arange(N) + np.random.default_rng(4).uniform(0, 16, N)))
ORDERS = {
    "two": moved(100, 101),
    "late": moved(100, 130),
    "early": moved(130, 100),
    "first": moved(0, 20),
    "last": moved(N - 1, N - 25),
    "swapped": SWAPPED,
    "backwards": BACKWARDS,
    "shuffled": SHUFFLED,
}


@pytest.mark.parametrize("chunk_bytes", [8 << 20, 60_000])
@pytest.mark.parametrize("name", ORDERS)
def test_late_packets_are_put_back(name, chunk_bytes, tmp_path, monkeypatch):
    monkeypatch.setattr(framing, "CHUNK_BYTES", chunk_bytes)
    path = in_order(ORDERS[name], tmp_path)
    payloads, _, _, ledger = scan(path)
    np.testing.assert_array_equal(payloads, PAYLOADS)
    late = sum(number < max(ORDERS[name][:k], default=-1) for k, number in enumerate(ORDERS[name]))
    assert ledger.reordered == late > 0
    assert ledger.rejected == {}
    assert ledger.unaccounted_bytes == 0
    found = inspect(path)
    assert (found.gaps, found.packets_missing) == (0, 0)
    assert len(found.index) == len(inspect(in_order(range(N), tmp_path)).index)


@pytest.mark.parametrize("chunk_bytes", [8 << 20, 60_000])
@pytest.mark.parametrize("apart", [1, 2, 31])
def test_duplicates_are_dropped(apart, chunk_bytes, tmp_path, monkeypatch):
    monkeypatch.setattr(framing, "CHUNK_BYTES", chunk_bytes)
    order = list(range(N))
    for number in (200, 100, 50, 1):
        order.insert(number + apart, number)
    payloads, _, _, ledger = scan(in_order(order, tmp_path))
    np.testing.assert_array_equal(payloads, PAYLOADS)
    assert {k: (c.packets, c.bytes) for k, c in ledger.rejected.items()} == {
        "duplicate": (4, 4 * 1248)
    }
    assert ledger.unaccounted_bytes == 0


def test_every_packet_twice(tmp_path):
    payloads, _, _, ledger = scan(in_order(np.repeat(np.arange(N), 2), tmp_path))
    np.testing.assert_array_equal(payloads, PAYLOADS)
    assert ledger.rejected["duplicate"].packets == N


def test_duplicates_without_a_clock(tmp_path):
    payloads = spin(N, paired=True)
    view(payloads)["timestamp"] = 0x20433134  # text
    order = [*range(100), 99, 98, *range(100, N)]
    found, _, _, ledger = scan(in_order(order, tmp_path, payloads))
    np.testing.assert_array_equal(found, payloads)
    assert ledger.rejected["duplicate"].packets == 2
    assert ledger.reordered == 0


@pytest.mark.parametrize("chunk_bytes", [8 << 20, 60_000])
def test_too_late(chunk_bytes, tmp_path, monkeypatch):
    """A packet that comes 60 packets late has no place; it is not taken for a clock set back."""
    monkeypatch.setattr(framing, "CHUNK_BYTES", chunk_bytes)
    payloads, _, _, ledger = scan(in_order(moved(100, 160), tmp_path))
    np.testing.assert_array_equal(payloads, np.delete(PAYLOADS, 100, axis=0))
    assert ledger.rejected["late by more than 32 packets"].packets == 1
    assert ledger.unaccounted_bytes == 0


def test_a_clock_that_is_set_back_keeps_the_order(tmp_path):
    """As when a scanner finds its time: nothing is sorted or dropped."""
    payloads = PAYLOADS.copy()
    view(payloads)["timestamp"][120:] -= 4_000_000
    found, _, _, ledger = scan(in_order(range(N), tmp_path, payloads))
    np.testing.assert_array_equal(found, payloads)
    assert (ledger.reordered, ledger.rejected) == (0, {})


def test_order_over_the_hour(tmp_path):
    payloads = spin(N, stamp_us=3_600_000_000 - 120 * 553)
    found, _, _, ledger = scan(in_order(SHUFFLED, tmp_path, payloads))
    np.testing.assert_array_equal(found, payloads)
    assert ledger.reordered > 0


def test_reading_what_was_put_in_order(tmp_path):
    """The index cannot point into such a file; it is read from its beginning."""
    straight, mixed = in_order(range(N), tmp_path), tmp_path / "mixed"
    mixed.mkdir()
    mixed = in_order(SHUFFLED, mixed)
    index, other = inspect(straight).index, inspect(mixed).index
    assert index.seekable
    assert not other.seekable
    write_index(tmp_path / "mixed.parquet", other)
    columns, _ = storage.read_table(tmp_path / "mixed.parquet", schemas.ROTATIONS)
    assert (columns["offset"] == -1).all()
    other = read_index(tmp_path / "mixed.parquet")
    assert not other.seekable
    np.testing.assert_array_equal(other.packet, index.packet)
    wanted = np.array([3, 5, 6])
    for path, found in ((straight, index), (mixed, other)):
        parts = list(read_rotations(path, found, wanted))
        blocks = np.concatenate([c.payloads for c, _ in parts])[:, :1200].reshape(-1, 100)
        rotation = np.concatenate([r for _, r in parts]).reshape(-1)
        content = blocks[rotation >= 0]
        if path == straight:
            expected = content
    np.testing.assert_array_equal(content, expected)
    assert len(expected) == 3 * 240


def test_the_usual_order_needs_no_sorting(tmp_path):
    assert (inspect(in_order(range(N), tmp_path)).index.offset >= 0).all()
