"""Which scanner a recording comes from, by its block flags, factory byte and timing."""

from __future__ import annotations

import numpy as np

from velocal.errors import RecordingError
from velocal.recording.inspection import INTERVAL_TOLERANCE, Inspection
from velocal.scanner.models import SCANNERS, Scanner

#: Measured and nominal packet rate, or firing cycle, may differ by this share.
RATE_TOLERANCE = 0.15


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
        if sender:
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
    if not scanner.coarse_encoder and abs(np.log(cycle)) > 2 * RATE_TOLERANCE:
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
        if not fits:
            raise RecordingError(
                "flags and packet rate fit no known scanner",
                where=where,
                allowed=", ".join(SCANNERS),
                hint="`velocal inspect` shows the flags and the rate.",
            )
        stated = fits[0]
    return stated, check_scanner(inspection, stated, where)
