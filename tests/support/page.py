"""What a report shows of a calibration, made up: for tests of the page."""

import io

import numpy as np
from PIL import Image

from velocal.evaluation.certificate import Certificate, Conditions, File, Laser, StationResult
from velocal.evaluation.holdout import Gain
from velocal.evaluation.residual_map import BINS, ResidualMap
from velocal.reporting.interactive import SampleMap

LASERS = 32


def picture():
    """Content of a small PNG file."""
    content = io.BytesIO()
    Image.new("RGB", (8, 4), "white").save(content, "PNG")
    return content.getvalue()


def certificate(**changes):
    """Certificate of a calibration of an HDL-32E; the vertical angle is weakly determined."""
    gain = Gain(0.0133, 0.0034, 0.0099, 0.0070, 0.0128, LASERS)
    lasers = tuple(
        Laser(
            laser=k + 1, dl_mm=10.0 - k, alpha_deg=0.01 * k, v_deg=0.001, dl_expanded_mm=5.5,
            alpha_expanded_deg=0.055, v_expanded_deg=0.06, dl_from_data=0.99,
            alpha_from_data=0.7, v_from_data=0.1, range_m=3.4,
        )
        for k in range(LASERS)
    )  # fmt: skip
    values = {
        "scanner": "HDL-32E", "serial": "S <7>", "name": "all", "simulated": True,
        "recommended": True, "verdict": "better", "held_out_total": gain,
        "held_out_centred": gain, "coverage_factor": 2.0, "ranges_m": (2.0, 6.0),
        "far_point_m": None,
        "recordings": (Conditions("sa5", "P5", 330, 9.99, "4.07", "", (38.0, 46.0)),),
        "budget": (), "stations": (StationResult("P5", 1000, 1.0, 2.0, 0.5),), "lasers": lasers,
        "points": (), "properties": (), "files": (File("recording", "sa5.bin", "ab" * 32),),
        "versions": {}, "warnings": (),
    }  # fmt: skip
    return Certificate(**(values | changes))


def sample_map(after="all"):
    """Residuals of all lasers but the last two on a wall that crosses the angle 0, and a floor."""
    laser, azimuth_bin = np.meshgrid(np.arange(LASERS - 2), np.arange(-40, 60), indexing="ij")
    laser, azimuth_bin = laser.ravel(), azimuth_bin.ravel()
    angle = np.deg2rad(0.5 * (azimuth_bin + 0.5))
    columns = {
        "laser_id": laser.astype(np.uint8),
        "plane": (azimuth_bin >= 30).astype(np.uint8),
        "azimuth_bin": (azimuth_bin % BINS).astype(np.uint16),
        "count": np.full(len(azimuth_bin), 3, dtype=np.uint16),
        "x_m": 4.0 * np.sin(angle),
        "y_m": 4.0 * np.cos(angle),
        "z_m": -1.0 + 0.05 * laser,
        "before_m": 0.01 - 0.001 * laser + 0.002 * np.sin(azimuth_bin / 5.0),
        "after_m": 0.002 * np.sin(azimuth_bin / 5.0),
    }
    wall = np.array([[-2.0, 4.0, -1.0], [2.0, 4.0, -1.0], [2.0, 4.0, 1.0], [-2.0, 4.0, 1.0]])
    corners = [wall, np.zeros((0, 3))]
    return SampleMap(
        "sa5", "HDL-32E", "P5", after, ["short_wall", "floor"], corners, ResidualMap(**columns),
        picture(),
    )  # fmt: skip
