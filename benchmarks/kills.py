"""Kill runs of a study at random times; the same command must then finish with the same bytes.

Usage: python benchmarks/kills.py STUDY WORK [--kills 20] [--longest 25] [--cores 2] [--seed 1]

STUDY is a folder with a Snakefile, as `velocal init` writes it, or a checkout. It is copied twice
into WORK. One copy runs undisturbed, the other is killed: in turn the process alone with SIGKILL
(its jobs live on), all processes with SIGKILL, and all with SIGINT as Ctrl-C does. Whenever
the killed study is finished before the kills are used up, it is compared and begun anew.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

RESULTS = "results"
WAYS = ("one SIGKILL", "all SIGKILL", "Ctrl-C")
NOT_COPIED = shutil.ignore_patterns(RESULTS, ".snakemake", ".git", ".venv", ".cache")


def main() -> None:
    """Kill, finish, compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", type=Path)
    parser.add_argument("work", type=Path)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--longest", type=float, default=25.0, help="seconds before a kill")
    parser.add_argument("--cores", default="2")
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    undisturbed, killed = chosen.work / "undisturbed", chosen.work / "killed"
    for folder in (undisturbed, killed):
        if not folder.exists():
            shutil.copytree(chosen.study, folder, ignore=NOT_COPIED, symlinks=True)
    finish(undisturbed, chosen.cores)
    expected = digests(undisturbed)
    rng = random.Random(chosen.seed)
    done, finished = 0, 0
    while done < chosen.kills or not finished:
        if done == chosen.kills:
            finish(killed, chosen.cores)
            code: int | None = 0
        else:
            code = killed_once(killed, chosen.cores, rng.uniform(1.0, chosen.longest), done)
        if code is None:
            done += 1
            continue
        if code != 0:
            sys.exit(f"a run after {done} kills ended with exit code {code}")
        found = digests(killed)
        others = [name for name in expected | found if expected.get(name) != found.get(name)]
        print(f"{done} kills: finished, {len(found)} files, {len(others)} are not the same")
        if others:
            sys.exit("\n".join(others))
        finished += 1
        if done < chosen.kills:
            shutil.rmtree(killed / RESULTS)
            shutil.rmtree(killed / ".snakemake")
    print(f"{done} kills, {finished} times finished with the bytes of an undisturbed run")


def killed_once(folder: Path, cores: str, after_s: float, number: int) -> int | None:
    """Run and kill after some seconds; the exit code if the run ends before, else None."""
    process = started(folder, cores)
    try:
        return process.wait(timeout=after_s)
    except subprocess.TimeoutExpired:
        pass
    way = WAYS[number % len(WAYS)]
    files = sum(path.is_file() for path in (folder / RESULTS).rglob("*"))
    print(f"kill {number + 1}: {way} after {after_s:.1f} s, {files} files are there", flush=True)
    if way == "one SIGKILL":
        process.kill()
    else:
        os.killpg(process.pid, signal.SIGINT if way == "Ctrl-C" else signal.SIGKILL)
    process.wait()
    return None


def finish(folder: Path, cores: str) -> None:
    """Run to the end."""
    code = started(folder, cores).wait()
    if code:
        sys.exit(f"the run in {folder} ended with exit code {code}; see {folder / 'run.log'}")


def started(folder: Path, cores: str) -> subprocess.Popen[bytes]:
    """Start a run in a process group of its own; what it says is added to `run.log`."""
    command = [sys.executable, "-m", "velocal.cli", "run", "--cores", cores]
    with (folder / "run.log").open("ab") as log:
        log.write(f"--- {time.strftime('%H:%M:%S')}\n".encode())
        log.flush()
        return subprocess.Popen(
            command,
            cwd=folder,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            # A shell lets its background processes ignore Ctrl-C, and they hand that on.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )


def digests(folder: Path) -> dict[str, str]:
    """Digest of every result but the logs."""
    results = folder / RESULTS
    return {
        path.relative_to(results).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(results.rglob("*"))
        if path.is_file() and not {"logs", "benchmarks"} & set(path.relative_to(results).parts)
    }


if __name__ == "__main__":
    main()
