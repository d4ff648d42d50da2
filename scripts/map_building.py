"""Map of an interior: one rotation per position, decoded and put in one frame."""

from pathlib import Path

from velocal.calibration.files import formats
from velocal.evaluation import interior_map
from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.recording.recording import open_recording
from velocal.scanner.models import scanner_named
from velocal.survey.targets import read_targets


def main(
    *,
    recordings: list[Path],
    base_map: Path,
    base_scanner: Path,
    calibration: Path | None,
    refined: Path,
    points: Path,
    positions: list[str],
    parameter_set: str,
    scanner: str,
) -> None:
    """Write the points with both calibrations as Parquet; `positions` has one per recording."""
    known = scanner_named(scanner)
    sets = [formats.read_or_nominal(calibration, known), formats.read(refined, known.n_lasers)]
    there = read_targets(base_map, "position")
    here = read_targets(base_scanner, "scanner").of(scanner, where=str(base_scanner))
    poses = [
        interior_map.scanner_pose(there.of(name, where=str(base_map)), here, where=str(base_map))
        for name in positions
    ]
    facts = {
        "positions": positions,
        "scanners_m": [pose.translation for pose in poses],
        "set": parameter_set,
    }
    with storage.table_writer(points, schemas.MAP, **facts) as writer:
        for number, (path, pose) in enumerate(zip(recordings, poses, strict=True)):
            recording = open_recording(path, known)
            first = interior_map.first_complete(recording.rotations.complete, str(path))
            beams = recording.returns(first).beams()
            writer.write(interior_map.rows(number, beams, sets, pose))


if "snakemake" in globals():
    run(main, snakemake)
