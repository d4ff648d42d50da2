# What makes a job run again, what begins and ends a run, and one run at a time; no rules.
#
# Snakemake compares the times of files, the params and the script of a job with those of its last
# run. The functions here let it see all else: modules of the library, files of an older time, and
# outputs that are missing in the middle.

import atexit
import functools

from snakemake.common import NOTHING_TO_BE_DONE_MSG
from snakemake.iocontainers import Wildcards
from velocal.io.identity import WHOLE_BYTES, identify
from velocal.io.provenance import library_digest
from velocal.io.run_times import write_summary
from velocal.study.files import given_files
from velocal.study.shipped import shipped

GIVEN = given_files(STUDY)


# `velocal run` has begun already. This is not called in a dry run and in jobs.
onstart:
    try:
        run_lock.begin(RESULTS, logger.warning)
    except VelocalError as error:
        raise WorkflowError(str(error)) from None
    # Snakemake's limit of jobs per second makes it look at all jobs again a second after each look,
    # so that with every job that ends there is one look a second more: after 2000 jobs it does
    # nothing else. A cluster may need the limit, this machine does not.
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None


# The last lines of a run stand behind those of Snakemake itself.
onsuccess:
    write_summary(Path(f"{RESULTS}/benchmarks"))
    atexit.register(print, "\n".join(last_words()))


def also_with_nothing_to_do(record):
    """Have the last lines printed after a run without jobs: Snakemake calls no handler then."""
    if record.msg == NOTHING_TO_BE_DONE_MSG and not workflow.dryrun:
        atexit.register(print, "\n".join(last_words()))
    return True


logger.addFilter(also_with_nothing_to_do)


def complete(rules):
    """Give every rule of these files what is the same for all of them.

    `library` is a digest of the library behind the script. Snakemake itself sees only a change of
    the script, so this param is what lets a job run again after a change of a module.

    `given` are digests of those inputs of a job that people hand over. Snakemake itself compares
    only the times of files, so this param is what lets a job run again after `cp -p` or `rsync -t`
    has put an older file there.

    `benchmark` is measured by Snakemake: where time and memory went. These numbers differ from run
    to run, so nothing is made from them but a summary, when a run ends.

    The environment says which packages the script needs. velocal must be installed in it too, as
    environment.yml tells; no channel has it, so `--software-deployment-method conda` cannot make it.
    """
    for each in rules:
        script = Path(str(each.script or "")).name
        if script and each.basedir == RULES and "library" not in each.params.keys():
            # The workflow may be in a git repository; the library has the same scripts.
            script = shipped(f"scripts/{script}")
            each.set_params(library=library_digest(script), given=given_inputs(each))
            each.benchmark_modifier = each.log_modifier
            each.benchmark = benchmark_of(each)
            each.conda_env = "../../environment.yml"
            if str(RULES).startswith("git+file:"):
                # Snakemake 9.27 cannot find a relative script there.
                each.script = str(RULES.join(each.script))


def benchmark_of(rule):
    """Path like that of the rule's log."""
    log = str(rule.log[0]).removeprefix(f"{RESULTS}/logs/").removesuffix(".log")
    return f"{RESULTS}/benchmarks/{log}.tsv"


def given_inputs(rule):
    """Function of the wildcards that identifies the inputs of a rule that no rule makes.

    Not a function of `input`: Snakemake does not remember params that depend on it.
    """

    def identities(wildcards):
        paths = dict.fromkeys(map(str, rule.expand_input(wildcards)[0]))
        return " ".join(f"{path}:{identity(path)}" for path in paths if path in GIVEN)

    return identities


@functools.cache
def identity(path):
    """Size and digest of a file; of a large one, of which only the ends are digested, its time too."""
    found = identify(Path(path))
    time = Path(path).stat().st_mtime_ns if found.bytes > WHOLE_BYTES else ""
    return f"{found.bytes}:{found.digest}:{time}"


def after_checks(wildcards):
    """Findings on the survey, as input of jobs that wait for the checks but do not change with them.

    While checks have to run, Snakemake does not look whether a job behind them has another reason
    to run; with `ancient` alone it would leave such a job out, and its old results would pass for
    new ones. Behind a checkpoint it looks again when the checks are done.
    """
    return ancient(checkpoints.check_survey.get().output.checks)


def with_all_before(targets):
    """Files, and every file that is made on the way to them.

    A job that fails or is stopped leaves no output, and Snakemake forgets what it was made with.
    While files that were once made from it are there, it would not be missed: the next run would
    say "Nothing to be done", and results of before the change would pass for new ones.
    """
    found, seen, jobs, open_ = {}, set(), set(), [*targets]
    while open_:
        path = open_.pop()
        if isinstance(path, list):
            open_ += path
            continue
        if path in seen:
            continue
        seen.add(path)
        maker = next((rule for rule in workflow.rules if rule.is_producer(path)), None)
        if maker is None:
            continue
        values = maker.get_wildcards(path)
        found[path] = None
        job = maker.name, *sorted(values.items())
        if job in jobs:
            continue  # it makes other files too
        jobs.add(job)
        wildcards = Wildcards(fromdict=values)
        open_ += maker.expand_input(wildcards)[0]
        open_ += maker.expand_output(wildcards)[0]
    return list(found)
