"""A scan as KITTI stores it, simulated: x, y, z and reflectance, one ring after the other."""

import numpy as np

from velocal.scanner import beam
from velocal.scanner.parameters import LaserParameters

#: Normal and offset of a road, house fronts and gables around a car, metres.
STREET = (
    ((0.0, 0.0, 1.0), 1.73),
    ((1.0, 0.0, 0.0), 9.0),
    ((-1.0, 0.1, 0.0), 7.0),
    ((0.1, -1.0, 0.0), 14.0),
    ((0.0, 1.0, 0.0), 11.0),
    ((0.7, 0.7, 0.0), 10.0),
)


def street_scan(
    true: LaserParameters,
    used: LaserParameters,
    *,
    sigma_m: float,
    columns: int = 1000,
    seed: int = 1,
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 4) of a unit whose beams are `true`, computed with `used`; and their lasers."""
    rng = np.random.default_rng(seed)
    laser = np.repeat(np.argsort(-true.v), columns)  # the highest ring first
    phi = np.tile(-np.linspace(0.0, 2 * np.pi, columns, endpoint=False), len(true))
    # A ring begins in front of the car, where X of KITTI is, and goes to the left.
    phi = phi + true.alpha[laser]
    direction, origin = beam.laser_beams(phi, laser, true)
    nearest = np.full(len(laser), np.inf)
    for normal, offset in STREET:
        unit = np.array(normal) / np.linalg.norm(normal)
        towards = direction @ unit
        with np.errstate(divide="ignore"):
            length = -(origin @ unit + offset) / towards
        nearest = np.where((length > 0) & (length < nearest), length, nearest)
    measured = nearest - true.dl[laser] + rng.normal(0.0, sigma_m, len(laser))
    kept = nearest < 70.0
    x, y, z = beam.points(measured[kept], phi[kept], laser[kept], used).T
    return np.stack([y, -x, z, np.full(len(x), 0.3)], axis=1).astype("<f4"), laser[kept]
