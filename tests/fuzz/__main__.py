"""Fuzz the readers: python -m fuzz [READER...] [--cases N] [--seconds S] [--seed K].

With --cases, so many cases of `mutation` are tried, shared between the readers as in `make test`.
If not, every reader is fuzzed for so many seconds: guided by coverage if atheris is installed
(`pip install 'velocal[fuzz]'`), with `mutation` if not. A case that takes more than 10 s or more
than 4 GB is a finding, as is every exception that is not one of `velocal.errors`. Findings are
written to .fuzz/findings, to become a test in test_fuzz.py.
"""

import argparse
import importlib.util
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from fuzz.mutation import MOST_BYTES, cases

OUT = Path(".fuzz")
SECONDS, GIGABYTES = 10, 4


def place_of(error: BaseException) -> str:
    """Kind of an exception and the line that raised it: findings with the same are one."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__} in {Path(last.filename).name}:{last.lineno}"


def tried(name: str, contents: Iterator[bytes], more: Callable[[], bool]) -> tuple[int, Counter]:
    """Number of cases, and findings by kind."""
    from fuzz.readers import READERS

    def late(*_: object) -> None:
        raise TimeoutError(f"a case took more than {SECONDS} s")

    found: Counter[str] = Counter()
    n = 0
    signal.signal(signal.SIGALRM, late)
    with tempfile.TemporaryDirectory() as folder:
        for content in contents:
            if not more():
                break
            n += 1
            signal.alarm(SECONDS)
            try:
                READERS[name].read(content, Path(folder))
            except Exception as error:  # whatever it is, it is a finding
                found[place_of(error)] += 1
                if found[place_of(error)] == 1:
                    (OUT / "findings").mkdir(parents=True, exist_ok=True)
                    number = f"{zlib.crc32(content):08x}"
                    (OUT / "findings" / f"{name}-{number}").write_bytes(content)
            finally:
                signal.alarm(0)
    return n, found


def by_mutation(name: str, number: int, seconds: float, seed: int) -> tuple[int, Counter]:
    """Try so many cases, or as many as the time allows."""
    from fuzz.readers import READERS

    end = time.monotonic() + seconds
    contents = cases(READERS[name].seeds, number, seed)
    return tried(name, contents, lambda: time.monotonic() < end)


def by_coverage(name: str, seconds: int, seed: int) -> int:
    """Let atheris choose the cases, in a process of its own; its exit code."""
    corpus = OUT / "corpus" / name
    corpus.mkdir(parents=True, exist_ok=True)
    (OUT / "findings").mkdir(parents=True, exist_ok=True)
    command = [
        sys.executable, "-m", "fuzz", "--atheris", name, f"-seed={seed}", str(corpus),
        f"-max_total_time={seconds}", f"-max_len={MOST_BYTES}", f"-timeout={SECONDS}",
        f"-rss_limit_mb={1024 * GIGABYTES}", f"-artifact_prefix={OUT}/findings/{name}-",
        "-print_final_stats=1",
    ]  # fmt: skip
    return subprocess.run(command, check=False).returncode


def atheris_process(name: str, arguments: list[str]) -> None:
    """What runs in the process of `by_coverage`."""
    import atheris

    with atheris.instrument_imports(include=["velocal"]):
        from fuzz.readers import READERS
    reader = READERS[name]
    corpus = OUT / "corpus" / name
    for number, seed in enumerate(reader.seeds):
        (corpus / f"seed{number}").write_bytes(seed)
    with tempfile.TemporaryDirectory() as folder:
        atheris.Setup(["fuzz", *arguments], lambda data: reader.read(data, Path(folder)) and None)
        atheris.Fuzz()


def main() -> int:
    """Fuzz what is asked for, and print what was found."""
    from fuzz.readers import READERS

    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.add_argument("readers", nargs="*", metavar="READER", help=", ".join(READERS))
    parser.add_argument("--cases", type=int, help="cases of all readers together")
    parser.add_argument("--seconds", type=int, default=60, help="time for each reader")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if unknown := set(given.readers) - set(READERS):
        parser.error(f"unknown reader {unknown.pop()!r} (allowed: {', '.join(READERS)})")
    names = given.readers or list(READERS)
    if given.cases is None and importlib.util.find_spec("atheris"):
        return max(by_coverage(name, given.seconds, given.seed) for name in names)
    limit = GIGABYTES << 30
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    shares = sum(READERS[name].share for name in names)
    total, findings = 0, 0
    for name in names:
        wanted = sys.maxsize if given.cases is None else given.cases * READERS[name].share // shares
        seconds = given.seconds if given.cases is None else float("inf")
        start = time.process_time()
        n, found = by_mutation(name, wanted, seconds, given.seed)
        spent = time.process_time() - start
        print(f"{name:14s} {n:8d} cases {spent:8.1f} s {len(found)} findings", flush=True)
        for place, number in found.most_common():
            print(f"    {number:6d} {place}", flush=True)
        total, findings = total + n, findings + len(found)
    print(f"{total} cases, {findings} findings")
    return 1 if findings else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--atheris"]:
        atheris_process(sys.argv[2], sys.argv[3:])
    else:
        sys.exit(main())
