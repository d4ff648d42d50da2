"""Proof of files for programs: the formula of the reader, applied to observed planes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.observations import Observations
from velocal.arrays import Array
from velocal.calibration.applied import AppliedCalibration, applied
from velocal.calibration.dialects import MANUAL, dialect_named
from velocal.calibration.files.document import CalibrationFile
from velocal.scanner.models import Scanner
from velocal.scanner.parameters import LaserParameters


@dataclass(frozen=True)
class Observed:
    """Medians of a window on surveyed planes.

    Attributes
    ----------
    observations : Observations
        Raw distances, rotational angles of the model, and planes.
    rate_hz : float
        Rotation rate of the recording.
    """

    observations: Observations
    rate_hz: float

    def distances(self, calibration: AppliedCalibration) -> Array:
        """Distances of the points of a program from their planes, metres, shape (n,)."""
        data = self.observations
        xyz = calibration.points(data.distance_m, data.phi, data.laser_id, rounded=True)
        return np.asarray(np.einsum("ni,ni->n", data.normal, xyz) + data.offset)


def exported_columns(
    files: Mapping[str, CalibrationFile],
    factory: CalibrationFile | LaserParameters,
    model: LaserParameters,
    windows: Sequence[Observed],
    scanner: Scanner,
) -> dict[str, NDArray[Any]]:
    """Compare what programs make of exported files with what they are made from.

    Parameters
    ----------
    files : mapping of str to CalibrationFile
        Exported files by name.
    factory : CalibrationFile or LaserParameters
        Calibration before.
    model : LaserParameters
        The same calibration as the files, for equations (1) to (3).
    windows : sequence of Observed
    scanner : Scanner

    Returns
    -------
    dict of str to ndarray, shape (files,)
        ``file``, ``program``, ``rotation_rate_hz`` (NaN: for any rate), ``count``, and the root
        mean square of the distances of points from their planes in centimetres: ``factory_cm``, the
        calibration before by its own formula; ``before_cm``, its numbers in the program;
        ``model_cm``; and ``after_cm``, the file in the program.
    """

    def rms_cm(calibration: CalibrationFile | LaserParameters, program: str | None = None) -> float:
        parts = []
        for window in windows:
            use = applied(calibration, scanner, window.rate_hz)
            if program is not None:
                use = replace(use, dialect=dialect_named(program))
            parts.append(window.distances(use))
        return float(100.0 * np.sqrt(np.mean(np.concatenate(parts) ** 2)))

    n, programs = len(files), [each.dialect or MANUAL.name for each in files.values()]
    rates = [each.rotation_rate_hz or np.nan for each in files.values()]
    return {
        "file": np.array(list(files)),
        "program": np.array(programs),
        "rotation_rate_hz": np.array(rates, dtype=np.float64),
        "count": np.full(n, sum(len(window.observations.phi) for window in windows)),
        "factory_cm": np.full(n, rms_cm(factory)),
        "before_cm": np.array([rms_cm(factory, program) for program in programs]),
        "model_cm": np.full(n, rms_cm(model)),
        "after_cm": np.array([rms_cm(each) for each in files.values()]),
    }
