"""UDP datagrams out of captured frames: link layers, VLAN, MPLS, IPv6, IPv4 and its fragments."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.capture.chunk import Chunk
from velocal.capture.ledger import Ledger
from velocal.capture.source import SENDER, senders_of
from velocal.packets.data import PAYLOAD_BYTES, check_payloads

#: Ethernet, IPv4 and UDP headers before the payload.
HEADER_BYTES = 42
POSITION_PAYLOAD_BYTES = 512
#: Where the NMEA sentence begins in a position packet (VLP-16 manual).
SENTENCE_AT = 206
#: Largest number of incomplete datagrams whose further fragments are waited for.
PENDING = 64
#: Largest number of fragments of one datagram: one of 64 KiB has fewer on any usual network.
FRAGMENTS = 128

_IPV4, _IPV6 = 0x0800, 0x86DD
_VLAN_TAGS = (0x8100, 0x88A8, 0x9100)
_MPLS = (0x8847, 0x8848)
_UDP_BYTES = 8
_UDP = 17
_ADDRESS_BYTES = 4
#: Extension headers of IPv6 that are skipped: hop-by-hop options, routing, destination options.
_EXTENSIONS = (0, 43, 60)
#: Names of what frames and IP packets carry, for the ledger (IANA, EtherTypes and protocols).
_ETHERTYPES = {0x0806: "ARP", 0x8863: "PPPoE", 0x8864: "PPPoE", 0x88CC: "LLDP", 0x88F7: "PTP"}
_PROTOCOLS = {
    1: "ICMP", 2: "IGMP", 4: "IPv4 in IP", 6: "TCP", 41: "IPv6 in IP",
    44: "IPv6 fragments", 47: "GRE", 50: "ESP", 58: "ICMPv6", 132: "SCTP",
}  # fmt: skip

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
    content_bytes: int = 0
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


#: Marks instead of the place of a payload: not looked at yet, entered in the ledger, assembled.
_UNKNOWN, _DONE, _ASSEMBLED = -1, -2, -3
_SHORT = "captured {} of {} bytes"


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
            payload[row], address = self._parse(frames, int(row), base, whole)
            if address:
                sender[row] = senders_of(np.frombuffer(address, np.uint8)[None])[0]
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
        for key in list(self._pending):
            self._give_up(key)

    def _plain(
        self, frames: Frames, data: NDArray[np.uint8]
    ) -> tuple[NDArray[np.int64], NDArray[np.void]]:
        """Payload and sender of the frames whose headers are as a scanner sends them."""
        payload = np.full(len(frames.start), _UNKNOWN, dtype=np.int64)
        sender = np.zeros(len(frames.start), dtype=SENDER)
        rows = np.flatnonzero((frames.link == ETHERNET) & (frames.captured >= HEADER_BYTES))
        if len(rows) == 0:
            return payload, sender
        heads = np.lib.stride_tricks.sliding_window_view(data, HEADER_BYTES)[frames.at[rows]]
        plain = (heads[:, 12] == 8) & (heads[:, 13] == 0) & (heads[:, 14] == 0x45)
        plain &= (heads[:, 23] == _UDP) & (heads[:, 20] & 0x3F == 0) & (heads[:, 21] == 0)
        length = (heads[:, 38].astype(np.int64) << 8) + heads[:, 39] - _UDP_BYTES
        whole = frames.captured[rows] - HEADER_BYTES >= np.maximum(length, 0)
        of_data = plain & whole & (length == PAYLOAD_BYTES)
        payload[rows[of_data]] = frames.at[rows[of_data]] + HEADER_BYTES
        sender[rows[of_data]] = senders_of(heads[of_data][:, [26, 27, 28, 29, 36, 37]])
        of_position = plain & whole & (length == POSITION_PAYLOAD_BYTES)
        positions = rows[of_position]
        if len(positions):
            at = int(frames.at[positions[-1]]) + HEADER_BYTES
            self._position(
                frames.data[at : at + POSITION_PAYLOAD_BYTES],
                len(positions),
                int(frames.size[positions].sum()),
            )
        foreign = plain & whole & ~of_data & ~of_position
        self._reject_alike("payload of {} bytes", length[foreign, None], frames.size[rows[foreign]])
        cut = rows[plain & ~whole]
        lengths = np.column_stack([frames.captured[cut], frames.original[cut]])
        self._reject_alike(_SHORT, lengths, frames.size[cut])
        payload[rows[plain & ~of_data]] = _DONE
        return payload, sender

    def _reject_alike(
        self, reason: str, values: NDArray[np.int64], sizes: NDArray[np.int64]
    ) -> None:
        """Enter frames of which many have the same reason, a row of `values` each."""
        if len(sizes) == 0:
            return
        found, number = np.unique(values, axis=0, return_inverse=True)
        counts = np.bincount(number.reshape(-1))
        bytes_ = np.bincount(number.reshape(-1), weights=sizes)
        for row, n, total in zip(found, counts, bytes_, strict=True):
            self._ledger.reject(reason.format(*row), int(n), int(total))

    def _position(self, payload: bytes, packets: int, bytes_: int) -> None:
        """Enter position packets; the NMEA sentence of the last one is kept."""
        self._ledger.position.add(packets, bytes_)
        text = payload[SENTENCE_AT:].split(b"\0")[0].strip()
        if text.startswith(b"$") and text.isascii():
            self._ledger.nmea = text.decode("ascii")

    def _parse(
        self, frames: Frames, row: int, base: int, whole: list[tuple[bytes, _Fragments]]
    ) -> tuple[int, bytes]:
        """Place of the payload, and address and port of the sender; or a mark and nothing."""
        data, at, size = frames.data, int(frames.at[row]), int(frames.size[row])
        end = at + int(frames.captured[row])
        short = _SHORT.format(frames.captured[row], frames.original[row])
        ip, kind = _ip_packet(data, at, end, int(frames.link[row]))
        if not kind and ip + (20 if data[ip] >> 4 == 4 else 40) > end:
            kind = short if end - at < frames.original[row] else "not IP: cut short"
        if kind:
            self._ledger.reject(kind, 1, size)
            return _DONE, b""
        body, protocol, address = _ip_header(data, ip, end)
        if protocol != _UDP:
            name = _PROTOCOLS.get(protocol, f"protocol {protocol}")
            self._ledger.reject(f"not UDP: {name}", 1, size)
            return _DONE, b""
        fragment = 0
        if len(address) == _ADDRESS_BYTES:
            fragment = int.from_bytes(data[ip + 6 : ip + 8], "big") & 0x3FFF
        if fragment:
            stop = ip + int.from_bytes(data[ip + 2 : ip + 4], "big")
            if stop > end or stop < body:
                self._ledger.reject(short, 1, size)
                return _DONE, b""
            place = base + int(frames.start[row])
            found = self._assemble(data[ip:body], data[body:stop], fragment, place, size)
            if found is None:
                return _DONE, b""
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
            sender = address + udp[2:4]
            if not fragment:
                return body + _UDP_BYTES, sender
            whole.append((payload[:PAYLOAD_BYTES], parts))
            return _ASSEMBLED, sender
        return _DONE, b""

    def _assemble(
        self, header: bytes, body: bytes, fragment: int, place: int, size: int
    ) -> tuple[bytes, _Fragments] | None:
        """Keep a fragment; give the whole datagram if no other is missing (RFC 791)."""
        key = header[4:6] + header[9:10] + header[12:20]
        parts = self._pending.setdefault(key, _Fragments(offset=place))
        at = 8 * (fragment & 0x1FFF)
        parts.content_bytes += len(body) - len(parts.parts.get(at, b""))
        parts.parts[at] = body
        parts.bytes += size
        parts.frames += 1
        if not fragment & 0x2000:
            parts.total = at + len(body)
        # Put together only when there are enough bytes: once, unless fragments overlap.
        if parts.total is not None and parts.content_bytes >= parts.total:
            content = b""
            for at in sorted(parts.parts):
                if at > len(content):
                    break
                content = content[:at] + parts.parts[at]
            if len(content) >= parts.total:
                del self._pending[key]
                return content, parts
        if len(parts.parts) > FRAGMENTS:
            self._give_up(key)
        elif len(self._pending) > PENDING:
            self._give_up(next(iter(self._pending)))
        return None

    def _give_up(self, key: bytes) -> None:
        """Reject the fragments of a datagram."""
        parts = self._pending.pop(key)
        self._ledger.reject("fragment without the others", parts.frames, parts.bytes)


def _ip_packet(data: bytes, at: int, end: int, link: int) -> tuple[int, str]:
    """Where the IP packet of a frame begins, and why it is none, or nothing."""
    _, type_at, header = LINKS.get(link, ("", None, end - at))
    ip = at + header
    if type_at is not None:
        kind = int.from_bytes(data[at + type_at : at + type_at + 2], "big")
        while kind in _VLAN_TAGS and ip + 4 <= end:
            kind = int.from_bytes(data[ip + 2 : ip + 4], "big")
            ip += 4
        if kind in _MPLS:
            ip = _after_labels(data, ip, end)
        elif kind not in (_IPV4, _IPV6):
            name = _ETHERTYPES.get(kind, f"type 0x{kind:04X}")
            return ip, f"not IP: {'length' if kind < 0x600 else name}"
    if ip >= end:
        return ip, "not IP: cut short"
    if data[ip] >> 4 == 6 or (data[ip] >> 4 == 4 and data[ip] & 15 >= 5):
        return ip, ""
    return ip, "not IP: neither version 4 nor 6"


def _after_labels(data: bytes, ip: int, end: int) -> int:
    """Byte after the labels of MPLS (RFC 3032): the last one has the bottom-of-stack bit."""
    while ip + 4 <= end:
        ip += 4
        if data[ip - 2] & 1:
            break
    return ip


def _ip_header(data: bytes, ip: int, end: int) -> tuple[int, int, bytes]:
    """Byte after the headers of an IP packet, protocol that follows, and source address."""
    if data[ip] >> 4 == 4:
        return ip + 4 * (data[ip] & 15), data[ip + 9], data[ip + 12 : ip + 16]
    body, protocol = ip + 40, data[ip + 6]
    while protocol in _EXTENSIONS and body + 2 <= end:
        body, protocol = body + 8 * (data[body + 1] + 1), data[body]
    return body, protocol, data[ip + 8 : ip + 24]
