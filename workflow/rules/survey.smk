# From observations or surveyed targets to the planes in the frame of a scanner.
#
# in:   observations (points, sights, image rays, readings), or survey files: targets of the planes
#       and of the scanner's base in the field frame, targets of the base in the scanner frame
# out:  {results}/survey/{control,planes,base_field,base_scanner}.csv   adjusted from observations
#       {results}/survey/covariance.json  of all coordinates of a base, and of the planes
#       {results}/survey/network.csv     largest standard deviation of every kind of point
#       {results}/survey/network.json    redundancy, variance factor, tests, datum; points
#       {results}/survey/network.{svg,png}   plan with error ellipses
#       {results}/survey/{position}.json   transformation T_scanner_field with covariance and
#       residuals; planes with covariance, flatness and corners, in the scanner frame

SURVEY = STUDY.survey_files(f"{RESULTS}/survey")

if STUDY.observations:

    rule adjust_network:
        input:
            points=STUDY.observations["points"],
            network=STUDY.observations["network"],
            images=STUDY.observations.get("images", []),
            base_sights=STUDY.observations["base_sights"],
            base_readings=STUDY.observations["base_readings"],
        output:
            control=f"{RESULTS}/survey/control.csv",
            planes=SURVEY["planes"],
            base_field=SURVEY["base_field"],
            base_scanner=SURVEY["base_scanner"],
            covariance=SURVEY["covariance"],
            quality=f"{RESULTS}/survey/network.json",
            accuracy=f"{RESULTS}/survey/network.csv",
        log:
            f"{RESULTS}/logs/adjust_network.log",
        conda:
            "../../environment.yml"
        params:
            library=library("adjust_network"),
        script:
            "../../scripts/adjust_network.py"

    rule draw_network:
        input:
            quality=rules.adjust_network.output.quality,
        output:
            svg=f"{RESULTS}/survey/network.svg",
            png=f"{RESULTS}/survey/network.png",
        log:
            f"{RESULTS}/logs/draw_network.log",
        conda:
            "../../environment.yml"
        params:
            simulated=bool(WORLD),
            library=library("draw_network"),
        script:
            "../../scripts/draw_network.py"


rule adjust_survey:
    input:
        planes=SURVEY.get("planes", []),
        base_scanner=SURVEY.get("base_scanner", []),
        base_field=SURVEY.get("base_field", []),
        covariance=SURVEY.get("covariance", []),
    output:
        survey=f"{RESULTS}/survey/{{position}}.json",
    log:
        f"{RESULTS}/logs/adjust_survey/{{position}}.log",
    conda:
        "../../environment.yml"
    params:
        scanner=lambda wildcards: STUDY.positions[wildcards.position],
        names=config.get("assignment", {}).get("planes"),
        library=library("adjust_survey"),
    script:
        "../../scripts/adjust_survey.py"
