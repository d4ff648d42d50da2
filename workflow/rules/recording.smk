# From a capture to medians.
#
# in:   recording of a sample (any framing that `velocal inspect` knows)
# out:  {results}/recordings/{sample}/ledger.json        what was used, what not and why
#       {results}/recordings/{sample}/rotations.parquet  where every rotation begins
#       {results}/recordings/{sample}/calibration.xml    where the sample table says `embedded`
#       {results}/returns/{sample}/{window}.parquet      returns of the window's rotations
#       {results}/medians/{sample}/{window}.parquet      median per laser and azimuth bin
#
# The whole recording is scanned once; only the rotations of the windows are decoded. All windows of a
# sample are one job, one after the other, so that its memory is that of one window.

# Samples whose recording holds the calibration of their scanner, as `embedded` in the sample table says.
EMBEDDED = [
    name
    for name in STUDY.samples
    if f"{RESULTS}/recordings/{name}/calibration.xml"
    in {sample.calibration for sample in STUDY.samples.values()}
]


rule index_recording:
    input:
        recording=lambda wildcards: recording_of(sample_of(wildcards)),
    output:
        ledger=f"{RESULTS}/recordings/{{sample}}/ledger.json",
        rotations=f"{RESULTS}/recordings/{{sample}}/rotations.parquet",
        calibration=[],
    log:
        f"{RESULTS}/logs/index_recording/{{sample}}.log",
    wildcard_constraints:
        sample=one_of(
            [name for name in STUDY.samples if name not in [*EMBEDDED, *CLOUDS]]
        ),
    params:
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        port=lambda wildcards: sample_of(wildcards).port,
        address=lambda wildcards: sample_of(wildcards).address,
        max_missing=SETTINGS.windows.max_missing if SETTINGS.windows else MAX_MISSING,
    script:
        "../../scripts/index_recording.py"


use rule index_recording as index_recording_with_calibration with:
    output:
        ledger=f"{RESULTS}/recordings/{{sample}}/ledger.json",
        rotations=f"{RESULTS}/recordings/{{sample}}/rotations.parquet",
        calibration=f"{RESULTS}/recordings/{{sample}}/calibration.xml",
    wildcard_constraints:
        sample=one_of(EMBEDDED),


rule reduce_recording:
    input:
        recording=lambda wildcards: recording_of(sample_of(wildcards)),
        rotations=f"{RESULTS}/recordings/{{sample}}/rotations.parquet",
    output:
        returns=of_windows(f"{RESULTS}/returns/{{sample}}/{{window}}.parquet"),
        medians=of_windows(f"{RESULTS}/medians/{{sample}}/{{window}}.parquet"),
    log:
        f"{RESULTS}/logs/reduce_recording/{{sample}}.log",
    wildcard_constraints:
        sample=one_of(STUDY.surveyed),
    resources:
        mem_mb=1200,
    params:
        window=windows_of,
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        port=lambda wildcards: sample_of(wildcards).port,
        address=lambda wildcards: sample_of(wildcards).address,
        which=SETTINGS.reduction.which,
        length=SETTINGS.windows.rotations if SETTINGS.windows else None,
        azimuth_bin_ticks=lambda wildcards: SETTINGS.reduction.azimuth_bin_ticks(
            STUDY.scanner(sample_of(wildcards).scanner)
        ),
        min_count=SETTINGS.reduction.min_count,
    script:
        "../../scripts/reduce_recording.py"


use rule reduce_recording as reduce_whole_recording with:
    output:
        returns=f"{RESULTS}/returns/{{sample}}/{WHOLE}.parquet",
        medians=f"{RESULTS}/medians/{{sample}}/{WHOLE}.parquet",
    wildcard_constraints:
        sample=one_of([name for name in STUDY.unsurveyed if name not in CLOUDS]),
