"""Status bytes: decoding undoes encoding to the resolution of the wire, whatever is lost."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from velocal.errors import CalibrationFileError
from velocal.packets.status import OPENING, TABLE_PACKETS, StatusReader
from velocal.scanner.parameters import PARAMETERS, LaserParameters
from velocal.simulation.status import encode_table, status_bytes, table_packets

#: Half of what the wire can tell apart.
HALF = {"dl": 5e-4, "alpha": np.deg2rad(5e-3), "v": np.deg2rad(5e-3), "voff": 5e-4, "hoff": 5e-4}
CARRIED = {"dist_correction_x": 5e-4, "focal_distance": 5e-4, "focal_slope": 0.05}


def values(bound: float):
    return arrays(np.float64, 64, elements=st.floats(-bound, bound))


def sets():
    one = {name: values(1.5 if name in ("v", "alpha") else 30.0) for name in PARAMETERS}
    carried = st.fixed_dictionaries({name: values(30.0) for name in CARRIED})
    return st.builds(LaserParameters, **one, carried=carried).filter(
        lambda p: np.ptp(p.v) > np.deg2rad(0.02)
    )


def sent(parameters, series, first, packets) -> np.ndarray:
    number = first + np.arange(packets)
    time_us = 1_000 + 288 * np.arange(packets)
    table = table_packets(encode_table(parameters, series=series), series)
    status = status_bytes(table, number, time_us, np.full(packets, 46.4))
    stamps = time_us.astype("<u4").view(np.uint8).reshape(-1, 4)
    return np.concatenate([stamps, status], axis=1)


def read(trailing, chunk):
    reader = StatusReader()
    for begin in range(0, len(trailing), chunk):
        reader.consume(trailing[begin : begin + chunk])
    return reader.result()


@settings(max_examples=30)
@given(
    parameters=sets(),
    series=st.sampled_from(["S2", "S3"]),
    first=st.integers(0, TABLE_PACKETS - 1),
    chunk=st.integers(300, 9000),
)
def test_decoding_undoes_encoding(parameters, series, first, chunk):
    found = read(sent(parameters, series, first, 2 * TABLE_PACKETS), chunk)
    assert found.series == series
    assert found.tables in (1, 2)
    assert found.temperature_deg_c == (46.0, 46.0)
    back = found.calibration("x")
    for name in PARAMETERS:
        apart = np.abs(getattr(back, name) - getattr(parameters, name))
        assert apart.max() <= HALF[name] * (1 + 1e-6)
    for name, half in CARRIED.items():
        assert np.abs(back.carried[name] - parameters.carried[name]).max() <= half * (1 + 1e-6)
    # What was rounded once stays as it is.
    again = read(sent(back, series, 0, TABLE_PACKETS), chunk).calibration("x")
    for name in PARAMETERS:
        np.testing.assert_array_equal(getattr(again, name), getattr(back, name))


FIXED = LaserParameters(*(np.linspace(-0.4, 0.4, 64) for _ in PARAMETERS))
SENT = {series: sent(FIXED, series, 3210, 6 * TABLE_PACKETS) for series in ("S2", "S3")}
RIGHT = {series: read(trailing, 4000).calibration("x") for series, trailing in SENT.items()}


@settings(max_examples=60)
@example(series="S2", losses=[(5 * TABLE_PACKETS + 950, 1)], chunk=300)
@example(series="S3", losses=[(5 * TABLE_PACKETS + 950, 16)], chunk=300)
@given(
    series=st.sampled_from(["S2", "S3"]),
    losses=st.lists(st.tuples(st.integers(0, 6 * TABLE_PACKETS), st.integers(1, 5000)), max_size=6),
    chunk=st.integers(300, 9000),
)
def test_losses_never_give_a_wrong_table(series, losses, chunk):
    kept = np.ones(len(SENT[series]), dtype=bool)
    for at, length in losses:
        kept[at : at + length] = False
    found = read(SENT[series][kept], chunk)
    # Tables of which every packet is there are used, and no more; the opening of the cycle after
    # a table shows that nothing was lost by its end.
    whole = [
        kept[begin : begin + TABLE_PACKETS + len(OPENING)].all()
        for begin in range(TABLE_PACKETS - 3210, 5 * TABLE_PACKETS + 1, TABLE_PACKETS)
    ]
    assert found.tables == sum(whole)
    assert found.failed == found.deviating == 0
    if found.tables:
        np.testing.assert_array_equal(found.calibration("x").v, RIGHT[series].v)
    else:
        assert found.parameters is None


def test_values_that_do_not_fit_the_wire():
    with pytest.raises(CalibrationFileError, match=r"dl does not fit.*-32\.768 to 32\.767"):
        encode_table(replace(FIXED, dl=np.linspace(-33.0, 33.0, 64)))
