"""Residuals of the medians that a window was adjusted on, before and after."""

from pathlib import Path

from velocal import schemas, storage
from velocal.adjustment.tabulate import read_corrections
from velocal.beam_model import points
from velocal.calibration_files.formats import read_or_nominal
from velocal.errors import reported
from velocal.sensors import scanner_named
from velocal.station import observations, patches_of
from velocal.validation import laser_statistics, statistics_table


def main(
    assigned: Path,
    adjustment: Path,
    survey: Path,
    calibration: Path | None,
    residuals: Path,
    statistics: Path,
    *,
    sample: str,
    window: str,
    scanner: str,
    sigma_cm: float,
) -> None:
    """Write s of every median as Parquet and its statistics per laser as CSV."""
    known = scanner_named(scanner)
    columns, facts = storage.read_table(assigned, schemas.ASSIGNED)
    data = observations(columns, patches_of(storage.read_json(survey)))
    factory = read_or_nominal(calibration, known)
    corrections, _, _ = read_corrections(storage.read_csv(adjustment))
    s = {
        "before": data.misclosure(factory),
        "after": data.misclosure(factory.corrected(corrections)),
    }
    xyz = points(data.distance_m, data.phi, data.laser_id, factory)
    rows = {name: columns[name] for name in ("laser_id", "plane")}
    rows |= {name: xyz[:, axis] for axis, name in enumerate(("x_m", "y_m", "z_m"))}
    rows |= {f"{name}_m": values for name, values in s.items()}
    storage.write_table(residuals, schemas.RESIDUALS, rows, **facts)
    heading = {"scanner": scanner, "sample": sample, "window": window, "data": "calibration"}
    per_laser = {
        name: laser_statistics(values, data.laser_id, known.n_lasers, sigma_cm * 1e-2)
        for name, values in s.items()
    }
    storage.write_csv(statistics, statistics_table(heading, per_laser))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        calibration = snakemake.input.calibration
        main(
            Path(snakemake.input.assigned),
            Path(snakemake.input.adjustment),
            Path(snakemake.input.survey),
            Path(calibration) if calibration else None,
            Path(snakemake.output.residuals),
            Path(snakemake.output.statistics),
            sample=snakemake.wildcards.sample,
            window=snakemake.wildcards.window,
            scanner=snakemake.params.scanner,
            sigma_cm=snakemake.params.sigma_cm,
        )
