"""The world of the study, and a room of its own that is small enough to reckon with."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from velocal.simulation import world
from velocal.study.reading import read_yaml

CONTENT = read_yaml(Path(__file__).resolve().parents[2] / "config/world.yaml")
WORLD = world.load(CONTENT)
UPRIGHT = {"heading_deg": 0.0, "tilt_x_deg": 0.0, "tilt_y_deg": 0.0}
#: One room of 4 m x 3 m with a door in its east wall and a window in its north wall.
ROOM = {
    "scanner": "HDL-64E",
    "size_m": [4.0, 3.0],
    "height_m": 2.5,
    "base_std_mm": 0.4,
    "reflectance": {"walls": 60, "floor": 30},
    "boxes": {
        "west": {"x_m": [-0.2, 0.0], "y_m": [-0.2, 3.2]},
        "east": {"x_m": [4.0, 4.2], "y_m": [-0.2, 3.2], "openings_m": [[1.0, 2.0, 0.0, 2.1]]},
        "south": {"x_m": [0.0, 4.0], "y_m": [-0.2, 0.0]},
        "north": {"x_m": [0.0, 4.0], "y_m": [3.0, 3.2], "openings_m": [[1.0, 3.0, 0.8, 2.0]]},
        "pillar": {"x_m": [1.0, 1.2], "y_m": [0.4, 0.6]},
    },
    "positions": {"A": {"x_m": 2.0, "y_m": 1.5, "z_m": 1.0, **UPRIGHT}},
}


def stated(parts):
    """Targets of a perfect survey, with a standard deviation that a file can hold."""
    return [replace(part, std=np.full(part.std.shape, 1e-5)) for part in parts]
