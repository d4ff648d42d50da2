# Residuals before and after. All windows of a sample are one job, and the maps of all samples.
#
# in:   assigned medians and the window's own adjustment (calibration data), or the calibration
#       of the unit where the study has no parameter sets;
#       single rotations of the recording, outside the windows, and every parameter set and
#       calibration (validation)
# out:  {results}/residuals/{sample}/{window}.parquet               s of every median
#       {results}/residual_maps/{sample}.{parquet,svg,png}          mean s along the azimuth, before
#                                                                   and after
#       {results}/statistics/calibration/{sample}/{window}.csv      per laser, before and after
#       {results}/statistics/validation/{sample}/{window}.csv       per laser, before and each set
#       {results}/statistics/lasers.csv, summary.csv                all of them; one row a window


STATISTICS_FILES = expand(
    f"{RESULTS}/statistics/{{name}}.csv",
    name=("lasers", "summary") if STUDY.surveyed else (),
)


# Samples whose residuals are mapped: with those of no calibration there would be no "after".
MAPPED = [
    name for name, sample in STUDY.surveyed.items() if STUDY.candidates(sample.scanner)
]
MAPPED_ON = [STUDY.surveyed[name].scanner for name in MAPPED]
OF_MAPS = {
    "assigned": [
        per_window(f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet", [name])
        for name in MAPPED
    ],
    "calibration": factory_paths(MAPPED_ON),
}


rule residuals_calibration:
    input:
        assigned=of_windows(f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet"),
        adjusted=adjusted_on,
        survey=lambda wildcards: f"{RESULTS}/survey/{sample_of(wildcards).position}.json",
        calibration=calibration_file,
    output:
        residuals=of_windows(f"{RESULTS}/residuals/{{sample}}/{{window}}.parquet"),
        statistics=of_windows(
            f"{RESULTS}/statistics/calibration/{{sample}}/{{window}}.csv"
        ),
    log:
        f"{RESULTS}/logs/residuals_calibration/{{sample}}.log",
    params:
        window=windows_of,
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        unit=lambda wildcards: unit_of(wildcards),
        sigma_cm=lambda wildcards: STUDY.sigma_cm(sample_of(wildcards).scanner),
        near_points=SETTINGS.joint.near_points,
    script:
        "../../scripts/residuals_calibration.py"


rule residuals_validation:
    input:
        recording=lambda wildcards: recording_of(sample_of(wildcards)),
        rotations=f"{RESULTS}/recordings/{{sample}}/rotations.parquet",
        survey=lambda wildcards: f"{RESULTS}/survey/{sample_of(wildcards).position}.json",
        calibration=calibration_file,
        sets=lambda wildcards: expand(
            f"{RESULTS}/parameter_sets/{{scanner}}/{{parameter_set}}.csv",
            scanner=sample_of(wildcards).scanner,
            parameter_set=STUDY.candidates(sample_of(wildcards).scanner),
        ),
    output:
        statistics=of_windows(
            f"{RESULTS}/statistics/validation/{{sample}}/{{window}}.csv"
        ),
    log:
        f"{RESULTS}/logs/residuals_validation/{{sample}}.log",
    params:
        window=windows_of,
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        port=lambda wildcards: sample_of(wildcards).port,
        address=lambda wildcards: sample_of(wildcards).address,
        which=SETTINGS.reduction.which,
        length=lambda wildcards: SETTINGS.windows.rotations,
        candidates=lambda wildcards: list(
            STUDY.candidates(sample_of(wildcards).scanner)
        ),
        units=lambda wildcards: list(
            STUDY.calibrations.get(sample_of(wildcards).scanner, {})
        ),
        limits=lambda wildcards: STUDY.assignment.limits.plain(),
        validation=lambda wildcards: STUDY.validation.plain(),
        sigma_cm=lambda wildcards: STUDY.sigma_cm(sample_of(wildcards).scanner),
        near_points=SETTINGS.joint.near_points,
    script:
        "../../scripts/residuals_validation.py"


rule summarise_statistics:
    input:
        statistics=[
            path
            for stage in ("calibration", "validation")
            for path in per_window(
                f"{RESULTS}/statistics/{stage}/{{sample}}/{{window}}.csv",
                STUDY.surveyed,
            )
        ],
    output:
        lasers=f"{RESULTS}/statistics/lasers.csv",
        summary=f"{RESULTS}/statistics/summary.csv",
    log:
        f"{RESULTS}/logs/summarise_statistics.log",
    localrule: True
    script:
        "../../scripts/summarise_statistics.py"


rule map_residuals:
    input:
        assigned=grouped(OF_MAPS["assigned"]),
        survey=at_positions(f"{RESULTS}/survey/{{position}}.json", MAPPED),
        calibration=grouped(OF_MAPS["calibration"]),
        adjusted=[
            f"{RESULTS}/parameter_sets/{scanner}/{STUDY.shown(scanner)}.csv"
            for scanner in MAPPED_ON
        ],
    output:
        residuals=expand(f"{RESULTS}/residual_maps/{{sample}}.parquet", sample=MAPPED),
        svg=expand(f"{RESULTS}/residual_maps/{{sample}}.svg", sample=MAPPED),
        png=expand(f"{RESULTS}/residual_maps/{{sample}}.png", sample=MAPPED),
    log:
        f"{RESULTS}/logs/map_residuals.log",
    params:
        taken=taken(**OF_MAPS),
        sample=MAPPED,
        scanner=MAPPED_ON,
        after=[STUDY.shown(scanner) for scanner in MAPPED_ON],
        is_unit=[scanner in STUDY.calibrations for scanner in MAPPED_ON],
        near_points=SETTINGS.joint.near_points,
        sigma_cm=[STUDY.sigma_cm(scanner) for scanner in MAPPED_ON],
        simulated=bool(WORLD),
    script:
        "../../scripts/map_residuals.py"
