# From medians on surveyed planes to parameter sets.
#
# A parameter set is a mean of the adjustments of single windows, as in the paper. A calibration is
# one adjustment of all lasers, stations and planes of a unit. All windows of a sample are one job,
# and so are all parameter sets, and the proofs of all exported files.
#
# in:   medians of a window, planes of its position, the factory's calibration
# out:  {results}/assigned/{sample}/{window}.parquet       medians with the plane that each hit
#       {results}/adjustment/{sample}/{window}.csv         corrections, their standard deviation,
#                                                          rank and quality, per laser
#       {results}/adjustment/{sample}/{window}.covariance.csv   all covariances, by source
#       {results}/parameter_sets/{scanner}/{set}.*         csv and json (all that is known),
#                                                          yaml and db.xml for drivers (`export`)
#       {results}/parameter_sets/{scanner}/{set}.velodyne_decoder.yaml   for that program
#       {results}/parameter_sets/{scanner}/{set}.exports.csv   points of every program from planes
#       {results}/parameter_sets/{scanner}/{calibration}.*   the same of a calibration
#       {results}/calibrations/{scanner}/{calibration}.json  population, stations, noise, verdict
#       {results}/calibrations/{scanner}/{calibration}.csv   corrections, standard deviations and
#                                                            the share from the data, per laser
#       {results}/calibrations/{scanner}/{calibration}.hold_out.csv   what was held out, before
#                                                                     and after
#       {results}/certificate.{json,html}                    results, uncertainty, traceability
#       {results}/calibrations/verdicts.txt                  the verdicts on all calibrations; the run
#                                                            fails at its end if one is not better
#                                                            than the factory's
#       {results}/parameter_sets/{scanner}/{set}.scatter.csv   means, plain and weighted; scatter of
#                                                          the samples against what is stated


SETS = [
    f"{RESULTS}/parameter_sets/{scanner}/{name}"
    for scanner in STUDY.scanners
    for name in STUDY.candidates(scanner)
]
CALIBRATIONS = ["/".join(each) for each in STUDY.calibration_names]
CERTIFICATES = expand(
    f"{RESULTS}/certificate.{{suffix}}", suffix=("json", "html") if CALIBRATIONS else ()
)
CERTIFIED = list(
    dict.fromkeys(
        sample
        for each in STUDY.calibration_names
        for sample in STUDY.calibrated_on(*each)
    )
)
VERDICTS = f"{RESULTS}/calibrations/verdicts.txt" if CALIBRATIONS else []
PROGRAM_SUFFIXES = ("yaml", "xml", "velodyne_decoder.yaml")
SET_FILES = expand(
    "{path}.{suffix}", path=SETS, suffix=("csv", *PROGRAM_SUFFIXES, "exports.csv")
)


rule assign_medians:
    input:
        medians=of_windows(f"{RESULTS}/medians/{{sample}}/{{window}}.parquet"),
        survey=lambda wildcards: f"{RESULTS}/survey/{sample_of(wildcards).position}.json",
        calibration=calibration_file,
    output:
        assigned=of_windows(f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet"),
    log:
        f"{RESULTS}/logs/assign_medians/{{sample}}.log",
    params:
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        limits=lambda wildcards: STUDY.assignment.limits.plain(),
    script:
        "../../scripts/assign_medians.py"


rule adjust_lasers:
    input:
        assigned=of_windows(f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet"),
        survey=lambda wildcards: f"{RESULTS}/survey/{sample_of(wildcards).position}.json",
        calibration=calibration_file,
        # Nothing is adjusted with a wrong survey; what the checks say changes no adjustment.
        checks=after_checks,
    output:
        adjustment=of_windows(f"{RESULTS}/adjustment/{{sample}}/{{window}}.csv"),
        covariance=of_windows(
            f"{RESULTS}/adjustment/{{sample}}/{{window}}.covariance.csv"
        ),
    log:
        f"{RESULTS}/logs/adjust_lasers/{{sample}}.log",
    params:
        scanner=lambda wildcards: sample_of(wildcards).scanner,
        config=lambda wildcards: STUDY.adjustment(sample_of(wildcards).scanner).plain(),
    script:
        "../../scripts/adjust_lasers.py"


rule adjust_unit:
    input:
        medians=lambda wildcards: per_window(
            f"{RESULTS}/medians/{{sample}}/{{window}}.parquet",
            samples_of_calibration(wildcards),
        ),
        surveys=lambda wildcards: at_positions(
            f"{RESULTS}/survey/{{position}}.json",
            samples_of_calibration(wildcards),
        ),
        calibration=lambda wildcards: factory_path(wildcards.scanner),
        checks=after_checks,
    output:
        csv=f"{RESULTS}/parameter_sets/{{scanner}}/{{unit}}.csv",
        json=f"{RESULTS}/parameter_sets/{{scanner}}/{{unit}}.json",
        yaml=f"{RESULTS}/parameter_sets/{{scanner}}/{{unit}}.yaml",
        xml=f"{RESULTS}/parameter_sets/{{scanner}}/{{unit}}.xml",
        decoder=f"{RESULTS}/parameter_sets/{{scanner}}/{{unit}}.velodyne_decoder.yaml",
        judged=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.json",
        lasers=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.csv",
        hold_out=f"{RESULTS}/calibrations/{{scanner}}/{{unit}}.hold_out.csv",
    log:
        f"{RESULTS}/logs/adjust_unit/{{scanner}}.{{unit}}.log",
    wildcard_constraints:
        unit=one_of([name for sets in STUDY.calibrations.values() for name in sets]),
    params:
        positions=lambda wildcards: positions_per_window(
            samples_of_calibration(wildcards)
        ),
        limits=lambda wildcards: STUDY.assignment.limits.plain(),
        joint=SETTINGS.joint.plain(),
        export=SETTINGS.export.plain(),
    script:
        "../../scripts/adjust_unit.py"


rule write_certificate:
    input:
        units=expand(f"{RESULTS}/calibrations/{{name}}.json", name=CALIBRATIONS),
        recordings=recordings_of(CERTIFIED),
        ledgers=expand(f"{RESULTS}/recordings/{{sample}}/ledger.json", sample=CERTIFIED),
        surveys=at_positions(f"{RESULTS}/survey/{{position}}.json", CERTIFIED),
        factory_files=sorted(
            {
                sample.calibration
                for sample in map(STUDY.samples.get, CERTIFIED)
                if sample.calibration != NOMINAL
            }
        ),
        descriptions=list(STUDY.scanner_files.values()),
    output:
        json=f"{RESULTS}/certificate.json",
        html=in_report("certificate", "Report", f"{RESULTS}/certificate.html"),
    log:
        f"{RESULTS}/logs/write_certificate.log",
    params:
        names=[name for _, name in STUDY.calibration_names],
        scanners=[scanner for scanner, _ in STUDY.calibration_names],
        samples=[list(STUDY.calibrated_on(*each)) for each in STUDY.calibration_names],
        sample_names=CERTIFIED,
        # Samples without a survey have no position.
        positions=[
            STUDY.surveyed[sample].position if sample in STUDY.surveyed else ""
            for sample in CERTIFIED
        ],
        factories=[
            str(STUDY.samples[STUDY.calibrated_on(*each)[0]].calibration)
            for each in STUDY.calibration_names
        ],
        described=list(STUDY.scanner_files),
        serials=SETTINGS.serials,
        simulated=bool(WORLD),
    script:
        "../../scripts/write_certificate.py"


rule judge_calibrations:
    input:
        units=expand(f"{RESULTS}/calibrations/{{name}}.json", name=CALIBRATIONS),
        report=f"{RESULTS}/report.html",
    output:
        verdicts=f"{RESULTS}/calibrations/verdicts.txt",
    log:
        f"{RESULTS}/logs/judge_calibrations.log",
    localrule: True
    params:
        names=CALIBRATIONS,
    script:
        "../../scripts/judge_calibrations.py"


# For each parameter set: the adjustments that it is the mean of, and the samples of these.
OF_AVERAGES = [STUDY.parameter_sets[scanner][name] for scanner, name in AVERAGED]
OF_SETS = {
    "adjustments": [
        per_window(f"{RESULTS}/adjustment/{{sample}}/{{window}}.csv", samples)
        for samples in OF_AVERAGES
    ],
    "covariances": [
        per_window(
            f"{RESULTS}/adjustment/{{sample}}/{{window}}.covariance.csv", samples
        )
        for samples in OF_AVERAGES
    ],
    "assigned": [
        per_window(f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet", samples)
        for samples in OF_AVERAGES
    ],
    "calibration": factory_paths([scanner for scanner, _ in AVERAGED]),
}


rule average_set:
    input:
        adjustments=grouped(OF_SETS["adjustments"]),
        covariances=grouped(OF_SETS["covariances"]),
        assigned=grouped(OF_SETS["assigned"]),
        calibration=grouped(OF_SETS["calibration"]),
    output:
        csv=set_files("csv"),
        json=set_files("json"),
        yaml=set_files("yaml"),
        xml=set_files("xml"),
        decoder=set_files("velodyne_decoder.yaml"),
        scatter=set_files("scatter.csv"),
    log:
        f"{RESULTS}/logs/average_set.log",
    localrule: True
    params:
        taken=taken(**OF_SETS),
        scanner=[scanner for scanner, _ in AVERAGED],
        weights=lambda wildcards: STUDY.average,
        samples=[samples_per_window(samples) for samples in OF_AVERAGES],
        positions=[positions_per_window(samples) for samples in OF_AVERAGES],
        export=SETTINGS.export.plain(),
    script:
        "../../scripts/average_set.py"


# For each set and calibration: its exported files, and what it was adjusted on.
CANDIDATES = [
    (scanner, name) for scanner in STUDY.scanners for name in STUDY.candidates(scanner)
]
OF_EXPORTS = {
    "assigned": [
        per_window(
            f"{RESULTS}/assigned/{{sample}}/{{window}}.parquet",
            samples_of_candidate(*each),
        )
        for each in CANDIDATES
    ],
    "surveys": [
        at_positions(f"{RESULTS}/survey/{{position}}.json", samples_of_candidate(*each))
        for each in CANDIDATES
    ],
    "calibration": factory_paths([scanner for scanner, _ in CANDIDATES]),
    "files": [[f"{path}.{suffix}" for suffix in PROGRAM_SUFFIXES] for path in SETS],
}


rule prove_exports:
    input:
        assigned=grouped(OF_EXPORTS["assigned"]),
        surveys=grouped(OF_EXPORTS["surveys"]),
        calibration=grouped(OF_EXPORTS["calibration"]),
        csv=[f"{path}.csv" for path in SETS],
        files=grouped(OF_EXPORTS["files"]),
    output:
        exports=[f"{path}.exports.csv" for path in SETS],
    log:
        f"{RESULTS}/logs/prove_exports.log",
    params:
        taken=taken(**OF_EXPORTS),
        scanner=[scanner for scanner, _ in CANDIDATES],
        positions=[
            positions_per_window(samples_of_candidate(*each)) for each in CANDIDATES
        ],
    script:
        "../../scripts/prove_exports.py"
