"""Temporal stability: planted changes come back, with their scatter and their temperature."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support.chain import study_world
from support.corner import FACTORY, TRUE, N, position

from velocal.evaluation.drift import Window, drift, drift_table, summarised, temperature_table
from velocal.io import storage
from velocal.recording.scan import inspect
from velocal.recording.windows import temperature_deg_c, window_rotations
from velocal.reporting.figures.drift import draw
from velocal.simulation import capture

#: Distances of every laser change by this much, metres.
CHANGE = np.linspace(-0.02, 0.03, N)
SEEN = position(0.4, (2.0, 3.0, 0.8))
RNG = np.random.default_rng(11)
#: What stays in all windows: a pattern along azimuth.
PATTERN = RNG.normal(0.0, 0.01, len(SEEN.phi))


def window(share, noise=0.0):
    """Medians in which a share of the change has come about."""
    white = RNG.normal(0.0, noise, len(SEEN.phi)) if noise else 0.0
    distance = SEEN.distance_m + PATTERN + share * CHANGE[SEEN.laser_id] + white
    return replace(SEEN, distance_m=distance)


def test_a_pattern_that_stays_does_not_disturb_the_change():
    found = drift(window(0.0), [window(0.0), window(1.0)], TRUE)
    np.testing.assert_allclose(found.change_m, [np.zeros(N), CHANGE], atol=1e-12)
    assert found.std_m.max() < 1e-12
    # Other parameters change nothing that matters: s is the distance along the beam.
    other = drift(window(0.0), [window(1.0)], FACTORY)
    np.testing.assert_allclose(other.change_m[0], CHANGE, atol=1e-4)


def test_stated_deviations_are_those_of_the_noise():
    noise = 0.003
    found = drift(window(0.0, noise), [window(1.0, noise) for _ in range(40)], TRUE)
    count = np.bincount(SEEN.laser_id, minlength=N)
    # The reference is one draw for all windows: its error is common, the rest scatters.
    scatter = np.std(found.change_m, axis=0, ddof=1)
    np.testing.assert_allclose(scatter, noise / np.sqrt(count), rtol=0.45)
    np.testing.assert_allclose(
        np.sqrt(np.mean(found.std_m**2, axis=0)), noise * np.sqrt(2.0 / count), rtol=0.25
    )


def test_a_laser_that_a_window_does_not_see_has_no_change():
    blind = window(1.0)
    found = drift(window(0.0), [blind.take(blind.laser_id != 2)], TRUE)
    assert np.isnan(found.change_m[0, 2])
    assert np.isnan(found.std_m[0, 2])
    assert np.isfinite(np.delete(found.change_m[0], 2)).all()


@pytest.fixture(scope="module")
def tables():
    warmths = {"sa1": (40.0, 44.0, 46.0), "sa2": (46.0, 47.0, 46.0)}
    rows = [
        Window("HDL-64E", "P1", sample, name, warmth, window((warmth - 46.0) / 10.0))
        for sample, of_windows in warmths.items()
        for name, warmth in zip(("beginning", "middle", "end"), of_windows, strict=True)
    ]
    rows += [
        Window("HDL-32E", "P5", "sa5", name, float("nan"), window(share))
        for name, share in (("beginning", 1.0), ("end", 0.0))
    ]
    table = pd.DataFrame(drift_table(rows, {"HDL-64E": TRUE, "HDL-32E": TRUE}))
    return table, summarised(table)


def test_the_last_window_of_a_position_is_the_reference(tables):
    table, means = tables
    assert len(table) == 8 * N
    ends = table[(table["sample"].isin(["sa2", "sa5"])) & (table["window"] == "end")]
    assert (ends["change_cm"] == 0.0).all()
    first = means.iloc[0]
    assert first["common_cm"] == pytest.approx(-60.0 * CHANGE.mean())
    assert first["single_cm"] == pytest.approx(60.0 * CHANGE.std(ddof=1))


def test_the_common_change_follows_the_temperature(tables):
    found = temperature_table(tables[1])
    assert found["position"].tolist() == ["P1"]  # the other scanner sends no temperature
    row = found.iloc[0]
    assert row["slope_cm_per_k"] == pytest.approx(10.0 * CHANGE.mean())
    assert row["low"] <= row["slope_cm_per_k"] <= row["high"]
    spoilt = tables[1].assign(common_cm=lambda t: t["common_cm"] + [0.3, -0.3] * 4)
    wide = temperature_table(spoilt).iloc[0]
    assert wide["low"] < 0.0 < wide["high"]


def test_the_figure_has_a_row_per_scanner(tables):
    figure = draw(*tables, simulated=True)
    assert len(figure.axes) == 4
    assert [ax.get_title(loc="left") for ax in figure.axes[::2]] == ["HDL-64E", "HDL-32E"]
    texts = [text.get_text() for text in figure.axes[3].texts]
    assert texts == ["sends no temperature"]


@pytest.mark.parametrize(
    ("scanner", "place", "sample"), [("HDL-64E", "P1", "sa1"), ("HDL-32E", "P5", "sa5")]
)
def test_the_temperature_of_a_window_is_read_from_its_packets(scanner, place, sample, tmp_path):
    """sa1 begins colder than the steady 46 deg C, and warms up."""
    world, path = study_world(), tmp_path / "capture.bin"
    storage.write_blocks(path, capture.records(world, scanner, place, sample, 6))
    index = inspect(path).index
    windows = [window_rotations(index, name, 1, "here") for name in ("beginning", "end")]
    found = [temperature_deg_c(path, index, rotations) for rotations in windows]
    if scanner == "HDL-32E":
        assert np.isnan(found).all()
        return
    packets, length_s = path.stat().st_size / 1248, 0.7
    passed_s = length_s * index.packet / packets
    expected = []
    for own in windows:
        times = np.linspace(passed_s[own[0]], passed_s[own[-1] + 1], 50)
        represented = world.represented_s(times, length_s)
        expected.append(46.0 + world.temperature_k(sample, represented).mean())
    # Readings are whole degrees.
    np.testing.assert_allclose(found, expected, atol=0.7)
    assert found[0] < found[1] - 3.0
