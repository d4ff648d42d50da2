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
# The recordings are short: index, decoding and planes of all of them are a single job.

OUTDOOR = SETTINGS.outdoor
OUTDOOR_FIGURES = OUTDOOR.figures if OUTDOOR else {}
# Recordings that are not handed over: name of the sample, and path.
SIMULATED_OUTDOOR = {
    name: f"{RESULTS}/simulation/recordings/{name}.bin"
    for name, sample in STUDY.outdoor.items()
    if sample.recording == f"{RESULTS}/simulation/recordings/{name}.bin"
}
# For each sample: the factory's calibration, and every parameter set and calibration.
OF_OUTDOOR = {
    "calibration": factory_paths([each.scanner for each in STUDY.outdoor.values()]),
    "sets": [
        expand(
            f"{RESULTS}/parameter_sets/{each.scanner}/{{name}}.csv",
            name=STUDY.candidates(each.scanner),
        )
        for each in STUDY.outdoor.values()
    ],
}


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
            recording=list(SIMULATED_OUTDOOR.values()),
        log:
            f"{RESULTS}/logs/simulate_outdoor.log",
        params:
            sample=list(SIMULATED_OUTDOOR),
            scanner=[STUDY.outdoor[name].scanner for name in SIMULATED_OUTDOOR],
            scene=[STUDY.outdoor[name].scene for name in SIMULATED_OUTDOOR],
            rotations=OUTDOOR.rotations if OUTDOOR else 0,
        script:
            "../../scripts/simulate_outdoor.py"


rule measure_panels:
    input:
        recording=[recording_of(each) for each in STUDY.outdoor.values()],
        calibration=grouped(OF_OUTDOOR["calibration"]),
        sets=grouped(OF_OUTDOOR["sets"]),
    output:
        ledger=expand(
            f"{RESULTS}/recordings/{{sample}}/ledger.json", sample=STUDY.outdoor
        ),
        panels=expand(f"{RESULTS}/outdoor/{{sample}}.csv", sample=STUDY.outdoor),
    log:
        f"{RESULTS}/logs/measure_panels.log",
    params:
        taken=taken(**OF_OUTDOOR),
        sample=[each.plain() for each in STUDY.outdoor.values()],
        candidates=[
            list(STUDY.candidates(each.scanner)) for each in STUDY.outdoor.values()
        ],
        units=[
            list(STUDY.calibrations.get(each.scanner, {}))
            for each in STUDY.outdoor.values()
        ],
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
        svg=figure_files(OUTDOOR_FIGURES, ["svg"]),
        png=in_report("figure", "Figures", figure_files(OUTDOOR_FIGURES, ["png"])),
        csv=figure_files(OUTDOOR_FIGURES, ["csv"]),
    log:
        f"{RESULTS}/logs/draw_panels.log",
    params:
        kind=[kind for kind, _ in OUTDOOR_FIGURES.values()],
        scanner=[scanner for _, scanner in OUTDOOR_FIGURES.values()],
        sigma_cm=[STUDY.sigma_cm(scanner) for _, scanner in OUTDOOR_FIGURES.values()],
        simulated=bool(WORLD),
    script:
        "../../scripts/draw_panels.py"
