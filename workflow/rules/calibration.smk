# From medians on surveyed planes to parameter sets.
#
# in:   medians of a window, planes of its position, the factory's calibration
# out:  {results}/assigned/{sample}/{window}.parquet       medians with the plane that each hit
#       {results}/adjustment/{sample}/{window}.csv         corrections, their standard deviation,
#                                                          rank and quality, per laser
#       {results}/adjustment/{sample}/{window}.covariance.csv   all covariances, by source
#       {results}/parameter_sets/{scanner}/{set}.*         csv and json (all that is known),
#                                                          yaml and db.xml for drivers (`export`)
#       {results}/parameter_sets/{scanner}/{set}.scatter.csv   means, plain and weighted; scatter of
#                                                          the samples against what is stated


SETS = [
    f"{RESULTS}/parameter_sets/{scanner}/{name}"
    for scanner, sets in STUDY.parameter_sets.items()
    for name in sets
]
SET_FILES = expand("{path}.{suffix}", path=SETS, suffix=("csv", "yaml", "xml"))


rule assign_medians:
    input:
        medians=f"{RESULTS}/medians/{{sample}}/{{window}}.parquet",
        survey=lambda wildcards: f"{RESULTS}/survey/{sample_of(wildcards).position}.json",
        calibration=calibration_file,
    output:
        assigned=f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet",
    log:
        f"{RESULTS}/logs/assign_medians/{{sample}}.{{window}}.log",
    params:
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        limits=lambda wildcards: STUDY.assignment.limits.plain(),
    script:
        "../../scripts/assign_medians.py"


rule adjust_lasers:
    input:
        assigned=f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet",
        survey=lambda wildcards: f"{RESULTS}/survey/{sample_of(wildcards).position}.json",
        calibration=calibration_file,
        # Nothing is adjusted with a wrong survey; what the checks say changes no adjustment.
        checks=ancient(CHECKS),
    output:
        adjustment=f"{RESULTS}/adjustment/{{sample}}/{{window}}.csv",
        covariance=f"{RESULTS}/adjustment/{{sample}}/{{window}}.covariance.csv",
    log:
        f"{RESULTS}/logs/adjust_lasers/{{sample}}.{{window}}.log",
    params:
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        config=lambda wildcards: STUDY.adjustment(sample_of(wildcards).scanner).plain(),
    script:
        "../../scripts/adjust_lasers.py"


rule average_set:
    input:
        adjustments=lambda wildcards: per_window(
            f"{RESULTS}/adjustment/{{sample}}/{{window}}.csv",
            samples_of_set(wildcards),
        ),
        covariances=lambda wildcards: per_window(
            f"{RESULTS}/adjustment/{{sample}}/{{window}}.covariance.csv",
            samples_of_set(wildcards),
        ),
        calibration=lambda wildcards: factory_path(wildcards.scanner),
    output:
        csv=f"{RESULTS}/parameter_sets/{{scanner}}/{{parameter_set}}.csv",
        json=f"{RESULTS}/parameter_sets/{{scanner}}/{{parameter_set}}.json",
        yaml=f"{RESULTS}/parameter_sets/{{scanner}}/{{parameter_set}}.yaml",
        xml=f"{RESULTS}/parameter_sets/{{scanner}}/{{parameter_set}}.xml",
        scatter=f"{RESULTS}/parameter_sets/{{scanner}}/{{parameter_set}}.scatter.csv",
    log:
        f"{RESULTS}/logs/average_set/{{scanner}}.{{parameter_set}}.log",
    localrule: True
    params:
        weights=lambda wildcards: STUDY.average,
        samples=lambda wildcards: samples_per_window(samples_of_set(wildcards)),
        positions=lambda wildcards: positions_per_window(samples_of_set(wildcards)),
        export=SETTINGS.export.plain(),
    script:
        "../../scripts/average_set.py"
