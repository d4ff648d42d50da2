"""The one array type that all numeric functions take and give."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Double precision numbers of any shape; docstrings say which shape and unit.
Array = NDArray[np.float64]
