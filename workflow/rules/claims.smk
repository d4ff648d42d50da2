# Claims of the paper that no table or figure answers, and what is needed to judge them.
#
# in:   assigned medians, recordings (their temperature), adjustments, statistics, outdoor samples;
#       the truth, if the world is simulated: offsets are compared with it
# out:  {results}/drift/lasers.csv        change of every laser in every window of a position
#       {results}/drift/summary.csv       its mean and scatter, with the temperature of the scanner
#       {results}/drift/temperature.csv   how the mean follows the temperature
#       {results}/drift/drift.{svg,png}
#       {results}/published/claims.{csv,md}          every claim with what was computed and a verdict
#       {results}/published/light.{csv,svg,png}      samples with and without light, per laser
#       {results}/published/offsets.{csv,svg,png}    voff and hoff adjusted too, per laser

DRIFT_FILES = (
    expand(
        f"{RESULTS}/drift/{{name}}",
        name=("lasers.csv", "summary.csv", "temperature.csv", "drift.svg", "drift.png"),
    )
    if SETTINGS.compare_with_paper
    else []
)
CLAIM_FILES = (
    expand(
        f"{RESULTS}/published/{{name}}",
        name=(
            "claims.csv",
            "claims.md",
            *(
                f"{stem}.{suffix}"
                for stem in ("light", "offsets")
                for suffix in ("csv", "svg", "png")
            ),
        ),
    )
    if SETTINGS.compare_with_paper
    else []
)
SURVEYED = list(STUDY.surveyed)


rule measure_drift:
    input:
        assigned=per_window(
            f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet", SURVEYED
        ),
        surveys=expand(f"{RESULTS}/survey/{{position}}.json", position=STUDY.positions),
        recordings=[STUDY.samples[name].recording for name in SURVEYED],
        rotations=expand(
            f"{RESULTS}/recordings/{{sample}}/rotations.parquet", sample=SURVEYED
        ),
        factories=[path for path in STUDY.factories.values() if path != NOMINAL],
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
        factory_scanners=[
            name for name, path in STUDY.factories.items() if path != NOMINAL
        ],
        length=lambda wildcards: SETTINGS.windows.rotations,
        simulated=bool(WORLD),
    script:
        "../../scripts/measure_drift.py"


rule judge_claims:
    input:
        assigned=per_window(
            f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet", SURVEYED
        ),
        adjustments=per_window(
            f"{RESULTS}/adjustment/{{sample}}/{{window}}.csv", SURVEYED
        ),
        covariances=per_window(
            f"{RESULTS}/adjustment/{{sample}}/{{window}}.covariance.csv", SURVEYED
        ),
        surveys=expand(f"{RESULTS}/survey/{{position}}.json", position=STUDY.positions),
        factories=[path for path in STUDY.factories.values() if path != NOMINAL],
        truths=expand(
            f"{RESULTS}/simulation/truth/{{scanner}}.csv",
            scanner=STUDY.scanners if WORLD else (),
        ),
        lasers=f"{RESULTS}/statistics/lasers.csv",
        summary=f"{RESULTS}/statistics/summary.csv",
        outdoor_samples=f"{RESULTS}/outdoor/summary.csv",
        outdoor_means=f"{RESULTS}/outdoor/means.csv",
        drift=f"{RESULTS}/drift/lasers.csv",
    output:
        claims=f"{RESULTS}/published/claims.csv",
        claims_md=f"{RESULTS}/published/claims.md",
        light_csv=f"{RESULTS}/published/light.csv",
        light_svg=f"{RESULTS}/published/light.svg",
        light_png=f"{RESULTS}/published/light.png",
        offsets_csv=f"{RESULTS}/published/offsets.csv",
        offsets_svg=f"{RESULTS}/published/offsets.svg",
        offsets_png=f"{RESULTS}/published/offsets.png",
    log:
        f"{RESULTS}/logs/judge_claims.log",
    params:
        samples=samples_per_window(SURVEYED),
        positions=positions_per_window(SURVEYED),
        scanners=[STUDY.samples[name].scanner for name in samples_per_window(SURVEYED)],
        factory_scanners=[
            name for name, path in STUDY.factories.items() if path != NOMINAL
        ],
        truth_scanners=STUDY.scanners if WORLD else [],
        adjustment={name: STUDY.adjustment(name).plain() for name in STUDY.scanners},
        tables=SETTINGS.plain()["tables"],
        sigma_cm=lambda wildcards: STUDY.validation.sigma_cm,
        simulated=bool(WORLD),
    script:
        "../../scripts/judge_claims.py"
