# What people look at.
#
# All tables are one job.
#
# in:   {results}/statistics/*.csv, figures, ledgers
# out:  {results}/tables/table_{2,3,4,5}.{csv,md,tex}   with the parameter set that each row shows
#       {results}/published/agreement.csv    every printed entry beside the reproduced one
#       {results}/published/misses.csv       those outside their tolerance, with the known reason;
#                                            the run fails if another one is outside
#       {results}/ro-crate-metadata.json     the run as a Research Object Crate; on demand
#       {results}/report.html                all of it on one page that needs no network; it is
#                                            written before that check, and shows what fails

from velocal.paper.printed import KNOWN_MISSES

TABLE_FILES = table_files("csv", "md", "tex")
AGREEMENT = f"{RESULTS}/published/agreement.csv" if SETTINGS.compare_with_paper else []
CLAIMS = f"{RESULTS}/published/claims.csv" if SETTINGS.compare_with_paper else []
ROTATIONS = SETTINGS.simulation.rotations if SETTINGS.simulation else None
MISSES = f"{RESULTS}/published/misses.csv" if SETTINGS.compare_with_paper else []


rule make_table:
    input:
        summary=f"{RESULTS}/statistics/summary.csv",
    output:
        csv=in_report("table", "Tables", table_files("csv")),
        md=table_files("md"),
        tex=table_files("tex"),
    log:
        f"{RESULTS}/logs/make_table.log",
    localrule: True
    params:
        table=list(SETTINGS.tables),
        selection=[each.plain() for each in SETTINGS.tables.values()],
        simulated=bool(WORLD),
        of_paper=SETTINGS.compare_with_paper,
    script:
        "../../scripts/make_table.py"


rule compare_with_paper:
    input:
        tables=table_files("csv"),
        summary=f"{RESULTS}/statistics/summary.csv",
        surveys=expand(f"{RESULTS}/survey/{{position}}.json", position=STUDY.positions),
        accuracy=f"{RESULTS}/survey/network.csv",
        facts=[f"{RESULTS}/outdoor/facts.csv", f"{RESULTS}/map/summary.csv"],
    output:
        agreement=f"{RESULTS}/published/agreement.csv",
    log:
        f"{RESULTS}/logs/compare_with_paper.log",
    localrule: True
    script:
        "../../scripts/compare_with_paper.py"


rule check_agreement:
    input:
        agreement=f"{RESULTS}/published/agreement.csv",
        known=KNOWN_MISSES,
        report=f"{RESULTS}/report.html",  # written first, so that it exists if this fails
    output:
        misses=f"{RESULTS}/published/misses.csv",
    log:
        f"{RESULTS}/logs/check_agreement.log",
    localrule: True
    params:
        rotations=ROTATIONS,
    script:
        "../../scripts/check_agreement.py"


rule write_report:
    input:
        ledgers=expand(
            f"{RESULTS}/recordings/{{sample}}/ledger.json",
            sample=[*STUDY.samples, *STUDY.outdoor],
        ),
        agreement=AGREEMENT,
        claims=CLAIMS,
        listed_misses=KNOWN_MISSES if AGREEMENT else [],
        summary=f"{RESULTS}/statistics/summary.csv" if STUDY.surveyed else [],
        surveys=expand(f"{RESULTS}/survey/{{position}}.json", position=STUDY.positions),
        checks=CHECKS if STUDY.surveyed else [],
        maps=expand(
            f"{RESULTS}/residual_maps/{{sample}}.parquet",
            sample=[*MAPPED, *UNSURVEYED_MAPS],
        ),
        map_pictures=expand(
            f"{RESULTS}/residual_maps/{{sample}}.png",
            sample=[*MAPPED, *UNSURVEYED_MAPS],
        ),
        interior=f"{RESULTS}/map/points.parquet" if MAPS else [],
        sets=expand("{path}.csv", path=SETS),
        exports=expand("{path}.exports.csv", path=SETS),
        factories=list(STUDY.factory_files.values()),
        pictures=figure_files(FIGURES, ["png"]),
        numbers=figure_files(FIGURES, ["csv"]),
        certificate=f"{RESULTS}/certificate.json" if CALIBRATIONS else [],
        methods_csv=f"{RESULTS}/methods/comparison.csv" if METHODS else [],
        methods_png=f"{RESULTS}/methods/comparison.png" if METHODS else [],
        field_table=f"{RESULTS}/field/table.csv" if STUDY.unsurveyed else [],
        field_pictures=expand(
            f"{RESULTS}/field/{{sample}}/planes.png", sample=STUDY.unsurveyed
        ),
        unit_pictures=expand(
            f"{RESULTS}/calibrations/{{unit}}.png", unit=UNSURVEYED_UNITS
        ),
        unit_tables=expand(
            f"{RESULTS}/calibrations/{{unit}}.more.csv", unit=UNSURVEYED_UNITS
        ),
        drift_pictures=expand(
            f"{RESULTS}/calibrations/{{unit}}.drift.png",
            unit=[*SURVEYED_UNITS, *TIMED_UNITS],
        ),
        outdoor=f"{RESULTS}/outdoor/means.csv" if STUDY.outdoor else [],
        outdoor_pictures=figure_files(OUTDOOR_FIGURES, ["png"]),
        outdoor_numbers=figure_files(OUTDOOR_FIGURES, ["csv"]),
    output:
        report_html=in_report("page", "Report", f"{RESULTS}/report.html"),
    log:
        f"{RESULTS}/logs/write_report.log",
    localrule: True
    params:
        title=SETTINGS.study,
        simulated=bool(WORLD),
        rotations=ROTATIONS,
        tables=SETTINGS.plain()["tables"],
        figures=SETTINGS.plain()["figures"],
        samples=[*STUDY.samples, *STUDY.outdoor],
        scanners=list(STUDY.factories),
        range_sigma_m={
            scanner: STUDY.scanner(scanner).range_sigma_m
            for scanner, _ in STUDY.calibration_names
        },
        factory_scanners=list(STUDY.factory_files),
        set_scanners=[
            scanner for scanner in STUDY.scanners for _ in STUDY.candidates(scanner)
        ],
        set_names=[
            name for scanner in STUDY.scanners for name in STUDY.candidates(scanner)
        ],
        field_samples=list(STUDY.unsurveyed),
        unsurveyed_units=UNSURVEYED_UNITS,
        timed_units=[*SURVEYED_UNITS, *TIMED_UNITS],
        outdoor_figures=SETTINGS.plain()["outdoor"]["figures"] if OUTDOOR else {},
    script:
        "../../scripts/write_report.py"


# Not part of `all`, as it holds the day of the run; `make crate` asks for it.
rule describe_run:
    input:
        handed_over=list(GIVEN),
        made=lambda wildcards: with_all_before(TARGETS),
    output:
        metadata=f"{RESULTS}/ro-crate-metadata.json",
    log:
        f"{RESULTS}/logs/describe_run.log",
    localrule: True
    params:
        title=SETTINGS.study,
        simulated=bool(WORLD),
    script:
        "../../scripts/describe_run.py"
