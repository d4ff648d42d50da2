"""A small folder as a user has it: a capture, the factory's file and the files of a survey."""

from pathlib import Path

from support.chain import study_world
from velocal.calibration.files import formats
from velocal.io import storage
from velocal.simulation import capture, truth
from velocal.simulation.survey import field_book
from velocal.survey.network.survey import adjust_field_book
from velocal.survey.station import adjust_station
from velocal.survey.targets import write_targets

SCANNER, POSITION = "HDL-32E", "P5"


def write_example(folder: Path) -> None:
    """Write capture.bin, factory.xml, the three files of the survey, and station.json."""
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
