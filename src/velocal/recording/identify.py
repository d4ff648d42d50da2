"""Which scanner a recording comes from, by its block flags, factory byte and timing."""

from __future__ import annotations

import numpy as np

from velocal.errors import RecordingError
from velocal.recording.inspection import INTERVAL_TOLERANCE, Inspection
from velocal.scanner.models import SCANNERS, Scanner

#: Measured and nominal packet rate, or firing cycle, may differ by this share.
RATE_TOLERANCE = 0.15
#: No scanner turns faster than 20 times a second; five times as much is no rate of one scanner.
_IMPOSSIBLE_RATE_HZ = 100.0
#: Packets before which the azimuth does not go on, as a share of all: there are several scanners.
_BROKEN_SHARE = 0.3
#: Packets that the order of the device clock has rejected, or before which it jumps: the same.
_DISORDER_SHARE = 0.03
_FEW = 10


def _mismatch(inspection: Inspection, scanner: Scanner) -> float:
    """Logarithm of the ratio of measured and nominal packet rate; zero without time."""
    nominal = scanner.dual_packet_rate_hz if inspection.dual else scanner.packet_rate_hz
    if np.isnan(nominal):
        return np.inf  # it has no such mode
    off = abs(np.log(1.0 / (inspection.packet_interval_s * nominal)))
    return 0.0 if np.isnan(off) else float(off)


def candidates(inspection: Inspection) -> list[Scanner]:
    """Find the scanners whose flags and packet rate agree with a recording.

    Scanners of the same timing differ by their product byte.

    Parameters
    ----------
    inspection : Inspection

    Returns
    -------
    list of Scanner
        The best first.
    """
    fits = []
    for number, scanner in enumerate(SCANNERS.values()):
        mismatch = _mismatch(inspection, scanner)
        if len(scanner.flags) == inspection.banks and mismatch < np.log1p(RATE_TOLERANCE):
            other = inspection.product not in scanner.factory_bytes
            fits.append((mismatch, other, number, scanner))
    return [scanner for *_, scanner in sorted(fits, key=lambda fit: fit[:3])]


def _mixed(inspection: Inspection) -> str:
    """What shows that the packets are those of several scanners; empty if nothing does."""
    packets = inspection.ledger.data.packets
    senders = [s for s in SCANNERS.values() if len(s.flags) == inspection.banks]
    bytes_ = {byte for scanner in senders for byte in scanner.factory_bytes}
    known = {byte: n for byte, n in inspection.products.items() if byte in bytes_}
    if len(known) > 1 and not any(scanner.sends_status for scanner in senders):
        told = "; ".join(f"0x{byte:02X}, {n} packets" for byte, n in known.items())
        return f"their product bytes are {told}"
    if inspection.broken > max(_FEW, _BROKEN_SHARE * packets):
        return f"the azimuth does not go on before {inspection.broken} of {packets} packets"
    late = sum(n.packets for why, n in inspection.ledger.rejected.items() if why.startswith("late"))
    few, jumps = max(_FEW, _DISORDER_SHARE * packets), len(inspection.clock_jumps)
    if late > few:
        return f"{late} packets come far too late, {packets} do not"
    return f"the clock jumps before {jumps} of {packets} packets" if jumps > few else ""


def _check_one_sender(inspection: Inspection, where: str) -> None:
    """Check that the packets come from one scanner.

    Raises
    ------
    RecordingError
        If packets of several scanners are mixed, or the rotation rate is impossible.
    """
    mixed = _mixed(inspection)
    rate_hz = inspection.index.rate_hz()
    if not mixed and rate_hz > _IMPOSSIBLE_RATE_HZ:
        mixed = f"a rotation rate of {rate_hz:.0f} Hz is impossible"
    if mixed:
        raise RecordingError(
            f"holds packets that do not belong together: {mixed}",
            where=where,
            allowed="packets of one scanner",
            hint="Several scanners may send to one address and port. Give each its own port, or "
            "record them one by one; choose among different ones with --port and --address.",
        )


def _sender_of(product: int | None, among: list[Scanner]) -> list[Scanner]:
    """Scanners that may send a product byte."""
    return [
        scanner
        for scanner in among
        if not scanner.factory_bytes
        or product in (*scanner.factory_bytes, *scanner.borrowed_factory_bytes)
    ]


def check_scanner(inspection: Inspection, scanner: Scanner, where: str) -> list[str]:
    """Check the stated scanner against flags, factory byte and timing.

    Parameters
    ----------
    inspection : Inspection
    scanner : Scanner
        The scanner that is said to have made the recording.
    where : str
        The recording, for errors.

    Returns
    -------
    list of str
        Remarks on what is unusual, but no contradiction.

    Raises
    ------
    RecordingError
        If the recording cannot come from that scanner.
    """
    fits = candidates(inspection)
    if fits:
        _check_one_sender(inspection, where)
    allowed = ", ".join(fit.name for fit in fits) or "no scanner known here"
    hint = "Correct the scanner of this sample."
    if scanner not in fits:
        rate = 1.0 / inspection.packet_interval_s
        nominal = scanner.dual_packet_rate_hz if inspection.dual else scanner.packet_rate_hz
        blocks = ", ".join(f"{n} {bank}" for bank, n in inspection.block_counts.items())
        returns = "two returns" if inspection.dual else "one return"
        raise RecordingError(
            f"is said to come from {scanner.name}, which sends {nominal:.0f} "
            f"packets/s of {returns} a shot with block flags "
            f"{', '.join(f'{flag:04X}' for flag in scanner.flags)}; "
            f"the recording has {rate:.0f} packets/s and blocks: {blocks}",
            where=where,
            allowed=allowed,
            hint=hint,
        )
    remarks = inspection.remarks
    product, expected = inspection.product, scanner.factory_bytes
    if expected and product is not None and product not in expected:
        sender = [fit for fit in fits if product in fit.factory_bytes]
        if sender and product not in scanner.borrowed_factory_bytes:
            raise RecordingError(
                f"is said to come from {scanner.name}; its product byte 0x{product:02X} is that "
                f"of {sender[0].name}, and flags and timing agree with both",
                where=where,
                allowed=sender[0].name,
                hint=hint,
            )
        remarks.append(
            f"product byte is 0x{product:02X}, {scanner.name} should send 0x{expected[0]:02X}; "
            f"the timing agrees with {scanner.name}"
        )
    cycle = inspection.firing_cycle_s / (scanner.firing_cycle_s * scanner.firings_per_block)
    nominal_hz = scanner.dual_packet_rate_hz if inspection.dual else scanner.packet_rate_hz
    slower = inspection.interval_for(scanner) * nominal_hz
    turns = inspection.turning == "forward"
    if turns and not scanner.coarse_encoder and abs(np.log(cycle)) > 2 * RATE_TOLERANCE:
        remarks.append(
            f"the head turns {inspection.azimuth_step_ticks:.0f} hundredths of a degree from block "
            f"to block, {cycle:.2f} times what its rate and {scanner.name} would give"
        )
    elif abs(slower - 1.0) > INTERVAL_TOLERANCE:
        remarks.append(
            f"the firing cycle is {1e6 * slower * scanner.firing_cycle_s:.1f} us, which is used; "
            f"that of {scanner.name} should be {1e6 * scanner.firing_cycle_s:.1f} us"
        )
    if inspection.mode and inspection.dual != (inspection.mode == "dual"):
        remarks.append(
            f"return mode is said to be {inspection.mode}, the blocks hold "
            + ("two returns a shot" if inspection.dual else "one return a shot")
        )
    return remarks


def identify(
    inspection: Inspection, stated: Scanner | None, where: str
) -> tuple[Scanner, list[str]]:
    """Find the scanner that made a recording, or check the one that is stated.

    Parameters
    ----------
    inspection : Inspection
    stated : Scanner or None
        The scanner that is said to have made the recording.
    where : str
        The recording, for errors.

    Returns
    -------
    scanner : Scanner
        The stated one, or the best of `candidates`.
    remarks : list of str
        See `check_scanner`.

    Raises
    ------
    RecordingError
        If the recording cannot come from the stated scanner, or fits no known one.
    """
    if stated is None:
        fits = candidates(inspection)
        _check_one_sender(inspection, where)
        senders = _sender_of(inspection.product, fits)
        if fits and not senders and inspection.product is not None:
            of = [s.name for s in SCANNERS.values() if inspection.product in s.factory_bytes]
            whose = f"that of {of[0]}, which flags and packet rate do not fit" if of else "unknown"
            raise RecordingError(
                f"its product byte 0x{inspection.product:02X} is {whose}; "
                f"they fit {', '.join(fit.name for fit in fits)}",
                where=where,
                hint="State the scanner if you know that it is one of these (--scanner).",
            )
        fits = senders or fits
        if not fits:
            raise RecordingError(
                "flags and packet rate fit no known scanner",
                where=where,
                allowed=", ".join(SCANNERS),
                hint="`velocal inspect` shows the flags and the rate.",
            )
        stated = fits[0]
    return stated, check_scanner(inspection, stated, where)
