"""Distances of a few lasers to two walls at a right angle above a floor, with their truth."""

import numpy as np

from velocal.adjustment.observations import Observations
from velocal.scanner.parameters import LaserParameters

N = 6
FACTORY = LaserParameters(
    dl=np.full(N, 0.1),
    alpha=np.linspace(-0.06, 0.06, N),
    v=np.linspace(-0.42, 0.02, N),
    voff=np.full(N, 0.2),
    hoff=np.linspace(-0.02, 0.02, N),
)
RNG = np.random.default_rng(3)
#: Its mean over the lasers is the datum of planes that nobody surveyed.
TURN = RNG.normal(0.0, 1e-3, N)
TRUE = FACTORY.corrected(
    {"dl": RNG.normal(0.01, 0.02, N), "alpha": TURN - TURN.mean(), "v": RNG.normal(0.0, 1e-3, N)}
)


def position(heading, distances, tilt=0.0, points=240, parameters=TRUE):
    """Distances to two walls at a right angle, above a floor, without noise."""
    c, s = np.cos(heading), np.sin(heading)
    normals = np.array([[c, s, tilt], [-s, c, -tilt], [tilt, tilt, -1.0]])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    phi = np.linspace(-np.pi, np.pi, points, endpoint=False)
    laser = np.repeat(np.arange(len(parameters)), points)
    angle = np.tile(phi, len(parameters))
    reach = []
    for normal, distance in zip(normals, distances, strict=True):
        flat = Observations(
            np.zeros(len(angle)), angle, laser, np.tile(normal, (len(angle), 1)),
            np.full(len(angle), -distance),
        )  # fmt: skip
        reach.append(-flat.misclosure(parameters))
    ranges = np.where(np.array(reach) > 0.5, reach, np.inf)
    plane = np.argmin(ranges, axis=0)
    hit = np.min(ranges, axis=0) < 12.0
    return Observations(
        np.min(ranges, axis=0), angle, laser, normals[plane], -np.asarray(distances)[plane], plane
    ).take(hit)
