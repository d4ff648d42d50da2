# Configuration and helpers; no rules. Everything is checked here, before the DAG: a sample table
# that names a missing recording would otherwise be answered by "Nothing to be done" while old
# results lie there.

from pathlib import Path

from velocal.errors import VelocalError
from velocal.io.provenance import library_digest
from velocal.scanner.models import SCANNERS
from velocal.study.files import check_files
from velocal.study.samples import NOMINAL, WHOLE, WINDOWS
from velocal.study.study import read_study
from velocal.study.world import check_world, read_world

# Not `workflow.basedir`: that is the folder of whichever Snakefile includes this workflow.
WORKFLOW = Path(str(workflow.current_basedir)).parent
SCRIPTS = WORKFLOW.parent / "scripts"
CONFIG_NAME = "configuration"

try:
    STUDY = read_study(config, CONFIG_NAME)
    SETTINGS = STUDY.config
    RESULTS = SETTINGS.folder
    WORLD = SETTINGS.simulation.world if SETTINGS.simulation else None
    if WORLD:
        SIMULATED = read_world(Path(WORLD))
        check_world(STUDY, SIMULATED, WORLD)
    check_files(STUDY, CONFIG_NAME)
except VelocalError as error:
    raise WorkflowError(str(error)) from None


FIGURES, METHODS = SETTINGS.figures, SETTINGS.methods


def one_of(names):
    """Wildcard constraint: one of some names, or nothing at all."""
    return "|".join(map(re.escape, names)) or "(?!)"


wildcard_constraints:
    sample=one_of(STUDY.samples),
    window=one_of([*WINDOWS, WHOLE]),
    position=one_of(STUDY.positions),
    scanner=one_of(dict.fromkeys(s.scanner for s in STUDY.samples.values())),
    parameter_set=r"\w+",
    table=r"\d",
    figure=one_of(FIGURES),
    seed=r"\d+",


def library(script):
    """Digest of the library modules that a script imports, so that it reruns when one changes."""
    return library_digest(SCRIPTS / f"{script}.py")


def sample_of(wildcards):
    return STUDY.samples[wildcards.sample]


def calibration_file(wildcards):
    """Factory calibration of a sample, as input; nothing for nominal values."""
    path = sample_of(wildcards).calibration
    return [] if path == NOMINAL else path


def factory_path(scanner):
    """Factory calibration of a scanner, as input; nothing for nominal values."""
    path = STUDY.factories.get(scanner, NOMINAL)
    return [] if path == NOMINAL else path


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


def samples_of_set(wildcards):
    return STUDY.parameter_sets[wildcards.scanner][wildcards.parameter_set]


def set_files(suffixes=("csv", "yaml", "xml")):
    return [
        f"{RESULTS}/parameter_sets/{scanner}/{name}.{suffix}"
        for scanner, sets in STUDY.parameter_sets.items()
        for name in sets
        for suffix in suffixes
    ]


def table_files(suffixes=("csv", "md", "tex")):
    return expand(
        f"{RESULTS}/tables/table_{{table}}.{{suffix}}",
        table=SETTINGS.tables,
        suffix=suffixes,
    )


def figure_files(suffixes=("svg", "png", "csv")):
    return expand(
        f"{RESULTS}/figures/figure_{{figure}}.{{suffix}}",
        figure=FIGURES,
        suffix=suffixes,
    )


def method_files(suffixes=("csv", "md", "svg", "png")):
    return [f"{RESULTS}/methods/comparison.{s}" for s in suffixes if METHODS]


def figure_input(wildcards):
    """Histograms read residuals of their samples, the others the statistics per laser."""
    figure = FIGURES[wildcards.figure]
    if figure.kind == "histogram":
        return per_window(
            f"{RESULTS}/residuals/{{sample}}/{{window}}.parquet", figure.samples
        )
    return [f"{RESULTS}/statistics/lasers.csv"]


def field_files():
    table = [f"{RESULTS}/field/table.csv"] if STUDY.unsurveyed else []
    return [
        *table,
        *expand(
            f"{RESULTS}/field/{{sample}}/planes.{{suffix}}",
            sample=STUDY.unsurveyed,
            suffix=("json", "svg", "png"),
        ),
    ]


def targets():
    """Everything that the study asks for."""
    wanted = [f"{RESULTS}/report.html"]
    if STUDY.observations:
        wanted.append(f"{RESULTS}/survey/network.svg")
    if STUDY.surveyed:
        wanted += set_files()
        wanted += [f"{RESULTS}/statistics/{name}.csv" for name in ("lasers", "summary")]
        wanted += table_files() + figure_files() + method_files()
        if SETTINGS.compare_with_paper:
            wanted.append(f"{RESULTS}/published/agreement.csv")
        if METHODS and WORLD:
            wanted.append(f"{RESULTS}/methods/coverage.csv")
        if WORLD:
            wanted += [
                f"{RESULTS}/simulation/truth/{name}.csv" for name in STUDY.scanners
            ]
    return wanted + field_files() + outdoor_files()
