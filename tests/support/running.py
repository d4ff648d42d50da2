"""Real Snakemake runs in a temporary copy of the project: the checkout's results stay untouched."""

import contextlib
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

#: What a run needs, relative to the checkout.
PARTS = ("Snakefile", "environment.yml", "config", "profiles", "scripts", "src", "workflow")


def copy_project(folder: Path) -> Path:
    """Copy what a run needs into a folder, which is made; the library too, so it can be edited."""
    folder.mkdir(parents=True, exist_ok=True)
    ignored = shutil.ignore_patterns("__pycache__", ".*", "*.part")
    for name in PARTS:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=ignored, dirs_exist_ok=True)
        else:
            shutil.copy(source, folder / name)
    return folder


def environment(folder: Path) -> dict[str, str]:
    """Environment of a run in a copy of the project: with the library of that copy."""
    paths = [str(folder / "src"), os.environ.get("PYTHONPATH", "")]
    return os.environ | {
        # Sums of several threads are rounded otherwise. Snakemake says the same to each job.
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "XDG_CACHE_HOME": str(folder / ".cache"),
        # Every job imports the same modules: Python keeps them compiled, as `make` has it too.
        "PYTHONDONTWRITEBYTECODE": "",
    }


def snakemake(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Snakemake in a copy of the project."""
    return completed(folder, "snakemake", *arguments)


def velocal_run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """`velocal run` in the folder of a study."""
    return completed(folder, "velocal.cli", "run", *arguments)


def completed(
    folder: Path, *command: str, max_file_bytes: int | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a module of Python in a folder to its end; no file may become larger than the limit."""

    def limit() -> None:
        _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (max_file_bytes, hard))

    # Python would keep the part of a compiled module that fits, and could not import it again.
    also = {} if max_file_bytes is None else {"PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [sys.executable, "-m", *command],
        cwd=folder,
        env=environment(folder) | also,
        capture_output=True,
        text=True,
        check=False,
        timeout=1200,
        preexec_fn=None if max_file_bytes is None else limit,
    )


@contextlib.contextmanager
def small_disk(largest: int | None) -> Iterator[None]:
    """No file of this process may become larger; none for no limit."""
    if largest is None:
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    compiled, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # as for `completed`
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        sys.dont_write_bytecode = compiled
