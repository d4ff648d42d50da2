# Recordings without a survey ("field samples"): how well does each laser see a flat thing flat?
#
# in:   medians of the whole recording, a calibration (a file, or nominal values)
# out:  {results}/field/{sample}/planes.json      planes fitted to patches of the data
#       {results}/field/{sample}/lasers.csv       std of s per plane and laser
#       {results}/field/{sample}/planes.{svg,png} picture
#       {results}/field/table.{csv,md}            one row per sample and plane

FIELD = config.get("field", {})


FIELD_FILES = [f"{RESULTS}/field/table.csv"] if STUDY.field else []
FIELD_FILES += expand(
    f"{RESULTS}/field/{{sample}}/planes.{{suffix}}",
    sample=STUDY.field,
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
        patches=lambda wildcards: FIELD.get("patches", {}).get(wildcards.sample),
        search=FIELD.get("search"),
        sigma_cm=FIELD.get("sigma_cm"),
    script:
        "../../scripts/fit_field_planes.py"


rule tabulate_field:
    input:
        planes=expand(f"{RESULTS}/field/{{sample}}/planes.json", sample=STUDY.field),
    output:
        csv=f"{RESULTS}/field/table.csv",
        md=f"{RESULTS}/field/table.md",
    log:
        f"{RESULTS}/logs/tabulate_field.log",
    localrule: True
    script:
        "../../scripts/tabulate_field.py"
