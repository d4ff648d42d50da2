"""The bench of the adjustment: both programs solve the same problem."""

import sys
from pathlib import Path

import numpy as np
import pytest

from velocal.simulation.independent.plan import Plan
from velocal.simulation.independent.trial import draw

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def bench(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    import speed_adjustment

    yield speed_adjustment
    for name in [name for name in sys.modules if name.startswith("speed_")]:
        del sys.modules[name]


def test_the_peer_of_the_paper_s_adjustment_finds_the_same(bench):
    """Within what both leave to the last step: a micrometre, and 0.2 mdeg."""
    _, works = bench.paper(draw(Plan(scanner="HDL-32E", stations=1, every=40), seed=1))
    found = {name: work() for name, work in works.items()}
    ours = found.pop("velocal")
    assert np.all(np.abs(ours).max(axis=0) > 1e-4)
    for other in found.values():
        assert np.abs(other - ours)[:, 0].max() < 1e-6
        assert np.abs(other - ours)[:, 1:].max() < np.deg2rad(2e-4)
