"""Index of the rotations of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.io.identity import FileIdentity
from velocal.scanner.models import AZIMUTH_TICKS, Scanner


@dataclass(frozen=True)
class Loss:
    """Packets that are missing in a recording.

    Attributes
    ----------
    gaps : int
        Places where packets are missing.
    packets : int
        Packets that are missing there.
    largest : int
        Packets that are missing in the largest gap.
    """

    gaps: int = 0
    packets: int = 0
    largest: int = 0

    def __str__(self) -> str:
        if not self.gaps:
            return "0, about 0 packets missing"
        largest = f", {self.largest} in the largest" if self.gaps > 1 else ""
        return f"{self.gaps}, about {self.packets} packets missing{largest}"


@dataclass(frozen=True)
class RotationIndex:
    """Where every rotation of a recording begins.

    A rotation begins with the first block whose azimuth is smaller than that of the block
    before it. The first and the last row are usually incomplete.

    Attributes
    ----------
    offset : ndarray of int64, shape (n + 1,)
        Byte at which the packet with the first block of a rotation begins; the last element
        is the end of the recording. Without meaning if the index is not `seekable`.
    block : ndarray of int8, shape (n + 1,)
        Number of that block in its packet.
    packet : ndarray of int64, shape (n + 1,)
        Running number of that packet among the valid data packets.
    time_s : ndarray of float64, shape (n + 1,)
        Time of that packet since the first; from the device clock, else from the capture;
        NaN where neither exists.
    complete : ndarray of bool, shape (n,)
        False for a rotation that the recording cuts, or that misses too much in gaps.
    seekable : bool
        Whether packets can be read from any offset on. False for compressed files, for bags, and
        for recordings whose packets had to be put in order.
    recording : FileIdentity or None
        The file that the index was made from; None if that is not checked.
    loss : Loss
        Packets that are missing in the whole recording.
    step_ticks : float
        Mean step of the azimuth from packet to packet, 0.01 degree; negative if the head turns
        backward.
    mean_rate_hz : float
        Mean rotation rate, from the azimuth against the time; NaN without time.
    dual : bool
        Whether most packets hold two returns of a shot.
    """

    offset: NDArray[np.int64]
    block: NDArray[np.int8]
    packet: NDArray[np.int64]
    time_s: Array
    complete: NDArray[np.bool_]
    seekable: bool = True
    recording: FileIdentity | None = None
    loss: Loss = Loss()
    step_ticks: float = float("nan")
    mean_rate_hz: float = float("nan")
    dual: bool = False

    def __len__(self) -> int:
        return len(self.complete)

    def rate_hz(self, rotations: NDArray[np.integer] | None = None) -> float:
        """Median rotation rate of complete rotations; NaN without time.

        Parameters
        ----------
        rotations : ndarray of int, optional
            Rotations to use; all if left out.

        Returns
        -------
        float
            Rotations per second.
        """
        durations = np.diff(self.time_s)
        chosen = self.complete.copy()
        if rotations is not None:
            chosen &= np.isin(np.arange(len(self)), rotations)
        durations = durations[chosen & (durations > 0)]
        return float(1.0 / np.median(durations)) if len(durations) else float("nan")

    def rate_for(self, scanner: Scanner, rotations: NDArray[np.integer] | None = None) -> float:
        """Rotation rate, however short the recording is.

        Parameters
        ----------
        scanner : Scanner
            What sent the packets.
        rotations : ndarray of int, optional
            Rotations to use; all if left out.

        Returns
        -------
        float
            Rotations per second: the median of the complete ones among these rotations, else of all
            complete rotations, else the mean of the azimuth against the time. Without a clock it is
            that of the usual step of the azimuth at the packet rate that the scanner should have.
        """
        nominal = scanner.dual_packet_rate_hz if self.dual else scanner.packet_rate_hz
        by_step = abs(self.step_ticks) / AZIMUTH_TICKS * nominal
        for rate_hz in (self.rate_hz(rotations), self.rate_hz(), self.mean_rate_hz, by_step):
            if np.isfinite(rate_hz):
                return float(rate_hz)
        return 0.0
