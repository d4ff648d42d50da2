"""Status bytes of HDL-64E recordings: what is read of them, and when a table is refused."""

import struct
from datetime import UTC, datetime

import numpy as np
import pytest

from velocal.errors import RecordingError
from velocal.packets import status
from velocal.packets.status import StatusReader, crc16

INTERVAL_US = 288


def laser(number: int) -> bytes:
    """Values of a laser as they stand on the wire, by other code than the library's."""
    shorts = (-700 + 11 * number, 350 - 7 * number, 1200 + number, 1180, 1190, 207, -26, 14000, 13)
    return struct.pack("<B9h2B", number, *shorts, 40, 255)


def table(series: str = "S2", lasers=laser) -> bytes:
    """1820 bytes of a table."""
    body = b"UNIT#" + bytes([24, 25])
    for number in range(64):
        body += lasers(number)
        body += bytes([11, 2, 15, 10, 30, 0, 25]) if number == 63 else bytes([9] * 7)
    body += struct.pack("<hHHH4B4BBBB", 600, 0, 36000, 77, 10, 0, 0, 5, 10, 0, 0, 255, 0, 9, 160)
    check = 1820 if series == "S2" else crc16(b"".join(lasers(n)[1:] for n in range(64)))
    return body + struct.pack("<H", check)


def stream(
    tables: list[bytes], series: str = "S2", temperature: int = 46, gps: bytes = b"A"
) -> np.ndarray:
    """Trailing bytes of the packets that send tables one after another."""
    rows = []
    opening = bytes([21, 19, 55, 15, 12, 10, gps[0], temperature, 0x47])
    content = b"".join(tables)
    for cycle in range(len(content) // 7):
        warned = series == "S3" and cycle % 260 and cycle % 4 == 0 and cycle % 260 < 256
        types = b"HMSDNYGTV" + (b"W234567" if warned else b"1234567")
        values = opening + content[7 * cycle : 7 * cycle + 7]
        rows += list(zip(types, values, strict=True))
    return np.array(
        [list(struct.pack("<IBB", (7_000 + INTERVAL_US * n) % 3_600_000_000, *row))
         for n, row in enumerate(rows)],
        dtype=np.uint8,
    )  # fmt: skip


def read(trailing: np.ndarray, chunk: int = 1000) -> status.TrailingStatus:
    reader = StatusReader()
    for begin in range(0, len(trailing), chunk):
        reader.consume(trailing[begin : begin + chunk])
    return reader.result()


def test_crc_of_the_manual():
    """The four examples of the S3 manual, page 39."""
    three_lasers = bytes.fromhex(
        "fe7bfd27050e05530536 00c5001936b0000a00ff ff51fd4404f605500542 00c5ffe62328000f00ff"
        "018f0006049b04f404b7 00ce00192ee0001414ff"
    )
    assert crc16(three_lasers) == 0xA542
    assert crc16(bytes([16, 23, 59, 123, 2, 255, 0, 4, 23, 23, 90, 132, 145, 200])) == 0xCA6C
    assert crc16(b"\xf1\x0b\xf0\x24\x78") == 0x6328
    assert crc16(b"\x06\x07") == 0x9411


@pytest.mark.parametrize("series", ["S2", "S3"])
def test_a_whole_table(series):
    found = read(stream([table(series)] * 2, series)[1000:])
    assert (found.kind, found.series, found.tables) == ("status", series, 1)
    assert (found.broken, found.failed, found.deviating) == (0, 0, 0)
    assert found.temperature_deg_c == (46.0, 46.0)
    assert found.firmware == "4.07 (0x47)"
    assert found.gps_time == datetime(2010, 12, 15, 21, 19, 55, tzinfo=UTC)
    assert found.gps_valid
    assert found.unit.calibrated == "2011-02-15T10:30:00"
    assert found.unit.fov_deg == (0.0, 360.0)
    assert found.unit.source == "10.0.0.5"
    factory = found.calibration("x")
    numbers = np.arange(64)
    np.testing.assert_allclose(factory.v, np.deg2rad(-7.0 + 0.11 * numbers), atol=1e-16)
    np.testing.assert_allclose(factory.alpha, np.deg2rad(3.5 - 0.07 * numbers), atol=1e-16)
    np.testing.assert_allclose(factory.dl, 1.2 + 1e-3 * numbers, rtol=1e-15)
    carried = {name: values[5] for name, values in factory.carried.items()}
    assert carried == {
        "dist_correction_x": 1.18,
        "dist_correction_y": 1.19,
        "focal_distance": 14.0,
        "focal_slope": 1.3,
        "min_intensity": 40.0,
        "max_intensity": 255.0,
    }
    assert set(factory.voff) == {0.207}
    assert set(factory.hoff) == {-0.026}


@pytest.mark.parametrize("chunk", [1, 7, 24, 25, 4160, 100_000])
def test_the_chunks_do_not_matter(chunk):
    trailing = stream([table()] * 3)[77:]
    whole, parts = read(trailing), read(trailing, chunk)
    assert parts.as_dict() == whole.as_dict()
    assert parts.tables == 2


def test_the_last_packet_is_enough():
    assert read(stream([table()])).tables == 1
    assert read(stream([table()])[:-1]).tables == 0


@pytest.mark.parametrize("lost", [1, 5, 16, 64, 4160])
def test_a_table_with_packets_missing_is_not_used(lost):
    """Losses that leave the order of types whole are told by the clock."""
    trailing = stream([table()] * 4)
    found = read(np.delete(trailing, np.arange(2000, 2000 + lost), axis=0))
    assert found.broken >= 1
    assert found.tables == (2 if lost == 4160 else 3)
    assert found.parameters is not None


def test_a_clock_that_passes_the_hour():
    trailing = stream([table()])
    trailing[:, :4] = (
        ((3_599_900_000 + INTERVAL_US * np.arange(len(trailing))) % 3_600_000_000)
        .astype("<u4").view(np.uint8).reshape(-1, 4)
    )  # fmt: skip
    assert read(trailing).tables == 1


def other_laser(number: int) -> bytes:
    return laser(number)[:5] + struct.pack("<h", 999) + laser(number)[7:]


def test_tables_that_disagree():
    most = read(stream([table(), table(lasers=other_laser), table()]))
    assert (most.tables, most.deviating) == (2, 1)
    assert most.calibration("x").dl[0] == 1.2
    half = read(stream([table(), table(lasers=other_laser)]))
    with pytest.raises(RecordingError, match="its 2 valid tables disagree"):
        half.calibration("x")


@pytest.mark.parametrize(
    ("series", "damage"),
    [
        ("S2", lambda t: t[:7] + b"\x07" + t[8:]),  # id
        ("S2", lambda t: t[:-2] + b"\x00\x00"),  # length
        ("S2", lambda t: table(lasers=lambda n: struct.pack("<B", n) + b"\xff" * 20)),  # empty
        ("S3", lambda t: t[:-2] + b"\x00\x00"),  # CRC
        ("S3", lambda t: t[:890] + bytes([t[890] ^ 1]) + t[891:]),  # a value
    ],
)
def test_a_damaged_table_fails_its_check(series, damage):
    found = read(stream([damage(table(series))], series))
    assert (found.tables, found.failed) == (0, 1)
    with pytest.raises(RecordingError, match="1 fail their check"):
        found.calibration("x")


def test_too_short():
    found = read(stream([table()])[:2100])
    with pytest.raises(RecordingError, match="2100 packets, the table takes 4160") as error:
        found.calibration("short.bin")
    assert "Record 8320 packets" in str(error.value)
    late = read(stream([table()] * 2)[100:5000])
    with pytest.raises(RecordingError, match="no whole table in 4900 packets"):
        late.calibration("x")


def test_time_and_temperature():
    cold = stream([table()], temperature=0xFB, gps=b"\0")
    cold[:, 5] = np.where(cold[:, 4] == ord("N"), 0, cold[:, 5])
    found = read(cold)
    assert found.temperature_deg_c == (-5.0, -5.0)
    assert found.gps == "not connected"
    assert found.gps_time is None
    assert not found.gps_valid
    assert not read(stream([table()], gps=b"P")).gps_valid


def test_text():
    text = np.frombuffer(b"\x4f\x20DegC\x22\x0cv25c" * 100, np.uint8).reshape(-1, 6)
    found = read(text)
    assert (found.kind, found.temperature_deg_c, found.firmware) == ("text", (32.0, 32.0), "v25c")
    with pytest.raises(RecordingError, match="are text"):
        found.calibration("x")


def test_none():
    rng = np.random.default_rng(3)
    trailing = rng.integers(0, 256, (5000, 6)).astype(np.uint8)
    trailing[:, 4:] = (0x37, 0x21)
    found = read(trailing)
    assert found.as_dict() == status.TrailingStatus(packets=5000).as_dict()
    with pytest.raises(RecordingError, match="no status bytes"):
        found.calibration("x")
    assert read(trailing[:0]).kind == "none"
