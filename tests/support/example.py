"""A small folder as a user has it: a capture, the factory's file and the files of a survey."""

from pathlib import Path

from support.chain import study_world
from velocal.calibration.files import formats
from velocal.io import storage
from velocal.points.files import cloud_writer
from velocal.points.stream import stream_points
from velocal.recording.recording import open_recording
from velocal.scanner.models import SCANNERS
from velocal.simulation import capture, truth
from velocal.simulation.survey import field_book
from velocal.survey.network.survey import adjust_field_book
from velocal.survey.station import adjust_station
from velocal.survey.targets import write_targets

SCANNER, POSITION = "HDL-32E", "P5"
#: As docs/file-formats.md shows it.
DESCRIBED = """\
name: ACME-4
lasers: 4
vertical_deg: [-9, -3, 3, 9]
azimuth_bin_deg: 0.2
range_sigma_m: 0.02
max_range_m: 100
"""


def write_example(folder: Path) -> None:
    """Write capture.bin, points.pcd of it, factory.xml, scanner.yaml, and files of the survey."""
    world = study_world()
    storage.write_blocks(
        folder / "capture.bin", capture.records(world, SCANNER, POSITION, "sa5", 10)
    )
    formats.write(folder / "factory.xml", truth.factory_parameters(world, SCANNER))
    survey = adjust_field_book(field_book(world))
    write_targets(folder / "planes.csv", "plane", [survey.planes])
    write_targets(folder / "base_scanner.csv", "scanner", [survey.base_scanner[SCANNER].targets])
    write_targets(folder / "base_field.csv", "position", [survey.base_site[POSITION]])
    station = adjust_station(
        folder / "planes.csv",
        folder / "base_scanner.csv",
        folder / "base_field.csv",
        position=POSITION,
        scanner=SCANNER,
    )
    storage.write_json(folder / "station.json", station.to_json())
    recording, factory = open_recording(folder / "capture.bin", SCANNER), folder / "factory.xml"
    with cloud_writer(folder / "points.pcd", shift=False, facts={}) as write:
        for columns in stream_points(
            recording, formats.read_or_nominal(factory, SCANNERS[SCANNER])
        ):
            write(columns)
    (folder / "scanner.yaml").write_text(DESCRIBED)
