"""Perfect shots and survey: the true parameters come back to what ticks and steps allow.

Every median is wrong by no more than half a tick of the distance (1 mm) plus what the range
changes over half a step of the encoder: |ds/dphi| times 0.045 deg (HDL-64E) or half an azimuth bin
(HDL-32E), and over the 0.005 deg to which the simulation rounds the true angle. Through the
least-squares solution delta = -A^+ w, an error e_i of the misclosures moves parameter j by at
most sum_i |A^+_ji| e_i: that is the bound, and every parameter must keep it. It is the worst case,
in which all errors conspire. If they were independent, the root of the sum of squares would be
expected; nearly all parameters are within four times that. Not all: the range to a level floor
hardly changes with the rotational angle, so that its rounding errors are alike over many cells.
"""

import numpy as np
import pytest
from support.chain import Loop, run, study_world

from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.solvers import PaperModel
from velocal.adjustment.stochastic import Stochastic
from velocal.scanner.parameters import PARAMETERS

NAMES = ("dl", "alpha", "v")
PRIOR = {"dl": 0.02, "alpha": np.deg2rad(0.2), "v": np.deg2rad(0.2)}
TICK_M = 0.002
CASES = {
    "HDL-64E": ("P2", np.deg2rad(0.045 + 0.005)),
    "HDL-32E": ("P5", np.deg2rad(0.05 + 0.005)),
}


@pytest.fixture(scope="module", params=CASES)
def loop(request, tmp_path_factory) -> tuple[Loop, float]:
    position, half_step = CASES[request.param]
    result = run(
        study_world().without_errors(),
        request.param,
        position,
        tmp_path_factory.mktemp("loop"),
        rotations=24,
        names=NAMES,
        planes=("short_wall", "long_wall", "floor"),
        solver=PaperModel(truncate_at=1.0),
        # Half a tick is what is known of a misclosure here.
        stochastic=Stochastic(noise_std_m=TICK_M / 2, prior_std=PRIOR),
    )
    return result, half_step


def bounds(loop: Loop, laser: int, half_step: float) -> tuple[np.ndarray, np.ndarray]:
    """Worst and expected error of the parameters of a laser."""
    own = loop.observations.of_laser(laser)
    _, matrix = own.design(loop.true)
    alpha = matrix[:, PARAMETERS.index("alpha")]
    error = TICK_M / 2 + np.abs(alpha) * half_step
    inverse = np.linalg.pinv(matrix[:, :3])
    return np.abs(inverse) @ error, np.sqrt(inverse**2 @ (error**2 / 3.0))


def test_observable_parameters_return(loop):
    result, half_step = loop
    free, typical = 0, []
    for laser, adjustment in enumerate(result.adjustments):
        if adjustment.weakly_determined:
            continue
        free += 1
        assert adjustment.converged
        true = np.array([getattr(result.true, name)[laser] for name in NAMES])
        start = np.array([getattr(result.factory, name)[laser] for name in NAMES])
        error = np.abs(start + adjustment.corrections - true)
        worst, expected = bounds(result, laser, half_step)
        assert (error <= worst).all(), (laser, error, worst)
        typical.extend(error <= 4.0 * expected)
    assert np.mean(typical) > 0.9
    assert free >= len(result.adjustments) // 3


def test_what_cannot_be_observed_is_named(loop):
    result, _ = loop
    weak = [a for a in result.adjustments if a.weakly_determined]
    for adjustment in weak:
        assert adjustment.rank < len(NAMES)
        assert "left to the prior" in adjustment.message
        for name in adjustment.weakly_determined:
            # What is known of it is what the prior says.
            stated = adjustment.std[NAMES.index(name)]
            assert 0.7 * PRIOR[name] < stated < 1.3 * PRIOR[name]
            # It stays where the factory put it, but for its share in what is estimable.
            assert abs(adjustment.corrections[NAMES.index(name)]) < PRIOR[name]


def test_walls_alone_do_not_show_the_vertical_angle(tmp_path):
    """With the walls only and honest noise, v is weakly determined nearly everywhere, and named."""
    result = run(
        study_world(),
        "HDL-64E",
        "P2",
        tmp_path,
        rotations=12,
        names=NAMES,
        planes=("short_wall", "long_wall"),
        solver=PaperModel(truncate_at=1.0),
        stochastic=Stochastic(noise_std_m=0.02, prior_std=PRIOR),
    )
    weak = [laser for laser, a in enumerate(result.adjustments) if "v" in a.weakly_determined]
    assert len(weak) > 32
    untouched = [a for a in result.adjustments if "v" in a.weakly_determined]
    assert all(abs(a.corrections[2]) < PRIOR["v"] for a in untouched)
    # The pseudo-inverse at machine precision instead sends some of them far away.
    literal = adjust_all(
        result.observations,
        result.factory,
        NAMES,
        PaperModel(truncate_at=None),
        Stochastic(noise_std_m=0.02, prior_std=PRIOR),
    )
    assert max(abs(a.corrections[2]) for a in literal) > 10 * PRIOR["v"]


def test_a_laser_without_points_is_named(loop):
    result, _ = loop
    from velocal.adjustment.lasers import adjust_laser

    data = result.observations
    keep = data.laser_id != 3
    fewer = type(data)(
        data.distance_m[keep], data.phi[keep], data.laser_id[keep], data.normal[keep],
        data.offset[keep],
    )  # fmt: skip
    adjustment = adjust_laser(
        fewer, 3, result.factory, NAMES, PaperModel(), Stochastic(noise_std_m=0.02, prior_std=PRIOR)
    )
    assert adjustment.rank == 0
    assert adjustment.weakly_determined == NAMES
    assert adjustment.message == "no observations"
    assert not adjustment.corrections.any()
