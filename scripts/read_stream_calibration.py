"""Take the factory's calibration from the status bytes of a recording."""

from pathlib import Path

from velocal.calibration.files import formats
from velocal.capture.reading import Choice
from velocal.io.scripts import run
from velocal.recording.scan import inspect


def main(
    *,
    recording: Path,
    calibration: Path,
    port: int | None,
    address: str | None,
) -> None:
    """Write the calibration; every value as the wire holds it."""
    status = inspect(recording, choice=Choice(port, address)).status
    formats.write(calibration, status.calibration(str(recording)))


if "snakemake" in globals():
    run(main, snakemake)
