# From observations or surveyed targets to the planes in the frame of a scanner.
#
# in:   observations (points, polar and image observations, repeated coordinates), or survey files:
#       targets of the planes and of the scanner's base in the site frame, targets of the base in the
#       scanner frame
# out:  {results}/survey/{control,planes,base_field,base_scanner}.csv   adjusted from observations
#       {results}/survey/covariance.json  of all coordinates of a base, and of the planes
#       {results}/survey/network.csv     largest standard deviation of every kind of point
#       {results}/survey/network.json    redundancy, variance factor, tests, datum; points
#       {results}/survey/network.{svg,png}   plan with error ellipses
#       {results}/survey/{position}.json   transformation T_scanner_field with covariance and
#       residuals; planes with covariance, flatness and corners, in the scanner frame
#       {results}/survey/checks.{csv,md}   what the checks of the survey warn of; an error of the
#       survey, or of a recording against it, stops the run here
#       {results}/survey/checks_planes.csv   what every sample says of every plane


SURVEY, OBSERVATIONS = STUDY.coordinates, STUDY.observations
SURVEY_FILES = [f"{RESULTS}/survey/network.svg"] if STUDY.observations else []
CHECKS = f"{RESULTS}/survey/checks.csv"

if OBSERVATIONS:

    rule adjust_network:
        input:
            points=OBSERVATIONS.points,
            network=OBSERVATIONS.polar,
            images=OBSERVATIONS.images or [],
            base_sights=OBSERVATIONS.base_polar,
            base_readings=OBSERVATIONS.base_coordinates,
        output:
            control=f"{RESULTS}/survey/control.csv",
            planes=SURVEY.planes,
            base_field=SURVEY.base_site,
            base_scanner=SURVEY.base_scanner,
            covariance=f"{RESULTS}/survey/covariance.json",
            quality=f"{RESULTS}/survey/network.json",
            accuracy=f"{RESULTS}/survey/network.csv",
        log:
            f"{RESULTS}/logs/adjust_network.log",
        script:
            "../../scripts/adjust_network.py"

    rule draw_network:
        input:
            quality=rules.adjust_network.output.quality,
        output:
            svg=f"{RESULTS}/survey/network.svg",
            png=f"{RESULTS}/survey/network.png",
        log:
            f"{RESULTS}/logs/draw_network.log",
        params:
            simulated=bool(WORLD),
        script:
            "../../scripts/draw_network.py"


rule adjust_survey:
    input:
        planes=SURVEY.planes if SURVEY else [],
        base_scanner=SURVEY.base_scanner if SURVEY else [],
        base_field=SURVEY.base_site if SURVEY else [],
        covariance=f"{RESULTS}/survey/covariance.json" if OBSERVATIONS else [],
    output:
        survey=f"{RESULTS}/survey/{{position}}.json",
    log:
        f"{RESULTS}/logs/adjust_survey/{{position}}.log",
    localrule: True
    params:
        scanner=lambda wildcards: STUDY.positions[wildcards.position],
        names=lambda wildcards: list(STUDY.assignment.planes),
    script:
        "../../scripts/adjust_survey.py"


# A checkpoint, for the jobs that wait for it: see `after_checks`.
checkpoint check_survey:
    input:
        planes=SURVEY.planes if SURVEY else [],
        base_scanner=SURVEY.base_scanner if SURVEY else [],
        base_field=SURVEY.base_site if SURVEY else [],
        covariance=f"{RESULTS}/survey/covariance.json" if OBSERVATIONS else [],
        surveys=expand(f"{RESULTS}/survey/{{position}}.json", position=STUDY.positions),
        medians=per_window(
            f"{RESULTS}/medians/{{sample}}/{{window}}.parquet", STUDY.surveyed
        ),
        calibrations=list(STUDY.factory_files.values()),
    output:
        checks=CHECKS,
        planes_csv=f"{RESULTS}/survey/checks_planes.csv",
        md=f"{RESULTS}/survey/checks.md",
    log:
        f"{RESULTS}/logs/check_survey.log",
    params:
        positions=list(STUDY.positions),
        samples=samples_per_window(STUDY.surveyed),
        windows=[
            window for sample in STUDY.surveyed.values() for window in sample.windows
        ],
        sample_positions={
            name: sample.position for name, sample in STUDY.surveyed.items()
        },
        scanners=STUDY.positions,
        files_of=list(STUDY.factory_files),
        adjustments={name: STUDY.adjustment(name).plain() for name in STUDY.scanners},
        limits=lambda wildcards: STUDY.assignment.limits.plain(),
        sigma_cm=lambda wildcards: STUDY.sigma_cm(*STUDY.scanners),
    script:
        "../../scripts/check_survey.py"
