"""A small complete study to try velocal on: simulated captures, survey and factory's file."""

from __future__ import annotations

import gzip
import struct
from collections.abc import Iterator
from pathlib import Path

from velocal.calibration.files import formats
from velocal.io import storage
from velocal.packets.data import PAYLOAD_BYTES
from velocal.scanner.models import SCANNERS
from velocal.simulation import capture, world
from velocal.simulation.survey import field_book
from velocal.simulation.truth import factory_parameters
from velocal.study.shipped import shipped
from velocal.study.template import CAPTURES, FACTORY, write_templates
from velocal.survey.network.survey import adjust_field_book
from velocal.survey.targets import write_targets

#: One unit at two positions of the simulated world of the study.
SCANNER = "HDL-32E"
SAMPLES = {"monday": "P5", "tuesday": "P6"}
#: Complete rotations of each of the windows at the beginning, in the middle and at the end.
WINDOW_ROTATIONS = 3
#: Complete rotations of a capture: the windows, and some between them that are only judged.
ROTATIONS = 3 * WINDOW_ROTATIONS + 2

_FRAME_BYTES = 42 + PAYLOAD_BYTES
#: Of a capture of Ethernet frames with times in microseconds.
_PCAP_HEAD = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
#: 2012-06-14 09:00:00 UTC; the same input gives the same bytes on any day.
_BEGIN_S = 1_339_664_400


def write_example(folder: Path) -> list[Path]:
    """Write the example: all that `velocal init` writes, filled in, and the simulated files.

    The numbers are those of the simulated world that comes with velocal, whose seed is fixed:
    the packets and the survey are always the same.

    Parameters
    ----------
    folder : Path
        Is made where it does not exist.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ConfigError
        If one of the files of the study exists.
    """
    simulated = world.read(shipped("config/world.yaml"))
    surveyed = adjust_field_book(field_book(simulated))
    values = {
        "scanner": SCANNER,
        "samples": list(SAMPLES),
        "positions": list(SAMPLES.values()),
        "captures": CAPTURES,
        "factory": FACTORY,
        "rotations": WINDOW_ROTATIONS,
        "azimuth_bin_deg": SCANNERS[SCANNER].azimuth_bin_ticks / 100,
        "planes": sorted(set(map(str, surveyed.planes.group))),
    }
    written = write_templates(folder, "example", values)
    for sample, position in SAMPLES.items():
        path = folder / CAPTURES / f"{sample}.pcap.gz"
        records = capture.records(simulated, SCANNER, position, sample, ROTATIONS)
        content = gzip.compress(b"".join(_pcap(records)), compresslevel=6, mtime=0)
        storage.write_blocks(path, [content])
        written.append(path)
    formats.write(folder / FACTORY, factory_parameters(simulated, SCANNER))
    survey = folder / "survey"
    survey.mkdir(exist_ok=True)
    tables = {
        "planes": ("plane", [surveyed.planes]),
        "base_scanner": ("scanner", [surveyed.base_scanner[SCANNER].targets]),
        "base_field": ("position", [surveyed.base_site[each] for each in SAMPLES.values()]),
    }
    for name, (group, targets) in tables.items():
        write_targets(survey / f"{name}.csv", group, targets)
    return [*written, folder / FACTORY, *(survey / f"{name}.csv" for name in tables)]


def _pcap(records: Iterator[bytes]) -> Iterator[bytes]:
    """Capture of Ethernet frames: a head, then each frame behind its time and length."""
    yield _PCAP_HEAD
    interval_us = 1e6 / SCANNERS[SCANNER].packet_rate_hz
    number = 0
    for block in records:
        for at in range(0, len(block), _FRAME_BYTES):
            seconds, microseconds = divmod(round(number * interval_us), 1_000_000)
            yield struct.pack("<IIII", _BEGIN_S + seconds, microseconds, _FRAME_BYTES, _FRAME_BYTES)
            yield block[at : at + _FRAME_BYTES]
            number += 1
