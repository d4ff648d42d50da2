# The simulated world: it stands in for the recordings that the study's authors never published.
#
# in:   config/world.yaml
# out:  {results}/simulation/recordings/{sample}.bin   records of 1248 bytes
#       {results}/simulation/factory/{scanner}.xml     the factory's calibration
#       {results}/simulation/survey/*.csv              observations of the surveyor
#       {results}/simulation/truth/{scanner}.csv       read by tests and comparisons only
#
# A sample is simulated if its row names a recording below {results}/simulation; a row that names
# another file uses that file. Nothing downstream can tell the difference.


TRUTH_FILES = expand(
    f"{RESULTS}/simulation/truth/{{scanner}}.csv",
    scanner=STUDY.scanners if WORLD else [],
)

if WORLD:

    rule simulate_recording:
        input:
            world_file=WORLD,
        output:
            recording=f"{RESULTS}/simulation/recordings/{{sample}}.bin",
        log:
            f"{RESULTS}/logs/simulate_recording/{{sample}}.log",
        params:
            scanner=lambda wildcards: sample_of(wildcards).scanner,
            position=lambda wildcards: sample_of(wildcards).position,
            rotations=SETTINGS.simulation.rotations,
        script:
            "../../scripts/simulate_recording.py"

    rule simulate_factory:
        input:
            world_file=WORLD,
        output:
            factory=f"{RESULTS}/simulation/factory/{{scanner}}.xml",
            truth=f"{RESULTS}/simulation/truth/{{scanner}}.csv",
        log:
            f"{RESULTS}/logs/simulate_factory/{{scanner}}.log",
        localrule: True
        script:
            "../../scripts/simulate_factory.py"

    rule simulate_survey:
        input:
            world_file=WORLD,
        output:
            points=f"{RESULTS}/simulation/survey/points.csv",
            network=f"{RESULTS}/simulation/survey/network.csv",
            images=f"{RESULTS}/simulation/survey/images.csv",
            base_sights=f"{RESULTS}/simulation/survey/base_sights.csv",
            base_readings=f"{RESULTS}/simulation/survey/base_readings.csv",
        log:
            f"{RESULTS}/logs/simulate_survey.log",
        localrule: True
        script:
            "../../scripts/simulate_survey.py"
