# Configuration and helpers; no rules. Everything is checked here, before the DAG: a sample table
# that names a missing recording would otherwise be answered by "Nothing to be done" while old
# results lie there.

import gc
import os
from pathlib import Path

from snakemake.settings.types import DeploymentMethod
from velocal.errors import VelocalError, visible
from velocal.io import run_lock
from velocal.simulation.world import check_world, read as read_world
from velocal.study.files import check_files, check_times
from velocal.study.samples import NOMINAL
from velocal.study.study import read_study
from velocal.study.windows import MAX_MISSING, WHOLE, WINDOWS
from velocal.survey.checks.findings import read_findings
from velocal.survey.files import check_survey

# Snakemake itself and what is imported here live until the end: Python need not visit them again
# and again to look for garbage, as in jobs (`velocal.io.scripts.run`).
gc.freeze()

# Not `workflow.basedir`: that is the folder of whichever Snakefile includes this workflow.
RULES = workflow.current_basedir
CONFIG_NAME = ", ".join(map(str, workflow.configfiles)) or "configuration"

# The C library of Linux gives large arrays back to the system when they are freed, and jobs would
# spend a tenth of their time on asking for the same memory again.
for limit in ("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_"):
    os.environ.setdefault(limit, str(2**30))

if DeploymentMethod.CONDA in workflow.deployment_settings.deployment_method:
    raise WorkflowError(
        "Snakemake cannot make the environment of a job by conda: no channel of conda has velocal.\n"
        "Hint: Make the environment yourself, as environment.yml says, and leave the option out."
    )

try:
    STUDY = read_study(config, CONFIG_NAME)
    SETTINGS = STUDY.config
    RESULTS = SETTINGS.folder
    WORLD = SETTINGS.simulation.world if SETTINGS.simulation else None
    if WORLD:
        SIMULATED = read_world(Path(WORLD))
        check_world(STUDY, SIMULATED, WORLD)
    check_files(STUDY, CONFIG_NAME)
    if workflow.is_main_process:
        check_survey(STUDY)
        check_times(Path(RESULTS))
        if os.environ.get(run_lock.VARIABLE) == run_lock.BEGIN:  # by `velocal run`
            run_lock.begin(RESULTS, logger.warning)
            run_lock.remove_snakemake_locks(RESULTS)
    else:
        run_lock.join()
except VelocalError as error:
    raise WorkflowError(str(error)) from None


FIGURES = SETTINGS.figures
# Samples whose recording is a cloud of points: `read_cloud` makes their returns.
CLOUDS = [name for name, sample in STUDY.unsurveyed.items() if sample.is_cloud]


def one_of(names):
    """Wildcard constraint: one of some names, or nothing at all."""
    return "|".join(map(re.escape, names)) or "(?!)"


wildcard_constraints:
    sample=one_of(STUDY.samples),
    window=one_of([*WINDOWS, WHOLE]),
    position=one_of(STUDY.positions),
    scanner=one_of(dict.fromkeys(s.scanner for s in STUDY.samples.values())),
    seed=r"\d+",


def figures_of(*kinds):
    """Figures of some kinds, by number: each kind is drawn by a rule of its own."""
    return {number: each for number, each in FIGURES.items() if each.kind in kinds}


def figure_files(numbers, suffixes=("svg", "png", "csv")):
    return expand(
        f"{RESULTS}/figures/figure_{{figure}}.{{suffix}}",
        figure=numbers,
        suffix=suffixes,
    )


def table_files(*suffixes):
    return expand(
        f"{RESULTS}/tables/table_{{table}}.{{suffix}}",
        table=SETTINGS.tables,
        suffix=suffixes,
    )


def sample_of(wildcards):
    return STUDY.samples[wildcards.sample]


def recording_of(sample):
    """Recording of a sample, as input; what a storage plugin has is fetched when a job needs it."""
    return sample.recording if not sample.is_remote else storage(sample.recording)


def recordings_of(samples):
    return [recording_of(STUDY.samples[name]) for name in samples]


def outdoor_sample(wildcards):
    return STUDY.outdoor[wildcards.outdoor]


def calibration_file(wildcards):
    """Factory calibration of a sample, as input; nothing for nominal values."""
    path = sample_of(wildcards).calibration
    return [] if path == NOMINAL else path


def described(scanner):
    """File that describes a scanner, as input; nothing for one that velocal knows."""
    return STUDY.scanner_files.get(scanner, [])


def factory_path(scanner):
    """Factory calibration of a scanner, as input; nothing for nominal values."""
    return STUDY.factory_files.get(scanner, [])


def of_windows(pattern):
    """Paths of a pattern for all windows of a surveyed sample; its other wildcards remain."""
    return expand(pattern, window=WINDOWS, allow_missing=True)


def windows_of(wildcards):
    return list(sample_of(wildcards).windows)


def per_window(pattern, samples):
    """Paths of a pattern for all windows of samples."""
    return [
        expand(pattern, sample=name, window=window)[0]
        for name in samples
        for window in STUDY.samples[name].windows
    ]


def samples_per_window(samples):
    """Samples of the paths of `per_window`, one each."""
    return [name for name in samples for _ in STUDY.samples[name].windows]


def positions_per_window(samples):
    """Positions of the paths of `per_window`, one each."""
    return [STUDY.samples[name].position for name in samples_per_window(samples)]


# Parameter sets, scanner by scanner.
AVERAGED = [
    (scanner, name) for scanner, sets in STUDY.parameter_sets.items() for name in sets
]


def set_files(suffix):
    """Files of all parameter sets."""
    return [
        f"{RESULTS}/parameter_sets/{scanner}/{name}.{suffix}"
        for scanner, name in AVERAGED
    ]


def samples_of_calibration(wildcards):
    return STUDY.calibrated_on(wildcards.scanner, wildcards.unit)


def factory_of_calibration(wildcards):
    """Factory calibration that a calibration without a survey corrects, as input."""
    path = STUDY.samples[samples_of_calibration(wildcards)[0]].calibration
    return [] if path == NOMINAL else path


def samples_of_candidate(scanner, name):
    """Samples of a parameter set or of a calibration."""
    sets = STUDY.parameter_sets.get(scanner, {})
    return sets[name] if name in sets else STUDY.calibrations[scanner][name]


def grouped(groups):
    """Files of all calls of a script, each once: an input with `taken`.

    For each output of a job, Snakemake digests each of its inputs, as often as it is named.
    """
    return list(dict.fromkeys(path for group in groups for path in group))


def taken(**groups):
    """Which files of `grouped` every call takes, by name of the input (`velocal.io.scripts`)."""
    found = {}
    for name, each in groups.items():
        numbers = {path: number for number, path in enumerate(grouped(each))}
        found[name] = [[numbers[path] for path in group] for group in each]
    return found


def factory_paths(scanners):
    """Factory calibration of each of some scanners, as `grouped` takes them."""
    return [
        [STUDY.factory_files[name]] if name in STUDY.factory_files else []
        for name in scanners
    ]


def unit_of(wildcards):
    """Calibration that shows as "after" what the windows of a sample were adjusted on; empty where
    they have adjustments of their own."""
    sample = sample_of(wildcards)
    averaged = STUDY.parameter_sets.get(sample.scanner)
    return "" if averaged else STUDY.calibration_of(wildcards.sample) or ""


def adjusted_on(wildcards):
    """Files with the parameters of `unit_of` or of its own adjustment, one for every window."""
    unit, scanner = unit_of(wildcards), sample_of(wildcards).scanner
    if unit:
        return [f"{RESULTS}/parameter_sets/{scanner}/{unit}.csv" for _ in WINDOWS]
    return per_window(
        f"{RESULTS}/adjustment/{{sample}}/{{window}}.csv", [wildcards.sample]
    )


def at_positions(pattern, samples):
    """Paths of a pattern for the positions of samples; those without a survey have none."""
    return [
        expand(pattern, position=STUDY.surveyed[name].position)[0]
        for name in samples
        if name in STUDY.surveyed
    ]


def sets_drawn(figure):
    """Parameter sets and calibrations of a figure of corrections."""
    return list(figure.sets or STUDY.candidates(figure.scanner))


def adjustments_drawn(figure):
    """Adjustments behind each of `sets_drawn`, as pairs of its name and a path."""
    scanner = figure.scanner
    found = []
    for name in sets_drawn(figure):
        samples = STUDY.parameter_sets.get(scanner, {}).get(name)
        if samples is None:
            paths = [f"{RESULTS}/calibrations/{scanner}/{name}.csv"]
        else:
            paths = per_window(
                f"{RESULTS}/adjustment/{{sample}}/{{window}}.csv", samples
            )
        found += [(name, path) for path in paths]
    return found


def last_words():
    """What a run says at its end: the warnings at the top of the report, and where that is."""
    warnings = read_findings(Path(CHECKS)) if Path(CHECKS).is_file() else []
    said = [visible(f"Warning: {warning}") for warning in warnings]
    if not set(workflow.dag_settings.targets) - {"all", "default"}:
        place = f"The report is {RESULTS}/report.html."
        # The last line of the verdicts also says what each calibration is worth.
        text = Path(VERDICTS).read_text("utf-8") if VERDICTS else place
        said.append(text.splitlines()[-1])
    return said


def in_report(kind, category, files):
    """Files as outputs that `snakemake --report` shows, with the caption of their kind."""
    return report(files, caption=f"../report/{kind}.rst", category=category)
