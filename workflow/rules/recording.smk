# From a capture to medians.
#
# in:   recording of a sample (any framing that `velocal inspect` knows)
# out:  {results}/recordings/{sample}/ledger.json        what was used, what not and why
#       {results}/recordings/{sample}/rotations.parquet  where every rotation begins
#       {results}/recordings/{sample}/calibration.xml    where the sample table says `embedded`
#       {results}/returns/{sample}/{window}.parquet      returns of the window's rotations
#       {results}/medians/{sample}/{window}.parquet      median per laser and azimuth bin
#
# The whole recording is scanned once; only the rotations of the windows are decoded.


rule index_recording:
    input:
        recording=lambda wildcards: sample_of(wildcards).recording,
    output:
        ledger=f"{RESULTS}/recordings/{{sample}}/ledger.json",
        rotations=f"{RESULTS}/recordings/{{sample}}/rotations.parquet",
    log:
        f"{RESULTS}/logs/index_recording/{{sample}}.log",
    conda:
        "../../environment.yml"
    params:
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        port=lambda wildcards: sample_of(wildcards).port,
        address=lambda wildcards: sample_of(wildcards).address,
        library=library("index_recording"),
    script:
        "../../scripts/index_recording.py"


rule read_stream_calibration:
    input:
        recording=lambda wildcards: sample_of(wildcards).recording,
    output:
        calibration=f"{RESULTS}/recordings/{{sample}}/calibration.xml",
    log:
        f"{RESULTS}/logs/read_stream_calibration/{{sample}}.log",
    conda:
        "../../environment.yml"
    params:
        port=lambda wildcards: sample_of(wildcards).port,
        address=lambda wildcards: sample_of(wildcards).address,
        library=library("read_stream_calibration"),
    script:
        "../../scripts/read_stream_calibration.py"


rule decode_returns:
    input:
        recording=lambda wildcards: sample_of(wildcards).recording,
        rotations=f"{RESULTS}/recordings/{{sample}}/rotations.parquet",
    output:
        returns=f"{RESULTS}/returns/{{sample}}/{{window}}.parquet",
    log:
        f"{RESULTS}/logs/decode_returns/{{sample}}.{{window}}.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=800,
    params:
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        port=lambda wildcards: sample_of(wildcards).port,
        address=lambda wildcards: sample_of(wildcards).address,
        which=SETTINGS.reduction.which,
        length=lambda wildcards: (
            None if wildcards.window == WHOLE else STUDY.windows.rotations
        ),
        library=library("decode_returns"),
    script:
        "../../scripts/decode_returns.py"


rule reduce_medians:
    input:
        returns=f"{RESULTS}/returns/{{sample}}/{{window}}.parquet",
    output:
        medians=f"{RESULTS}/medians/{{sample}}/{{window}}.parquet",
    log:
        f"{RESULTS}/logs/reduce_medians/{{sample}}.{{window}}.log",
    conda:
        "../../environment.yml"
    resources:
        mem_mb=1200,
    params:
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        azimuth_bin_ticks=lambda wildcards: SETTINGS.reduction.azimuth_bin_ticks(
            SCANNERS[sample_of(wildcards).scanner]
        ),
        min_count=SETTINGS.reduction.min_count,
        library=library("reduce_medians"),
    script:
        "../../scripts/reduce_medians.py"
