# Figures of what was found, and drawings of how it is found.
#
# in:   {results}/statistics/*.csv, {results}/residuals, adjustments and parameter sets; the drawings
#       need nothing but the configuration
# out:  {results}/figures/figure_NN.{svg,png,csv}   of all kinds but those of map.smk; the figures of
#                                                   panels are in outdoor.smk

LASER_FIGURES = figures_of("std", "within", "within_1sigma", "within_3sigma")
HISTOGRAMS = figures_of("histogram")
CORRECTIONS = figures_of("corrections")
DIAGRAMS = figures_of("packet", "frame", "residual", "flow")
PROCEDURES = figures_of("procedure")


rule draw_lasers:
    input:
        lasers=f"{RESULTS}/statistics/lasers.csv",
        summary=f"{RESULTS}/statistics/summary.csv",
    output:
        svg=f"{RESULTS}/figures/figure_{{figure}}.svg",
        png=f"{RESULTS}/figures/figure_{{figure}}.png",
        csv=f"{RESULTS}/figures/figure_{{figure}}.csv",
    log:
        f"{RESULTS}/logs/draw_lasers/{{figure}}.log",
    wildcard_constraints:
        figure=one_of(LASER_FIGURES),
    params:
        selection=lambda wildcards: LASER_FIGURES[wildcards.figure].plain(),
        sigma_cm=lambda wildcards: STUDY.sigma_cm(
            LASER_FIGURES[wildcards.figure].scanner
        ),
        simulated=bool(WORLD),
    script:
        "../../scripts/draw_lasers.py"


rule draw_histogram:
    input:
        residuals=lambda wildcards: per_window(
            f"{RESULTS}/residuals/{{sample}}/{{window}}.parquet",
            HISTOGRAMS[wildcards.figure].samples,
        ),
    output:
        svg=f"{RESULTS}/figures/figure_{{figure}}.svg",
        png=f"{RESULTS}/figures/figure_{{figure}}.png",
        csv=f"{RESULTS}/figures/figure_{{figure}}.csv",
    log:
        f"{RESULTS}/logs/draw_histogram/{{figure}}.log",
    wildcard_constraints:
        figure=one_of(HISTOGRAMS),
    params:
        selection=lambda wildcards: HISTOGRAMS[wildcards.figure].plain(),
        sigma_cm=lambda wildcards: STUDY.sigma_cm(HISTOGRAMS[wildcards.figure].scanner),
        simulated=bool(WORLD),
    script:
        "../../scripts/draw_histogram.py"


rule draw_corrections:
    input:
        sets=lambda wildcards: expand(
            f"{RESULTS}/parameter_sets/{{scanner}}/{{parameter_set}}.json",
            scanner=CORRECTIONS[wildcards.figure].scanner,
            parameter_set=sets_drawn(wildcards),
        ),
        adjustments=lambda wildcards: [path for _, path in adjustments_drawn(wildcards)],
        calibration=lambda wildcards: factory_path(
            CORRECTIONS[wildcards.figure].scanner
        ),
    output:
        svg=f"{RESULTS}/figures/figure_{{figure}}.svg",
        png=f"{RESULTS}/figures/figure_{{figure}}.png",
        csv=f"{RESULTS}/figures/figure_{{figure}}.csv",
    log:
        f"{RESULTS}/logs/draw_corrections/{{figure}}.log",
    wildcard_constraints:
        figure=one_of(CORRECTIONS),
    params:
        selection=lambda wildcards: CORRECTIONS[wildcards.figure].plain(),
        set_names=lambda wildcards: list(sets_drawn(wildcards)),
        adjusted_for=lambda wildcards: [
            name for name, _ in adjustments_drawn(wildcards)
        ],
        simulated=bool(WORLD),
    script:
        "../../scripts/draw_corrections.py"


rule draw_diagram:
    output:
        svg=f"{RESULTS}/figures/figure_{{figure}}.svg",
        png=f"{RESULTS}/figures/figure_{{figure}}.png",
        csv=f"{RESULTS}/figures/figure_{{figure}}.csv",
    log:
        f"{RESULTS}/logs/draw_diagram/{{figure}}.log",
    wildcard_constraints:
        figure=one_of(DIAGRAMS),
    params:
        selection=lambda wildcards: DIAGRAMS[wildcards.figure].plain(),
    script:
        "../../scripts/draw_diagram.py"


rule draw_procedure:
    output:
        svg=f"{RESULTS}/figures/figure_{{figure}}.svg",
        png=f"{RESULTS}/figures/figure_{{figure}}.png",
        csv=f"{RESULTS}/figures/figure_{{figure}}.csv",
    log:
        f"{RESULTS}/logs/draw_procedure/{{figure}}.log",
    wildcard_constraints:
        figure=one_of(PROCEDURES),
    params:
        samples=list(STUDY.surveyed),
        scanners=[each.scanner for each in STUDY.surveyed.values()],
        positions=[each.position for each in STUDY.surveyed.values()],
        parameter_sets=SETTINGS.plain()["parameter_sets"],
        tables=SETTINGS.plain()["tables"],
        simulated=bool(WORLD),
    script:
        "../../scripts/draw_procedure.py"
