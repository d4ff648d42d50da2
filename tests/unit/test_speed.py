"""Measurements of speed: all framings hold the same packets, and missing programs are named."""

import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from support.capture import record_list, spin

from velocal.points.placing import _counted
from velocal.recording.scan import inspect

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def measure(monkeypatch):
    """The shared module of the measurements, which are no package."""
    monkeypatch.syspath_prepend(str(FOLDER))
    import speed_measure

    yield speed_measure
    del sys.modules["speed_measure"]


def test_the_page_has_a_place_for_every_measurement(measure):
    """Before, all was measured, and then could not be written."""
    speed = importlib.import_module("speed")
    marks = re.findall("<!-- numbers: ([a-z_]+) ", speed.PAGE.read_text())
    assert tuple(marks) == speed.SECTIONS


@pytest.mark.parametrize("framing", ["pcap", "pcapng"])
def test_framings_of_the_measurements_hold_the_packets(framing, measure, tmp_path):
    payloads = spin(300)
    packets = np.frombuffer(b"".join(record_list(payloads, 42)), np.uint8).reshape(-1, 1248)
    path = tmp_path / f"x.{framing}"
    micro = 5_000_000_000 + 553 * np.arange(len(packets))
    path.write_bytes(b"".join(getattr(measure, f"_{framing}")(packets, micro)))
    found = inspect(path)
    assert found.ledger.framing == framing
    assert found.ledger.data.packets == len(packets)
    assert not found.ledger.rejected
    assert found.ledger.unaccounted_bytes == 0


def test_a_program_that_is_missing_is_named(measure):
    measures = measure.Measures()
    measures.add("ours", lambda: sum(range(100_000)))
    measures.add("theirs", lambda: 1 / 0, needs="a_program_that_nobody_has")
    measures.run(3)
    assert measures.time_of("theirs") == "a_program_that_nobody_has is not installed"
    assert measures.ratio("ours", "theirs") == ""
    assert measures.ratio("ours", "ours") == "1.0 (1.0 to 1.0)"


def test_ratios_are_of_the_same_round(measure):
    measures = measure.Measures(seconds={"a": [1.0, 2.0, 4.0], "b": [3.0, 10.0, 16.0]})
    assert measures.ratio("a", "b") == "4.0 (3.0 to 5.0)"


@pytest.mark.parametrize("width", [4, 8, 16, 32])
def test_points_of_firings_of_any_width_are_counted(width):
    used = np.random.default_rng(width).random((50, width)) < 0.7
    np.testing.assert_array_equal(_counted(used), used.sum(axis=1))
