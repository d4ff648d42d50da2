# From a cloud of points to returns, for samples that name the program which computed the points.
#
# in:   cloud of a sample without a survey, the calibration that its program used (or nominal values)
# out:  {results}/recordings/{sample}/ledger.json  what was used, what not and why
#       {results}/returns/{sample}/all.parquet     returns in raw ticks
#
# Everything after it is the same as for packets.


rule read_cloud:
    input:
        recording=lambda wildcards: sample_of(wildcards).recording,
        calibration=calibration_file,
    output:
        ledger=f"{RESULTS}/recordings/{{sample}}/ledger.json",
        returns=f"{RESULTS}/returns/{{sample}}/{WHOLE}.parquet",
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
    script:
        "../../scripts/read_cloud.py"
