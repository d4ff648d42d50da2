"""The index of rotations, windows of it, and what the packets say of their scanner."""

import numpy as np
import pytest
from support.capture import (
    as_bytes,
    pcap,
    pcap_head,
    pcap_packet,
    record_list,
    spin,
    two_returns,
    udp_frame,
    write,
)

from velocal.capture import framing
from velocal.capture import order as sequence
from velocal.errors import ConfigError, RecordingError
from velocal.io import schemas, storage
from velocal.packets.data import view
from velocal.packets.firings import decode
from velocal.recording import scan as rotations
from velocal.recording.identify import candidates, check_scanner
from velocal.recording.returns import write_returns
from velocal.recording.scan import inspect
from velocal.recording.windows import read_rotations, single_rotations, window_rotations
from velocal.scanner.models import SCANNERS

N = 120  # packets; with 150 ticks a firing a rotation has 240 blocks in 20 packets


def starts_of(payloads: np.ndarray) -> list[int]:
    """Running numbers of the blocks with which rotations begin, one block after another."""
    azimuths = [int(a) for packet in view(payloads) for a in packet["blocks"]["azimuth"]]
    found = [0]
    for number in range(1, len(azimuths)):
        if azimuths[number] < azimuths[number - 1] - 18_000:
            found.append(number)
    return found


def recording(folder, payloads, header=42):
    return write(folder, record_list(payloads, header))


@pytest.mark.parametrize(("start", "step"), [(17_000, 150), (0, 150), (35_990, 137), (5, 1201)])
@pytest.mark.parametrize("paired", [False, True])
@pytest.mark.parametrize("header", [0, 42])
def test_index(start, step, paired, header, tmp_path):
    payloads = spin(N, start=start, step=step, paired=paired)
    path = recording(tmp_path, payloads, header)
    index = inspect(path).index
    begins = np.array(starts_of(payloads))
    assert len(index) == len(begins) > 2
    np.testing.assert_array_equal(index.packet, [*(begins // 12), N])
    np.testing.assert_array_equal(index.block, [*(begins % 12), 0])
    np.testing.assert_array_equal(index.offset, index.packet * (1206 + header))
    times = 553e-6 * np.array([*(begins // 12), N - 1])
    np.testing.assert_allclose(index.time_s, times, rtol=0, atol=1e-9)
    assert not index.complete[0]
    assert not index.complete[-1]
    assert index.complete[1:-1].all()


def test_a_rotation_may_begin_in_any_block(tmp_path):
    """The index above does meet wraps inside packets."""
    blocks = {int(b) for b in inspect(recording(tmp_path, spin(N, step=137))).index.block[1:-1]}
    assert len(blocks - {0}) > 2


def test_the_rate(tmp_path):
    inspection = inspect(recording(tmp_path, spin(N)))
    # 150 ticks in 553/12 us; the times of rotations are those of whole packets.
    assert inspection.index.rate_hz() == pytest.approx(150 / 36_000 / (553e-6 / 12), rel=0.03)
    assert inspection.packet_interval_s == pytest.approx(553e-6, abs=1e-9)
    assert inspection.azimuth_step_ticks == 150
    assert inspection.duration_s == pytest.approx(119 * 553e-6, abs=1e-9)
    assert inspection.clock == "device"
    assert (inspection.gaps, inspection.packets_missing) == (0, 0)
    assert np.isnan(inspection.index.rate_hz(np.array([0])))  # not complete
    assert inspection.index.rate_hz(np.array([2])) == pytest.approx(1 / (20 * 553e-6), rel=1e-6)


@pytest.mark.parametrize(
    ("lost", "gaps", "incomplete"),
    [
        ([60, 61, 62], 1, {3}),
        ([45], 1, {2}),
        # Packets 10, 30, 50, 70, 90 and 110 hold the end of one rotation and the next one's begin.
        ([50], 1, {2, 3}),
        ([69, 70, 71], 1, {3, 4}),
        ([25, 45, 46, 85], 3, {1, 2, 4}),
    ],
)
def test_gaps(lost, gaps, incomplete, tmp_path):
    path = recording(tmp_path, np.delete(spin(N), lost, axis=0))
    inspection = inspect(path, max_missing=0.0)
    assert inspection.packets_missing == len(lost)
    assert inspection.gaps == gaps
    assert len(inspection.index) == 7
    assert set(np.flatnonzero(~inspection.index.complete)) == {0, 6} | incomplete


def test_a_gap_that_hides_the_end_of_a_rotation(tmp_path):
    """The azimuth does not fall by half a turn, so two rotations become one, which is marked."""
    inspection = inspect(recording(tmp_path, np.delete(spin(N), np.s_[64:76], axis=0)))
    assert inspection.packets_missing == 12
    assert len(inspection.index) == 6
    assert set(np.flatnonzero(~inspection.index.complete)) == {0, 3, 5}


def test_the_clock_may_pass_the_hour(tmp_path):
    start = 3_600_000_000 - 60 * 553
    plain = inspect(recording(tmp_path, spin(N)))
    passed = inspect(recording(tmp_path, spin(N, stamp_us=start)))
    np.testing.assert_allclose(passed.index.time_s, plain.index.time_s, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(passed.index.complete, plain.index.complete)
    assert passed.gaps == 0
    assert passed.clock == "device"


def test_the_clock_may_pass_several_hours(tmp_path, monkeypatch):
    """An hour of 20 packets: five passes, with chunks that end anywhere."""
    monkeypatch.setattr(sequence, "HOUR_US", 20 * 553)
    monkeypatch.setattr(sequence, "BOUND", 4)
    monkeypatch.setattr(rotations, "CLOCK_PACKETS", 7)
    monkeypatch.setattr(framing, "CHUNK_BYTES", 5000)
    payloads = spin(N, stamp_us=0)
    packets = view(payloads)
    packets["timestamp"] = packets["timestamp"] % (20 * 553)
    found = inspect(recording(tmp_path, payloads))
    begins = np.array(starts_of(payloads)) // 12
    np.testing.assert_allclose(
        found.index.time_s, 553e-6 * np.array([*begins, N - 1]), rtol=0, atol=1e-9
    )


TEXT = np.frombuffer(b"\x00\x41\x42 1.4.10 41C ", dtype=np.uint8)


def with_text(payloads: np.ndarray) -> np.ndarray:
    """Trailing bytes as early HDL-64E send them: text that takes turns."""
    changed = payloads.copy()
    for number, payload in enumerate(changed):
        payload[-6:] = TEXT[(6 * number) % 12 :][:6]
    return changed


def test_text_is_no_clock(tmp_path):
    payloads = with_text(spin(N, paired=True))
    bare = inspect(recording(tmp_path, payloads))
    assert bare.clock == "none"
    assert np.isnan(bare.index.time_s).all()
    assert np.isnan(bare.index.rate_hz())
    assert bare.status_types == ""
    caught = inspect(write(tmp_path, pcap(payloads), "x.pcap"))
    assert caught.clock == "capture"
    assert caught.index.time_s[-1] == pytest.approx(119 * 553e-6, abs=1e-6)


def test_damage_at_the_beginning_does_not_hide_the_clock(tmp_path):
    """The first valid packet stands alone, and one time is no clock."""
    records = record_list(spin(N), 42)
    records[1] = records[1][:500] + records[1][503:]
    found = inspect(write(tmp_path, records))
    assert found.clock == "device"
    assert found.packet_interval_s == pytest.approx(553e-6, abs=1e-9)
    assert found.packets_missing == 1


@pytest.mark.parametrize("chunk_bytes", [2500, 5000, 20_000])
def test_index_does_not_depend_on_the_chunk(chunk_bytes, tmp_path, monkeypatch):
    monkeypatch.setattr(rotations, "CLOCK_PACKETS", 5)
    path = recording(tmp_path, np.delete(spin(N, step=137), [50, 51, 77], axis=0))
    whole = inspect(path)
    monkeypatch.setattr(framing, "CHUNK_BYTES", chunk_bytes)
    parts = inspect(path)
    for name in ("offset", "block", "packet", "time_s", "complete"):
        np.testing.assert_array_equal(getattr(parts.index, name), getattr(whole.index, name))
    assert parts.ledger == whole.ledger
    assert (parts.gaps, parts.packets_missing) == (whole.gaps, whole.packets_missing) == (2, 3)
    assert parts.packet_interval_s == pytest.approx(whole.packet_interval_s, rel=1e-9)
    assert parts.azimuth_step_ticks == whole.azimuth_step_ticks == 137


def test_progress_ends_with_the_file(tmp_path):
    path = recording(tmp_path, spin(N))
    seen: list[tuple[int, int]] = []
    inspect(path, lambda done, total: seen.append((done, total)))
    assert seen[-1] == (path.stat().st_size,) * 2


def test_what_the_packets_say(tmp_path):
    payloads = spin(N, start=9 * 100, step=18, paired=True)
    # The status types of an HDL-64E S2 take turns; 1 to 7 carry the calibration, cut short here.
    view(payloads)["status"][:, 0] = np.resize(np.frombuffer(b"HMSDNYGTV1234567", np.uint8), N)
    view(payloads)["status"][:, 1] = np.arange(N)
    found = inspect(recording(tmp_path, payloads))
    assert found.azimuth_multiple == 18
    assert found.block_counts == {"upper": 6 * N, "lower": 6 * N}
    assert found.status_types == "1234567DGHMNSTVY"
    assert found.status.kind == "status"
    assert not found.calibration_in_stream
    assert found.product is None
    other = inspect(recording(tmp_path, spin(N, status=(0x37, 0x22))))
    assert other.product == 0x22
    assert not other.calibration_in_stream
    assert other.block_counts == {"upper": 12 * N, "lower": 0}


def test_times_that_are_mostly_equal_show_no_gap(tmp_path):
    """As of a computer whose clock steps every 20 packets; the azimuth tells gaps, not they."""
    payloads = with_text(spin(N, paired=True))
    frames = [udp_frame(payload) for payload in as_bytes(payloads)]
    caught = [pcap_packet(frame, 20 * (number // 20)) for number, frame in enumerate(frames)]
    del caught[50:55]
    found = inspect(write(tmp_path, [pcap_head(), *caught]))
    assert found.clock == "capture"
    assert np.isnan(found.packet_interval_s)
    assert np.isnan(found.as_dict()["packet_rate_hz"])
    assert (found.gaps, found.packets_missing) == (1, 5)
    assert SCANNERS["HDL-64E"] in candidates(found)


def test_what_is_told_to_programs_and_people(tmp_path):
    path = recording(tmp_path, np.delete(spin(N), [45], axis=0))
    found = inspect(path, max_missing=0.0)
    assert list(found.as_dict()) == [
        "duration_s", "clock", "rotations", "rotations_complete", "rotation_rate_hz",
        "packet_rate_hz", "azimuth_step_deg", "azimuth_resolution_deg", "gaps", "packets_missing",
        "largest_gap_packets", "clock_jumps", "damaged_stamps", "field_of_view_deg",
        "block_counts", "returns", "product", "status_types", "calibration_in_stream", "status",
        "ledger",
    ]  # fmt: skip
    told = {fact.label: fact.text for fact in found.facts() if fact.label}
    assert told["gaps"] == "1, about 1 packets missing"
    assert told["rotations"] == "7, 4 complete"
    assert told["azimuth step"] == "1.50 deg, in multiples of 0.50 deg"
    assert told["product byte"] == "0x21"


# -- windows -----------------------------------------------------------------------------------


@pytest.fixture
def index(tmp_path):
    """Fourteen rotations; 0 and 13 are cut, 4 has a gap."""
    payloads = np.delete(spin(260), [85], axis=0)
    found = inspect(recording(tmp_path, payloads), max_missing=0.0).index
    assert list(np.flatnonzero(~found.complete)) == [0, 4, 13]
    return found


def test_windows(index):
    def window(name, length):
        return list(window_rotations(index, name, length, "sa1"))

    assert window("beginning", 3) == [1, 2, 3]
    assert window("middle", 3) == [6, 7, 8]  # complete are 1 2 3 5 6 7 8 9 10 11 12
    assert window("end", 3) == [10, 11, 12]
    assert window("beginning", 2) == [1, 2]
    assert window("all", None) == list(range(14))
    assert window("all", 3) == list(range(14))


@pytest.mark.parametrize("length", [4, 100, None])
def test_too_few_rotations(length, index):
    with pytest.raises(ConfigError, match="11 complete rotations, too few") as caught:
        window_rotations(index, "middle", length, "sa1")
    assert str(caught.value).startswith("sa1: ")
    assert "Hint: " in str(caught.value)
    if length:
        assert f"at least {3 * length}" in str(caught.value)


def test_single_rotations_are_outside_the_windows(index):
    """Complete are 1 2 3 5 6 7 8 9 10 11 12; of two that are equally near, the later one."""

    def single(name, length, count):
        found = single_rotations(index, name, length, count, "sa1")
        return list(found.numbers), found.origin

    # Windows 1 2 3, 6 7 8 and 10 11 12 leave 5 and 9.
    assert single("beginning", 3, 1) == ([5], "outside")
    assert single("middle", 3, 1) == ([9], "outside")
    assert single("end", 3, 1) == ([9], "outside")
    assert single("middle", 3, 2) == ([5, 9], "outside")
    # Windows 1 2, 6 7 and 11 12: the rotation 4 is not complete.
    assert single("beginning", 2, 2) == ([3, 5], "outside")
    assert single("end", 2, 2) == ([9, 10], "outside")


def test_single_rotations_of_the_window_if_too_few_are_left(index):
    found = single_rotations(index, "end", 3, 3, "sa1")
    assert (list(found.numbers), found.origin) == ([10, 11, 12], "window")
    with pytest.raises(ConfigError, match="11 complete rotations, too few"):
        single_rotations(index, "end", 4, 1, "sa1")


# -- reading -----------------------------------------------------------------------------------


def read_one_by_one(payloads: np.ndarray, wanted: list[int]) -> list[tuple[int, bytes]]:
    """Number of the rotation and bytes of every block that was asked for, in their order."""
    begins = starts_of(payloads)
    found = []
    for number in range(12 * len(payloads)):
        rotation = sum(begin <= number for begin in begins) - 1
        if rotation in wanted:
            packet, block = divmod(number, 12)
            found.append((rotation, bytes(payloads[packet][100 * block : 100 * block + 100])))
    return found


def read_with_index(path, wanted: list[int]) -> list[tuple[int, bytes]]:
    found = []
    index = inspect(path).index
    for chunk, rotation in read_rotations(path, index, np.array(wanted)):
        assert rotation.shape == (len(chunk.payloads), 12)
        assert len(chunk.payloads) > 0
        for payload, of_block in zip(chunk.payloads, rotation, strict=True):
            for block in np.flatnonzero(of_block >= 0):
                content = bytes(payload[100 * block :][:100])
                found.append((int(of_block[block]), content))
    return found


WANTED = [[0], [1], [3], [6], [1, 2, 3], [0, 1], [5, 6], [2, 4, 6], [1, 3, 4], list(range(7))]


@pytest.mark.parametrize("chunk_bytes", [8 << 20, 5000])
@pytest.mark.parametrize("wanted", WANTED)
@pytest.mark.parametrize("step", [150, 163])
def test_reading_gives_the_blocks_asked_for(step, wanted, chunk_bytes, tmp_path, monkeypatch):
    monkeypatch.setattr(framing, "CHUNK_BYTES", chunk_bytes)
    payloads = spin(N, step=step)
    expected = read_one_by_one(payloads, wanted)
    assert expected
    assert read_with_index(recording(tmp_path, payloads), wanted) == expected


@pytest.mark.parametrize("wanted", [[1], [2, 3], [1, 3]])
def test_reading_over_damage(wanted, tmp_path):
    """What the index counted and what is read later are the same packets."""
    payloads = spin(N)
    records = record_list(payloads, 42)
    records[33] = bytes(1248)  # a bad record
    records[40] = records[40][:300] + b"junk" + records[40][300:]
    records[50] = records[50][:300] + records[50][301:]
    survivors = np.delete(payloads, [33, 40, 50], axis=0)
    path = write(tmp_path, records)
    assert read_with_index(path, wanted) == read_one_by_one(survivors, wanted)


def test_a_rotation_shorter_than_a_packet(tmp_path):
    """Jitter about zero makes one; the packet it lies in belongs to three rotations."""
    payloads = spin(60, start=100)
    azimuth = view(payloads)["blocks"]["azimuth"]
    azimuth[20] = [35_700, 35_800, 35_900, 35_950, 10, 20, 35_990, 30, 40, 50, 60, 70]
    path = recording(tmp_path, payloads)
    for wanted in ([0, 2], [1], [0, 1, 2]):
        assert read_with_index(path, wanted) == read_one_by_one(payloads, wanted)


def test_returns_of_rotations(tmp_path):
    """A stretch without one valid packet amid the rotation does not stop the decoding."""
    payloads = spin(N)
    azimuth = view(payloads)["blocks"]["azimuth"]
    azimuth[41] = 40_000
    content = bytearray(pcap(payloads))
    for packet in (40, 42):
        at = 24 + packet * 1264
        content[at : at + 16] = b"\xfe" * 16
    path = write(tmp_path, bytes(content))
    scanner = SCANNERS["HDL-32E"]
    index = inspect(path).index
    out = tmp_path / "returns.parquet"
    rows = write_returns(path, index, np.array([1, 2]), scanner, out)
    columns, facts = storage.read_table(out, schemas.RETURNS)
    survivors = np.delete(payloads, [40, 41, 42], axis=0)
    begins = starts_of(survivors)
    firings = decode(survivors, scanner)
    blocks = slice(begins[1], begins[3])
    assert rows == 32 * (begins[3] - begins[1])
    np.testing.assert_array_equal(columns["distance"], firings.distance[blocks].reshape(-1))
    np.testing.assert_array_equal(columns["intensity"], firings.intensity[blocks].reshape(-1))
    np.testing.assert_array_equal(columns["azimuth"], np.repeat(firings.azimuth[blocks], 32))
    np.testing.assert_array_equal(columns["timestamp"], np.repeat(firings.timestamp[blocks], 32))
    np.testing.assert_array_equal(columns["laser_id"], np.tile(np.arange(32), rows // 32))
    np.testing.assert_array_equal(columns["rotation"], np.repeat([1, 2], 32 * np.diff(begins[1:4])))
    assert facts["scanner"] == "HDL-32E"
    assert facts["lasers_per_firing"] == 32


def test_returns_of_two_firings_in_a_block(tmp_path):
    payloads = spin(N, status=(0x37, 0x22), interval_us=1327)
    path = recording(tmp_path, payloads)
    out = tmp_path / "returns.parquet"
    rows = write_returns(path, inspect(path).index, np.array([2]), SCANNERS["VLP-16"], out)
    columns, _ = storage.read_table(out, schemas.RETURNS)
    begins = starts_of(payloads)
    assert rows == len(columns["azimuth"]) == 32 * (begins[3] - begins[2])
    assert set(columns["laser_id"]) == set(range(16))
    steps = np.diff(columns["azimuth"][::16].astype(int)) % 36_000
    assert set(steps) == {75}


# -- which scanner -------------------------------------------------------------------------------


def sent_by(name: str, folder, dual: bool = False, product: int | None = None):
    scanner = SCANNERS[name]
    product = scanner.factory_byte or 0x21 if product is None else product
    status = (0x39 if dual else 0x37, product)
    rate = scanner.dual_packet_rate_hz if dual else scanner.packet_rate_hz
    payloads = spin(N, interval_us=round(1e6 / rate), banks=len(scanner.flags), status=status)
    return inspect(recording(folder, two_returns(payloads) if dual else payloads))


@pytest.mark.parametrize("name", SCANNERS)
def test_a_scanner_is_known_by_its_packets(name, tmp_path):
    inspection = sent_by(name, tmp_path)
    # An S3 sends what an S2 sends.
    assert candidates(inspection)[0].name == name.removesuffix("-S3")
    assert check_scanner(inspection, SCANNERS[name], "sa1") == []
    assert not inspection.dual


DUAL = [name for name in SCANNERS if name != "HDL-64E-S1"]


@pytest.mark.parametrize("name", DUAL)
def test_dual_returns_are_seen(name, tmp_path):
    inspection = sent_by(name, tmp_path, dual=True)
    assert inspection.dual
    assert candidates(inspection)[0].name == name.removesuffix("-S3")
    assert check_scanner(inspection, SCANNERS[name], "sa1") == []
    assert inspection.as_dict()["returns"] == "dual"


def test_the_return_mode_may_be_wrong(tmp_path):
    payloads = spin(N, status=(0x39, 0x21))
    inspection = inspect(recording(tmp_path, payloads))
    assert not inspection.dual
    (remark,) = check_scanner(inspection, SCANNERS["HDL-32E"], "sa1")
    assert "return mode is said to be dual" in remark


def test_lost_packets_do_not_hide_the_firing_cycle(tmp_path):
    """Half of the packets of an HDL-32E come as often as those of a VLP-16 would, nearly."""
    payloads = spin(2 * N, interval_us=590)[::2]
    inspection = inspect(recording(tmp_path, payloads))
    (remark,) = check_scanner(inspection, SCANNERS["VLP-16"], "sa1")[1:]
    assert "times what its rate and VLP-16 would give" in remark


@pytest.mark.parametrize(
    ("sender", "stated"),
    [
        ("VLP-16", "HDL-32E"),
        ("HDL-32E", "VLP-16"),
        ("HDL-32E", "HDL-64E"),
        ("HDL-64E", "VLP-16"),
        ("VLS-128", "HDL-64E"),
        ("VLP-32C", "HDL-32E"),
        ("VLP-16-Hi-Res", "VLP-16"),
        ("VLP-16", "VLP-16-Hi-Res"),
    ],
)
def test_another_scanner_than_stated(sender, stated, tmp_path):
    inspection = sent_by(sender, tmp_path)
    with pytest.raises(RecordingError, match=f"is said to come from {stated}") as caught:
        check_scanner(inspection, SCANNERS[stated], "config/samples.tsv, row 3")
    message = str(caught.value)
    assert message.startswith("config/samples.tsv, row 3: ")
    assert f"allowed: {sender}" in message
    assert "Hint: Correct the scanner" in message


def test_no_scanner_known(tmp_path):
    inspection = inspect(recording(tmp_path, spin(N, interval_us=90)))
    with pytest.raises(RecordingError, match="no scanner known here"):
        check_scanner(inspection, SCANNERS["HDL-32E"], "sa1")


def test_an_early_vlp16_calls_itself_hdl32e(tmp_path):
    remarks = check_scanner(sent_by("VLP-16", tmp_path, product=0x21), SCANNERS["VLP-16"], "sa1")
    assert len(remarks) == 1
    assert "0x21" in remarks[0]
    assert "0x22" in remarks[0]
