"""Two returns of a shot: how packets hold them, and which of them is used.

No byte of an HDL-64E says that its packets hold two returns, so the blocks are compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.errors import ConfigError
from velocal.scanner.models import Scanner

#: Which return a row of a table is: the only one of its shot, or one of two.
ONLY, STRONGEST, LAST = 0, 1, 2
#: What can be asked for where a shot has two returns.
CHOICES = ("both", "strongest", "last")

#: Packets of which the greater part decides whether the one in their middle holds two returns.
NEIGHBOURS = 9


def check_choice(returns: str, where: str | None = None) -> None:
    """Check the choice of returns.

    Parameters
    ----------
    returns : str
    where : str, optional
        Key or option that holds it, for errors.

    Raises
    ------
    ConfigError
        If it is unknown.
    """
    if returns not in CHOICES:
        raise ConfigError(
            f"unknown return {returns!r}",
            where=where,
            allowed=", ".join(CHOICES),
            hint="It matters only where a scanner was set to dual return.",
        )


@dataclass(frozen=True)
class DualLayout:
    """Order of the blocks of a packet that holds two returns of every shot.

    Attributes
    ----------
    blocks_apart : int
        Blocks from the first return of a shot to its second return.
    first, second : int
        Which return each of the two is: `STRONGEST` or `LAST`.
    """

    blocks_apart: int
    first: int
    second: int

    def is_second(self, block: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether a block holds second returns, by its number; any shape."""
        return np.asarray(block % (2 * self.blocks_apart) >= self.blocks_apart)

    def which(self, block: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Return that a block holds, `STRONGEST` or `LAST`, by its number; any shape."""
        return np.where(self.is_second(block), self.second, self.first).astype(np.uint8)


#: S3 manual: the blocks of both halves with the strongest return, then both with the last one.
_PAIRED = DualLayout(blocks_apart=2, first=STRONGEST, second=LAST)
#: Manuals of HDL-32E, VLP-16, VLP-32C and VLS-128.
_SINGLE = DualLayout(blocks_apart=1, first=LAST, second=STRONGEST)


def dual_layout(scanner: Scanner) -> DualLayout:
    """Order of the blocks in which a scanner sends two returns."""
    return _PAIRED if scanner.paired else _SINGLE


def two_returns(flag: NDArray[np.uint16], azimuth: NDArray[np.uint16]) -> NDArray[np.bool_]:
    """Tell which packets hold every shot twice: their blocks share flag and azimuth.

    The two returns of a shot lie in blocks 0 and 1, 2 and 3, ..., or in blocks 0 and 2, 1 and 3,
    4 and 6, ... (HDL-64E). Both are looked for, as the scanner need not be known.

    Parameters
    ----------
    flag, azimuth : ndarray of uint16, shape (n, 12)

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    # The first three blocks tell of nearly every packet that it does not.
    alike = (flag[:, 1:3] == flag[:, :1]) & (azimuth[:, 1:3] == azimuth[:, :1])
    if not alike.any():
        return np.zeros(len(flag), dtype=bool)
    both = flag.astype(np.uint32) << np.uint32(16) | azimuth
    # Where the head stands still, all blocks are alike and nothing can be told.
    pairs = (both[:, 0::2] == both[:, 1::2]).all(axis=1) & (both[:, 0] != both[:, 2])
    quads = both.reshape(-1, 3, 2, 2)
    paired = (quads[:, :, 0] == quads[:, :, 1]).all(axis=(1, 2))
    paired &= (flag[:, 0] != flag[:, 1]) & (azimuth[:, 0] != azimuth[:, 4])
    return np.asarray(pairs | paired)


def dual_packets(flag: NDArray[np.uint16], azimuth: NDArray[np.uint16]) -> NDArray[np.bool_]:
    """Tell which of consecutive packets hold two returns, by each packet and its neighbours.

    A few damaged packets among others do not change the setting of a scanner, but the setting may
    change in the middle of a recording.

    Parameters
    ----------
    flag, azimuth : ndarray of uint16, shape (n, 12)

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    found = two_returns(flag, azimuth)
    share = np.count_nonzero(found)
    if share in (0, len(found)):
        return found
    if 2 * min(share, len(found) - share) < NEIGHBOURS:
        return np.full(len(found), 2 * share > len(found))
    ends = [np.repeat(found[at], NEIGHBOURS // 2) for at in (0, -1)]
    around = np.cumsum(np.concatenate([[0], ends[0], found, ends[1]]))
    return np.asarray(2 * (around[NEIGHBOURS:] - around[:-NEIGHBOURS]) > NEIGHBOURS)
