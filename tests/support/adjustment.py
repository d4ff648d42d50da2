"""One laser of an adjustment."""

from velocal.adjustment.lasers import adjust_all


def adjust_laser(observations, laser, initial, names, solver, stochastic):
    """Adjust one laser on its own observations; see `adjust_all`."""
    own = observations.take(observations.laser_id == laser)
    return adjust_all(own, initial, names, solver, stochastic)[laser]
