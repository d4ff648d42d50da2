# Recordings without a survey: how flat does each laser see a flat surface?
#
# in:   medians of the whole recording, a calibration (a file, or nominal values), the file that
#       describes the scanner where velocal does not know it
# out:  {results}/field/{sample}/planes.json      planes fitted to patches of the data
#       {results}/field/{sample}/planes.parquet   which medians lie on them
#       {results}/field/{sample}/lasers.csv       std of s per plane and laser
#       {results}/field/{sample}/planes.{svg,png} picture
#       {results}/field/table.{csv,md}            one row per sample and plane
#       {results}/parameter_sets/{scanner}/{calibration}.*   calibrations without a survey, and
#       {results}/calibrations/{scanner}/{calibration}.*     what they rest on, as in
#                                                            calibration.smk; the picture shows
#                                                            corrections, and planes left out;
#                                                            {calibration}.more.csv tells what one
#                                                            more plane would bring;
#                                                            {calibration}.drift.{csv,svg,png} tell
#                                                            whether its distances have changed
#       {results}/residual_maps/{sample}.{parquet,svg,png}   mean s along the azimuth, before and
#                                                            after, of samples of calibrations

UNSURVEYED = SETTINGS.unsurveyed
UNSURVEYED_SETS = [
    name for sets in STUDY.unsurveyed_calibrations.values() for name in sets
]


FIELD_FILES = [f"{RESULTS}/field/table.csv"] if STUDY.unsurveyed else []
FIELD_FILES += expand(
    f"{RESULTS}/field/{{sample}}/planes.{{suffix}}",
    sample=STUDY.unsurveyed,
    suffix=("json", "svg", "png"),
)
UNSURVEYED_UNITS = [
    f"{scanner}/{name}"
    for scanner, sets in STUDY.unsurveyed_calibrations.items()
    for name in sets
]
# A cloud of points has no packets whose clock tells when something was measured.
TIMED_UNITS = [
    f"{scanner}/{name}"
    for scanner, sets in STUDY.unsurveyed_calibrations.items()
    for name, samples in sets.items()
    if not set(samples) & set(CLOUDS)
]
FIELD_FILES += expand(
    f"{RESULTS}/calibrations/{{unit}}.{{suffix}}",
    unit=UNSURVEYED_UNITS,
    suffix=("csv", "svg", "png"),
)
FIELD_FILES += expand(
    f"{RESULTS}/calibrations/{{unit}}.drift.{{suffix}}",
    unit=TIMED_UNITS,
    suffix=("csv", "svg", "png"),
)
# Scanner and last calibration of every sample that one was adjusted on.
UNSURVEYED_MAPS = {
    sample: (scanner, name)
    for scanner, sets in STUDY.unsurveyed_calibrations.items()
    for name, samples in sets.items()
    for sample in samples
}
OF_UNSURVEYED_MAPS = {
    "calibration": [
        [path] if (path := STUDY.unsurveyed[name].calibration) != NOMINAL else []
        for name in UNSURVEYED_MAPS
    ],
    "description": [
        [STUDY.scanner_files[scanner]] if scanner in STUDY.scanner_files else []
        for scanner, _ in UNSURVEYED_MAPS.values()
    ],
}
FIELD_FILES += expand(
    f"{RESULTS}/residual_maps/{{sample}}.{{suffix}}",
    sample=UNSURVEYED_MAPS,
    suffix=("parquet", "svg", "png"),
)


rule fit_field_planes:
    input:
        medians=f"{RESULTS}/medians/{{sample}}/{WHOLE}.parquet",
        calibration=calibration_file,
        description=lambda wildcards: described(sample_of(wildcards).scanner),
    output:
        planes=f"{RESULTS}/field/{{sample}}/planes.json",
        members=f"{RESULTS}/field/{{sample}}/planes.parquet",
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
        near_points=SETTINGS.joint.near_points,
        sigma_cm=lambda wildcards: STUDY.unsurveyed_sigma_cm(wildcards.sample),
    script:
        "../../scripts/fit_field_planes.py"


rule adjust_unsurveyed:
    input:
        medians=lambda wildcards: per_window(
            f"{RESULTS}/medians/{{sample}}/{{window}}.parquet",
            samples_of_calibration(wildcards),
        ),
        members=lambda wildcards: expand(
            f"{RESULTS}/field/{{sample}}/planes.parquet",
            sample=samples_of_calibration(wildcards),
        ),
        calibration=factory_of_calibration,
        description=lambda wildcards: described(wildcards.scanner),
    output:
        csv=f"{RESULTS}/parameter_sets/{{scanner}}/{{unit}}.csv",
        json=f"{RESULTS}/parameter_sets/{{scanner}}/{{unit}}.json",
        yaml=f"{RESULTS}/parameter_sets/{{scanner}}/{{unit}}.yaml",
        xml=f"{RESULTS}/parameter_sets/{{scanner}}/{{unit}}.xml",
        decoder=f"{RESULTS}/parameter_sets/{{scanner}}/{{unit}}.velodyne_decoder.yaml",
        judged=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.json",
        lasers=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.csv",
        hold_out=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.hold_out.csv",
        more=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.more.csv",
        svg=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.svg",
        png=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.png",
    log:
        f"{RESULTS}/logs/adjust_unsurveyed/{{scanner}}.{{unit}}.log",
    wildcard_constraints:
        unit=one_of(UNSURVEYED_SETS),
    params:
        samples=samples_of_calibration,
        joint=SETTINGS.joint.plain(),
        export=SETTINGS.export.plain(),
        chosen=lambda wildcards: UNSURVEYED.judged.plain(),
    script:
        "../../scripts/adjust_unsurveyed.py"


rule map_unsurveyed:
    input:
        medians=per_window(
            f"{RESULTS}/medians/{{sample}}/{{window}}.parquet", UNSURVEYED_MAPS
        ),
        members=expand(
            f"{RESULTS}/field/{{sample}}/planes.parquet", sample=UNSURVEYED_MAPS
        ),
        calibration=grouped(OF_UNSURVEYED_MAPS["calibration"]),
        description=grouped(OF_UNSURVEYED_MAPS["description"]),
        judged=[
            f"{RESULTS}/calibrations/{scanner}/{name}.json"
            for scanner, name in UNSURVEYED_MAPS.values()
        ],
    output:
        residuals=expand(
            f"{RESULTS}/residual_maps/{{sample}}.parquet", sample=UNSURVEYED_MAPS
        ),
        svg=expand(f"{RESULTS}/residual_maps/{{sample}}.svg", sample=UNSURVEYED_MAPS),
        png=expand(f"{RESULTS}/residual_maps/{{sample}}.png", sample=UNSURVEYED_MAPS),
    log:
        f"{RESULTS}/logs/map_unsurveyed.log",
    params:
        taken=taken(**OF_UNSURVEYED_MAPS),
        sample=list(UNSURVEYED_MAPS),
        scanner=[scanner for scanner, _ in UNSURVEYED_MAPS.values()],
        after=[name for _, name in UNSURVEYED_MAPS.values()],
        near_points=SETTINGS.joint.near_points,
        sigma_cm=[STUDY.unsurveyed_sigma_cm(name) for name in UNSURVEYED_MAPS],
    script:
        "../../scripts/map_unsurveyed.py"


rule measure_stability:
    input:
        returns=lambda wildcards: per_window(
            f"{RESULTS}/returns/{{sample}}/{{window}}.parquet",
            samples_of_calibration(wildcards),
        ),
        medians=lambda wildcards: per_window(
            f"{RESULTS}/medians/{{sample}}/{{window}}.parquet",
            samples_of_calibration(wildcards),
        ),
        members=lambda wildcards: expand(
            f"{RESULTS}/field/{{sample}}/planes.parquet",
            sample=samples_of_calibration(wildcards),
        ),
        recordings=lambda wildcards: recordings_of(samples_of_calibration(wildcards)),
        rotations=lambda wildcards: expand(
            f"{RESULTS}/recordings/{{sample}}/rotations.parquet",
            sample=samples_of_calibration(wildcards),
        ),
        calibration=factory_of_calibration,
        judged=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.json",
    output:
        csv=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.drift.csv",
        svg=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.drift.svg",
        png=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.drift.png",
    log:
        f"{RESULTS}/logs/measure_stability/{{scanner}}.{{unit}}.log",
    wildcard_constraints:
        unit=one_of(UNSURVEYED_SETS),
    resources:
        mem_mb=1200,
    params:
        samples=samples_of_calibration,
        ports=lambda wildcards: [
            STUDY.samples[name].port for name in samples_of_calibration(wildcards)
        ],
        addresses=lambda wildcards: [
            STUDY.samples[name].address for name in samples_of_calibration(wildcards)
        ],
        joint=SETTINGS.joint.plain(),
    script:
        "../../scripts/measure_stability.py"


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
