"""Which scanner a recording comes from, by its block flags and timing."""

from __future__ import annotations

import numpy as np

from velocal.errors import RecordingError
from velocal.recording.rotations import Inspection
from velocal.sensors import SCANNERS, Scanner

#: Measured and nominal packet rate may differ by this share.
RATE_TOLERANCE = 0.15


def candidates(inspection: Inspection) -> list[Scanner]:
    """Scanners whose flags and packet rate agree with a recording, best first."""
    lower = inspection.block_counts["lower"] > 0
    measured = 1.0 / inspection.packet_interval_s if inspection.packet_interval_s else np.nan
    fits: list[tuple[float, Scanner]] = []
    for scanner in SCANNERS.values():
        if scanner.paired != lower:
            continue
        ratios = [abs(np.log(measured / (scanner.packet_rate_hz * returns))) for returns in (1, 2)]
        mismatch = min(ratios) if np.isfinite(measured) else 0.0
        if mismatch < np.log1p(RATE_TOLERANCE):
            fits.append((float(mismatch), scanner))
    return [scanner for _, scanner in sorted(fits, key=lambda fit: fit[0])]


def check_scanner(inspection: Inspection, scanner: Scanner, where: str) -> list[str]:
    """Check the stated scanner against flags and timing; remarks that are no contradiction.

    Raises
    ------
    RecordingError
        If the recording cannot come from that scanner.
    """
    fits = candidates(inspection)
    if scanner not in fits:
        rate = 1.0 / inspection.packet_interval_s
        blocks = inspection.block_counts
        raise RecordingError(
            f"is said to come from {scanner.name}, which sends {scanner.packet_rate_hz:.0f} "
            f"packets/s with block flags {', '.join(f'{flag:04X}' for flag in scanner.flags)}; "
            f"the recording has {rate:.0f} packets/s, {blocks['upper']} upper and "
            f"{blocks['lower']} lower blocks",
            where=where,
            allowed=", ".join(fit.name for fit in fits) or "no scanner known here",
            hint="Correct the scanner of this sample.",
        )
    remarks = []
    expected, product = scanner.factory_byte, inspection.product
    if expected is not None and product is not None and product != expected:
        remarks.append(
            f"product byte is 0x{product:02X}, {scanner.name} should send 0x{expected:02X}; "
            f"the timing agrees with {scanner.name}"
        )
    return remarks
