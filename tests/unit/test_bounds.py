"""What damage costs: bytes that are read, bytes that are kept, and steps; never seconds."""

import struct

import numpy as np
import pytest
from support.capture import as_bytes, pcap_head, pcap_packet, record_list, scan, spin, write
from support.containers import enhanced, ethernet, frames_of, interface, ip_packet, section

from velocal.capture import framing, order, udp
from velocal.capture.ledger import Ledger
from velocal.capture.pcapng import PcapNg
from velocal.capture.reading import detect, open_capture

N = 2000
PAYLOADS = spin(N)


def cut(records: list[bytes], one_in: int = 20) -> list[bytes]:
    """Records of which one in so many has lost 100 bytes."""
    return [r[:600] + r[700:] if k % one_in == 7 else r for k, r in enumerate(records)]


def packets(container: str) -> tuple[bytes, list[bytes]]:
    """Beginning of a file, and its packets."""
    frames = frames_of(PAYLOADS)
    if container == "pcap":
        return pcap_head(), [pcap_packet(frame, k) for k, frame in enumerate(frames)]
    if container == "pcapng":
        return section() + interface(), [enhanced(frame, k) for k, frame in enumerate(frames)]
    return b"", record_list(PAYLOADS, int(container) - 1206)


class Counting:
    """A file that counts the bytes that are read from it."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at, self.read_bytes = content, 0, 0

    def seek(self, position: int) -> None:
        self.at = position

    def read(self, size: int) -> bytes:
        found = self.content[self.at : self.at + size]
        self.at += len(found)
        self.read_bytes += len(found)
        return found


def memory_of(array: np.ndarray) -> tuple[int, int]:
    """Identity and bytes of the memory that an array keeps, of which it may be a small part."""
    while isinstance(array.base, np.ndarray):
        array = array.base
    base = array.base
    if isinstance(base, memoryview):
        base = base.obj
    return (id(array), array.nbytes) if base is None else (id(base), len(base))


@pytest.mark.parametrize("container", ["1206", "1248", "pcap", "pcapng"])
@pytest.mark.parametrize("one_in", [3, 20])
def test_damage_is_read_few_times_and_keeps_little(container, one_in):
    head, records = packets(container)
    content = b"".join([head, *cut(records, one_in)])
    file, ledger = Counting(content), Ledger(len(content))
    found = detect(content[: 1 << 20], "x")
    chunks = list(found.chunks(file, found.first_packet, len(content), ledger))
    n = sum(len(chunk) for chunk in chunks)
    assert n > N * (1 - 2.1 / one_in)
    # Once, and what lies behind each damage a few times more: not 8 MiB with each.
    assert file.read_bytes < 5 * len(content)
    kept = dict(memory_of(chunk.payloads) for chunk in chunks)
    assert sum(kept.values()) < 1.2 * len(content)


@pytest.mark.parametrize("container", ["1206", "1248", "pcap", "pcapng"])
def test_zeros_behind_a_recording_are_one_stretch(container, tmp_path):
    """A header of zeros is no packet: a file of zeros would hold millions."""
    head, records = packets(container)
    content = b"".join([head, *records])
    payloads, _, _, ledger = scan(write(tmp_path, content + bytes(3_000_000)))
    np.testing.assert_array_equal(payloads, PAYLOADS)
    (lost,) = ledger.rejected.values()
    assert (lost.packets, lost.bytes) == (1, 3_000_000)


@pytest.mark.parametrize("container", ["pcap", "pcapng"])
def test_holes_are_not_read(container, tmp_path, monkeypatch):
    """A sparse file tells where it has no bytes."""
    head, records = packets(container)
    path = write(tmp_path, b"".join([head, *records[:24]]))
    with path.open("r+b") as file:
        file.seek(100_000_000)
        file.write(b"".join(records[24:48]))
        file.truncate(300_000_000)
    looked_at = []
    find = framing.find_payload
    monkeypatch.setattr(
        framing, "find_payload", lambda data, *of: looked_at.append(len(data)) or find(data, *of)
    )
    payloads, _, _, ledger = scan(path)
    np.testing.assert_array_equal(payloads, PAYLOADS[:48])
    assert ledger.unaccounted_bytes == 0
    # Two parts of the file, each with what is read beyond it.
    assert sum(looked_at) < 6 * (framing.CHUNK_BYTES + framing.MAX_CAPTURED)


def test_fragments_that_never_become_whole_are_given_up(monkeypatch):
    """8,192 fragments of one datagram were put together again with each of them."""
    ledger = Ledger(0)
    datagrams = udp.Datagrams(ledger)
    packet = ip_packet(bytes(8))
    frames = []
    for number in range(8191):
        head = packet[:2] + struct.pack(">HHH", 28, 1, 0x2000 | number) + packet[8:20]
        frames.append(pcap_packet(ethernet(head + bytes(8)), number))
    content = pcap_head() + b"".join(frames)
    most = []
    give_up = datagrams._give_up

    def counted(key: bytes) -> None:
        most.append(len(datagrams._pending[key].parts))
        give_up(key)

    monkeypatch.setattr(datagrams, "_give_up", counted)
    monkeypatch.setattr("velocal.capture.pcap.Datagrams", lambda ledger: datagrams)
    found = detect(content, "x")
    assert not sum(len(c) for c in found.chunks(Counting(content), 24, len(content), ledger))
    assert max(most) == udp.FRAGMENTS + 1
    assert ledger.rejected["fragment without the others"].packets == 8191


def test_one_jump_of_the_clock_does_not_slow_the_rest(tmp_path, monkeypatch):
    """Packets are compared with their neighbours only near it."""
    monkeypatch.setattr(framing, "CHUNK_BYTES", 500_000)
    later = spin(N, stamp_us=5_000_000 + 553 * 300 + 200_000)
    path = write(tmp_path, b"".join(as_bytes(PAYLOADS[:300]) + as_bytes(later[300:])))
    compared = []
    duplicates = order._duplicates
    monkeypatch.setattr(order, "_duplicates", lambda p: compared.append(len(p)) or duplicates(p))
    payloads, _, _, _ = scan(path)
    assert len(payloads) == N
    assert 0 < sum(compared) < N / 2


def test_short_packets_are_not_looked_at_one_by_one(tmp_path, monkeypatch):
    """Snapped packets, and those of other scanners, are entered as arrays."""
    monkeypatch.setattr(udp.Datagrams, "_parse", None)
    content = pcap_head()
    for number, frame in enumerate(frames_of(PAYLOADS[:300])):
        content += pcap_packet(frame, number, captured=600 if number % 2 else None)
    payloads, _, _, ledger = scan(write(tmp_path, content))
    assert len(payloads) == 150
    assert ledger.rejected["captured 600 of 1248 bytes"].packets == 150


def test_chunks_are_joined_after_damage(tmp_path):
    """The steps that follow cost the same for few packets as for many."""
    path = write(tmp_path, cut(record_list(PAYLOADS, 0)))
    sizes = [len(chunk) for chunk in open_capture(path).read()]
    assert len(sizes) <= 1 + sum(sizes) // 128


def test_blocks_are_found_after_a_hole_of_both_byte_orders():
    for byte_order in "<>":
        blocks = [enhanced(frame, k, byte_order) for k, frame in enumerate(frames_of(PAYLOADS[:9]))]
        content = section(byte_order) + interface(byte_order) + b"".join(blocks[:4])
        content += bytes(40_001) + b"".join(blocks[4:])
        ledger = Ledger(len(content))
        chunks = PcapNg().chunks(Counting(content), 0, len(content), ledger)
        assert sum(len(chunk) for chunk in chunks) == 9
        assert ledger.rejected["bytes without a block"].bytes == 40_001
