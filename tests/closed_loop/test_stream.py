"""The chain starts from the recording's own status bytes and ends where it does from the file."""

import numpy as np
import pytest
from support.chain import run, study_world

from velocal.adjustment.solvers import WithPrior
from velocal.adjustment.stochastic import Stochastic

NAMES = ("dl", "alpha", "v")
PRIOR = {"dl": 0.02, "alpha": np.deg2rad(0.2), "v": np.deg2rad(0.2)}
#: Half a step of the wire: 1 mm and 0.01 deg. The offsets are not adjusted: what their rounding
#: moves goes to the angles, at most by its lever, the height of the scanner above the floor.
HALF_MM = 0.5e-3
HEIGHT_M = 0.8
HALF_ANGLE = np.deg2rad(0.005)


@pytest.fixture(scope="module")
def loops(tmp_path_factory):
    return [
        run(
            study_world(),
            "HDL-64E",
            "P2",
            tmp_path_factory.mktemp("loop"),
            rotations=26,
            names=NAMES,
            planes=("short_wall", "long_wall", "floor"),
            solver=WithPrior(),
            stochastic=Stochastic(noise_std_m=0.01, prior_std=PRIOR),
            from_stream=from_stream,
        )
        for from_stream in (False, True)
    ]


def test_the_factory_is_that_of_the_file_but_for_rounding(loops):
    file, stream = (loop.factory for loop in loops)
    for name, half in {
        "dl": HALF_MM,
        "voff": HALF_MM,
        "alpha": HALF_ANGLE,
        "v": HALF_ANGLE,
    }.items():
        apart = np.abs(getattr(stream, name) - getattr(file, name))
        assert 0.0 < apart.max() <= half * (1 + 1e-9)
    assert set(stream.carried) > set(file.carried)


def test_the_adjustment_is_the_same_but_for_rounding(loops):
    file, stream = loops
    for column, bound in enumerate((HALF_MM, *[HALF_ANGLE + HALF_MM / HEIGHT_M] * 2)):
        name = NAMES[column]
        ends = [
            getattr(loop.factory, name) + [a.corrections[column] for a in loop.adjustments]
            for loop in loops
        ]
        assert np.abs(ends[1] - ends[0]).max() <= bound
    for before, after in zip(file.adjustments, stream.adjustments, strict=True):
        assert np.std(after.residuals) == pytest.approx(np.std(before.residuals), abs=1e-4)
        assert after.weakly_determined == before.weakly_determined
