"""UDP datagrams out of captured frames: link layers, VLAN tags, IPv4 and its fragments."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.capture.chunk import Chunk
from velocal.capture.ledger import Ledger
from velocal.packets.data import PAYLOAD_BYTES, check_payloads

#: Ethernet, IPv4 and UDP headers before the payload.
HEADER_BYTES = 42
POSITION_PAYLOAD_BYTES = 512
#: Where the NMEA sentence begins in a position packet (VLP-16 manual).
SENTENCE_AT = 206
#: Largest number of incomplete datagrams whose further fragments are waited for.
PENDING = 64

_IPV4 = 0x0800
_VLAN_TAGS = (0x8100, 0x88A8, 0x9100)
_UDP_BYTES = 8

#: Link types (tcpdump.org, link-layer header types): where the type of the payload stands, or
#: None where there is none, and the length of the header.
ETHERNET = 1
LINKS: dict[int, tuple[str, int | None, int]] = {
    0: ("loopback", None, 4),
    ETHERNET: ("Ethernet", 12, 14),
    12: ("raw IP", None, 0),
    14: ("raw IP", None, 0),
    101: ("raw IP", None, 0),
    108: ("loopback", None, 4),
    113: ("Linux cooked", 14, 16),
    228: ("raw IPv4", None, 0),
    276: ("Linux cooked, version 2", 0, 20),
}


@dataclass(frozen=True)
class Frames:
    """Captured frames of a stretch of a file.

    Attributes
    ----------
    data : bytes
        The stretch.
    start, size : ndarray of int64, shape (n,)
        Where each record begins, and its bytes.
    at, captured, original : ndarray of int64, shape (n,)
        Where the frame in it begins, how many of its bytes were captured, and of how many.
    time_s : ndarray of float64, shape (n,)
    link : ndarray of int64, shape (n,)
        Link type.
    """

    data: bytes
    start: NDArray[np.int64]
    size: NDArray[np.int64]
    at: NDArray[np.int64]
    captured: NDArray[np.int64]
    original: NDArray[np.int64]
    time_s: Array
    link: NDArray[np.int64]


@dataclass
class _Fragments:
    """Fragments of one datagram that have come so far."""

    parts: dict[int, bytes] = field(default_factory=dict)
    total: int | None = None
    bytes: int = 0
    frames: int = 0
    offset: int = 0


def keep_valid(
    chunk: Chunk, ledger: Ledger, checked: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None = None
) -> Chunk:
    """Keep the valid packets of a chunk; the others are entered in the ledger.

    Parameters
    ----------
    chunk : Chunk
    ledger : Ledger
    checked : (ndarray of bool, ndarray of bool), optional
        Result of `check_payloads`, where it is known already.

    Returns
    -------
    Chunk
    """
    flags_known, azimuths_valid = checked or check_payloads(chunk.payloads)
    valid = flags_known & azimuths_valid
    if valid.all():
        return chunk
    beyond = flags_known & ~azimuths_valid
    unknown = ~flags_known
    ledger.reject("unknown block flag", int(unknown.sum()), int(chunk.sizes[unknown].sum()))
    ledger.reject("azimuth beyond one turn", int(beyond.sum()), int(chunk.sizes[beyond].sum()))
    return chunk.select(valid)


def sender_of(head: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Make one number of the sender of every packet.

    Parameters
    ----------
    head : ndarray of uint8, shape (n, 6)
        Source address and destination port, as in the headers.

    Returns
    -------
    ndarray of int64, shape (n,)
        `65536 * address + port`.
    """
    wide = np.zeros((len(head), 8), dtype=np.uint8)
    wide[:, 2:] = head
    return wide.view(">i8")[:, 0].astype(np.int64)


#: Marks instead of the place of a payload: not looked at yet, entered in the ledger, assembled.
_UNKNOWN, _DONE, _ASSEMBLED = -1, -2, -3


class Datagrams:
    """UDP payloads of frames; keeps fragments of datagrams between calls."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._pending: dict[bytes, _Fragments] = {}

    def payloads(self, frames: Frames, base: int, end: int) -> Chunk:
        """Find the valid data packets among frames; all others are entered in the ledger.

        Parameters
        ----------
        frames : Frames
        base : int
            Where the stretch of the frames begins in the file.
        end : int
            Byte after the last frame.

        Returns
        -------
        Chunk
        """
        data = np.frombuffer(frames.data, dtype=np.uint8)
        payload, sender = self._plain(frames, data)
        whole: list[tuple[bytes, _Fragments]] = []
        for row in np.flatnonzero(payload == _UNKNOWN):
            payload[row], sender[row] = self._parse(frames, int(row), base, whole)
        rows = np.flatnonzero((payload >= 0) | (payload == _ASSEMBLED))
        place, start, size = payload[rows], base + frames.start[rows], frames.size[rows]
        payloads = np.empty((len(rows), PAYLOAD_BYTES), dtype=np.uint8)
        if (place >= 0).any():
            windows = np.lib.stride_tricks.sliding_window_view(data, PAYLOAD_BYTES)
            if whole:
                payloads[place >= 0] = windows[place[place >= 0]]
            else:
                payloads = windows[place]
        for at, (content, parts) in zip(np.flatnonzero(place == _ASSEMBLED), whole, strict=True):
            payloads[at] = np.frombuffer(content, dtype=np.uint8)
            start[at], size[at] = parts.offset, parts.bytes
            self._ledger.assembled += 1
        found = Chunk(payloads, start, size, end, frames.time_s[rows], sender[rows])
        return keep_valid(found, self._ledger)

    def finish(self) -> None:
        """Reject the datagrams of which fragments are missing at the end of the file."""
        for parts in self._pending.values():
            self._ledger.reject("fragment without the others", parts.frames, parts.bytes)
        self._pending.clear()

    def _plain(
        self, frames: Frames, data: NDArray[np.uint8]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Payload and sender of the frames whose headers are as a scanner sends them."""
        payload = np.full(len(frames.start), _UNKNOWN, dtype=np.int64)
        sender = np.zeros(len(frames.start), dtype=np.int64)
        long = frames.captured >= HEADER_BYTES + POSITION_PAYLOAD_BYTES
        rows = np.flatnonzero((frames.link == ETHERNET) & long)
        if len(rows) == 0:
            return payload, sender
        heads = np.lib.stride_tricks.sliding_window_view(data, HEADER_BYTES)[frames.at[rows]]
        plain = (heads[:, 12] == 8) & (heads[:, 13] == 0) & (heads[:, 14] == 0x45)
        plain &= (heads[:, 23] == 17) & (heads[:, 20] & 0x3F == 0) & (heads[:, 21] == 0)
        length = (heads[:, 38].astype(np.int64) << 8) + heads[:, 39] - _UDP_BYTES
        of_data = plain & (length == PAYLOAD_BYTES)
        of_data &= frames.captured[rows] >= HEADER_BYTES + PAYLOAD_BYTES
        payload[rows[of_data]] = frames.at[rows[of_data]] + HEADER_BYTES
        sender[rows[of_data]] = sender_of(heads[of_data][:, [26, 27, 28, 29, 36, 37]])
        positions = rows[plain & (length == POSITION_PAYLOAD_BYTES)]
        if len(positions):
            payload[positions] = _DONE
            at = int(frames.at[positions[-1]]) + HEADER_BYTES
            self._position(
                frames.data[at : at + POSITION_PAYLOAD_BYTES],
                len(positions),
                int(frames.size[positions].sum()),
            )
        return payload, sender

    def _position(self, payload: bytes, packets: int, bytes_: int) -> None:
        """Enter position packets; the NMEA sentence of the last one is kept."""
        self._ledger.position.add(packets, bytes_)
        text = payload[SENTENCE_AT:].split(b"\0")[0].strip()
        if text.startswith(b"$") and text.isascii():
            self._ledger.nmea = text.decode("ascii")

    def _parse(
        self, frames: Frames, row: int, base: int, whole: list[tuple[bytes, _Fragments]]
    ) -> tuple[int, int]:
        """Place of the payload and sender of any frame, or a mark and 0."""
        data, at, size = frames.data, int(frames.at[row]), int(frames.size[row])
        end = at + int(frames.captured[row])
        short = f"captured {frames.captured[row]} of {frames.original[row]} bytes"
        what: str | None = None
        ip = _ip_packet(data, at, end, int(frames.link[row]))
        if ip is None:
            what = "not IPv4"
        elif ip + 20 > end:
            what = short if end - at < frames.original[row] else "not IPv4"
        elif data[ip + 9] != 17:
            what = "not UDP"
        if what is not None or ip is None:
            self._ledger.reject(what or "not IPv4", 1, size)
            return _DONE, 0
        body = ip + 4 * (data[ip] & 15)
        fragment = int.from_bytes(data[ip + 6 : ip + 8], "big") & 0x3FFF
        if fragment:
            stop = ip + int.from_bytes(data[ip + 2 : ip + 4], "big")
            if stop > end or stop < body:
                self._ledger.reject(short, 1, size)
                return _DONE, 0
            place = base + int(frames.start[row])
            found = self._assemble(data[ip:body], data[body:stop], fragment, place, size)
            if found is None:
                return _DONE, 0
            content, parts = found
            udp, packets, size = content[:_UDP_BYTES], parts.frames, parts.bytes
            payload, available = content[_UDP_BYTES:], len(content) - _UDP_BYTES
        else:
            udp, packets = data[body : body + _UDP_BYTES], 1
            available = end - body - _UDP_BYTES
        length = int.from_bytes(udp[4:6], "big") - _UDP_BYTES
        if available < max(length, 0):
            self._ledger.reject(short, packets, size)
        elif length == POSITION_PAYLOAD_BYTES:
            first = body + _UDP_BYTES
            self._position(payload if fragment else data[first : first + length], packets, size)
        elif length != PAYLOAD_BYTES:
            self._ledger.reject(f"payload of {length} bytes", packets, size)
        else:
            sender = int.from_bytes(data[ip + 12 : ip + 16] + udp[2:4], "big")
            if not fragment:
                return body + _UDP_BYTES, sender
            whole.append((payload[:PAYLOAD_BYTES], parts))
            return _ASSEMBLED, sender
        return _DONE, 0

    def _assemble(
        self, header: bytes, body: bytes, fragment: int, place: int, size: int
    ) -> tuple[bytes, _Fragments] | None:
        """Keep a fragment; give the whole datagram if no other is missing (RFC 791)."""
        key = header[4:6] + header[9:10] + header[12:20]
        parts = self._pending.setdefault(key, _Fragments(offset=place))
        at = 8 * (fragment & 0x1FFF)
        parts.parts[at] = body
        parts.bytes += size
        parts.frames += 1
        if not fragment & 0x2000:
            parts.total = at + len(body)
        content = b""
        for at in sorted(parts.parts):
            if at > len(content):
                break
            content = content[:at] + parts.parts[at]
        if parts.total is not None and len(content) >= parts.total:
            del self._pending[key]
            return content, parts
        if len(self._pending) > PENDING:
            oldest = self._pending.pop(next(iter(self._pending)))
            self._ledger.reject("fragment without the others", oldest.frames, oldest.bytes)
        return None


def _ip_packet(data: bytes, at: int, end: int, link: int) -> int | None:
    """Where the IPv4 packet of a frame begins; None if it carries another."""
    _, type_at, header = LINKS.get(link, ("", None, end - at))
    ip = at + header
    if type_at is not None:
        kind = int.from_bytes(data[at + type_at : at + type_at + 2], "big")
        while kind in _VLAN_TAGS and ip + 4 <= end:
            kind = int.from_bytes(data[ip + 2 : ip + 4], "big")
            ip += 4
        if kind != _IPV4:
            return None
    return ip if ip < end and data[ip] >> 4 == 4 and data[ip] & 15 >= 5 else None
