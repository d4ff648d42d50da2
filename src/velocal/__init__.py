"""Intrinsic calibration of Velodyne multi-beam laser scanners against surveyed planes.

A calibration from Python, in the order of the work::

    import velocal

    recording = velocal.open_recording("capture.pcap", scanner="HDL-64E")
    station = velocal.adjust_station(
        "planes.csv", "base_scanner.csv", "base_field.csv", position="P1", scanner="HDL-64E"
    )
    factory = velocal.read_parameters("factory.xml", "HDL-64E")
    found = velocal.calibrate_unit([(recording.medians("all"), station)], factory)
    print(found.summary())
    velocal.write_calibration("refined.csv", found, "HDL-64E")

Only the names of `__all__` are public; every other module may change without notice. They are
imported when they are used for the first time, so that `import velocal` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the same names as in `_PLACES`; a test compares both
    from velocal.adjustment.average import Member as Member
    from velocal.adjustment.average import average as average
    from velocal.adjustment.result import CalibrationSet as CalibrationSet
    from velocal.calibration.convert import convert as convert
    from velocal.calibration.convert import max_point_distance as max_point_distance
    from velocal.calibration.dialects import DIALECTS as DIALECTS
    from velocal.calibration.files.document import CalibrationFile as CalibrationFile
    from velocal.calibration.files.formats import read_calibration as read_calibration
    from velocal.calibration.lint import lint as lint
    from velocal.capture.ledger import Ledger as Ledger
    from velocal.chain import calibrate as calibrate
    from velocal.chain import calibrate_unit as calibrate_unit
    from velocal.chain import calibrate_without_survey as calibrate_without_survey
    from velocal.chain import residuals as residuals
    from velocal.errors import VelocalError as VelocalError
    from velocal.evaluation.statistics import LaserStatistics as LaserStatistics
    from velocal.exports import read_parameters as read_parameters
    from velocal.exports import write_calibration as write_calibration
    from velocal.points.stream import stream_points as stream_points
    from velocal.recording.cloud import read_cloud as read_cloud
    from velocal.recording.recording import Recording as Recording
    from velocal.recording.recording import open_recording as open_recording
    from velocal.recording.returns import Returns as Returns
    from velocal.reduction.assignment import Limits as Limits
    from velocal.scanner.beam import Beams as Beams
    from velocal.scanner.models import SCANNERS as SCANNERS
    from velocal.scanner.models import Scanner as Scanner
    from velocal.scanner.parameters import LaserParameters as LaserParameters
    from velocal.study.adjustment import Adjustment as Adjustment
    from velocal.study.scanner_file import read_scanner as read_scanner
    from velocal.survey.station import Station as Station
    from velocal.survey.station import adjust_station as adjust_station
    from velocal.survey.station import read_station as read_station
    from velocal.survey.targets import Targets as Targets
    from velocal.survey.targets import read_targets as read_targets

#: Module of every public name.
_PLACES = {
    "Adjustment": "study.adjustment",
    "Beams": "scanner.beam",
    "CalibrationFile": "calibration.files.document",
    "CalibrationSet": "adjustment.result",
    "DIALECTS": "calibration.dialects",
    "LaserParameters": "scanner.parameters",
    "LaserStatistics": "evaluation.statistics",
    "Ledger": "capture.ledger",
    "Limits": "reduction.assignment",
    "Member": "adjustment.average",
    "Recording": "recording.recording",
    "Returns": "recording.returns",
    "SCANNERS": "scanner.models",
    "Scanner": "scanner.models",
    "Station": "survey.station",
    "Targets": "survey.targets",
    "VelocalError": "errors",
    "adjust_station": "survey.station",
    "average": "adjustment.average",
    "calibrate": "chain",
    "calibrate_unit": "chain",
    "calibrate_without_survey": "chain",
    "convert": "calibration.convert",
    "lint": "calibration.lint",
    "max_point_distance": "calibration.convert",
    "open_recording": "recording.recording",
    "read_calibration": "calibration.files.formats",
    "read_cloud": "recording.cloud",
    "read_parameters": "exports",
    "read_scanner": "study.scanner_file",
    "read_station": "survey.station",
    "read_targets": "survey.targets",
    "residuals": "chain",
    "stream_points": "points.stream",
    "write_calibration": "exports",
}

__all__ = [*_PLACES, "__version__"]

if TYPE_CHECKING:
    __version__: str


def __getattr__(name: str) -> Any:
    """Import a public name, or look up the version, when it is used for the first time."""
    if name == "__version__":
        globals()[name] = import_module("importlib.metadata").version(__name__)
        return globals()[name]
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
