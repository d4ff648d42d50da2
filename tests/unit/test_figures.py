"""Figures: their numbers, their bytes, their scales."""

import draw_histogram
import draw_lasers
import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from support.results import statistics

from velocal.errors import VelocalError
from velocal.io import schemas, storage
from velocal.reporting.captions import caption
from velocal.reporting.figures import histogram, per_laser
from velocal.study.figures import HistogramFigure, LaserFigure

LASERS, SUMMARY = statistics()


def selection(kind="std", data="validation", scanner="HDL-64E", samples=("sa1", "sa2"), **more):
    model = HistogramFigure if kind == "histogram" else LaserFigure
    return model(kind=kind, scanner=scanner, samples=list(samples), data=data, **more)


def numbers(**changes):
    return per_laser.per_laser(LASERS, SUMMARY, selection(**changes))


def test_lasers_are_counted_from_one():
    found = numbers()
    assert list(found["laser"]) == [*range(1, 65)] * 2
    assert (found["laser"] == found["laser_id"] + 1).all()
    assert list(found["calibration"]) == ["before"] * 64 + ["after"] * 64


@pytest.mark.parametrize(
    ("data", "scanner", "samples", "after", "name"),
    [
        ("validation", "HDL-64E", ("sa1", "sa2"), ("set", "set2"), "set2"),
        ("validation", "HDL-32E", ("sa5",), ("set", "set1"), "set1"),
        ("calibration", "HDL-64E", ("sa3",), ("window", ""), "adjusted"),
    ],
)
def test_what_after_stands_for(data, scanner, samples, after, name):
    found = numbers(data=data, scanner=scanner, samples=samples)
    rows = found[["calibration", "role", "parameter_set"]].drop_duplicates().to_numpy().tolist()
    assert rows == [["before", "factory", ""], ["after", *after]]
    assert per_laser.name_after(found) == name


def test_a_set_named_after_is_that_set():
    lasers, summary = (
        table.replace({"parameter_set": {"set2": "after"}}) for table in (LASERS, SUMMARY)
    )
    found = per_laser.per_laser(lasers, summary, selection())
    assert found.drop(columns="parameter_set").equals(numbers().drop(columns="parameter_set"))
    assert per_laser.name_after(found) == "after"


def test_windows_are_weighted_by_their_residuals():
    rows = LASERS.query(
        "sample in ['sa1', 'sa2'] and data == 'validation' and parameter_set == 'set2' "
        "and laser_id == 11"
    )
    assert rows["count"].nunique() > 1
    found = numbers(kind="within").query("calibration == 'after' and laser == 12").iloc[0]
    assert found["count"] == rows["count"].sum()
    for name in ("within_1sigma_pct", "within_3sigma_pct"):
        np.testing.assert_allclose(found[name], np.average(rows[name], weights=rows["count"]))
    std = numbers().query("calibration == 'after' and laser == 12")["rms_cm"].iloc[0]
    mean_square = np.average(rows["rms_cm"] ** 2, weights=rows["count"])
    np.testing.assert_allclose(std, np.sqrt(mean_square))


def test_lasers_that_become_worse_are_marked():
    lasers = LASERS.copy()
    own = (lasers["data"] == "validation") & lasers["laser_id"].isin([3, 8])
    lasers.loc[own & (lasers["role"] == "factory"), "rms_cm"] = 0.01
    found = per_laser.per_laser(lasers, SUMMARY, selection())
    before, after = (found[found["calibration"] == when] for when in ("before", "after"))
    worse = after["rms_cm"].to_numpy() > before["rms_cm"].to_numpy()
    assert worse[[3, 8]].all()
    assert after["worse"].tolist() == worse.astype(int).tolist()
    assert not before["worse"].any()
    figure = per_laser.draw_per_laser(found, selection(), sigma_cm=2.0, simulated=False)
    rings = [line for line in figure.axes[0].lines if "worse" in str(line.get_label())]
    assert rings[0].get_label() == f"worse: {worse.sum()} of {len(worse)}"
    assert rings[0].get_xdata().tolist() == after["laser"][worse].tolist()


def test_a_laser_without_residuals_is_named_and_not_drawn():
    found = numbers()
    assert found.query("laser == 7")["rms_cm"].isna().all()
    figure = per_laser.draw_per_laser(found, selection(), sigma_cm=2.0, simulated=False)
    assert figure.axes[-1].get_xlabel() == "laser (no residuals: 7)"


@pytest.mark.parametrize(("kind", "panels"), [("std", 1), ("within_3sigma", 1), ("within", 2)])
def test_panels_share_a_scale_before_and_after(kind, panels):
    figure = per_laser.draw_per_laser(
        numbers(kind=kind), selection(kind=kind), sigma_cm=2.0, simulated=False
    )
    assert len(figure.axes) == panels
    for ax in figure.axes:
        low, high = ax.get_ylim()
        markers = [line for line in ax.lines if line.get_marker() == "o"]
        assert [line.get_label() for line in markers] == ["before (factory)", "after (set2)"]
        for line in markers:
            values = np.asarray(line.get_ydata())
            assert (values[np.isfinite(values)] <= high).all()
        assert low == 0.0
        assert "[cm]" in ax.get_ylabel() or "[%]" in ax.get_ylabel()


def test_datasheet_line():
    figure = per_laser.draw_per_laser(numbers(), selection(), sigma_cm=2.5, simulated=False)
    dashed = [line for line in figure.axes[0].lines if line.get_linestyle() == "--"]
    assert [line.get_ydata()[0] for line in dashed] == [2.5]


def texts(figure):
    return [text.get_text() for text in figure.texts]


@pytest.mark.parametrize("simulated", [True, False])
def test_only_simulated_studies_say_so(simulated):
    counts = histogram.histogram(np.array([0.01, -0.02]), np.array([0.0, 0.001]))
    options = {"sigma_cm": 2.0, "simulated": simulated}
    for figure in (
        per_laser.draw_per_laser(numbers(), selection(), **options),
        histogram.draw_histogram(counts, selection("histogram", "calibration", laser=1), **options),
    ):
        assert ("simulated recordings" in texts(figure)) == simulated


def test_missing_sample_is_named():
    with pytest.raises(VelocalError, match=r"sample 'sa9'.*sa1, sa2, sa3, sa4"):
        numbers(data="calibration", samples=("sa1", "sa9"))


def test_histogram_counts_every_residual_once():
    random = np.random.default_rng(1)
    before, after = random.normal(0.05, 0.02, 5000), random.normal(0.0, 0.01, 5000)
    found = pd.DataFrame(histogram.histogram(before, after))
    assert found["before"].sum() == found["after"].sum() == 5000
    inner = found.iloc[1:-1]
    for name, s in (("before", before), ("after", after)):
        edges = np.append(inner["from_cm"], inner["to_cm"].iloc[-1])
        # np.histogram closes its last bin above.
        expected = np.histogram(s[s * 100 < edges[-1]] * 100, edges)[0]
        assert list(inner[name]) == list(expected)
    width = inner["to_cm"] - inner["from_cm"]
    np.testing.assert_allclose(width, width.iloc[0])
    np.testing.assert_allclose(inner["from_cm"].iloc[0], -inner["to_cm"].iloc[-1])
    assert found["before"].iloc[[0, -1]].sum() <= 0.002 * 10000 + 1


def test_histogram_without_any_spread():
    found = histogram.histogram(np.zeros(5), np.zeros(5))
    assert found["before"].sum() == 5


def test_histogram_panels_share_axes():
    found = histogram.histogram(np.linspace(-0.1, 0.1, 50), np.linspace(-0.01, 0.01, 50))
    figure = histogram.draw_histogram(
        found, selection("histogram", "calibration", laser=3), sigma_cm=2.0, simulated=False
    )
    left, right = figure.axes
    assert left.get_xlim() == right.get_xlim()
    assert left.get_ylim() == right.get_ylim()


def test_residuals_of_one_laser():
    table = {
        "laser_id": np.array([0, 9, 9, 1], np.uint8),
        "before_m": np.array([1.0, 2.0, 3.0, 4.0], np.float32),
        "after_m": np.array([5.0, 6.0, 7.0, 8.0], np.float32),
    }
    chosen = selection("histogram", "calibration", laser=10)
    before, after = histogram.residuals_of([table, table], chosen)
    assert before.tolist() == [2, 3, 2, 3]
    assert after.tolist() == [6, 7, 6, 7]


def test_histogram_errors():
    with pytest.raises(VelocalError, match="no residuals"):
        histogram.histogram(np.zeros(0), np.zeros(0))
    for data, more in (("calibration", {}), ("validation", {"laser": 1})):
        with pytest.raises(ValueError, match="HistogramFigure"):
            selection("histogram", data, **more)


def draw(tmp_path, name, chosen):
    files = [tmp_path / f"{name}.{suffix}" for suffix in ("svg", "png", "csv")]
    arguments = dict(zip(("svg", "png", "csv"), files, strict=True))
    arguments |= {"selection": chosen, "sigma_cm": 2.0, "simulated": True}
    if chosen.kind == "histogram":
        n = 400
        columns = {f"{axis}_m": np.zeros(n, np.float32) for axis in "xyz"}
        columns |= {"laser_id": np.arange(n) % 64, "plane": np.zeros(n)}
        columns |= {"before_m": np.linspace(0, 0.1, n), "after_m": np.linspace(-0.02, 0.02, n)}
        storage.write_table(tmp_path / "residuals.parquet", schemas.RESIDUALS, columns)
        draw_histogram.main(residuals=[tmp_path / "residuals.parquet"], **arguments)
    else:
        storage.write_csv(tmp_path / "lasers.csv", LASERS)
        storage.write_csv(tmp_path / "summary.csv", SUMMARY)
        tables = {name: tmp_path / f"{name}.csv" for name in ("lasers", "summary")}
        draw_lasers.main(**tables, **arguments)
    return files


@pytest.mark.parametrize(
    "chosen",
    [
        selection("std"),
        selection("within", "calibration", "HDL-32E", ("sa5",)),
        selection("histogram", "calibration", laser=10),
    ],
    ids=lambda chosen: chosen.kind,
)
def test_bytes_depend_on_nothing_but_the_numbers(tmp_path, monkeypatch, chosen):
    first = draw(tmp_path, "first", chosen)
    monkeypatch.setitem(mpl.rcParams, "font.size", 23.0)
    monkeypatch.setitem(mpl.rcParams, "savefig.dpi", 30)
    second = draw(tmp_path, "second", chosen)
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert mpl.rcParams["font.size"] == 23.0
    assert len(pd.read_csv(first[2])) > 0
    assert b"<dc:date>" not in first[0].read_bytes()


def test_a_panel_of_large_shares_is_not_empty():
    """The lower part of a scale from zero would be."""
    table = numbers(kind="within")
    table["within_3sigma_pct"] = 100.0
    table.loc[table["laser"] == 5, "within_3sigma_pct"] = 98.3
    figure = per_laser.draw_per_laser(
        table, selection(kind="within"), sigma_cm=2.0, simulated=False
    )
    first, second = figure.axes
    assert first.get_ylim()[0] == 0.0
    low, high = second.get_ylim()
    assert 96.0 < low < 98.3
    assert 100.0 < high < 101.0


def test_histogram_draws_all_residuals_unless_some_are_far_away():
    near = np.concatenate([np.full(998, 0.02), [0.028, -0.028]])
    options = {"sigma_cm": 2.0, "simulated": False}
    chosen = selection("histogram", "calibration", laser=1)

    def titles(counts):
        figure = histogram.draw_histogram(counts, chosen, **options)
        return [ax.get_title("left") for ax in figure.axes]

    found = histogram.histogram(near, near)
    assert found["before"][[0, -1]].sum() == 0
    assert titles(found) == ["before (factory): 1000 medians", "after (adjusted): 1000 medians"]
    far = np.concatenate([np.full(999, 0.019), [0.3]])
    found = histogram.histogram(far, np.full(1000, 0.019))
    assert found["before"][-1] == 1
    edge = found["to_cm"][-2]
    assert titles(found)[0].endswith(f"1 of them with |s| > {edge:g} cm not drawn")
    assert titles(found)[1] == "after (adjusted): 1000 medians"


@pytest.mark.parametrize(
    ("role", "name", "said"),
    [
        ("window", "", "After: the parameters adjusted on each window itself."),
        ("unit", "all", "After: parameter set all, the calibration of the unit as a whole."),
        ("set", "set3", "After: parameter set set3, that of least mean standard deviation"),
    ],
)
def test_caption_says_what_after_is(role, name, said):
    rows = [("before", "factory", ""), ("after", role, name)]
    found = pd.DataFrame(rows, columns=["calibration", "role", "parameter_set"])
    assert said in caption(selection(data="calibration"), found)
