"""What a complete scan of a recording found, and how it is told."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from velocal.capture.ledger import Ledger
from velocal.packets.status import TrailingStatus
from velocal.recording.rotation_index import RotationIndex
from velocal.scanner.models import AZIMUTH_TICK_DEG, AZIMUTH_TICKS, Scanner

#: The nominal time between packets is used where the measured one differs by less than this share.
INTERVAL_TOLERANCE = 0.01
#: Packets with two returns are told where they are neither nearly none nor nearly all.
DUAL_SHARE = 0.001


@dataclass(frozen=True)
class Fact:
    """One line that is told about a recording.

    Attributes
    ----------
    label : str
        Heading for people; empty for what is told to programs only.
    text : str
        The same as `values`, for people.
    values : dict
        Key and value in JSON; empty for what is told to people only.
    """

    label: str
    text: str
    values: dict[str, Any]


@dataclass(frozen=True)
class Inspection:
    """What a complete scan of a recording found.

    Attributes
    ----------
    index : RotationIndex
    ledger : Ledger
        With the packets that are missing: by the device clock, or by azimuth and capture times.
    view_deg : tuple of (float, float)
        First and last azimuth of every part of the field of view, degrees; empty if it is the whole
        turn.
    packet_interval_s : float
        Median time between packets; NaN without time.
    azimuth_step_ticks : float
        Median difference of azimuths of successive firings.
    azimuth_multiple : int
        Greatest common divisor of all azimuths: 9 for an encoder of 0.09 degree.
    clock : str
        "device", "capture" or "none": where times come from.
    unused_times : bool
        Whether there are times of capture that hardly advance.
    clock_jumps : tuple of (int, float)
        Number of the first packet after each jump of that clock, and how far it jumps, seconds.
    damaged_stamps : int
        Packets whose time stamp alone is wrong.
    irregular : int
        Packets that cannot belong where they stand, or whose azimuth is damaged.
    broken : int
        Packets before which the azimuth does not go on as within packets, though the device clock
        says that nothing is missing.
    turning : {"forward", "backward", "standing"}
        How the head turns.
    block_counts : dict of str to int
        Number of upper and lower blocks; of the third and fourth bank of a VLS-128.
    dual : bool
        Whether every shot has two returns.
    mode : str
        What the scanner says of its returns: "strongest", "last" or "dual"; empty if it says
        nothing.
    packets_dual : int
        Packets that hold two returns of a shot.
    product : int or None
        Last byte of the payloads, if it changes in a few damaged packets at most.
    products : dict of int to int
        Packets by their last byte, for those that are not rare.
    status_types : str
        Printable status types in the last but one byte (HDL-64E S2 and S3).
    status : TrailingStatus
        What the trailing bytes say: temperature, firmware, time, embedded calibration.
    """

    index: RotationIndex
    ledger: Ledger
    view_deg: tuple[tuple[float, float], ...] = ()
    packet_interval_s: float = float("nan")
    azimuth_step_ticks: float = float("nan")
    azimuth_multiple: int = 0
    clock: str = "none"
    unused_times: bool = False
    clock_jumps: tuple[tuple[int, float], ...] = ()
    damaged_stamps: int = 0
    irregular: int = 0
    broken: int = 0
    turning: str = "forward"
    block_counts: dict[str, int] = field(default_factory=dict)
    dual: bool = False
    mode: str = ""
    packets_dual: int = 0
    product: int | None = None
    products: dict[int, int] = field(default_factory=dict)
    status_types: str = ""
    status: TrailingStatus = field(default_factory=TrailingStatus)

    @property
    def gaps(self) -> int:
        """Places where packets are missing."""
        return self.index.loss.gaps

    @property
    def packets_missing(self) -> int:
        """Packets that are missing there."""
        return self.index.loss.packets

    @property
    def calibration_in_stream(self) -> bool:
        """Whether the status bytes hold the factory's calibration."""
        return self.status.parameters is not None

    @property
    def banks(self) -> int:
        """Number of banks of 32 lasers that occur."""
        return sum(count > 0 for count in self.block_counts.values())

    @property
    def duration_s(self) -> float:
        """Time from the first to the last packet, seconds; NaN without time."""
        return float(self.index.time_s[-1] - self.index.time_s[0])

    @property
    def firing_cycle_s(self) -> float:
        """Time between blocks that differ in azimuth; NaN without a device clock or such blocks.

        It follows from the rotation rate and the azimuth step, so that lost packets do not change
        it.
        """
        if self.clock != "device" or self.azimuth_step_ticks == 0:
            return float("nan")
        rate_hz = self.index.rate_hz()
        rate_hz = rate_hz if np.isfinite(rate_hz) else self.index.mean_rate_hz
        return self.azimuth_step_ticks / AZIMUTH_TICKS / rate_hz if rate_hz > 0 else float("nan")

    @property
    def view_text(self) -> str:
        """Field of view, for people."""
        parts = [f"{first:.0f} to {last:.0f} deg" for first, last in self.view_deg]
        return ", ".join(parts) or "whole turn"

    @property
    def remarks(self) -> list[str]:
        """What is unusual in the recording, whatever scanner made it."""
        told = []
        if self.unused_times:
            told.append("the times of capture hardly advance, and are not used")
        if self.clock_jumps:
            packet, jump_s = max(self.clock_jumps, key=lambda jump: abs(jump[1]))
            more = f"{len(self.clock_jumps)} times, most" if len(self.clock_jumps) > 1 else "once,"
            told.append(
                f"the {self.clock} clock jumps {more} by {jump_s:.6g} s before packet {packet}; "
                "times go on as azimuth and capture tell"
            )
        if self.damaged_stamps:
            told.append(f"{self.damaged_stamps} packets have a wrong time stamp, which is not used")
        if self.turning != "forward":
            how = "stands still" if self.turning == "standing" else "turns backward"
            told.append(f"the head {how}: there are no rotations")
        packets = self.ledger.data.packets
        if DUAL_SHARE * packets < self.packets_dual < (1 - DUAL_SHARE) * packets:
            told.append(
                f"{self.packets_dual} of {packets} packets hold two returns a shot, the others one"
            )
        return told

    def interval_for(self, scanner: Scanner, dual: bool | None = None) -> float:
        """Time between packets, seconds.

        Parameters
        ----------
        scanner : Scanner
            What sent the packets.
        dual : bool, optional
            Whether they hold two returns of a shot; as most packets of the recording if left out.

        Returns
        -------
        float
            That of the scanner, or what the device clock shows where the two differ by more than
            1 %: later firmware of a VLS-128 fires every 55.3 us instead of every 53.3 us.
        """
        nominal_hz = scanner.dual_packet_rate_hz if self.dual else scanner.packet_rate_hz
        measured = self.clock == "device" and self.packet_interval_s > 0
        differs = measured and abs(self.packet_interval_s * nominal_hz - 1.0) > INTERVAL_TOLERANCE
        slower = self.packet_interval_s * nominal_hz if differs else 1.0
        dual = self.dual if dual is None else dual
        return slower / (scanner.dual_packet_rate_hz if dual else scanner.packet_rate_hz)

    def facts(self, scanner: Scanner | None = None) -> list[Fact]:
        """Everything that is told about a recording, in order: the only list of it.

        Parameters
        ----------
        scanner : Scanner, optional
            What sent the packets, where that is known.
        """
        complete, rate_hz = int(self.index.complete.sum()), self.index.rate_hz()
        of = ""
        if not np.isfinite(rate_hz):
            rate_hz, of = self.index.mean_rate_hz, ", from the azimuth against the time"
        if not np.isfinite(rate_hz) and scanner is not None:
            rate_hz = self.index.rate_for(scanner)
            of = f", from the azimuth step and the packet rate of an {scanner.name}"
        rate = f"{rate_hz:.3f} Hz{of}" if np.isfinite(rate_hz) else "unknown: there is no clock"
        packet_rate_hz = 1.0 / self.packet_interval_s
        packets = f"{packet_rate_hz:.1f} Hz" if np.isfinite(packet_rate_hz) else "unknown"
        step_deg = self.azimuth_step_ticks * AZIMUTH_TICK_DEG
        resolution_deg = self.azimuth_multiple * AZIMUTH_TICK_DEG
        returns = "dual" if self.dual else self.mode or "single"
        product = None if self.product is None else f"0x{self.product:02X}"
        return [
            Fact(
                "duration",
                "unknown: there is no clock"
                if self.clock == "none"
                else f"{self.duration_s:.3f} s ({self.clock} clock)",
                {"duration_s": self.duration_s, "clock": self.clock},
            ),
            Fact(
                "rotations",
                f"{len(self.index)}, {complete} complete",
                {"rotations": len(self.index), "rotations_complete": complete},
            ),
            Fact("rotation rate", rate, {"rotation_rate_hz": rate_hz}),
            Fact("packet rate", packets, {"packet_rate_hz": packet_rate_hz}),
            Fact(
                "azimuth step",
                f"{step_deg:.2f} deg, in multiples of {resolution_deg:.2f} deg",
                {"azimuth_step_deg": step_deg, "azimuth_resolution_deg": resolution_deg},
            ),
            Fact(
                "gaps",
                str(self.index.loss),
                {
                    "gaps": self.gaps,
                    "packets_missing": self.packets_missing,
                    "largest_gap_packets": self.index.loss.largest,
                },
            ),
            Fact(
                "",
                "",
                {
                    "clock_jumps": [
                        {"packet": packet, "jump_s": jump_s} for packet, jump_s in self.clock_jumps
                    ],
                    "damaged_stamps": self.damaged_stamps,
                },
            ),
            Fact("field of view", self.view_text, {"field_of_view_deg": self.view_deg}),
            Fact(
                "blocks",
                ", ".join(f"{count} {bank}" for bank, count in self.block_counts.items()),
                {"block_counts": self.block_counts},
            ),
            Fact("returns", returns, {"returns": returns}),
            Fact("product byte", product or "none", {"product": product}),
            Fact("", "", {"status_types": self.status_types}),
            *(Fact(label, text, {}) for label, text in self.status.lines().items()),
            Fact(
                "embedded calibration",
                self.status.calibration_text,
                {"calibration_in_stream": self.calibration_in_stream},
            ),
            Fact("", "", {"status": self.status.as_dict(), "ledger": self.ledger.as_dict()}),
        ]

    def as_dict(self, scanner: Scanner | None = None) -> dict[str, Any]:
        """Plain mapping of all facts, for JSON; `scanner` as in `facts`."""
        return {key: value for fact in self.facts(scanner) for key, value in fact.values.items()}
