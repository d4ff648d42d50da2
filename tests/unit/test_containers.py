"""One capture in every container gives one table; several scanners are told apart."""

import bz2
import gzip
import hashlib
import lzma

import numpy as np
import pytest
from support.capture import as_bytes, pcap_head, pcap_packet, scan, spin, udp_frame, write
from support.containers import (
    block,
    containers,
    enhanced,
    ethernet,
    fragments,
    frames_of,
    interface,
    ip_packet,
    pcap_of,
    pcapng,
    section,
    write_ros1,
    write_ros2,
)

from velocal.capture import compressed, framing
from velocal.capture import pcapng as pcapng_module
from velocal.capture.reading import open_capture
from velocal.capture.source import SourceFilter
from velocal.errors import RecordingError
from velocal.recording.returns import write_returns
from velocal.recording.scan import inspect
from velocal.recording.windows import read_index, write_index
from velocal.scanner.models import SCANNERS

N = 72  # packets; rotations 1 and 2 are complete
PAYLOADS = spin(N)
FILES = containers(PAYLOADS)


@pytest.fixture(scope="module")
def expected(tmp_path_factory) -> tuple[str, np.ndarray]:
    folder = tmp_path_factory.mktemp("expected")
    return tables(write(folder, FILES["records 1248"]))


def tables(path) -> tuple[str, np.ndarray]:
    """Digest of the table of returns, by way of the stored index, and starts of rotations."""
    stored = path.parent / "rotations.parquet"
    write_index(stored, inspect(path).index)
    index = read_index(stored)
    out = path.parent / "returns.parquet"
    rows = write_returns(path, index, np.array([1, 2]), SCANNERS["HDL-32E"], out)
    assert rows == 2 * 240 * 32
    starts = np.column_stack([index.packet, index.block])
    return hashlib.sha256(out.read_bytes()).hexdigest(), starts


def assert_alike(path, expected) -> None:
    digest, starts = tables(path)
    assert digest == expected[0]
    np.testing.assert_array_equal(starts, expected[1])
    payloads, _, times, ledger = scan(path)
    np.testing.assert_array_equal(payloads, PAYLOADS)
    assert times is None or len(times) == N
    assert ledger.rejected == {}
    assert ledger.unaccounted_bytes == 0
    assert ledger.data.packets == N


@pytest.mark.parametrize("chunk_bytes", [8 << 20, 20_000])
@pytest.mark.parametrize("name", FILES)
def test_the_same_returns(name, chunk_bytes, expected, tmp_path, monkeypatch):
    monkeypatch.setattr(framing, "CHUNK_BYTES", chunk_bytes)
    path = write(tmp_path, FILES[name])
    assert_alike(path, expected)
    ledger = inspect(path).ledger
    unpack = {b"\x1f\x8b": gzip.decompress, b"BZ": bz2.decompress, b"\xfd7": lzma.decompress}
    content = unpack.get(FILES[name][:2], bytes)(FILES[name])
    assert ledger.file_bytes == len(content)
    assert ledger.assembled == (N if "fragments" in name else 0)
    senders = {} if "1206" in name else {"192.168.1.201:2368": N}
    assert ledger.senders == senders


@pytest.mark.parametrize("storage", ["ROS 1", "SQLITE3", "MCAP"])
def test_bags(storage, expected, tmp_path):
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    topics = {"/velodyne_packets": as_bytes(PAYLOADS)}
    if storage == "ROS 1":
        path = write_ros1(tmp_path / "x.bag", topics)
    else:
        path = write_ros2(tmp_path / "bag", topics, storage)
    assert_alike(path, expected)
    assert inspect(path).ledger.senders == {"/velodyne_packets": N}
    if storage != "ROS 1":
        (single,) = [file for file in path.iterdir() if file.suffix != ".yaml"]
        assert_alike(single, expected)


def test_topics_of_a_bag(tmp_path):
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    topics = {"/left": as_bytes(PAYLOADS), "/right": as_bytes(spin(9, seed=5))}
    path = write_ros2(tmp_path / "bag", topics)
    with pytest.raises(RecordingError, match="2 scanners") as caught:
        inspect(path)
    assert "/left, 11 messages; /right, 2 messages" in str(caught.value)
    payloads, _, _, ledger = scan(path, SourceFilter(address="/right"))
    np.testing.assert_array_equal(payloads, spin(9, seed=5))
    assert ledger.rejected["message of topic /left"].packets == 11
    assert ledger.unaccounted_bytes == 0
    for source in (SourceFilter(address="/up"), SourceFilter(port=2368)):
        with pytest.raises(RecordingError, match="holds no messages"):
            inspect(path, source=source)


def test_a_damaged_bag(tmp_path):
    path = write(tmp_path, b"SQLite format 3\0" + bytes(5000), "x.db3")
    with pytest.raises(RecordingError, match="cannot be read as a ROS bag") as caught:
        inspect(path)
    assert "Hint:" in str(caught.value)


# -- several scanners ------------------------------------------------------------------------------

OTHER = spin(N, seed=3, stamp_us=9_000_000)


def two_scanners(*, port: int = 2368, last: int = 201) -> bytes:
    """Packets of two scanners in turn."""
    frames = []
    for mine, other in zip(as_bytes(PAYLOADS), as_bytes(OTHER), strict=True):
        address = bytes([192, 168, 1, last])
        frames += [ethernet(ip_packet(mine))]
        frames += [ethernet(ip_packet(other, port=port, address=address))]
    return pcap_of(frames)


@pytest.mark.parametrize(
    ("differ", "mine", "other"),
    [
        ({"port": 2369}, SourceFilter(port=2368), SourceFilter(2369, "192.168.1.201")),
        ({"last": 7}, SourceFilter(address="192.168.1.201"), SourceFilter(address="192.168.1.7")),
        ({"port": 1, "last": 7}, SourceFilter(2368, "192.168.1.201"), SourceFilter(port=1)),
    ],
)
@pytest.mark.parametrize("packed", [False, True])
def test_several_scanners(differ, mine, other, packed, expected, tmp_path):
    content = two_scanners(**differ)
    path = write(tmp_path, gzip.compress(content) if packed else content)
    with pytest.raises(RecordingError, match="of 2 scanners") as caught:
        inspect(path)
    named = f"192.168.1.{differ.get('last', 201)}:{differ.get('port', 2368)}, {N} packets"
    for part in ("192.168.1.201:2368, 72 packets", named, "Hint: Choose one"):
        assert part in str(caught.value)
    for source, payloads in ((mine, PAYLOADS), (other, OTHER)):
        found, _, _, ledger = scan(path, source)
        np.testing.assert_array_equal(found, payloads)
        (rejected,) = ledger.rejected.items()
        assert rejected[0].startswith("from 192.168.1.")
        assert rejected[1].packets == N
        assert ledger.unaccounted_bytes == 0
    index = inspect(path, source=mine).index
    out = tmp_path / "returns.parquet"
    write_returns(path, index, np.array([1, 2]), SCANNERS["HDL-32E"], out, source=mine)
    assert hashlib.sha256(out.read_bytes()).hexdigest() == expected[0]


@pytest.mark.parametrize(
    ("source", "says"),
    [
        (SourceFilter(port=5), "no data packets to port 5"),
        (SourceFilter(5, "10.0.0.1"), "no data packets from 10.0.0.1 to port 5"),
        (SourceFilter(address="10.0.0"), "is not an IP address"),
        (SourceFilter(address="/velodyne_packets"), "is not an IP address"),
    ],
)
def test_a_scanner_that_is_not_there(source, says, tmp_path):
    with pytest.raises(RecordingError, match=says) as caught:
        inspect(write(tmp_path, FILES["pcapng"]), source=source)
    assert "allowed: " in str(caught.value)


def test_bare_payloads_have_no_address(tmp_path):
    with pytest.raises(RecordingError, match="have no addresses"):
        inspect(write(tmp_path, FILES["records 1206"]), source=SourceFilter(port=2368))


def test_a_damaged_address_is_no_scanner(tmp_path):
    frames = frames_of(PAYLOADS)
    frames[9] = frames[9][:27] + b"\x77" + frames[9][28:]
    payloads, _, _, ledger = scan(write(tmp_path, pcap_of(frames)))
    np.testing.assert_array_equal(payloads, PAYLOADS)
    assert ledger.senders["192.119.1.201:2368"] == 1


def test_a_damaged_address_at_the_beginning(tmp_path, monkeypatch):
    """Not taken for a scanner while the other has sent no more."""
    monkeypatch.setattr(framing, "CHUNK_BYTES", 2600)
    frames = frames_of(PAYLOADS)
    frames[1] = frames[1][:27] + b"\x77" + frames[1][28:]
    payloads, _, _, ledger = scan(write(tmp_path, pcap_of(frames)))
    np.testing.assert_array_equal(payloads, PAYLOADS)
    assert ledger.unaccounted_bytes == 0


# -- fragments, short captures, position packets ---------------------------------------------------


def test_missing_fragments(tmp_path):
    frames = frames_of(PAYLOADS)
    pieces = [ethernet(piece) for piece in fragments(ip_packet(bytes(PAYLOADS[5])), 5)]
    frames[5:6] = pieces[1:]
    payloads, _, _, ledger = scan(write(tmp_path, pcap_of(frames)))
    np.testing.assert_array_equal(payloads, np.delete(PAYLOADS, 5, axis=0))
    lost = ledger.rejected["fragment without the others"]
    assert (lost.packets, lost.bytes) == (2, sum(16 + len(piece) for piece in pieces[1:]))
    assert ledger.unaccounted_bytes == 0


def test_many_missing_fragments(tmp_path):
    """They are waited for in bounded memory."""
    frames = []
    for number, payload in enumerate(as_bytes(spin(200))):
        pieces = [ethernet(piece) for piece in fragments(ip_packet(payload), number)]
        frames += pieces[1:] if number % 2 else pieces
    payloads, _, _, ledger = scan(write(tmp_path, pcap_of(frames)))
    np.testing.assert_array_equal(payloads, spin(200)[::2])
    assert ledger.rejected["fragment without the others"].packets == 200
    assert ledger.unaccounted_bytes == 0


@pytest.mark.parametrize("pieces", [False, True])
def test_short_captures(pieces, tmp_path):
    content = pcap_head()
    for number, payload in enumerate(as_bytes(PAYLOADS)):
        packet = ip_packet(payload)
        frames = [ethernet(p) for p in fragments(packet, number)] if pieces else [ethernet(packet)]
        content += b"".join(
            pcap_packet(f, number, captured=400 if number == 5 else None) for f in frames
        )
    found, _, _, ledger = scan(write(tmp_path, content))
    np.testing.assert_array_equal(found, np.delete(PAYLOADS, 5, axis=0))
    reasons = {key: count.packets for key, count in ledger.rejected.items()}
    whole = {"captured 400 of 1248 bytes": 1}
    assert reasons == ({"captured 400 of 514 bytes": 2, "fragment without the others": 1}
                       if pieces else whole)  # fmt: skip
    assert ledger.unaccounted_bytes == 0


def test_position_packets_are_noted(tmp_path):
    sentence = b"$GPRMC,102030,A,4912.34,N,01635.67,E,0,0,010170,,,A*5C"
    payload = bytearray(512)
    payload[206 : 206 + len(sentence)] = sentence
    frames = frames_of(PAYLOADS)
    frames[5:5] = [udp_frame(bytes(payload))] * 3
    for content in (pcap_of(frames), pcapng(frames)):
        ledger = inspect(write(tmp_path, content)).ledger
        assert ledger.position.packets == 3
        assert ledger.nmea == sentence.decode()
        assert ledger.unaccounted_bytes == 0


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("damaged", [None, 30, 60])
def test_runs_of_pcapng_are_what_their_packets_are(order, damaged, tmp_path, monkeypatch):
    """Packets of one size are looked at as an array, up to the first that is not like them."""
    blocks = [enhanced(frame, n, order) for n, frame in enumerate(frames_of(PAYLOADS))]
    if damaged is not None:
        blocks[damaged] = blocks[damaged][:-4] + bytes(4)
    blocks.insert(50, block(4, bytes(8), order))
    path = write(tmp_path, section(order) + interface(order) + b"".join(blocks))
    in_runs = scan(path)
    monkeypatch.setattr(pcapng_module, "ALIKE", 10**9)
    one_by_one = scan(path)
    for one, other in zip(in_runs[:3], one_by_one[:3], strict=True):
        np.testing.assert_array_equal(one, other)
    assert in_runs[3].as_dict() == one_by_one[3].as_dict()
    lost = [] if damaged is None else [damaged]
    np.testing.assert_array_equal(in_runs[0], np.delete(PAYLOADS, lost, axis=0))
    assert sum(count.packets for count in in_runs[3].rejected.values()) == len(lost)
    assert in_runs[3].unaccounted_bytes == 0


# -- compressed ------------------------------------------------------------------------------------


def test_a_cut_gzip_file(tmp_path):
    packed = FILES["pcap <1000000, gzip"]
    payloads, _, _, ledger = scan(write(tmp_path, packed[: len(packed) // 2]))
    n = len(payloads)
    assert N / 3 < n < 2 * N / 3
    np.testing.assert_array_equal(payloads, PAYLOADS[:n])
    assert ledger.rejected["compressed file cut short"].packets == 1
    assert ledger.unaccounted_bytes == 0


def test_a_damaged_gzip_file(tmp_path, monkeypatch):
    monkeypatch.setattr(compressed, "PIECE_BYTES", 500)
    packed = FILES["pcap <1000000, gzip"]
    half = len(packed) // 2
    path = write(tmp_path, packed[:half] + b"\xff" * 200 + packed[half:])
    payloads, _, _, ledger = scan(path)
    lost = ledger.rejected["compressed bytes that cannot be unpacked"]
    assert N / 3 < len(payloads) < N
    np.testing.assert_array_equal(payloads[: N // 3], PAYLOADS[: N // 3])
    assert 0 < lost.bytes <= len(packed) - half + 200 + 500
    assert ledger.unaccounted_bytes == 0


def test_a_compressed_recording_is_read_forwards(tmp_path, monkeypatch):
    monkeypatch.setattr(compressed, "KEPT_BYTES", 1000)
    content = np.random.default_rng(0).bytes(300_000)
    path = write(tmp_path, gzip.compress(content))
    with path.open("rb") as file:
        unpacked = compressed.UnpackedContent(file, compressed.COMPRESSIONS[0])
        unpacked.seek(100_000)
        assert unpacked.read(5000) == content[100_000:105_000]
        unpacked.seek(104_500)
        assert unpacked.read(5000) == content[104_500:109_500]
        with pytest.raises(RecordingError, match="forwards"):
            unpacked.seek(50_000)
        assert unpacked.end() == len(content)


def test_a_compressed_bag(tmp_path):
    path = write(tmp_path, gzip.compress(b"SQLite format 3\0" + bytes(100)))
    with pytest.raises(RecordingError, match="compressed ROS bag"):
        open_capture(path)
