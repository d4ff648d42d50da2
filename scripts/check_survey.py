"""Check the survey, and the medians against it: a wrong survey stops the run here."""

from pathlib import Path

from velocal.calibration.files.formats import read_or_nominal
from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.scanner.beam import Beams
from velocal.scanner.models import scanner_named
from velocal.study.adjustment import Adjustment
from velocal.study.reduction import AssignmentLimits
from velocal.survey.checks.findings import columns, raise_errors
from velocal.survey.checks.run import Recorded, SurveyFiles, check_study
from velocal.survey.checks.tables import markdown, plane_columns
from velocal.survey.station import read_base, read_station
from velocal.survey.targets import read_targets


def main(
    *,
    planes: Path,
    base_scanner: Path,
    base_field: Path,
    covariance: Path | None,
    surveys: list[Path],
    medians: list[Path],
    calibrations: list[Path],
    checks: Path,
    planes_csv: Path,
    md: Path,
    positions: list[str],
    samples: list[str],
    windows: list[str],
    sample_positions: dict[str, str],
    scanners: dict[str, str],
    files_of: list[str],
    adjustments: dict[str, Adjustment],
    limits: AssignmentLimits,
    sigma_cm: float,
) -> None:
    """Write the findings and what every sample says of every plane, or stop with all errors.

    Files of a kind are in the order of what they are of: `surveys` of `positions`, `medians` of
    `samples` and `windows`, `calibrations` of the scanners `files_of`. `scanners` are by position.
    """
    stations = dict(zip(positions, map(read_station, surveys), strict=True))
    survey = SurveyFiles(
        planes=read_targets(planes, "plane"),
        base_scanner=read_targets(base_scanner, "scanner"),
        base_site={name: read_base(base_field, name, covariance) for name in positions},
        stations=stations,
        where=(str(planes), str(base_scanner), str(base_field)),
    )
    known = dict(zip(files_of, calibrations, strict=True))
    beams: dict[str, dict[str, Beams]] = {}
    for sample, window, path in zip(samples, windows, medians, strict=True):
        rows, facts = storage.read_table(path, schemas.MEDIANS)
        scanner = scanner_named(scanners[sample_positions[sample]])
        rate = facts["rotation_rate_hz"]
        beams.setdefault(sample, {})[window] = Beams.from_ticks(rows, scanner, rate)
    recorded = []
    for sample, by_window in beams.items():
        position = sample_positions[sample]
        name = scanners[position]
        scanner = scanner_named(name)
        factory = read_or_nominal(known.get(name), scanner)
        stochastic = adjustments[name].stochastic()
        recorded.append(
            Recorded(sample, position, scanner, factory, name in known, stochastic, by_window)
        )
    found = check_study(survey, recorded, limits=limits.metric(), sigma_m=sigma_cm * 1e-2)
    raise_errors(found.findings)
    storage.write_csv(checks, columns(found.findings))
    storage.write_csv(planes_csv, plane_columns(found.planes))
    storage.write_text(md, markdown(found))


if "snakemake" in globals():
    run(main, snakemake)
