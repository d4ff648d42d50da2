"""Uncertainty of what is not adjusted: how it reaches the misclosures."""

import numpy as np
import pytest

from velocal.adjustment import nuisance
from velocal.adjustment.stochastic import Stochastic, SurveyUncertainty


@pytest.mark.parametrize("block_deg", [None, 1.0])
def test_flatness_leaves_out_what_blocks_have_in_common(block_deg):
    """Rows 2 cm apart on a wall, in segments of some 25 rows, and in blocks of 10 rows.

    A segment of n rows with n_b rows in block b has the share 1 - sum(n_b^2) / n^2 of the variance
    left, as the noise of the blocks contains the rest.
    """
    n, flatness_m = 100, 0.003
    # No row lies on the limit of a segment or a block, where rounding would decide.
    place = 0.0199 * np.arange(n)
    segment = np.floor(place / nuisance.FLATNESS_LENGTH_M).astype(int)
    angle_deg = 0.1 * (np.arange(n) + 0.5)
    block = np.floor(angle_deg).astype(int)
    survey = SurveyUncertainty(
        translation=np.zeros(3),
        pose=np.zeros((6, 6)),
        planes=np.zeros((1, 4, 4)),
        flatness_m=np.array([flatness_m]),
    )
    stochastic = Stochastic(
        noise_std_m=0.01,
        prior_std={},
        block_rad=None if block_deg is None else np.deg2rad(block_deg),
        survey=(survey,),
    )
    point = np.column_stack([place, np.full(n, 3.0), np.zeros(n)])
    towards = np.full(n, 0.8)
    found = nuisance.derivatives(
        stochastic,
        point=point,
        normal=np.tile([0.0, 1.0, 0.0], (n, 1)),
        towards=towards,
        distance_m=np.full(n, 4.0),
        phi=np.deg2rad(angle_deg),
        laser_id=np.zeros(n, dtype=int),
        station=np.zeros(n, dtype=int),
        plane=np.zeros(n, dtype=int),
    )
    expected = np.full(n, flatness_m)
    if block_deg is not None:
        for number in range(segment.max() + 1):
            own = segment == number
            _, rows = np.unique(block[own], return_counts=True)
            expected[own] *= np.sqrt(1.0 - np.sum(rows**2) / own.sum() ** 2)
    np.testing.assert_allclose(found.offset, expected / towards, rtol=1e-12)
