"""What is written is read back bit for bit, in every format."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from velocal.calibration.files import decimals, formats
from velocal.calibration.files.document import CARRIED
from velocal.scanner.parameters import PARAMETERS, TWO_POINT, LaserParameters

RIGHT_ANGLE = np.pi / 2
UNITS = [decimals.UNCHANGED, decimals.METRES_PER_CENTIMETRE, decimals.RADIANS_PER_DEGREE]


@st.composite
def parameter_sets(draw: st.DrawFn, flags: bool = True) -> LaserParameters:
    n_lasers = draw(st.integers(1, 70))

    def column(largest: float) -> np.ndarray:
        return draw(arrays(np.float64, n_lasers, elements=st.floats(-largest, largest)))

    bounds = {"dl": 1e6, "alpha": 1e6, "v": RIGHT_ANGLE, "voff": 1e6, "hoff": 1e6}
    carried = draw(st.sets(st.sampled_from(sorted({*CARRIED} - {TWO_POINT}))))
    values = {name: column(1e6) for name in sorted(carried)}
    if flags and draw(st.booleans()):
        values[TWO_POINT] = draw(arrays(np.float64, n_lasers, elements=st.sampled_from([0.0, 1.0])))
    return LaserParameters(
        **{name: column(bounds[name]) for name in PARAMETERS},
        carried=values,
    )


@pytest.mark.parametrize("suffix", [".xml", ".yaml", ".csv", ".json"])
@settings(max_examples=25)  # each fills up to 70 lasers
@given(data=st.data())
def test_read_inverts_write(suffix: str, data: st.DataObject) -> None:
    written = data.draw(parameter_sets(flags=suffix != ".xml"))  # db.xml has no flag
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"calibration{suffix}"
        formats.write(path, written)
        found = formats.read_calibration(path, len(written)).parameters
    for name in PARAMETERS:
        assert getattr(found, name).tobytes() == getattr(written, name).tobytes()
    for name, column in written.carried.items():
        np.testing.assert_array_equal(found.carried[name], column)


@pytest.mark.parametrize("unit", UNITS)
@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_number_inverts_text(unit: decimals.Decimal, value: float) -> None:
    found = decimals.number(decimals.text(value, unit), "key", "file", unit)
    assert np.float64(found).tobytes() == np.float64(value).tobytes()
