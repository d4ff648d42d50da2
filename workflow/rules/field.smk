# Recordings without a survey: how flat does each laser see a flat surface?
#
# in:   medians of the whole recording, a calibration (a file, or nominal values)
# out:  {results}/field/{sample}/planes.json      planes fitted to patches of the data
#       {results}/field/{sample}/lasers.csv       std of s per plane and laser
#       {results}/field/{sample}/planes.{svg,png} picture
#       {results}/field/table.{csv,md}            one row per sample and plane

UNSURVEYED = SETTINGS.unsurveyed


FIELD_FILES = [f"{RESULTS}/field/table.csv"] if STUDY.unsurveyed else []
FIELD_FILES += expand(
    f"{RESULTS}/field/{{sample}}/planes.{{suffix}}",
    sample=STUDY.unsurveyed,
    suffix=("json", "svg", "png"),
)


rule fit_field_planes:
    input:
        medians=f"{RESULTS}/medians/{{sample}}/{WHOLE}.parquet",
        calibration=calibration_file,
    output:
        planes=f"{RESULTS}/field/{{sample}}/planes.json",
        lasers=f"{RESULTS}/field/{{sample}}/lasers.csv",
        svg=f"{RESULTS}/field/{{sample}}/planes.svg",
        png=f"{RESULTS}/field/{{sample}}/planes.png",
    log:
        f"{RESULTS}/logs/fit_field_planes/{{sample}}.log",
    params:
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        # None where planes are searched for.
        patches=lambda wildcards: UNSURVEYED.plain()["patches"].get(wildcards.sample),
        search=lambda wildcards: UNSURVEYED.search.plain(),
        sigma_cm=lambda wildcards: STUDY.unsurveyed_sigma_cm(wildcards.sample),
    script:
        "../../scripts/fit_field_planes.py"


rule tabulate_field:
    input:
        planes=expand(
            f"{RESULTS}/field/{{sample}}/planes.json", sample=STUDY.unsurveyed
        ),
    output:
        csv=f"{RESULTS}/field/table.csv",
        md=f"{RESULTS}/field/table.md",
    log:
        f"{RESULTS}/logs/tabulate_field.log",
    localrule: True
    script:
        "../../scripts/tabulate_field.py"
