"""Damaged files: whatever bytes are lost or added, nothing crashes and every byte is counted."""

import gzip
import tempfile
from pathlib import Path

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from support.capture import pcap, record_list, scan, spin, write
from support.containers import containers

from velocal.errors import RecordingError
from velocal.recording.scan import inspect
from velocal.recording.windows import read_rotations

N = 20
PAYLOADS = spin(N, step=300)
FILES = {
    "records of 1206 bytes": b"".join(record_list(PAYLOADS, 0)),
    "records of 1248 bytes": b"".join(record_list(PAYLOADS, 42)),
    "pcap": pcap(PAYLOADS),
    "pcap, big-endian": pcap(PAYLOADS, ">", 10**9),
    "pcapng": containers(PAYLOADS)["pcapng"],
    "pcap of fragments": containers(PAYLOADS)["fragments"],
    "pcapng of a cooked link": containers(PAYLOADS)["pcapng cooked"],
}
PACKED = {
    "gzip": gzip.compress(FILES["pcap"], mtime=0),
    "gzip of records": gzip.compress(FILES["records of 1206 bytes"], mtime=0),
    "gzip, stored": gzip.compress(FILES["pcapng"], 0, mtime=0),
}

lost = st.tuples(st.just("lose"), st.integers(0, 25_000), st.integers(1, 3000))
few_lost = st.tuples(st.just("lose"), st.integers(0, 25_000), st.integers(1, 48))
added = st.tuples(st.just("add"), st.integers(0, 25_000), st.binary(min_size=1, max_size=60))
changed = st.tuples(st.just("change"), st.integers(0, 25_000), st.binary(min_size=1, max_size=40))
copied = st.tuples(st.just("copy"), st.integers(0, 25_000), st.integers(0, 25_000))
damages = st.lists(st.one_of(lost, few_lost, added, changed, copied), min_size=1, max_size=4)


# A fragment takes others with it, and the beginning of a pcapng is longer than that of a pcap.
PLAIN = [name for name in FILES if "pcapng" not in name and "fragments" not in name]


def damaged(content: bytes, operations) -> bytes:
    for kind, at, what in operations:
        if kind == "lose":
            content = content[:at] + content[at + what :]
        elif kind == "add":
            content = content[:at] + what + content[at:]
        elif kind == "change":
            content = content[:at] + what + content[at + len(what) :]
        else:
            content = content[:at] + content[what : what + 700] + content[at:]
    return content


@given(st.sampled_from(sorted(FILES | PACKED)), damages)
def test_every_byte_is_counted(name, operations):
    with tempfile.TemporaryDirectory() as folder:
        path = write(Path(folder), damaged((FILES | PACKED)[name], operations))
        try:
            found = inspect(path)
        except RecordingError:
            return  # not one valid packet, or the file header is gone
        ledger = found.ledger
        assert ledger.unaccounted_bytes == 0
        parts = [ledger.data, ledger.position, *ledger.rejected.values()]
        assert all(part.packets >= 0 and part.bytes >= 0 for part in parts)
        payloads, offsets, _, again = scan(path)
        assert again == ledger
        assert ledger.data.packets == len(payloads) == found.index.packet[-1]
        assert len(np.unique(offsets)) == len(offsets)
        # What is read with the index is what the scan saw.
        chunks = list(read_rotations(path, found.index, np.arange(len(found.index))))
        np.testing.assert_array_equal(np.concatenate([c.payloads for c, _ in chunks]), payloads)
        begins = found.index.packet * 12 + found.index.block
        rotation = np.concatenate([r for _, r in chunks]).reshape(-1)
        np.testing.assert_array_equal(
            rotation, np.repeat(np.arange(len(begins) - 1), np.diff(begins))
        )


@given(st.sampled_from(PLAIN), st.one_of(few_lost, added, changed))
@example("pcap, big-endian", ("lose", 0, 28))  # addresses then read as a length
def test_small_damage_costs_little(name, operation):
    """Beyond the file header, one damage costs the packet it hits and the next at most."""
    with tempfile.TemporaryDirectory() as folder:
        kind, at, what = operation
        content = damaged(FILES[name], [(kind, 24 + at, what)])
        payloads, _, _, ledger = scan(write(Path(folder), content))
    assert ledger.framing == name.split(",")[0]
    whole = {bytes(payload) for payload in PAYLOADS}
    assert len(whole & {bytes(payload) for payload in payloads}) >= N - 2
    assert len(payloads) <= N
