"""What the measurements of speed share: measuring in turn, ratios, simulated recordings."""

from __future__ import annotations

import gzip
import os
import resource
import struct
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from velocal.calibration.files import formats
from velocal.io.markup import markdown_table
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters
from velocal.simulation import capture, truth, world

ROOT = Path(__file__).parents[1]
#: Bytes of Ethernet, IPv4 and UDP headers before a payload.
HEADERS = 42
Work = Callable[[], object]


@dataclass
class Measures:
    """Works that are measured in turn, so that each ratio is of neighbours in time.

    Attributes
    ----------
    works : dict of str to callable
        By name; those of which a package is missing are not there.
    missing : dict of str to str
        Package that is missing, by name of the work.
    seconds : dict of str to list of float
        Processor time of all threads of every round.
    """

    works: dict[str, Work] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, list[float]] = field(default_factory=dict)

    def add(self, name: str, work: Work, *, needs: str | None = None) -> None:
        """Add a work, which may need a package of the environment of `make bench`."""
        if needs is not None and find_spec(needs) is None:
            self.missing[name] = needs
        else:
            self.works[name] = work

    def run(self, rounds: int, clock: Callable[[], float] = time.process_time) -> None:
        """Do all works once without measuring, then in so many rounds."""
        for work in self.works.values():
            work()
        self.seconds = {name: [] for name in self.works}
        for _ in range(rounds):
            for name, work in self.works.items():
                start = clock()
                work()
                self.seconds[name].append(clock() - start)

    def took(self, name: str) -> float:
        """Median time, seconds."""
        return float(np.median(self.seconds[name]))

    def ratio(self, name: str, other: str) -> str:
        """How many times longer the other takes: median of the rounds, and least to largest."""
        if name not in self.seconds or other not in self.seconds:
            return ""
        ratios = np.array(self.seconds[other]) / np.array(self.seconds[name])
        low, middle, high = (_short(each) for each in np.quantile(ratios, (0.0, 0.5, 1.0)))
        return f"{middle} ({low} to {high})"

    def time_of(self, name: str) -> str:
        """Median time for a table, milliseconds; or which package is missing."""
        if name in self.missing:
            return f"{self.missing[name]} is not installed"
        return _short(1e3 * self.took(name))


def _short(value: float) -> str:
    """Two digits at least, and no more decimals than these need."""
    return f"{value:.0f}" if value >= 20 else f"{value:.1f}" if value >= 1 else f"{value:.2f}"


def table(headings: Sequence[str], rows: Sequence[Sequence[str]], texts: int = 1) -> str:
    """Markdown table whose first columns are texts."""
    numeric = [False] * texts + [True] * (len(headings) - texts)
    return "\n".join(markdown_table(headings, rows, numeric))


def children() -> float:
    """Processor time of all processes that were started and have ended, seconds."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def machine() -> str:
    """The machine in general terms: processors and memory."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    kinds = {
        line.split(":")[1].strip()
        for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        if line.startswith("model name")
    }
    return f"{os.cpu_count()} processors ({', '.join(sorted(kinds))}), {memory:.0f} GB of memory"


def read(path: Path) -> int:
    """Read all bytes of a file, 8 MiB at a time, and count them."""
    count = 0
    with path.open("rb", buffering=0) as file:
        while piece := file.read(8 << 20):
            count += len(piece)
    return count


@dataclass(frozen=True)
class Recorded:
    """The same packets in every framing, and the calibration of the factory.

    Attributes
    ----------
    files : dict of str to Path
        By framing.
    calibration : Path
        YAML, with the near-point corrections of the factory.
    factory : LaserParameters
    packets : int
    seconds : float
        Length of the recording.
    """

    files: Mapping[str, Path]
    calibration: Path
    factory: LaserParameters
    packets: int
    seconds: float


def _world() -> world.World:
    return world.load(yaml.safe_load((ROOT / "config/world.yaml").read_text("utf-8")))


def records(scanner: str, rotations: int) -> NDArray[np.uint8]:
    """Packets of a simulated scanner with their network headers, shape (n, 1248)."""
    blocks = capture.records(_world(), scanner, "P2", "bench", rotations)
    return np.frombuffer(b"".join(blocks), np.uint8).reshape(-1, 1248)


def recorded(folder: Path, scanner: str, rotations: int) -> Recorded:
    """Write a simulated recording in every framing."""
    factory = truth.factory_parameters(_world(), scanner)
    calibration = folder / "factory.yaml"
    formats.write(calibration, factory)
    packets = records(scanner, rotations)
    interval_s = 1.0 / SCANNERS[scanner].packet_rate_hz
    micro = np.rint(np.arange(len(packets)) * interval_s * 1e6).astype(np.int64)
    files = {name: folder / f"bench.{name}" for name in ("bin", "pcap", "pcapng", "pcap.gz")}
    files["bin"].write_bytes(packets[:, HEADERS:].tobytes())
    files["pcap"].write_bytes(b"".join(_pcap(packets, micro)))
    files["pcapng"].write_bytes(b"".join(_pcapng(packets, micro)))
    files["pcap.gz"].write_bytes(gzip.compress(files["pcap"].read_bytes(), 1))
    return Recorded(files, calibration, factory, len(packets), len(packets) * interval_s)


def _pcap(packets: NDArray[np.uint8], micro: NDArray[np.int64]) -> Iterator[bytes]:
    yield struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    heads = np.full((len(packets), 4), packets.shape[1], dtype="<u4")
    heads[:, 0], heads[:, 1] = np.divmod(micro, 10**6)
    yield _behind(heads, packets).tobytes()


def _pcapng(packets: NDArray[np.uint8], micro: NDArray[np.int64]) -> Iterator[bytes]:
    yield struct.pack("<IIIHHqI", 0x0A0D0D0A, 28, 0x1A2B3C4D, 1, 0, -1, 28)
    yield struct.pack("<IIHHII", 1, 20, 1, 0, 65535, 20)
    size = packets.shape[1] + 32
    heads = np.full((len(packets), 7), packets.shape[1], dtype="<u4")
    heads[:, :3] = 6, size, 0
    heads[:, 3], heads[:, 4] = np.divmod(micro, 2**32)
    tails = np.full((len(packets), 1), size, dtype="<u4")
    yield np.concatenate([_behind(heads, packets), tails.view(np.uint8)], axis=1).tobytes()


def _behind(heads: NDArray[np.uint32], packets: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Every packet behind its header."""
    return np.concatenate([heads.view(np.uint8), packets], axis=1)
