# From surveyed targets to the planes in the frame of a scanner.
#
# in:   survey files: targets of the planes and of the scanner's base in the field frame, targets
#       of the base in the scanner frame
# out:  {results}/survey/{position}.json   transformation T_scanner_field with covariance and
#       residuals; planes with covariance, flatness and corners, in the scanner frame


rule adjust_survey:
    input:
        planes=config.get("survey", {}).get("planes", []),
        base_scanner=config.get("survey", {}).get("base_scanner", []),
        base_field=config.get("survey", {}).get("base_field", []),
    output:
        survey=f"{RESULTS}/survey/{{position}}.json",
    log:
        f"{RESULTS}/logs/adjust_survey/{{position}}.log",
    conda:
        "../../environment.yml"
    params:
        scanner=lambda wildcards: STUDY.positions[wildcards.position],
        planes=config.get("assignment", {}).get("planes"),
        library=library("adjust_survey"),
    script:
        "../../scripts/adjust_survey.py"
