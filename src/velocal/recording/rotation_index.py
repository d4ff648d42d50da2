"""Index of the rotations of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.io.identity import FileIdentity


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
        False for a rotation that the recording cuts, or that has a gap in it.
    seekable : bool
        Whether packets can be read from any offset on. False for compressed files, for bags, and
        for recordings whose packets had to be put in order.
    recording : FileIdentity or None
        The file that the index was made from; None if that is not checked.
    """

    offset: NDArray[np.int64]
    block: NDArray[np.int8]
    packet: NDArray[np.int64]
    time_s: Array
    complete: NDArray[np.bool_]
    seekable: bool = True
    recording: FileIdentity | None = None

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
