"""Payloads out of files: nothing valid is lost, and every byte is accounted for."""

import gzip
import struct

import numpy as np
import pytest
from support.capture import (
    FIRST_SECOND,
    PAYLOAD,
    as_bytes,
    pcap,
    pcap_head,
    pcap_packet,
    record_list,
    scan,
    spin,
    udp_frame,
    vlan_frame,
    write,
)

from velocal.capture import framing
from velocal.capture.reading import open_capture
from velocal.errors import RecordingError
from velocal.packets.data import check_payloads
from velocal.recording.scan import inspect

N = 24
ALL = list(range(N))


def without(*lost: int) -> list[int]:
    return [number for number in ALL if number not in lost]


def flagless(record: bytes) -> bytes:
    """The record with the flag of its first block gone."""
    at = len(record) - PAYLOAD
    return record[:at] + b"\x00\x00" + record[at + 2 :]


def beyond(record: bytes) -> bytes:
    """The record with an azimuth of 360.01 degrees in its third block."""
    at = len(record) - PAYLOAD + 202
    return record[:at] + struct.pack("<H", 36_001) + record[at + 2 :]


def replaced(records: list[bytes], changed: dict[int, bytes]) -> list[bytes]:
    return [changed.get(number, record) for number, record in enumerate(records)]


JUNK = b"\x55" * 100
FLAG, TURN = "unknown block flag", "azimuth beyond one turn"
CUT = "record cut short at the end of the file"
LOST = "bytes without a record"


def damaged_records(name: str, records: list[bytes]):
    """File content, numbers of the payloads that survive, and what the ledger must reject."""
    r, size = records, len(records[0])
    split = r[5][:600] + JUNK + r[5][600:]
    match name:
        case "undamaged":
            return r, ALL, {}
        case "cut tail":
            return [*r[:-1], r[-1][:-500]], ALL[:-1], {CUT: (1, size - 500)}
        case "junk within":
            return replaced(r, {5: split}), without(5), {LOST: (1, size + 100)}
        case "junk between":
            return [*r[:5], JUNK, *r[5:]], ALL, {LOST: (1, 100)}
        case "junk before":
            return [JUNK, *r], ALL, {LOST: (1, 100)}
        case "junk at two places":
            content = replaced(r, {5: split, 9: r[9][:700] + r[9][701:]})
            return content, without(5, 9), {LOST: (2, 2 * size + 99)}
        case "one bad":
            return replaced(r, {5: flagless(r[5])}), without(5), {FLAG: (1, size)}
        case "every second bad":
            bad = {k: flagless(r[k]) for k in range(1, 10, 2)}
            return replaced(r, bad), without(*bad), {FLAG: (5, 5 * size)}
        case "three bad in a row":
            bad = {k: flagless(r[k]) for k in (5, 6, 7)}
            return replaced(r, bad), without(*bad), {LOST: (1, 3 * size)}
        case "first bad":
            return replaced(r, {0: flagless(r[0])}), without(0), {FLAG: (1, size)}
        case "second bad":
            return replaced(r, {1: flagless(r[1])}), without(1), {FLAG: (1, size)}
        case "last bad":
            return replaced(r, {N - 1: flagless(r[-1])}), ALL[:-1], {LOST: (1, size)}
        case "azimuth":
            bad = {k: beyond(r[k]) for k in (5, 6)}
            return replaced(r, bad), without(5, 6), {TURN: (2, 2 * size)}
    raise AssertionError(name)


RECORD_CASES = [
    "undamaged", "cut tail", "junk within", "junk between", "junk before", "junk at two places",
    "one bad", "every second bad", "three bad in a row", "first bad", "second bad", "last bad",
    "azimuth",
]  # fmt: skip


@pytest.fixture(scope="module")
def payloads() -> np.ndarray:
    return spin(N)


def assert_found(path, payloads, survivors, rejected) -> None:
    found, offsets, _, ledger = scan(path)
    content = path.read_bytes()
    header = 0 if ledger.framing.endswith("1206 bytes") else 42
    header += 16 if ledger.framing == "pcap" else 0
    np.testing.assert_array_equal(found, payloads[survivors])
    for offset, payload in zip(offsets, found, strict=True):
        tag = 4 if content[offset + header - 30 : offset + header - 28] == b"\x81\x00" else 0
        assert content[offset + header + tag :][:PAYLOAD] == bytes(payload)
    counted = {reason: (c.packets, c.bytes) for reason, c in ledger.rejected.items()}
    assert counted == rejected
    assert ledger.data.packets == len(survivors)
    assert ledger.data.bytes == len(survivors) * PAYLOAD
    assert ledger.unaccounted_bytes == 0
    full = inspect(path).ledger
    assert full == ledger
    assert full.as_dict()["unaccounted_bytes"] == 0


@pytest.mark.parametrize("header", [0, 42])
@pytest.mark.parametrize("case", RECORD_CASES)
def test_records(case, header, payloads, tmp_path):
    content, survivors, rejected = damaged_records(case, record_list(payloads, header))
    path = write(tmp_path, content)
    assert open_capture(path).name == f"records of {header + PAYLOAD} bytes"
    assert_found(path, payloads, survivors, rejected)


PACKET = 16 + 42 + PAYLOAD
GARBAGE = b"\xfe" * 16
PCAP_CUT = "packet cut short at the end of the file"
PCAP_LOST = "bytes without a packet header"


def damaged_pcap(name: str, payloads: np.ndarray, order: str, ticks: int):
    """Like `damaged_records`, with the number of position packets at the end."""
    frames = [udp_frame(payload) for payload in as_bytes(payloads)]

    def packet(frame: bytes, number: int = 0, captured: int | None = None) -> bytes:
        return pcap_packet(frame, number, order=order, ticks=ticks, captured=captured)

    p = [packet(frame, number) for number, frame in enumerate(frames)]
    head = pcap_head(order, ticks)
    extra, survivors, rejected, position = {}, ALL, {}, 0
    match name:
        case "undamaged":
            pass
        case "cut in payload":
            extra, survivors, rejected = {N - 1: p[-1][:-7]}, ALL[:-1], {PCAP_CUT: (1, PACKET - 7)}
        case "cut in header":
            extra, survivors, rejected = {N - 1: p[-1][:9]}, ALL[:-1], {PCAP_CUT: (1, 9)}
        case "position":
            extra = {3: packet(udp_frame(bytes(512))) + p[3], 4: packet(udp_frame(bytes(512)))}
            survivors, position = without(4), 2
        case "foreign":
            extra = {3: packet(udp_frame(b"x" * 100)) + p[3]}
            rejected = {"payload of 100 bytes": (1, 158)}
        case "not udp":
            extra = {3: packet(udp_frame(bytes(PAYLOAD), protocol=6)) + p[3]}
            rejected = {"not UDP: TCP": (1, PACKET)}
        case "arp":
            extra = {3: packet(b"\xff" * 12 + b"\x08\x06" + bytes(28)) + p[3]}
            rejected = {"not IP: ARP": (1, 58)}
        case "vlan":
            extra = {3: packet(vlan_frame(bytes(payloads[3])), 3)}
        case "short capture":
            extra, survivors = {3: packet(frames[3], captured=100)}, without(3)
            rejected = {"captured 100 of 1248 bytes": (1, 116)}
        case "bad flag":
            extra, survivors = {3: flagless(p[3])}, without(3)
            rejected = {FLAG: (1, PACKET)}
        case "damaged header":
            extra, survivors = {5: GARBAGE + p[5][16:]}, without(5)
            rejected = {PCAP_LOST: (1, PACKET)}
        case "first header damaged":
            extra, survivors = {0: GARBAGE + p[0][16:]}, without(0)
            rejected = {PCAP_LOST: (1, PACKET)}
        case "last header damaged":
            extra, survivors = {N - 1: GARBAGE + p[-1][16:]}, without(N - 1)
            rejected = {PCAP_LOST: (1, PACKET)}
        case "four bytes lost":
            # The next length is then read where its double lies, and that one as ff:ff:ff:ff.
            extra, survivors = {5: p[5][:700] + p[5][704:]}, without(5, 6)
            rejected = {FLAG: (1, PACKET), PCAP_LOST: (1, PACKET - 4)}
        case "length misread":
            # Packet 5 claims to hold the next five as well.
            length = struct.pack(order + "I", 1248 + 5 * PACKET)
            extra, survivors = {5: p[5][:8] + 2 * length + p[5][16:]}, without(5)
            rejected = {PCAP_LOST: (1, PACKET)}
        case "length beyond the end":
            length = struct.pack(order + "I", 200_000)
            extra, survivors = {5: p[5][:8] + 2 * length + p[5][16:]}, without(5)
            rejected = {PCAP_LOST: (1, PACKET)}
        case "jumbo frame":
            extra = {3: packet(udp_frame(b"x" * 8000)) + p[3]}
            rejected = {"payload of 8000 bytes": (1, 8058)}
    return [head, *replaced(p, extra)], survivors, rejected, position


PCAP_CASES = [
    "undamaged", "cut in payload", "cut in header", "position", "foreign", "not udp", "arp", "vlan",
    "short capture", "bad flag", "damaged header", "first header damaged", "last header damaged",
    "four bytes lost", "length misread", "length beyond the end", "jumbo frame",
]  # fmt: skip


@pytest.mark.parametrize(
    ("order", "ticks"), [("<", 10**6), (">", 10**6), ("<", 10**9), (">", 10**9)]
)
@pytest.mark.parametrize("case", PCAP_CASES)
def test_pcap(case, order, ticks, payloads, tmp_path):
    content, survivors, rejected, position = damaged_pcap(case, payloads, order, ticks)
    path = write(tmp_path, content)
    assert_found(path, payloads, survivors, rejected)
    _, _, times, ledger = scan(path)
    np.testing.assert_allclose(
        times - FIRST_SECOND, 0.04 + 553e-6 * np.array(survivors), rtol=0, atol=3e-7
    )
    assert ledger.position.packets == position
    assert ledger.position.bytes == position * (16 + 42 + 512)


# Records are judged by the one that follows, so a chunk holds two of them at least.
CHUNKS = [1300, 2500, 5000, 5001, 20_000]


@pytest.mark.parametrize("chunk_bytes", CHUNKS[1:])
@pytest.mark.parametrize("case", RECORD_CASES)
def test_records_do_not_depend_on_the_chunk(chunk_bytes, case, payloads, tmp_path, monkeypatch):
    monkeypatch.setattr(framing, "CHUNK_BYTES", chunk_bytes)
    monkeypatch.setattr(framing, "SEARCH_BYTES", 1300)
    content, survivors, rejected = damaged_records(case, record_list(payloads, 42))
    assert_found(write(tmp_path, content), payloads, survivors, rejected)


@pytest.mark.parametrize("chunk_bytes", CHUNKS)
@pytest.mark.parametrize("case", PCAP_CASES)
def test_pcap_does_not_depend_on_the_chunk(chunk_bytes, case, payloads, tmp_path, monkeypatch):
    monkeypatch.setattr(framing, "CHUNK_BYTES", chunk_bytes)
    monkeypatch.setattr(framing, "SEARCH_BYTES", 1300)
    content, survivors, rejected, _ = damaged_pcap(case, payloads, "<", 10**6)
    assert_found(write(tmp_path, content), payloads, survivors, rejected)


@pytest.mark.parametrize("header", [0, 42])
def test_a_long_stretch_of_junk_is_skipped(header, payloads, tmp_path, monkeypatch):
    """Longer than a chunk, and all of its bytes look like the beginning of a flag."""
    monkeypatch.setattr(framing, "CHUNK_BYTES", 5000)
    monkeypatch.setattr(framing, "SEARCH_BYTES", 4000)
    records = record_list(payloads, header)
    junk = b"\xff" * 17_003
    path = write(tmp_path, [*records[:9], junk, *records[9:]])
    assert_found(path, payloads, ALL, {LOST: (1, len(junk))})


def test_payloads_are_found_in_one_way():
    """Flags as an array, as a pattern and of a whole packet: the same packets are payloads."""
    rng = np.random.default_rng(4)
    packets = spin(400)
    flags = np.array([[0xFF, 0xEE], [0xFF, 0xBB], [0, 0], [0xFF, 0xFF], [0, 0xEE], [0xFF, 0]])
    for packet in packets:
        for block in rng.integers(6, 12, 3):
            packet[100 * block : 100 * block + 2] = flags[rng.integers(len(flags))]
        if rng.random() < 0.4:
            packet[800:1200:100], packet[801:1200:100] = flags[2]
    known, _ = check_payloads(packets)
    assert 50 < known.sum() < 350
    found = np.array([len(framing.payload_positions(packet)) == 1 for packet in packets])
    np.testing.assert_array_equal(found, known)
    found = np.array([framing.find_payload(bytes(packet), 0) == 0 for packet in packets])
    np.testing.assert_array_equal(found, known)


@pytest.mark.parametrize("header", [0, 42])
def test_one_record_is_a_recording(header, payloads, tmp_path):
    path = write(tmp_path, record_list(payloads[:1], header))
    assert_found(path, payloads, [0], {})


def test_packets_that_begin_in_a_stretch(payloads, tmp_path):
    """Those and no others, whatever lies before and after."""
    path = write(tmp_path, pcap(payloads))
    _, offsets, _, _ = scan(path)
    found = list(open_capture(path).read_between(int(offsets[3]), int(offsets[8])))
    np.testing.assert_array_equal(np.concatenate([c.payloads for c in found]), payloads[3:8])


def test_a_stretch_has_a_ledger_of_its_own(payloads, tmp_path):
    packets = [pcap_packet(udp_frame(payload), k) for k, payload in enumerate(as_bytes(payloads))]
    packets[5] = flagless(packets[5])
    path = write(tmp_path, [pcap_head(), *packets])
    start = len(pcap_head()) + 3 * PACKET
    reading = open_capture(path).read_between(start, start + 5 * PACKET)
    found = np.concatenate([chunk.payloads for chunk in reading])
    np.testing.assert_array_equal(found, payloads[[3, 4, 6, 7]])
    assert reading.ledger.data.packets == 4
    assert reading.ledger.file_bytes == 5 * PACKET
    assert {k: (c.packets, c.bytes) for k, c in reading.ledger.rejected.items()} == {
        FLAG: (1, PACKET)
    }


def test_what_is_known_at_the_end_is_not_told_before(payloads, tmp_path, monkeypatch):
    monkeypatch.setattr(framing, "CHUNK_BYTES", 5000)
    capture = open_capture(write(tmp_path, pcap(payloads)))
    reading = capture.read()
    with pytest.raises(RecordingError, match="has not been read yet, so its ledger"):
        _ = reading.ledger
    chunks = iter(reading)
    next(chunks)
    assert not reading.complete
    for name in ("ledger", "seekable"):
        with pytest.raises(RecordingError, match="in part only"):
            getattr(reading, name)
    for _ in chunks:
        pass
    assert reading.complete
    assert reading.seekable
    assert reading.ledger.data.packets == N
    with pytest.raises(RecordingError, match="gives its packets once"):
        iter(reading)
    abandoned = capture.read()
    for _ in abandoned:
        break
    with pytest.raises(RecordingError, match="in part only"):
        _ = abandoned.ledger


def test_a_stretch_of_a_compressed_capture_cannot_be_read(payloads, tmp_path):
    capture = open_capture(write(tmp_path, gzip.compress(pcap(payloads))))
    assert not capture.seekable
    with pytest.raises(RecordingError, match="only be read from the beginning"):
        capture.read_between(24, 5000)


PAYLOADS_WITH_GAPS = b"".join(bytes(p) + b"\x07" * 20 for p in spin(N))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"x,y,z\n1,2,3\n" * 3000, "no Velodyne data packet"),
        (b"short", "no Velodyne data packet"),
        (b"\xd4\xc3\xb2\xa1", "no Velodyne data packet"),
        (pcap_head(link=105) + bytes(100), "link type 105"),
        (pcap_head(), "no valid data packet"),
        (pcap_head() + pcap_packet(udp_frame(bytes(512))), "no valid data packet"),
        # Another container may hold the same payloads.
        (PAYLOADS_WITH_GAPS, "no Velodyne data packet"),
    ],
    ids=["empty", "text", "short", "magic only", "link", "no packets", "position", "container"],
)
def test_what_is_no_recording(content, says, tmp_path):
    path = write(tmp_path, content, "thing.bin")
    with pytest.raises(RecordingError, match=says) as caught:
        inspect(path)
    assert str(path) in str(caught.value)


def test_a_missing_file(tmp_path):
    with pytest.raises(RecordingError, match="No such file") as caught:
        inspect(tmp_path / "absent.pcap")
    assert "Hint:" in str(caught.value)


def test_a_folder(tmp_path):
    with pytest.raises(RecordingError, match="cannot be read"):
        inspect(tmp_path)
