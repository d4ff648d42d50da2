"""Parameter sets: mean of windows, then of samples."""

import numpy as np

from velocal.averaging import average


def part(value, sigma, seen=True):
    return {"dl": np.array([value])}, {"dl": np.array([sigma])}, np.array([seen])


def test_mean_of_means():
    mean, std = average([[part(1.0, 0.1), part(3.0, 0.1)], [part(6.0, 0.2), part(10.0, 0.2)]])
    assert mean["dl"][0] == (2.0 + 8.0) / 2
    np.testing.assert_allclose(std["dl"][0], np.sqrt(2 * 0.1**2 + 2 * 0.2**2) / 4)


def test_adjustments_that_did_not_see_the_laser_have_no_say():
    unseen = part(0.0, np.nan, seen=False)
    mean, std = average([[part(1.0, 0.1), unseen], [unseen, unseen]])
    assert mean["dl"][0] == 1.0
    np.testing.assert_allclose(std["dl"][0], 0.1)


def test_held_and_unseen_have_no_standard_deviation():
    assert np.isnan(average([[part(1.0, np.nan), part(1.0, 0.1)]])[1]["dl"][0])
    mean, std = average([[part(0.0, np.nan, seen=False)]])
    assert mean["dl"][0] == 0.0
    assert np.isnan(std["dl"][0])
