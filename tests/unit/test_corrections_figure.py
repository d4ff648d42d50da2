"""Corrections of every laser: their numbers, their intervals, what is weakly determined."""

from dataclasses import replace

import draw_corrections
import numpy as np
import pandas as pd
import pytest

from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.errors import VelocalError
from velocal.io import storage
from velocal.reporting.captions import caption
from velocal.reporting.figures.corrections import (
    QUANTILE,
    CorrectedSet,
    corrections,
    weak_parameters,
)
from velocal.reporting.figures.corrections import (
    draw_corrections as draw,
)
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
from velocal.study.figures import CorrectionsFigure

FACTORY = nominal(SCANNERS["HDL-32E"])
SELECTION = CorrectionsFigure(kind="corrections", scanner="HDL-32E")
N = 32


def made(name="set1", *, dl=0.02, std=0.001, unseen=(), weak=((),)):
    """A set with one correction of dl and of v, and lasers that no adjustment observed."""
    stds = {"dl": np.full(N, std), "v": np.full(N, 2 * std)}
    for each in stds.values():
        each[list(unseen)] = np.nan
    parameters = replace(FACTORY, dl=FACTORY.dl + dl, v=FACTORY.v - 0.01)
    return CorrectedSet(name, parameters, stds, [[tuple(one)] * N for one in weak])


def test_numbers_are_in_units_for_people():
    found = corrections([made()], FACTORY)
    assert list(found["parameter"].unique()) == ["dl", "v"]
    dl, v = (found[found["parameter"] == name] for name in ("dl", "v"))
    assert set(dl["unit"]) == {"cm"}
    assert set(v["unit"]) == {"deg"}
    np.testing.assert_allclose(dl["correction"], 2.0)
    np.testing.assert_allclose(v["correction"], -np.rad2deg(0.01))
    # 1.96 standard deviations of 0.1 cm and of 0.002 rad.
    np.testing.assert_allclose(dl["half_width"], 0.196, atol=1e-4)
    np.testing.assert_allclose(v["half_width"], 1.96 * np.rad2deg(0.002), rtol=1e-4)
    assert list(dl["laser"]) == [*range(1, N + 1)]


def test_weak_in_one_adjustment_is_weak_in_the_set():
    found = corrections([made(weak=((), ("v",)))], FACTORY)
    assert (found.loc[found["parameter"] == "v", "weakly_determined"] == 1).all()
    assert (found.loc[found["parameter"] == "dl", "weakly_determined"] == 0).all()


def test_names_of_weak_parameters():
    column = np.array(["v", np.nan, "", "dl v"], dtype=object)
    assert weak_parameters(column) == [("v",), (), (), ("dl", "v")]


def test_a_laser_that_was_not_observed_is_named_and_not_drawn():
    found = corrections([made(unseen=[4])], FACTORY)
    assert found.loc[found["laser"] == 5, ["correction", "half_width"]].isna().all(axis=None)
    figure = draw(found, SELECTION, simulated=False)
    assert figure.axes[-1].get_xlabel() == "laser (not observed: 5)"


def test_marks_of_weakly_determined_parameters_are_open():
    figure = draw(corrections([made(weak=(("v",),))], FACTORY), SELECTION, simulated=False)
    for ax, open_marks in zip(figure.axes, (0, N), strict=True):
        lines = [line for line in ax.lines if line.get_markerfacecolor() == "white"]
        # One more stands in the legend, without a place.
        assert sum(len(line.get_xdata()) for line in lines) == open_marks


def test_sets_stand_beside_each_other():
    figure = draw(corrections([made(), made("set2")], FACTORY), SELECTION, simulated=False)
    drawn = {line.get_label(): line for line in figure.axes[0].lines}
    first, second = (np.asarray(drawn[name].get_xdata()) for name in ("set1", "set2"))
    assert (second - first > 0.0).all()
    assert (second - first < 0.5).all()
    assert drawn["set1"].get_marker() != drawn["set2"].get_marker()


def test_a_wide_interval_does_not_hide_the_others():
    table = corrections([made()], FACTORY)
    wide = (table["parameter"] == "v") & (table["laser"] == 9)
    table.loc[wide, "half_width"] = 60.0
    dl, v = draw(table, SELECTION, simulated=False).axes
    low, high = v.get_ylim()
    rows = table[table["parameter"] == "v"]
    assert high - low < 5.0
    assert ((rows["correction"] > low) & (rows["correction"] < high)).all()
    labels = [text.get_text() for text in dl.figure.legends[0].get_texts()]
    assert "interval ends outside" in labels
    plain = draw(corrections([made()], FACTORY), SELECTION, simulated=False)
    assert len(plain.legends[0].get_texts()) == 1


def test_caption_counts_lasers():
    found = corrections([made(weak=(("v",),))], FACTORY)
    text = caption(SELECTION, found)
    assert "v of 32 lasers" in text
    assert "95 %" in text
    assert "set1" in text
    assert "determine every parameter" in caption(SELECTION, corrections([made()], FACTORY))


def test_a_set_without_standard_deviations():
    with pytest.raises(VelocalError, match="'set1' states no standard deviation"):
        corrections([replace(made(), std={})], FACTORY)


def test_script_reads_sets_and_adjustments(tmp_path):
    one = made()
    formats.write(tmp_path / "set1.json", CalibrationFile(one.parameters, "paper", "HDL-32E",
                                                          std=one.std))  # fmt: skip
    windows = [tmp_path / "beginning.csv", tmp_path / "end.csv"]
    for path, weak in zip(windows, (["v"] + [""] * (N - 1), [""] * N), strict=True):
        storage.write_csv(path, {"laser_id": list(range(N)), "weakly_determined": weak})
    draw_corrections.main(
        sets=[tmp_path / "set1.json"], adjustments=windows, calibration=None,
        svg=tmp_path / "f.svg", png=tmp_path / "f.png", csv=tmp_path / "f.csv",
        selection=SELECTION, set_names=["set1"], adjusted_for=["set1", "set1"], simulated=True,
    )  # fmt: skip
    found = pd.read_csv(tmp_path / "f.csv")
    assert found["weakly_determined"].sum() == 1
    np.testing.assert_allclose(found["half_width"].iloc[0], QUANTILE * 0.1)
    assert (tmp_path / "f.png").stat().st_size > 0
