"""Fixtures that every kind of test may use."""

import fcntl
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from support.running import copy_project
from support.tiny import run_tiny

ROOT = Path(__file__).resolve().parents[1]

# The same examples in every run, so that one commit cannot pass and then fail; new ones are
# searched for with `pytest --hypothesis-profile explore`. Time limits per example fail on busy
# machines; a failing example prints how to repeat it.
settings.register_profile("velocal", deadline=None, print_blob=True, derandomize=True)
settings.register_profile("explore", settings.get_profile("velocal"), derandomize=False)
settings.load_profile("velocal")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--freeze", action="store_true", help="rewrite the frozen numbers in tests/golden"
    )


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files of the workflow first for `pytest -n`: they take longest."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        items.sort(key=lambda item: item.get_closest_marker("workflow") is None)


@pytest.fixture(scope="session")
def tiny_study(tmp_path_factory) -> Path:
    """The folder of the finished tiny study: a test puts back what it changes there.

    Processes of `pytest -n` share one run, and each has a copy of it.
    """
    own = tmp_path_factory.mktemp("tiny") / "project"
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return run_tiny(copy_project(own), 2)
    shared = tmp_path_factory.getbasetemp().parent / "tiny study"
    finished = shared.with_suffix(".finished")
    with shared.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not finished.exists():
            shutil.rmtree(shared, ignore_errors=True)
            run_tiny(copy_project(shared), 2)
            finished.touch()
    return shutil.copytree(shared, own)


@pytest.fixture(scope="session")
def study_rules() -> dict[str, Any]:
    """Rules of the study, which has every optional stage, by name."""
    from snakemake.api import SnakemakeApi
    from snakemake.settings.types import OutputSettings, Quietness, ResourceSettings

    with SnakemakeApi(OutputSettings(quiet={Quietness.ALL})) as api:
        loaded = api.workflow(
            resource_settings=ResourceSettings(cores=1),
            snakefile=ROOT / "workflow/Snakefile",
            workdir=ROOT,
        )
        return {rule.name: rule for rule in loaded._workflow.rules}


@pytest.fixture(scope="session")
def root() -> Path:
    """The top folder of the checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of real recordings and calibrations, which the project may not distribute."""
    folder = Path(os.environ.get("VELOCAL_SHARED") or ROOT.parent / "shared").resolve()
    if not (folder / "recordings").is_dir():
        pytest.skip(
            "no real recordings: there is no folder 'recordings' in VELOCAL_SHARED or in "
            "'shared' beside the checkout. Hint: set VELOCAL_SHARED to the folder that holds it"
        )
    return folder
