# What people look at.
#
# in:   {results}/statistics/*.csv, {results}/residuals, ledgers
# out:  {results}/tables/table_{2,3,4,5}.{csv,md,tex}
#       {results}/figures/figure_NN.{svg,png,csv}
#       {results}/published/agreement.csv    every printed cell beside the reproduced one
#       {results}/report.html                all of it on one page that needs no network

FIGURES = config.get("figures", {})


def table_files(suffixes=("csv", "md", "tex")):
    return expand(
        f"{RESULTS}/tables/table_{{table}}.{{suffix}}",
        table=config.get("tables", {}),
        suffix=suffixes,
    )


def figure_files(suffixes=("svg", "png", "csv")):
    return expand(
        f"{RESULTS}/figures/figure_{{figure}}.{{suffix}}", figure=FIGURES, suffix=suffixes
    )


rule make_table:
    input:
        summary=f"{RESULTS}/statistics/summary.csv",
    output:
        csv=f"{RESULTS}/tables/table_{{table}}.csv",
        md=f"{RESULTS}/tables/table_{{table}}.md",
        tex=f"{RESULTS}/tables/table_{{table}}.tex",
    params:
        number=lambda wildcards: wildcards.table,
        table=lambda wildcards: config["tables"][wildcards.table],
        simulated=bool(WORLD),
        library=library("make_table"),
    log:
        f"{RESULTS}/logs/make_table/{{table}}.log",
    conda:
        "../../environment.yml"
    script:
        "../../scripts/make_table.py"


rule compare_with_paper:
    input:
        tables=table_files(["csv"]),
        summary=f"{RESULTS}/statistics/summary.csv",
    output:
        agreement=f"{RESULTS}/published/agreement.csv",
    params:
        library=library("compare_with_paper"),
    log:
        f"{RESULTS}/logs/compare_with_paper.log",
    conda:
        "../../environment.yml"
    script:
        "../../scripts/compare_with_paper.py"


def figure_input(wildcards):
    """Histograms read residuals of their samples, the others the statistics per laser."""
    figure = FIGURES[wildcards.figure]
    if figure["kind"] == "histogram":
        return per_window(f"{RESULTS}/residuals/{{sample}}/{{window}}.parquet", figure["samples"])
    return [f"{RESULTS}/statistics/lasers.csv"]


rule draw_figure:
    input:
        data=figure_input,
        summary=f"{RESULTS}/statistics/summary.csv",
    output:
        svg=f"{RESULTS}/figures/figure_{{figure}}.svg",
        png=f"{RESULTS}/figures/figure_{{figure}}.png",
        csv=f"{RESULTS}/figures/figure_{{figure}}.csv",
    params:
        figure=lambda wildcards: FIGURES[wildcards.figure],
        sigma_cm=config.get("validation", {}).get("sigma_cm"),
        library=library("draw_figure"),
    log:
        f"{RESULTS}/logs/draw_figure/{{figure}}.log",
    conda:
        "../../environment.yml"
    script:
        "../../scripts/draw_figure.py"


rule write_report:
    input:
        ledgers=expand(f"{RESULTS}/recordings/{{sample}}/ledger.json", sample=STUDY.samples),
        tables=table_files(["csv"]),
        figures=figure_files(["png", "csv"]),
        agreement=f"{RESULTS}/published/agreement.csv" if config.get("compare_with_paper") else [],
        summary=f"{RESULTS}/statistics/summary.csv" if STUDY.surveyed else [],
        surveys=expand(f"{RESULTS}/survey/{{position}}.json", position=STUDY.positions),
        sets=set_files(["csv"]),
        field=[f for f in field_files() if not f.endswith("svg")] if STUDY.field else [],
    output:
        report=f"{RESULTS}/report.html",
    params:
        study=config["study"],
        simulated=bool(WORLD),
        tables=config.get("tables", {}),
        figures=FIGURES,
        library=library("write_report"),
    log:
        f"{RESULTS}/logs/write_report.log",
    conda:
        "../../environment.yml"
    script:
        "../../scripts/write_report.py"
