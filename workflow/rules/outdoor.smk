# Outdoor validation: panels at 10 to 35 m, without a survey.
#
# in:   recordings of the outdoor samples, the factory's calibration, every parameter set of the
#       scanner; the world, for recordings that are simulated
# out:  {results}/recordings/{outdoor}/ledger.json  what was used, what not and why
#       {results}/outdoor/{outdoor}.csv             rms of s about the plane of every panel, with
#                                                   the factory's calibration and each set
#       {results}/outdoor/summary.csv, means.csv    one row per sample and calibration; their means
#       {results}/outdoor/facts.csv                 the means as items and values
#       {results}/figures/figure_NN.{svg,png,csv}   std against distance, all on one scale
#
# The recordings are short: index, decoding and planes of one are a single job.

OUTDOOR = SETTINGS.outdoor
OUTDOOR_FIGURES = OUTDOOR.figures if OUTDOOR else {}


wildcard_constraints:
    outdoor=one_of(STUDY.outdoor),


OUTDOOR_FILES = figure_files(OUTDOOR_FIGURES)
OUTDOOR_FILES += expand(
    f"{RESULTS}/outdoor/{{name}}.csv",
    name=("means", "summary") if STUDY.outdoor else (),
)


if WORLD:

    rule simulate_outdoor:
        input:
            world_file=WORLD,
        output:
            recording=f"{RESULTS}/simulation/recordings/{{outdoor}}.bin",
        log:
            f"{RESULTS}/logs/simulate_outdoor/{{outdoor}}.log",
        params:
            sample="{outdoor}",
            scanner=lambda wildcards: outdoor_sample(wildcards).scanner,
            scene=lambda wildcards: outdoor_sample(wildcards).scene,
            rotations=lambda wildcards: OUTDOOR.rotations,
        script:
            "../../scripts/simulate_outdoor.py"


rule measure_panels:
    input:
        recording=lambda wildcards: outdoor_sample(wildcards).recording,
        calibration=lambda wildcards: factory_path(outdoor_sample(wildcards).scanner),
        sets=lambda wildcards: expand(
            f"{RESULTS}/parameter_sets/{{scanner}}/{{parameter_set}}.csv",
            scanner=outdoor_sample(wildcards).scanner,
            parameter_set=STUDY.candidates(outdoor_sample(wildcards).scanner),
        ),
    output:
        ledger=f"{RESULTS}/recordings/{{outdoor}}/ledger.json",
        panels=f"{RESULTS}/outdoor/{{outdoor}}.csv",
    log:
        f"{RESULTS}/logs/measure_panels/{{outdoor}}.log",
    params:
        sample=lambda wildcards: outdoor_sample(wildcards).plain(),
        candidates=lambda wildcards: list(
            STUDY.candidates(outdoor_sample(wildcards).scanner)
        ),
        units=lambda wildcards: list(
            STUDY.calibrations.get(outdoor_sample(wildcards).scanner, {})
        ),
        boxes=lambda wildcards: OUTDOOR.plain()["panels"],
        fit=lambda wildcards: OUTDOOR.fit.plain(),
        near_points=SETTINGS.joint.near_points,
    script:
        "../../scripts/measure_panels.py"


rule summarise_outdoor:
    input:
        panels=expand(f"{RESULTS}/outdoor/{{sample}}.csv", sample=STUDY.outdoor),
    output:
        summary=f"{RESULTS}/outdoor/summary.csv",
        means=f"{RESULTS}/outdoor/means.csv",
        facts=f"{RESULTS}/outdoor/facts.csv",
    log:
        f"{RESULTS}/logs/summarise_outdoor.log",
    localrule: True
    script:
        "../../scripts/summarise_outdoor.py"


rule draw_panels:
    input:
        summary=f"{RESULTS}/outdoor/summary.csv",
    output:
        svg=f"{RESULTS}/figures/figure_{{figure}}.svg",
        png=f"{RESULTS}/figures/figure_{{figure}}.png",
        csv=f"{RESULTS}/figures/figure_{{figure}}.csv",
    log:
        f"{RESULTS}/logs/draw_panels/{{figure}}.log",
    wildcard_constraints:
        figure=one_of(OUTDOOR_FIGURES),
    params:
        kind=lambda wildcards: OUTDOOR_FIGURES[wildcards.figure][0],
        scanner=lambda wildcards: OUTDOOR_FIGURES[wildcards.figure][1],
        sigma_cm=lambda wildcards: STUDY.sigma_cm(OUTDOOR_FIGURES[wildcards.figure][1]),
        simulated=bool(WORLD),
    script:
        "../../scripts/draw_panels.py"
