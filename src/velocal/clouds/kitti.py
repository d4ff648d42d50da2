"""Points as bare single precision numbers: KITTI (`.bin`) and nuScenes (`.pcd.bin`).

KITTI stores x, y, z (X forward, Y left) and the reflectance of every point, without header, time
or ring (Geiger et al. 2013, and the development kit of the data set). nuScenes stores the ring too.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.clouds import packed
from velocal.errors import RecordingError

_KITTI, _NUSCENES = ("x", "y", "z", "intensity"), ("x", "y", "z", "intensity", "ring")
#: No scanner sees farther, metres; other content than such numbers is recognised by it.
_FARTHEST_M = 1000.0


def blocks(path: Path) -> Iterator[dict[str, NDArray[Any]]]:
    """Read the points of a scan.

    Parameters
    ----------
    path : Path

    Yields
    ------
    dict of str to ndarray, shape (n,)

    Raises
    ------
    RecordingError
        If the file does not hold whole points, or numbers that are no coordinates.
    """
    names = _NUSCENES if path.name.endswith(".pcd.bin") else _KITTI
    kind = np.dtype([(name, "<f4") for name in names])
    where = str(path)
    with path.open("rb") as file:
        size = file.seek(0, 2)
        if size % kind.itemsize or size == 0:
            raise RecordingError(
                f"has {size} bytes",
                where=where,
                allowed=f"a multiple of {kind.itemsize}: {', '.join(names)} of every point",
                hint="Is this a file of KITTI (.bin) or nuScenes (.pcd.bin)?",
            )
        file.seek(0)
        for begin, count in packed.batches(file, kind, size // kind.itemsize, where):
            file.seek(begin)
            rows = np.frombuffer(file.read(count * kind.itemsize), kind)
            for axis in "xyz":
                wrong = ~(np.abs(rows[axis]) < _FARTHEST_M)
                if wrong.any():
                    raise RecordingError(
                        f"{axis} of a point is {rows[axis][wrong.argmax()]:g}",
                        where=where,
                        allowed=f"up to {_FARTHEST_M:g} m",
                        hint="Is this a file of KITTI (.bin) or nuScenes (.pcd.bin)?",
                    )
            yield packed.columns_of(rows)
