"""From medians to a judged calibration of a unit, its files and its certificate."""

import html
from dataclasses import replace

import numpy as np
import pytest
from support.example import POSITION, SCANNER, write_example

import velocal
from velocal.chain import unit_stations
from velocal.errors import StorageError, VelocalError
from velocal.evaluation.certificate import Certificate, Conditions, certificate
from velocal.evaluation.holdout import (
    HoldOut,
    JudgedCalibration,
    Verdict,
    hold_out,
    judge,
    to_columns,
)
from velocal.evaluation.point_uncertainty import Use, point_std
from velocal.exports import fades, for_driver
from velocal.io import storage
from velocal.io.plain import from_plain, to_plain
from velocal.reporting import report
from velocal.reporting.certificate import render
from velocal.scanner.parameters import NEAR_POINT
from velocal.simulation import truth

SIGMA = {SCANNER: 0.02}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Stations with their observations, the factory's parameters, the judged calibration."""
    folder = tmp_path_factory.mktemp("unit")
    write_example(folder)
    recording = velocal.open_recording(folder / "capture.bin", scanner=SCANNER)
    station = velocal.read_station(folder / "station.json")
    factory = velocal.read_parameters(folder / "factory.xml", SCANNER)
    recordings = [(recording.medians("all", min_count=3), station)]
    stations = unit_stations(recordings, factory)
    return stations, factory, velocal.calibrate_unit(recordings, factory)


def test_every_plane_of_the_only_station_is_held_out(made):
    stations, _, found = made
    parts = found.hold_out.parts
    assert [part.plane for part in parts] == list(stations[0].plane_names)
    assert {part.station for part in parts} == {POSITION}
    assert found.hold_out.verdict is Verdict.BETTER
    # The gain of the whole is that of the lasers: smaller than before on every part together.
    assert found.hold_out.total.after_m < 0.5 * found.hold_out.total.before_m
    columns = to_columns(found.hold_out)
    assert columns["station"] == [POSITION] * 3 + ["all"]
    assert columns["verdict"][-1] == "better"


def moved(parameters, dl_m):
    return parameters.corrected({"dl": np.asarray(dl_m) * np.ones(len(parameters))})


def test_what_is_no_better_or_worse_is_told(made):
    stations, factory, _ = made
    same = hold_out(stations, factory, lambda kept: factory)
    assert same.verdict is Verdict.NO_DIFFERENCE
    assert same.total.gain_m == 0.0
    rng = np.random.default_rng(1)
    scattered = moved(factory, rng.normal(0.0, 0.1, len(factory)))
    assert hold_out(stations, factory, lambda kept: scattered).verdict is Verdict.WORSE
    # All lasers are too long by as much: nothing to see without what they share, but it is worse.
    true = truth.unit_truth(study(), SCANNER).parameters
    assert hold_out(stations, true, lambda kept: moved(true, 0.05)).verdict is Verdict.WORSE


def study():
    from support.chain import study_world

    return study_world()


def test_whole_stations_are_held_out_where_there_are_several(made):
    stations, factory, found = made
    two = [stations[0], replace(stations[0], name="other")]
    seen = []

    def calibrate(kept):
        seen.append([one.name for one in kept])
        return found.unit.calibration.adjusted

    result = hold_out(two, factory, calibrate)
    assert seen == [["other"], [POSITION]]
    assert result.by == "station"
    assert [part.plane for part in result.parts] == ["", ""]
    # Both parts hold the same data.
    assert result.parts[0].total == result.parts[1].total == result.total


def test_one_plane_is_not_judged(made):
    stations, factory, _ = made
    data = stations[0].observations
    only = replace(stations[0], observations=data.take(data.plane_number == 0))
    assert hold_out([only], factory, lambda kept: factory).verdict is Verdict.NOT_JUDGED


def not_better(found):
    return replace(found, hold_out=HoldOut((), None, None))


def test_a_calibration_that_is_not_better_ends_the_run(made):
    found = made[2]
    assert "better" in judge({"A/all": found})
    with pytest.raises(VelocalError, match="A/all: nothing could be held out") as error:
        judge({"B/all": found, "A/all": not_better(found)})
    assert "Keep the factory's file" in error.value.hint


def test_json_gives_the_same_object_back(made, tmp_path):
    found = made[2]
    storage.write_json(tmp_path / "unit.json", to_plain(found))
    again = from_plain(JudgedCalibration, storage.read_json(tmp_path / "unit.json"), "unit.json")
    assert to_plain(again.unit.calibration.sources) == to_plain(found.unit.calibration.sources)
    assert again.hold_out == found.hold_out
    np.testing.assert_array_equal(again.unit.shared, found.unit.shared)
    np.testing.assert_array_equal(again.unit.calibration.observed, found.unit.calibration.observed)
    assert again.unit.calibration.observed.dtype == bool
    with pytest.raises(StorageError, match="is no JudgedCalibration: 'unit'"):
        from_plain(JudgedCalibration, {"hold_out": None}, "unit.json")


def test_files_for_programs_hold_the_factorys_values_if_it_is_not_better(made, tmp_path):
    _, factory, found = made
    for judged, expected in (
        (found, found.unit.calibration.adjusted),
        (not_better(found), factory),
    ):
        velocal.write_calibration(tmp_path / "a.xml", judged, SCANNER)
        # As VeloView computes, in which the vertical offset is a part of the distance.
        assert velocal.read_calibration(tmp_path / "a.xml").dialect == "veloview"
        dl = velocal.read_parameters(tmp_path / "a.xml", SCANNER).dl
        np.testing.assert_allclose(dl, expected.dl, atol=1e-6)
    # Our own file keeps what was found, and says what it is worth.
    velocal.write_calibration(tmp_path / "a.json", not_better(found), SCANNER)
    read = velocal.read_calibration(tmp_path / "a.json")
    np.testing.assert_array_equal(read.parameters.dl, found.unit.calibration.adjusted.dl)
    assert read.provenance["recommended"] is False
    assert read.provenance["hold_out"] == "not judged"


def with_far_point(found):
    return replace(found, unit=replace(found.unit, far_point_m=25.04))


def test_a_correction_fades_to_that_of_the_factory(made):
    found = with_far_point(made[2])
    factory = made[1]
    assert fades("velodyne_decoder")
    assert not fades("ros")  # extrapolates beyond the far point
    assert not fades("veloview")  # one correction only
    near = for_driver(found, "velodyne_decoder", "safe")
    np.testing.assert_allclose(near.dl, factory.dl, atol=1e-12)
    x = near.carried[NEAR_POINT[0]] - factory.dl
    np.testing.assert_allclose(x, found.unit.near_correction(np.array([2.4]))[:, 0], atol=1e-12)
    assert np.abs(x).max() > 1e-3
    assert np.abs(near.v - factory.v).max() > 0.0
    safe = for_driver(found, "ros", "safe")
    np.testing.assert_allclose(safe.dl - for_driver(not_better(found), "ros", "safe").dl, 0.0,
                               atol=1e-4)  # fmt: skip
    single = for_driver(found, "veloview", "single")
    np.testing.assert_allclose(single.dl, for_driver(made[2], "veloview", "safe").dl, atol=1e-12)


def test_standard_deviations_of_points_follow_the_covariance(made):
    unit = made[2].unit
    lasers = np.arange(len(unit.calibration))
    std = {use: point_std(unit, lasers, unit.mean_range_m, use) for use in Use}
    # At the mean range the range-dependent error vanishes, and dl alone is left.
    np.testing.assert_allclose(std[Use.PARAMETERS].along, unit.calibration.std[:, 0])
    assert (std[Use.SHOT].along > std[Use.MEAN].along).all()
    assert (std[Use.MEAN].along > std[Use.PARAMETERS].along).all()
    far = point_std(unit, lasers, np.full(len(lasers), 50.0), Use.PARAMETERS)
    np.testing.assert_allclose(far.up, 50.0 * unit.calibration.std[:, 2])
    assert far.extrapolated.all()


def certified(found):
    return certificate(
        found, scanner=SCANNER, serial="17", name="all", simulated=True,
        recordings=[Conditions("s", "P5", 10, 10.0, "", "", ())], files=[], versions={"x": "1"},
    )  # fmt: skip


def test_the_report_says_what_to_use(made, tmp_path):
    one = certified(made[2])
    storage.write_json(tmp_path / "c.json", to_plain(one))
    again = from_plain(Certificate, storage.read_json(tmp_path / "c.json"), "c.json")
    page = report.render(report.Study("A unit", False, certificates=[again], range_sigma_m=SIGMA))
    assert "better than the factory" in page
    assert f"parameter_sets/{SCANNER}/all.yaml" in page
    # The errors of this unit's distances are 2.0 cm with a scatter of 1.6 cm.
    assert one.significant("dl") > 16
    assert f"not significant for {32 - one.significant('dl')} of 32 lasers" in page
    page = report.render(
        report.Study(
            "A unit", False, certificates=[certified(not_better(made[2]))], range_sigma_m=SIGMA
        )
    )
    text = html.unescape(" ".join(page.split()))
    assert "not judged" in text
    assert "Keep the factory's file" in text


def test_the_certificate_states_expanded_uncertainties(made):
    found = made[2]
    one = certified(found)
    std = found.unit.calibration.std
    for number in (0, 31):
        laser = one.lasers[number]
        assert laser.laser == number + 1
        assert laser.dl_expanded_mm == pytest.approx(2e3 * std[number, 0])
        assert laser.v_expanded_deg == pytest.approx(2.0 * np.rad2deg(std[number, 2]))
    total = one.budget[-1]
    assert total.source == "total"
    squares = sum(each.dl_mm**2 for each in one.budget[:-1])
    assert total.dl_mm**2 == pytest.approx(squares, rel=1e-6)
    page = render([one])
    assert "serial number 17" in page
    assert "simulated" in page
    assert "http" not in page.replace("http-equiv", "")
