"""Files from the field that hold no usable packets, or hold them in an unusual way."""

import bz2
import gzip
import json
import os
import pickle
import sqlite3
import struct

import numpy as np
import pytest
from support.capture import as_bytes, pcap_head, pcap_packet, scan, spin, udp_frame, write
from support.containers import (
    ethernet,
    ethernet6,
    fragments,
    frames_of,
    ip6_packet,
    ip_packet,
    labelled,
    mirrored,
    pcap_of,
    pcapng,
    ros1_scan,
    write_ros1,
    write_ros2,
)
from typer.testing import CliRunner

from velocal.capture import bag_message
from velocal.capture.ledger import NothingUsableError
from velocal.capture.reading import open_capture
from velocal.capture.source import SourceFilter
from velocal.cli import app
from velocal.errors import RecordingError
from velocal.recording.scan import inspect

N = 24
PAYLOADS = spin(N)
BARE = as_bytes(PAYLOADS)
FRAMES = frames_of(PAYLOADS)
POSITION = udp_frame(bytes(512))


def cut(frames: list[bytes], captured: int) -> bytes:
    return pcap_head() + b"".join(
        pcap_packet(frame, number, captured=captured) for number, frame in enumerate(frames)
    )


# -- nothing usable --------------------------------------------------------------------------------

NOTHING = {
    "no packets": (pcap_head(), "no valid data packet", "filter"),
    "snapped": (
        cut([*FRAMES, POSITION], 600),
        r"by number: captured 600 of 1248 bytes \(24\); position packets \(1\)",
        "tcpdump -s 0",
    ),
    "headers only": (cut(FRAMES, 42), r"captured 42 of 1248 bytes \(24\)", "tcpdump -s 0"),
    "position only": (pcap_of([POSITION] * 7), r"position packets \(7\)", "2368"),
    "another maker": (
        pcap_of([udp_frame(bytes(1080)), *[udp_frame(bytes(6464))] * 2]),
        r"payload of 6464 bytes \(2\); payload of 1080 bytes \(1\)",
        "1206 bytes",
    ),
    "same size": (pcap_of([udp_frame(bytes(1206))] * 3), r"unknown block flag \(3\)", "maker"),
    "another maker, IPv6": (
        pcap_of([ethernet6(ip6_packet(bytes(1080)))]),
        r"payload of 1080 bytes \(1\)",
        "1206 bytes",
    ),
    "IPv6, snapped": (
        cut([ethernet6(ip6_packet(payload)) for payload in BARE], 60),
        r"captured 60 of 1268 bytes \(24\)",
        "tcpdump -s 0",
    ),
    "ARP": (pcap_of([b"\xff" * 12 + b"\x08\x06" + bytes(28)]), "not IP: ARP", "interface"),
    "unknown type": (pcap_of([bytes(12) + b"\x12\x34" + bytes(28)]), "type 0x1234", "interface"),
    "TCP": (pcap_of([udp_frame(bytes(9), protocol=6)]), "not UDP: TCP", "interface"),
    "mirrored": (
        pcap_of([mirrored(ip_packet(payload)) for payload in BARE]),
        r"not UDP: GRE \(24\)",
        "editcap -C 50",
    ),
    "first fragments": (
        pcap_of([ethernet(fragments(ip_packet(p), 1)[-1]) for p in BARE[:3]]),
        r"fragment without the others \(3\)",
        "filter",
    ),
    "zeros": (pcap_head() + bytes(50_000), "bytes without a packet header", "damaged"),
    "pcapng": (pcapng([POSITION]), r"position packets \(1\)", "2368"),
    "gzip": (gzip.compress(pcap_of([POSITION])), r"position packets \(1\)", "2368"),
}


@pytest.mark.parametrize("name", NOTHING)
def test_what_was_found_is_told(name, tmp_path):
    content, says, hint = NOTHING[name]
    path = write(tmp_path, content)
    with pytest.raises(NothingUsableError, match=says) as caught:
        inspect(path)
    assert str(path) in str(caught.value)
    assert hint in (caught.value.hint or "")
    assert caught.value.ledger.unaccounted_bytes == 0
    again = pickle.loads(pickle.dumps(caught.value))  # errors cross the borders of processes
    assert (str(again), again.ledger) == (str(caught.value), caught.value.ledger)


def test_the_ledger_is_shown(tmp_path):
    path = write(tmp_path, NOTHING["snapped"][0])
    shown = CliRunner().invoke(app, ["inspect", str(path)])
    assert isinstance(shown.exception, NothingUsableError)
    assert "captured 600 of 1248 bytes" in shown.stdout
    as_json = CliRunner().invoke(app, ["inspect", str(path), "--json"])
    ledger = json.loads(as_json.stdout)["ledger"]
    assert ledger["rejected"]["captured 600 of 1248 bytes"]["packets"] == N
    assert ledger["unaccounted_bytes"] == 0


def test_reasons_and_senders_are_bounded(tmp_path):
    """Junk has any number of lengths and addresses."""
    junk = [udp_frame(bytes(n)) for n in range(300)]
    from_many = [
        ethernet(ip_packet(BARE[0], address=struct.pack(">I", number))) for number in range(1200)
    ]
    path = write(tmp_path, pcap_of([*junk, *from_many]))
    with pytest.raises(RecordingError, match="and 988 others") as caught:
        inspect(path)
    assert len(str(caught.value)) < 1000
    with pytest.raises(NothingUsableError, match="other reasons") as told:
        inspect(write(tmp_path, pcap_of(junk)))
    assert len(told.value.ledger.rejected) == 101
    assert told.value.ledger.unaccounted_bytes == 0
    assert len(str(told.value)) < 1000


# -- other kinds of files --------------------------------------------------------------------------

KINDS = {
    "Git LFS": (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "Git LFS", "pull"),
    "page": (b"\n<!DOCTYPE html><html><body>Sign in</body></html>", "web page", "itself"),
    "page, old": (b"\xef\xbb\xbf<HTML><HEAD>", "web page", "itself"),
    "zstd": (b"\x28\xb5\x2f\xfd" + bytes(99), "compressed with zstd", "`zstd -d 'a b.pcap'`"),
    "lz4": (b"\x04\x22\x4d\x18" + bytes(99), "compressed with lz4", "`lz4 -d 'a b.pcap'`"),
    "zip": (b"PK\x03\x04" + bytes(99), "zip archive", "`unzip 'a b.pcap'`"),
    "7z": (b"7z\xbc\xaf\x27\x1c" + bytes(99), "7z archive", "`7z x 'a b.pcap'`"),
    "tar": (b"x.pcap".ljust(257, b"\0") + b"ustar\0" + bytes(99), "tar", "tar -xf 'a b.pcap'"),
    "tar.gz": (gzip.compress(b"x".ljust(257, b"\0") + b"ustar\0"), "tar", "tar -xf"),
    "damaged gzip": (b"\x1f\x8b" + bytes(99), "its gzip data are damaged", "`gunzip 'a b.pcap'`"),
    "damaged xz": (b"\xfd7zXZ\0" + bytes(99), "its xz data are damaged", "`unxz 'a b.pcap'`"),
    "points": (b"LASF" + bytes(99), "LAS file of points", "--dialect"),
    "zeros": (bytes(5000), "zeros only", "Copy it again"),
    "text": (b"x,y,z\n1,2,3\n", "no recording", "tcpdump"),
}


@pytest.mark.parametrize("name", KINDS)
def test_other_files_are_named(name, tmp_path):
    content, says, hint = KINDS[name]
    path = write(tmp_path, content, "a b.pcap")
    with pytest.raises(RecordingError, match=says) as caught:
        open_capture(path)
    assert hint in (caught.value.hint or "")


def test_ten_gigabytes_of_nothing(tmp_path, monkeypatch):
    """Each byte is looked at once, in steps that grow: the number of reads tells."""
    from velocal.capture import framing

    path = write(tmp_path, pcap_head())
    steps = []
    found = framing.find_payload
    monkeypatch.setattr(
        framing, "find_payload", lambda data, *of: steps.append(len(data)) or found(data, *of)
    )
    size = 200_000_000  # sparse
    os.truncate(path, size)
    with pytest.raises(NothingUsableError, match="bytes without a packet header"):
        inspect(path)
    assert len(steps) < 3 + size / framing.SEARCH_BYTES * 1.1
    assert sum(steps) < 1.1 * size


def test_a_pipe_is_refused(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(RecordingError, match="no regular file"):
        open_capture(path)
    folder = tmp_path / "bag"
    folder.mkdir()
    os.mkfifo(folder / "bag_0.mcap")
    with pytest.raises(RecordingError, match="no regular file"):
        open_capture(folder)
    with pytest.raises(RecordingError, match="no regular file"):
        open_capture(type(path)("/dev/null"))


# -- unusual, but read -----------------------------------------------------------------------------

EXTENSION = bytes([17, 0, 1, 4, 0, 0, 0, 0])
READ = {
    "IPv6": [ethernet6(ip6_packet(payload)) for payload in BARE],
    "IPv6, options": [ethernet6(ip6_packet(payload, extension=EXTENSION)) for payload in BARE],
    "MPLS": frames_of(PAYLOADS, labelled),
}


@pytest.mark.parametrize("name", READ)
def test_other_networks_are_read(name, tmp_path):
    path = write(tmp_path, pcap_of(READ[name]))
    payloads, _, _, ledger = scan(path)
    np.testing.assert_array_equal(payloads, PAYLOADS)
    assert ledger.unaccounted_bytes == 0
    (sender,) = ledger.senders
    assert sender == ("[fe80::6276:88ff:fe00:1]:2368" if "IPv6" in name else "192.168.1.201:2368")


def test_a_scanner_is_chosen_by_its_ipv6_address(tmp_path):
    other = as_bytes(spin(N, seed=3))
    frames = [
        f for pair in zip(READ["IPv6"], frames_of(spin(N, seed=3)), strict=True) for f in pair
    ]
    path = write(tmp_path, pcap_of(frames))
    with pytest.raises(RecordingError, match="2 scanners"):
        inspect(path)
    for address, expected in (("fe80::6276:88ff:fe00:1", BARE), ("192.168.1.201", other)):
        payloads, _, _, ledger = scan(path, SourceFilter(address=address))
        assert as_bytes(payloads) == expected
        assert ledger.unaccounted_bytes == 0


def test_captured_bytes_that_a_card_appended(tmp_path):
    content = pcap_head()
    for number, frame in enumerate([*FRAMES, POSITION]):
        record = pcap_packet(frame + b"\xab\xcd", number)
        content += record[:12] + struct.pack("<I", len(frame)) + record[16:]
    payloads, _, _, ledger = scan(write(tmp_path, content))
    np.testing.assert_array_equal(payloads, PAYLOADS)
    assert ledger.position.packets == 1
    assert ledger.rejected == {}


def test_the_shared_capture_with_appended_bytes(shared, tmp_path):
    """`caplen_plus2.pcap` of the shared cases: the points of the capture, 65 position packets."""
    source = (shared / "recordings/hdl32e-static-outdoor.pcap").read_bytes()
    content, at = source[:24], 24
    while at < len(source):
        (captured,) = struct.unpack_from("<I", source, at + 8)
        if at + 16 + captured > len(source):
            break  # the recording ends within a packet
        frame = source[at + 16 : at + 16 + captured]
        content += (
            source[at : at + 8] + struct.pack("<II", captured + 2, captured) + frame + b"\0\0"
        )
        at += 16 + captured
    expected, _, _, _ = scan(shared / "recordings/hdl32e-static-outdoor.pcap")
    payloads, _, _, ledger = scan(write(tmp_path, content))
    np.testing.assert_array_equal(payloads, expected)
    assert ledger.position.packets == 65
    assert ledger.rejected == {}


# -- bags ------------------------------------------------------------------------------------------

SCANS = {"/velodyne_packets": BARE}


@pytest.mark.parametrize("compression", [None, "BZ2", "LZ4"])
def test_a_ros1_bag_is_read_as_far_as_it_is_whole(compression, tmp_path):
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    path = write_ros1(tmp_path / "x.bag", SCANS, package="velodyne_driver", compression=compression)
    payloads, _, _, ledger = scan(path)
    np.testing.assert_array_equal(payloads, PAYLOADS)
    assert ledger.rejected == {}
    content = path.read_bytes()
    index = content.index(b"index_pos=") + 10
    unindexed = content[:index] + bytes(8) + content[index + 8 :]
    payloads, _, _, ledger = scan(write(tmp_path, unindexed, "unindexed.bag"))
    np.testing.assert_array_equal(payloads, PAYLOADS)
    # Cut within the index, the chunk is whole.
    payloads, _, _, ledger = scan(write(tmp_path, content[:-300], "cut.bag"))
    np.testing.assert_array_equal(payloads, PAYLOADS)
    assert ledger.rejected["bag cut short or damaged"].packets == 1
    assert ledger.unaccounted_bytes == 0


@pytest.mark.parametrize("compression", [None, "STORAGE"])
def test_a_cut_mcap_is_used_as_far_as_its_chunks_are_whole(compression, tmp_path):
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    folder = write_ros2(
        tmp_path / "bag", {"/v": as_bytes(spin(2000))}, "MCAP", compression=compression
    )
    (path,) = folder.glob("*.mcap")
    content = path.read_bytes()
    whole, _, _, ledger = scan(folder)
    assert len(whole) == 2000
    assert ledger.rejected == {}
    found, _, _, ledger = scan(write(tmp_path, content[: len(content) * 3 // 4], "cut.mcap"))
    assert 500 < len(found) < 2000
    np.testing.assert_array_equal(found, whole[: len(found)])
    assert ledger.rejected["bag cut short or damaged"].packets == 1
    assert ledger.unaccounted_bytes == 0
    if compression:
        second = content.index(b"\x28\xb5\x2f\xfd", content.index(b"\x28\xb5\x2f\xfd") + 4)
        damaged = content[:second] + b"\0" + content[second + 1 :]
        found, _, _, ledger = scan(write(tmp_path, damaged, "damaged.mcap"))
        assert ledger.rejected["chunk that cannot be unpacked"].packets == 1
        assert ledger.unaccounted_bytes == 0
        assert 1000 < len(found) < 2000


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_compressed_messages_are_read_alone(storage, tmp_path):
    """Only metadata.yaml tells of them, which a single file lacks."""
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    folder = write_ros2(tmp_path / "bag", SCANS, storage, package="other", compression="MESSAGE")
    (path,) = [each for each in folder.iterdir() if each.suffix != ".yaml"]
    for each in (folder, path):
        payloads, _, _, ledger = scan(each)
        np.testing.assert_array_equal(payloads, PAYLOADS)
        assert ledger.unaccounted_bytes == 0


def test_a_bag_of_other_topics(tmp_path):
    database = tmp_path / "x.db3"
    with sqlite3.connect(database) as made:
        made.execute("CREATE TABLE topics (id INTEGER, name TEXT, type TEXT)")
        made.execute("CREATE TABLE messages (id INTEGER, topic_id INTEGER, timestamp, data BLOB)")
        made.execute("INSERT INTO topics VALUES (1, '/points', 'sensor_msgs/msg/PointCloud2')")
        made.execute("INSERT INTO topics VALUES (2, '/imu', 'sensor_msgs/msg/Imu')")
        made.executemany("INSERT INTO messages VALUES (?, 1, 5, x'00')", [(1,), (2,)])
    made.close()
    with pytest.raises(RecordingError, match="without messages of type VelodyneScan") as caught:
        open_capture(database)
    text = str(caught.value)
    assert "/points of type sensor_msgs/msg/PointCloud2, 2 messages" in text
    assert "/imu of type sensor_msgs/msg/Imu, 0 messages" in text
    assert "computed with a calibration already" in text


def test_a_bag_whose_only_chunk_is_cut(tmp_path):
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    content = write_ros1(tmp_path / "x.bag", SCANS).read_bytes()
    path = write(tmp_path, content[: len(content) // 2], "cut.bag")
    with pytest.raises(RecordingError, match=r"bag cut short or damaged \(1\)") as caught:
        open_capture(path)
    assert "reindex" in (caught.value.hint or "")


def test_a_view_is_no_table(tmp_path):
    """It could run for ever."""
    database = tmp_path / "x.db3"
    with sqlite3.connect(database) as made:
        made.execute("CREATE TABLE topics (id, name, type)")
        made.execute("INSERT INTO topics VALUES (1, '/v', 'v/VelodyneScan')")
        made.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(id) AS "
            "(SELECT 1 UNION ALL SELECT id + 1 FROM n) "
            "SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n"
        )
    made.close()
    with pytest.raises(RecordingError, match="cannot be read as a ROS bag"):
        open_capture(database)


def ros1_record(data: bytes, **fields: bytes) -> bytes:
    parts = [name.encode() + b"=" + value for name, value in fields.items()]
    header = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def test_a_chunk_that_unpacks_to_gigabytes(tmp_path, monkeypatch):
    """No more is unpacked than a chunk may have; the other chunks are used."""
    monkeypatch.setattr(bag_message, "MOST_BYTES", 100_000)
    kept = []
    unpack = bag_message.bz2.BZ2Decompressor

    class Counting:
        def __init__(self):
            self.inner = unpack()

        def decompress(self, data, most):
            content = self.inner.decompress(data, most)
            kept.append(len(content))
            return content

        @property
        def eof(self):
            return self.inner.eof

    monkeypatch.setitem(bag_message._DECOMPRESSORS, "bz2", Counting)
    name = b"/velodyne_packets"
    type_ = b"".join(
        struct.pack("<I", len(p)) + p
        for p in [b"topic=" + name, b"type=velodyne_msgs/VelodyneScan"]
    )
    connection = ros1_record(type_, op=b"\7", conn=bytes(4), topic=name)
    message = ros1_record(ros1_scan(BARE, 0), op=b"\2", conn=bytes(4), time=bytes(8))
    bomb = bz2.compress(bytes(30_000_000))
    content = b"#ROSBAG V2.0\n" + ros1_record(b"", op=b"\3", index_pos=bytes(8))
    content += ros1_record(connection + message, op=b"\5", compression=b"none", size=b"abcd")
    content += ros1_record(bomb, op=b"\5", compression=b"bz2", size=b"abcd")
    payloads, _, _, ledger = scan(write(tmp_path, content, "x.bag"))
    np.testing.assert_array_equal(payloads, PAYLOADS)
    assert ledger.rejected["chunk that cannot be unpacked"].bytes == len(bomb)
    assert ledger.unaccounted_bytes == 0
    assert max(kept) <= 100_001
