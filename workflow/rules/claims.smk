# Drift over the windows of a position; claims of the paper that no table or figure answers, and
# what is needed to judge them.
#
# in:   assigned medians, recordings (their temperature), adjustments, statistics, outdoor samples;
#       the truth, if the world is simulated: offsets are compared with it
# out:  {results}/drift/lasers.csv        change of every laser in every window of a position
#       {results}/drift/summary.csv       its mean and scatter, with the temperature of the scanner
#       {results}/drift/temperature.csv   how the mean follows the temperature
#       {results}/drift/drift.{svg,png}
#       {results}/calibrations/{scanner}/{calibration}.drift.{csv,svg,png}   changes between the
#                                         windows of a position, for surveyed calibrations
#       {results}/published/claims.{csv,md}          every claim with what was computed and a verdict
#       {results}/published/light.{csv,svg,png}      samples with and without light, per laser
#       {results}/published/offsets.{csv,svg,png}    voff and hoff adjusted too, per laser

from velocal.paper.claims import LIGHT

CLAIM_FILES = [
    *expand(
        f"{RESULTS}/published/{{stem}}.{{suffix}}",
        stem=("light", "offsets"),
        suffix=("csv", "svg", "png"),
    ),
    f"{RESULTS}/published/claims.csv",
    f"{RESULTS}/published/claims.md",
    *expand(
        f"{RESULTS}/drift/{{name}}",
        name=("lasers.csv", "summary.csv", "temperature.csv", "drift.svg", "drift.png"),
    ),
]
CLAIM_FILES = CLAIM_FILES if SETTINGS.compare_with_paper else []
SURVEYED = list(STUDY.surveyed)
# Surveyed calibrations, whose windows are compared, their samples, and the files of these.
UNITS = [
    (scanner, name) for scanner, sets in STUDY.calibrations.items() for name in sets
]
SURVEYED_UNITS = [f"{scanner}/{name}" for scanner, name in UNITS]
OF_UNITS = [list(STUDY.calibrations[scanner][name]) for scanner, name in UNITS]
OF_UNIT_DRIFT = {
    "assigned": [
        per_window(f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet", names)
        for names in OF_UNITS
    ],
    "surveys": [
        at_positions(f"{RESULTS}/survey/{{position}}.json", names) for names in OF_UNITS
    ],
    "recordings": [recordings_of(names) for names in OF_UNITS],
    "rotations": [
        expand(f"{RESULTS}/recordings/{{sample}}/rotations.parquet", sample=names)
        for names in OF_UNITS
    ],
}
UNIT_DRIFT_FILES = expand(
    f"{RESULTS}/calibrations/{{unit}}.drift.{{suffix}}",
    unit=SURVEYED_UNITS,
    suffix=("csv", "svg", "png"),
)
LIGHT_SAMPLES = (
    [name for pair in LIGHT for name in pair] if SETTINGS.compare_with_paper else []
)


rule measure_drift:
    input:
        assigned=per_window(
            f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet", SURVEYED
        ),
        surveys=expand(f"{RESULTS}/survey/{{position}}.json", position=STUDY.positions),
        recordings=recordings_of(SURVEYED),
        rotations=expand(
            f"{RESULTS}/recordings/{{sample}}/rotations.parquet", sample=SURVEYED
        ),
        factories=list(STUDY.factory_files.values()),
    output:
        lasers=f"{RESULTS}/drift/lasers.csv",
        summary=f"{RESULTS}/drift/summary.csv",
        temperature=f"{RESULTS}/drift/temperature.csv",
        svg=f"{RESULTS}/drift/drift.svg",
        png=f"{RESULTS}/drift/drift.png",
    log:
        f"{RESULTS}/logs/measure_drift.log",
    params:
        samples=samples_per_window(SURVEYED),
        windows=[window for name in SURVEYED for window in STUDY.samples[name].windows],
        names=SURVEYED,
        scanners=[STUDY.samples[name].scanner for name in SURVEYED],
        positions=[STUDY.samples[name].position for name in SURVEYED],
        ports=[STUDY.samples[name].port for name in SURVEYED],
        addresses=[STUDY.samples[name].address for name in SURVEYED],
        factory_scanners=list(STUDY.factory_files),
        length=lambda wildcards: SETTINGS.windows.rotations,
        simulated=bool(WORLD),
    script:
        "../../scripts/measure_drift.py"


rule measure_unit_drift:
    input:
        assigned=grouped(OF_UNIT_DRIFT["assigned"]),
        surveys=grouped(OF_UNIT_DRIFT["surveys"]),
        recordings=grouped(OF_UNIT_DRIFT["recordings"]),
        rotations=grouped(OF_UNIT_DRIFT["rotations"]),
        judged=[f"{RESULTS}/calibrations/{unit}.json" for unit in SURVEYED_UNITS],
    output:
        csv=[f"{RESULTS}/calibrations/{unit}.drift.csv" for unit in SURVEYED_UNITS],
        svg=[f"{RESULTS}/calibrations/{unit}.drift.svg" for unit in SURVEYED_UNITS],
        png=[f"{RESULTS}/calibrations/{unit}.drift.png" for unit in SURVEYED_UNITS],
    log:
        f"{RESULTS}/logs/measure_unit_drift.log",
    params:
        taken=taken(**OF_UNIT_DRIFT),
        scanner=[scanner for scanner, _ in UNITS],
        unit=[name for _, name in UNITS],
        samples=[samples_per_window(names) for names in OF_UNITS],
        windows=[
            [window for name in names for window in STUDY.samples[name].windows]
            for names in OF_UNITS
        ],
        names=OF_UNITS,
        positions=[
            [STUDY.surveyed[name].position for name in names] for names in OF_UNITS
        ],
        ports=[[STUDY.samples[name].port for name in names] for names in OF_UNITS],
        addresses=[
            [STUDY.samples[name].address for name in names] for names in OF_UNITS
        ],
        length=lambda wildcards: SETTINGS.windows.rotations,
        simulated=bool(WORLD),
    script:
        "../../scripts/measure_unit_drift.py"


rule adjust_offsets:
    input:
        assigned=per_window(
            f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet", SURVEYED
        ),
        surveys=expand(f"{RESULTS}/survey/{{position}}.json", position=STUDY.positions),
        factories=list(STUDY.factory_files.values()),
        truths=expand(
            f"{RESULTS}/simulation/truth/{{scanner}}.csv",
            scanner=STUDY.scanners if WORLD else (),
        ),
    output:
        csv=f"{RESULTS}/published/offsets.csv",
        svg=f"{RESULTS}/published/offsets.svg",
        png=f"{RESULTS}/published/offsets.png",
    log:
        f"{RESULTS}/logs/adjust_offsets.log",
    params:
        samples=samples_per_window(SURVEYED),
        positions=positions_per_window(SURVEYED),
        scanners=[STUDY.samples[name].scanner for name in samples_per_window(SURVEYED)],
        factory_scanners=list(STUDY.factory_files),
        truth_scanners=STUDY.scanners if WORLD else [],
        adjustment={name: STUDY.adjustment(name).plain() for name in STUDY.scanners},
        simulated=bool(WORLD),
    script:
        "../../scripts/adjust_offsets.py"


rule compare_light:
    input:
        adjustments=per_window(
            f"{RESULTS}/adjustment/{{sample}}/{{window}}.csv", LIGHT_SAMPLES
        ),
        covariances=per_window(
            f"{RESULTS}/adjustment/{{sample}}/{{window}}.covariance.csv", LIGHT_SAMPLES
        ),
        calibration=(
            factory_path(STUDY.samples[LIGHT_SAMPLES[0]].scanner)
            if LIGHT_SAMPLES
            else []
        ),
    output:
        csv=f"{RESULTS}/published/light.csv",
        svg=f"{RESULTS}/published/light.svg",
        png=f"{RESULTS}/published/light.png",
    log:
        f"{RESULTS}/logs/compare_light.log",
    params:
        samples=samples_per_window(LIGHT_SAMPLES),
        scanner=lambda wildcards: STUDY.samples[LIGHT_SAMPLES[0]].scanner,
        simulated=bool(WORLD),
    script:
        "../../scripts/compare_light.py"


rule judge_claims:
    input:
        light=f"{RESULTS}/published/light.csv",
        offsets=f"{RESULTS}/published/offsets.csv",
        lasers=f"{RESULTS}/statistics/lasers.csv",
        summary=f"{RESULTS}/statistics/summary.csv",
        outdoor_samples=f"{RESULTS}/outdoor/summary.csv",
        outdoor_means=f"{RESULTS}/outdoor/means.csv",
        drift=f"{RESULTS}/drift/lasers.csv",
    output:
        claims=f"{RESULTS}/published/claims.csv",
        claims_md=f"{RESULTS}/published/claims.md",
    log:
        f"{RESULTS}/logs/judge_claims.log",
    localrule: True
    params:
        tables=SETTINGS.plain()["tables"],
        sigma_cm=lambda wildcards: STUDY.sigma_cm(*STUDY.scanners),
        simulated=bool(WORLD),
    script:
        "../../scripts/judge_claims.py"
