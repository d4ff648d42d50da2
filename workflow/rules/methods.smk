# Methods of adjustment side by side: those of the literature, the paper's, and ours.
#
# in:   assigned medians of all windows of the samples of `methods`, the surveys of their positions,
#       the factory's calibration; the truth, if the world is simulated, for the errors against it
# out:  {results}/methods/comparison.{csv,md}    residuals on calibration data and on another
#                                                position, errors of the parameters, per method
#       {results}/methods/comparison.{svg,png}   the same as a picture
#       {results}/methods/coverage.csv           simulated worlds only: how often the stated 95 %
#                                                intervals cover the truth (Monte Carlo)
#
# The coverage is a property of the configuration and takes minutes: it is not part of `all`;
# `make coverage` or `snakemake coverage` asks for it.

METHODS = SETTINGS.methods
METHOD_SAMPLES = [*METHODS.calibration, *METHODS.other] if METHODS else []


METHOD_FILES = expand(
    f"{RESULTS}/methods/comparison.{{suffix}}",
    suffix=("csv", "md", "svg", "png") if METHODS else (),
)


rule compare_methods:
    input:
        assigned=per_window(
            f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet",
            METHOD_SAMPLES,
        ),
        surveys=[
            f"{RESULTS}/survey/{position}.json"
            for position, scanner in STUDY.positions.items()
            if METHODS and scanner == METHODS.scanner
        ],
        calibration=factory_path(METHODS.scanner) if METHODS else [],
        truth=(
            f"{RESULTS}/simulation/truth/{METHODS.scanner}.csv"
            if METHODS and WORLD
            else []
        ),
    output:
        csv=f"{RESULTS}/methods/comparison.csv",
        md=f"{RESULTS}/methods/comparison.md",
        svg=f"{RESULTS}/methods/comparison.svg",
        png=f"{RESULTS}/methods/comparison.png",
    log:
        f"{RESULTS}/logs/compare_methods.log",
    params:
        samples=samples_per_window(METHOD_SAMPLES),
        positions=positions_per_window(METHOD_SAMPLES),
        calibrate_on=lambda wildcards: list(METHODS.calibration),
        check_on=lambda wildcards: list(METHODS.other),
        scanner=lambda wildcards: METHODS.scanner,
        adjustment=lambda wildcards: STUDY.adjustment(METHODS.scanner).plain(),
        sigma_cm=lambda wildcards: STUDY.sigma_cm(METHODS.scanner),
        simulated=bool(WORLD),
    script:
        "../../scripts/compare_methods.py"


if WORLD and METHODS:

    rule coverage:
        input:
            world_file=WORLD,
        output:
            coverage=f"{RESULTS}/methods/coverage.csv",
        log:
            f"{RESULTS}/logs/coverage.log",
        params:
            adjustment={name: STUDY.adjustment(name).plain() for name in STUDY.scanners},
            runs=lambda wildcards: METHODS.runs,
        script:
            "../../scripts/coverage.py"
