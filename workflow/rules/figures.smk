# Figures of what was found, and drawings of how it is found.
#
# in:   {results}/statistics/*.csv, {results}/residuals, adjustments and parameter sets; the drawings
#       need nothing but the configuration
# out:  {results}/figures/figure_NN.{svg,png,csv}   of all kinds but those of map.smk; the figures of
#                                                   panels are in outdoor.smk
#
# All figures of a rule are one job.

LASER_FIGURES = figures_of("std", "within", "within_1sigma", "within_3sigma")
HISTOGRAMS = figures_of("histogram")
CORRECTIONS = figures_of("corrections")
DIAGRAMS = figures_of("packet", "frame", "residual", "flow", "procedure")

# For each figure: the files that it shows.
OF_HISTOGRAMS = [
    per_window(f"{RESULTS}/residuals/{{sample}}/{{window}}.parquet", each.samples)
    for each in HISTOGRAMS.values()
]
OF_CORRECTIONS = {
    "sets": [
        [
            f"{RESULTS}/parameter_sets/{each.scanner}/{name}.json"
            for name in sets_drawn(each)
        ]
        for each in CORRECTIONS.values()
    ],
    "adjustments": [
        [path for _, path in adjustments_drawn(each)] for each in CORRECTIONS.values()
    ],
    "calibration": factory_paths([each.scanner for each in CORRECTIONS.values()]),
}


rule draw_lasers:
    input:
        lasers=f"{RESULTS}/statistics/lasers.csv",
        summary=f"{RESULTS}/statistics/summary.csv",
    output:
        svg=figure_files(LASER_FIGURES, ["svg"]),
        png=in_report("figure", "Figures", figure_files(LASER_FIGURES, ["png"])),
        csv=figure_files(LASER_FIGURES, ["csv"]),
    log:
        f"{RESULTS}/logs/draw_lasers.log",
    params:
        selection=[each.plain() for each in LASER_FIGURES.values()],
        sigma_cm=[STUDY.sigma_cm(each.scanner) for each in LASER_FIGURES.values()],
        simulated=bool(WORLD),
    script:
        "../../scripts/draw_lasers.py"


rule draw_histogram:
    input:
        residuals=grouped(OF_HISTOGRAMS),
    output:
        svg=figure_files(HISTOGRAMS, ["svg"]),
        png=in_report("figure", "Figures", figure_files(HISTOGRAMS, ["png"])),
        csv=figure_files(HISTOGRAMS, ["csv"]),
    log:
        f"{RESULTS}/logs/draw_histogram.log",
    params:
        taken=taken(residuals=OF_HISTOGRAMS),
        selection=[each.plain() for each in HISTOGRAMS.values()],
        sigma_cm=[STUDY.sigma_cm(each.scanner) for each in HISTOGRAMS.values()],
        simulated=bool(WORLD),
    script:
        "../../scripts/draw_histogram.py"


rule draw_corrections:
    input:
        sets=grouped(OF_CORRECTIONS["sets"]),
        adjustments=grouped(OF_CORRECTIONS["adjustments"]),
        calibration=grouped(OF_CORRECTIONS["calibration"]),
    output:
        svg=figure_files(CORRECTIONS, ["svg"]),
        png=in_report("figure", "Figures", figure_files(CORRECTIONS, ["png"])),
        csv=figure_files(CORRECTIONS, ["csv"]),
    log:
        f"{RESULTS}/logs/draw_corrections.log",
    params:
        taken=taken(**OF_CORRECTIONS),
        selection=[each.plain() for each in CORRECTIONS.values()],
        set_names=[sets_drawn(each) for each in CORRECTIONS.values()],
        adjusted_for=[
            [name for name, _ in adjustments_drawn(each)]
            for each in CORRECTIONS.values()
        ],
        simulated=bool(WORLD),
    script:
        "../../scripts/draw_corrections.py"


rule draw_diagram:
    output:
        svg=figure_files(DIAGRAMS, ["svg"]),
        png=in_report("figure", "Figures", figure_files(DIAGRAMS, ["png"])),
        csv=figure_files(DIAGRAMS, ["csv"]),
    log:
        f"{RESULTS}/logs/draw_diagram.log",
    params:
        selection=[each.plain() for each in DIAGRAMS.values()],
        samples=list(STUDY.surveyed),
        scanners=[each.scanner for each in STUDY.surveyed.values()],
        positions=[each.position for each in STUDY.surveyed.values()],
        parameter_sets=SETTINGS.plain()["parameter_sets"],
        tables=SETTINGS.plain()["tables"],
        simulated=bool(WORLD),
    script:
        "../../scripts/draw_diagram.py"
