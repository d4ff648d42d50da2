"""Files of stations with given planes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from velocal.geometry.planes import Patch
from velocal.geometry.rigid import RigidTransformation
from velocal.io import storage
from velocal.survey.station import Station, SurveyedPlane


def write_station(path: Path, position: str, scanner: str, patches: Sequence[Patch]) -> None:
    """Write a station at the origin that knows its planes exactly."""
    station = Station(
        position=position,
        scanner=scanner,
        pose=RigidTransformation(np.eye(3), np.zeros(3), np.zeros((6, 6))),
        base_targets=(),
        residuals_m=np.zeros((0, 3)),
        variance_factor=float("nan"),
        redundancy=0,
        planes=tuple(SurveyedPlane(patch, 3, 0.0, 0.0, float("nan")) for patch in patches),
    )
    storage.write_json(path, station.to_json())
