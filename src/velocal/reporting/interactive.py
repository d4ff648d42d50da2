"""What the scripts of the report draw: residuals and planes as numbers, packed into the page.

Columns are little-endian integers in base64. The page works without scripts too: every number
that matters is in its tables, and the same maps are static pictures.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.evaluation.residual_map import STEP_DEG, ResidualMap

#: Residuals are in units of 0.1 mm, coordinates in units of 2 mm.
RESIDUAL_M, COORDINATE_M = 1e-4, 2e-3


@dataclass(frozen=True)
class SampleMap:
    """Residuals of a sample along the azimuth, for the page.

    Attributes
    ----------
    sample, scanner, position : str
        The position of a sample without a survey is empty.
    after : str
        Name of the calibration of ``after_m``.
    planes : sequence of str
        Names of the planes.
    corners_m : sequence of ndarray, shape (n, 3)
        Their corners in the scanner frame, metres; a curved or unbounded one has none.
    residuals : ResidualMap
    png : bytes
        The same as a picture.
    """

    sample: str
    scanner: str
    position: str
    after: str
    planes: Sequence[str]
    corners_m: Sequence[NDArray[Any]]
    residuals: ResidualMap
    png: bytes


#: Points of an interior that a page holds.
INTERIOR_POINTS = 15_000


@dataclass(frozen=True)
class Interior:
    """Points of an interior with both calibrations, for the page.

    Attributes
    ----------
    position : ndarray of int, shape (n,)
        Number of the position from which a point was seen.
    positions : sequence of str
        Names of the positions.
    scanners_m : sequence of sequence of float
        Where the scanner stood at each, metres.
    xyz : mapping of str to ndarray, shape (n, 3)
        Points by calibration, ``factory`` and ``refined``, metres.
    """

    position: NDArray[np.integer]
    positions: Sequence[str]
    scanners_m: Sequence[Sequence[float]]
    xyz: Mapping[str, NDArray[np.float64]]

    @property
    def shown(self) -> int:
        """Number of points that the page holds."""
        return len(self.position[self._some])

    @property
    def _some(self) -> slice:
        return slice(None, None, max(1, -(-len(self.position) // INTERIOR_POINTS)))

    def packed(self) -> dict[str, Any]:
        """Some of the points, evenly out of all, for `payload`."""
        every = self._some
        return {
            "position": packed(self.position[every], 1, "<u1"),
            "positions": list(self.positions),
            "scanners": np.round(np.asarray(self.scanners_m), 3).tolist(),
            **{
                state: [packed(column, COORDINATE_M, "<i2") for column in xyz[every].T]
                for state, xyz in self.xyz.items()
            },
        }


def packed(values: NDArray[Any], unit: float, type_: str) -> str:
    """Integers of a column in base64; values that do not fit are cut to the largest that do.

    Parameters
    ----------
    values : ndarray
    unit : float
        What one unit of the integers means.
    type_ : str
        Of NumPy, such as ``<i2``.

    Examples
    --------
    >>> import numpy as np
    >>> packed(np.array([0.001, -0.001]), 1e-4, "<i2")
    'CgD2/w=='
    """
    limits = np.iinfo(type_)
    whole = np.clip(np.rint(np.nan_to_num(values) / unit), limits.min, limits.max)
    return base64.b64encode(whole.astype(type_).tobytes()).decode("ascii")


def payload(maps: Sequence[SampleMap], interior: Interior | None = None) -> str:
    """Content of the element of data of the page.

    Parameters
    ----------
    maps : sequence of SampleMap
    interior : Interior, optional

    Returns
    -------
    str
        JSON that may stand in HTML: it contains no ``<``.
    """
    samples = [
        {
            "sample": one.sample,
            "scanner": one.scanner,
            "position": one.position,
            "after": one.after,
            "planes": [name.replace("_", " ") for name in one.planes],
            "corners": [np.round(corners, 3).tolist() for corners in one.corners_m],
            "laser": packed(one.residuals.laser_id, 1, "<u1"),
            "plane": packed(one.residuals.plane, 1, "<u1"),
            "azimuth_bin": packed(one.residuals.azimuth_bin, 1, "<u2"),
            "before": packed(one.residuals.before_m, RESIDUAL_M, "<i2"),
            "after_s": packed(one.residuals.after_m, RESIDUAL_M, "<i2"),
            "x": packed(one.residuals.x_m, COORDINATE_M, "<i2"),
            "y": packed(one.residuals.y_m, COORDINATE_M, "<i2"),
            "z": packed(one.residuals.z_m, COORDINATE_M, "<i2"),
        }
        for one in maps
    ]
    content = {
        "step_deg": STEP_DEG,
        "residual_mm": RESIDUAL_M * 1e3,
        "coordinate_m": COORDINATE_M,
        "samples": samples,
    }
    if interior is not None:
        content["interior"] = interior.packed()
    return json.dumps(content, ensure_ascii=True, separators=(",", ":")).replace("<", "\\u003c")
