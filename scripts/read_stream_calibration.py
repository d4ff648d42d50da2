"""Take the factory's calibration from the status bytes of a recording."""

from pathlib import Path

from velocal.calibration.files import formats
from velocal.capture.source import SourceFilter
from velocal.errors import reported
from velocal.recording.scan import inspect


def main(recording: Path, calibration: Path, *, source: SourceFilter) -> None:
    """Write the calibration; every value as the wire holds it."""
    status = inspect(recording, source=source).status
    formats.write(calibration, status.calibration(str(recording)))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.recording),
            Path(snakemake.output.calibration),
            source=SourceFilter(snakemake.params.port, snakemake.params.address),
        )
