# From a cloud of points to medians, for samples that name the program which computed the points.
#
# in:   cloud of a sample without a survey, the calibration that its program used (or nominal
#       values), the file that describes the scanner where velocal does not know it
# out:  {results}/recordings/{sample}/ledger.json  what was used, what not and why
#       {results}/returns/{sample}/all.parquet     returns in raw ticks
#       {results}/medians/{sample}/all.parquet     median per laser and azimuth bin
#
# Everything after it is the same as for packets.


rule read_cloud:
    input:
        recording=lambda wildcards: recording_of(sample_of(wildcards)),
        calibration=calibration_file,
        description=lambda wildcards: described(sample_of(wildcards).scanner),
    output:
        ledger=f"{RESULTS}/recordings/{{sample}}/ledger.json",
        returns=f"{RESULTS}/returns/{{sample}}/{WHOLE}.parquet",
        medians=f"{RESULTS}/medians/{{sample}}/{WHOLE}.parquet",
    log:
        f"{RESULTS}/logs/read_cloud/{{sample}}.log",
    wildcard_constraints:
        sample=one_of(CLOUDS),
    resources:
        mem_mb=2000,
    params:
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        dialect=lambda wildcards: sample_of(wildcards).dialect,
        frame=lambda wildcards: sample_of(wildcards).frame,
        address=lambda wildcards: sample_of(wildcards).address,
        azimuth_bin_ticks=lambda wildcards: SETTINGS.reduction.azimuth_bin_ticks(
            STUDY.scanner(sample_of(wildcards).scanner)
        ),
        min_count=SETTINGS.reduction.min_count,
    script:
        "../../scripts/read_cloud.py"
