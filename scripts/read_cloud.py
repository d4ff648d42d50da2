"""Read a cloud of points as returns and their medians, as packets are decoded and reduced."""

from pathlib import Path

from velocal.calibration.files import formats
from velocal.io import storage
from velocal.io.scripts import run
from velocal.recording import cloud
from velocal.recording.medians import write_reduced
from velocal.recording.motion import check_cloud_standing
from velocal.recording.returns import table_facts
from velocal.study.scanner_file import scanner_of


def main(
    *,
    recording: Path,
    calibration: Path | None,
    description: Path | None,
    ledger: Path,
    returns: Path,
    medians: Path,
    scanner: str,
    dialect: str,
    frame: str | None,
    address: str | None,
    azimuth_bin_ticks: int,
    min_count: int,
) -> None:
    """Write the returns and their medians as Parquet, and what was used of the cloud as JSON."""
    known = scanner_of(description or scanner)
    numbers = None if calibration is None else formats.read_for(calibration, known)
    found = cloud.read_cloud(recording, known, numbers, dialect=dialect, frame=frame, topic=address)
    check_cloud_standing(found.returns, str(recording))
    rotations, rate_hz = found.rotations, found.returns.rotation_rate_hz
    facts = table_facts(known, rotations, rate_hz, "points")
    limits = {"bin_ticks": azimuth_bin_ticks, "min_count": min_count}
    write_reduced([found.returns], facts, returns, medians, known, **limits)
    storage.write_json(ledger, {"file": recording.name, "scanner": scanner, **found.as_dict()})


if "snakemake" in globals():
    run(main, snakemake)
