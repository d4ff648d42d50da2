"""Run a small study through Slurm on this machine, to show that `profiles/slurm` works.

Usage (as root): python benchmarks/slurm.py FOLDER [--keep]

Needs the packages slurm-wlm and munge of the distribution, and the plugin
(`pip install 'velocal[slurm]'`). It writes /etc/slurm/slurm.conf, which must not exist before,
because the plugin asks the commands of Slurm, which read it there. Everything else lies in FOLDER,
which must not exist. At the end the daemons are stopped, the file is removed, and the results are
compared, byte by byte, with those of the same study without Slurm.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from support.running import copy_project, environment  # noqa: E402
from support.tiny import make_tiny  # noqa: E402

CONFIGURATION = Path("/etc/slurm/slurm.conf")
SETTINGS = """\
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
ReturnToService=2
# Finished jobs stay known for a day: the plugin asks for them, and there is no accounting database.
MinJobAge=86400
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory={memory_mb} State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def main(arguments: Sequence[str]) -> None:
    """Run the study twice, and say what differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--keep", action="store_true", help="keep the folder")
    chosen = parser.parse_args(arguments)
    for command in ("slurmctld", "slurmd", "munged", "scontrol", "squeue", "sbatch"):
        if shutil.which(command) is None:
            parser.error(f"no {command} here. Hint: apt-get install slurm-wlm munge")
    if CONFIGURATION.exists():
        parser.error(f"{CONFIGURATION} exists: this machine has a cluster of its own already")
    chosen.folder.mkdir(parents=True)
    found = []
    for name, profile in (("alone", "profiles/default"), ("slurm", "profiles/slurm")):
        place = copy_project((chosen.folder / name).resolve())
        make_tiny(place)
        command = [sys.executable, "-m", "snakemake", "--workflow-profile", profile]
        started = time.monotonic()
        if name == "slurm":
            with cluster(chosen.folder.resolve()):
                run([*command, "--jobs", "8"], place)
                run(["squeue", "--all", "--states=all", "--format=%.6i %.9T %.8M %.60j"], place)
        else:
            run([*command, "--cores", str(os.cpu_count())], place)
        print(f"{name}: {time.monotonic() - started:.0f} s", flush=True)
        found.append(digests(place / "results"))
    different = sorted(
        name
        for name in found[0].keys() | found[1].keys()
        if found[0].get(name) != found[1].get(name)
    )
    print(f"{len(found[0])} files, {len(different)} differ", *different, sep="\n")
    if not chosen.keep:
        shutil.rmtree(chosen.folder)
    sys.exit(bool(different))


def run(command: Sequence[str], place: Path) -> None:
    """Run a command whose failure ends all."""
    subprocess.run(command, cwd=place, env=environment(place), check=True)


@contextmanager
def cluster(folder: Path) -> Iterator[None]:
    """A cluster of one machine, until the end of the block."""
    for name in ("state", "spool"):
        (folder / name).mkdir()
    munge = Path("/run/munge")
    munge.mkdir(exist_ok=True)
    shutil.chown(munge, "munge", "munge")
    munged = subprocess.Popen(["runuser", "-u", "munge", "--", "munged", "--foreground"])
    memory_mb = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20 * 9 // 10
    CONFIGURATION.parent.mkdir(parents=True, exist_ok=True)
    CONFIGURATION.write_text(
        SETTINGS.format(
            host=socket.gethostname().split(".")[0],
            folder=folder,
            cores=os.cpu_count(),
            memory_mb=memory_mb,
        ),
        encoding="ascii",
    )
    try:
        time.sleep(1.0)
        subprocess.run(["slurmctld", "-i"], check=True)
        subprocess.run(["slurmd"], check=True)
        wait_for_node()
        yield
    finally:
        subprocess.run(["scontrol", "shutdown"], check=False)
        time.sleep(2.0)
        munged.terminate()
        munged.wait()
        CONFIGURATION.unlink()


def wait_for_node() -> None:
    """Wait until the node takes jobs."""
    for _ in range(60):
        done = subprocess.run(
            ["sinfo", "--noheader", "--format=%t"], capture_output=True, text=True, check=False
        )
        if done.stdout.strip() == "idle":
            return
        time.sleep(1.0)
    sys.exit(f"error: no node is ready: {done.stdout}{done.stderr}")


def digests(folder: Path) -> dict[str, str]:
    """Digest of every result but logs and measurements of time."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and path.relative_to(folder).parts[0] not in ("logs", "benchmarks")
    }


if __name__ == "__main__":
    main(sys.argv[1:])
