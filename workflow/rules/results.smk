# What people look at.
#
# in:   {results}/statistics/*.csv, {results}/residuals, ledgers
# out:  {results}/tables/table_{2,3,4,5}.{csv,md,tex}
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
        selection=lambda wildcards: SETTINGS.tables[wildcards.table].plain(),
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
        selection=lambda wildcards: FIGURES[wildcards.figure].plain(),
        sigma_cm=lambda wildcards: STUDY.validation.sigma_cm,
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
        agreement=(
            f"{RESULTS}/published/agreement.csv" if SETTINGS.compare_with_paper else []
        ),
        summary=f"{RESULTS}/statistics/summary.csv" if STUDY.surveyed else [],
        surveys=expand(f"{RESULTS}/survey/{{position}}.json", position=STUDY.positions),
        sets=set_files(["csv"]),
        factories=[path for path in STUDY.factories.values() if path != NOMINAL],
        figure_pngs=figure_files(["png"]),
        figure_csvs=figure_files(["csv"]),
        methods_csv=f"{RESULTS}/methods/comparison.csv" if METHODS else [],
        methods_png=f"{RESULTS}/methods/comparison.png" if METHODS else [],
        field_csv=f"{RESULTS}/field/table.csv" if STUDY.unsurveyed else [],
        field_pngs=expand(
            f"{RESULTS}/field/{{sample}}/planes.png", sample=STUDY.unsurveyed
        ),
        outdoor_csv=f"{RESULTS}/outdoor/means.csv" if STUDY.outdoor else [],
        outdoor_pngs=expand(
            f"{RESULTS}/figures/figure_{{number}}.png", number=OUTDOOR_FIGURES
        ),
    output:
        report_html=f"{RESULTS}/report.html",
    log:
        f"{RESULTS}/logs/write_report.log",
    conda:
        "../../environment.yml"
    params:
        title=SETTINGS.study,
        simulated=bool(WORLD),
        tables=SETTINGS.plain()["tables"],
        figures=SETTINGS.plain()["figures"],
        scanners=list(STUDY.factories),
        factory_scanners=[
            name for name, path in STUDY.factories.items() if path != NOMINAL
        ],
        library=library("write_report"),
    script:
        "../../scripts/write_report.py"
