# What people look at.
#
# in:   {results}/statistics/*.csv, {results}/residuals, ledgers
# out:  {results}/tables/table_{2,3,4,5}.{csv,md,tex}   with the parameter set that each row shows
#       {results}/figures/figure_NN.{svg,png,csv}
#       {results}/published/agreement.csv    every printed cell beside the reproduced one
#       {results}/report.html                all of it on one page that needs no network


rule make_table:
    input:
        summary=f"{RESULTS}/statistics/summary.csv",
    output:
        csv=f"{RESULTS}/tables/table_{{table}}.csv",
        md=f"{RESULTS}/tables/table_{{table}}.md",
        tex=f"{RESULTS}/tables/table_{{table}}.tex",
    log:
        f"{RESULTS}/logs/make_table/{{table}}.log",
    conda:
        "../../environment.yml"
    params:
        number=lambda wildcards: wildcards.table,
        table=lambda wildcards: config["tables"][wildcards.table],
        simulated=bool(WORLD),
        library=library("make_table"),
    script:
        "../../scripts/make_table.py"


rule compare_with_paper:
    input:
        tables=table_files(["csv"]),
        summary=f"{RESULTS}/statistics/summary.csv",
        surveys=expand(f"{RESULTS}/survey/{{position}}.json", position=STUDY.positions),
        accuracy=f"{RESULTS}/survey/network.csv",
        facts=[f"{RESULTS}/outdoor/facts.csv", f"{RESULTS}/map/summary.csv"],
    output:
        agreement=f"{RESULTS}/published/agreement.csv",
    log:
        f"{RESULTS}/logs/compare_with_paper.log",
    conda:
        "../../environment.yml"
    params:
        library=library("compare_with_paper"),
    script:
        "../../scripts/compare_with_paper.py"


rule draw_figure:
    input:
        data=figure_input,
        summary=f"{RESULTS}/statistics/summary.csv",
    output:
        svg=f"{RESULTS}/figures/figure_{{figure}}.svg",
        png=f"{RESULTS}/figures/figure_{{figure}}.png",
        csv=f"{RESULTS}/figures/figure_{{figure}}.csv",
    log:
        f"{RESULTS}/logs/draw_figure/{{figure}}.log",
    conda:
        "../../environment.yml"
    params:
        figure=lambda wildcards: FIGURES[wildcards.figure],
        sigma_cm=config.get("validation", {}).get("sigma_cm"),
        simulated=bool(WORLD),
        library=library("draw_figure"),
    script:
        "../../scripts/draw_figure.py"


rule write_report:
    input:
        ledgers=expand(
            f"{RESULTS}/recordings/{{sample}}/ledger.json",
            sample=[*STUDY.samples, *STUDY.outdoor],
        ),
        tables=table_files(["csv"]),
        pictures=figure_files(["png"]),
        numbers=figure_files(["csv"]),
        agreement=(
            f"{RESULTS}/published/agreement.csv"
            if config.get("compare_with_paper")
            else []
        ),
        summary=f"{RESULTS}/statistics/summary.csv" if STUDY.surveyed else [],
        surveys=expand(f"{RESULTS}/survey/{{position}}.json", position=STUDY.positions),
        sets=set_files(["csv"]),
        factories=[path for path in STUDY.factories.values() if path != "nominal"],
        methods=method_files(["png", "csv"]),
        field_table=f"{RESULTS}/field/table.csv" if STUDY.field else [],
        field_pictures=expand(
            f"{RESULTS}/field/{{sample}}/planes.png", sample=STUDY.field
        ),
        outdoor=f"{RESULTS}/outdoor/means.csv" if STUDY.outdoor else [],
        outdoor_pictures=expand(
            f"{RESULTS}/figures/figure_{{number}}.png", number=OUTDOOR_FIGURES
        ),
    output:
        report=f"{RESULTS}/report.html",
    log:
        f"{RESULTS}/logs/write_report.log",
    conda:
        "../../environment.yml"
    params:
        study=config["study"],
        simulated=bool(WORLD),
        tables=config.get("tables", {}),
        figures=FIGURES,
        factories=STUDY.factories,
        samples=[*STUDY.samples, *STUDY.outdoor],
        parameter_sets=[
            (scanner, name)
            for scanner, sets in STUDY.parameter_sets.items()
            for name in sets
        ],
        field_samples=list(STUDY.field),
        outdoor_figures=list(OUTDOOR_FIGURES),
        library=library("write_report"),
    script:
        "../../scripts/write_report.py"
