"""Planes in made-up clouds: found where there are some, reported missing where there are none."""

import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from velocal.errors import SurveyError
from velocal.evaluation import plane_search, planes_in_data
from velocal.io import schemas, storage
from velocal.reporting.figures.unsurveyed import TABLE, field_markdown, field_planes
from velocal.reporting.style import save
from velocal.scanner.beam import Beams
from velocal.scanner.models import scanner_named
from velocal.scanner.parameters import nominal
from velocal.study.planes import Box, PlaneSearch

SCANNER = scanner_named("HDL-32E")
SEARCH = planes_in_data.Search(
    planes=3, distance_m=0.06, extent_m=6.0, min_points=200, incidence_rad=1.2, seed=1
)
WALL, SIDE, FLOOR = ([0.0, 1.0, 0.0], 5.0), ([1.0, 0.0, 0.0], 6.0), ([0.0, 0.0, -1.0], 1.5)
ROOM = [WALL, SIDE, ([-1.0, 0.0, 0.0], 4.0), ([0.0, -1.0, 0.0], 7.0), FLOOR]


def cloud_of(distance_m, phi, laser_id, parameters) -> planes_in_data.Cloud:
    """Returns of the scanner with their points."""
    beams = Beams(distance_m, phi, laser_id, SCANNER.distance_tick_m)
    return planes_in_data.Cloud.from_beams(beams, parameters)


def scan(
    planes=ROOM, *, noise_m=0.003, offsets=None, parameters=None, step_deg=0.4, seed=0
) -> planes_in_data.Cloud:
    """What the scanner sees of planes, each given by its outward normal and distance."""
    rng = np.random.default_rng(seed)
    parameters = parameters or nominal(SCANNER)
    phi = np.deg2rad(np.arange(0.0, 360.0, step_deg))
    laser_id, phi = (a.ravel() for a in np.meshgrid(np.arange(32), phi, indexing="ij"))
    direction = cloud_of(np.ones(len(phi)), phi, laser_id, parameters).direction
    normals = np.array([normal for normal, _ in planes])
    towards = direction @ normals.T
    # Beams begin on the axis, at the height of their laser.
    away = np.array([d for _, d in planes]) - np.outer(parameters.voff[laser_id], normals[:, 2])
    with np.errstate(divide="ignore"):
        ranges = np.where(towards > 1e-9, away / towards, np.inf)
    nearest = ranges.min(axis=1)
    hit = nearest < 100.0
    distance = nearest + rng.normal(0.0, noise_m, len(phi)) if noise_m else nearest
    if offsets is not None:
        distance = distance + offsets[laser_id]
    return cloud_of(distance[hit], phi[hit], laser_id[hit], parameters)


def hedge(n=6000, seed=0) -> planes_in_data.Cloud:
    """Returns from all depths of a thick hedge."""
    rng = np.random.default_rng(seed)
    laser_id = rng.integers(0, 32, n)
    return cloud_of(rng.uniform(4.0, 6.0, n), rng.uniform(0.0, 1.5, n), laser_id, nominal(SCANNER))


def together(*clouds: planes_in_data.Cloud) -> planes_in_data.Cloud:
    columns = (np.concatenate([getattr(c, name) for c in clouds]) for name in
               ("distance_m", "phi", "laser_id"))  # fmt: skip
    return cloud_of(*columns, nominal(SCANNER))


def test_patch_points():
    xyz = np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2], [1, 1, 9]])
    box = {"x_m": [1.0, 3.0], "y_m": [3.0, 0.5], "z_m": [0.0, 2.0]}
    np.testing.assert_array_equal(planes_in_data.patch_points(xyz, Box(**box)), [1, 2])
    assert len(planes_in_data.patch_points(xyz, Box(**{**box, "x_m": [5.0, 6.0]}))) == 0


def test_planes_of_a_room():
    cloud = scan()
    planes, findings = plane_search.find_planes(cloud, SEARCH)
    assert findings == []
    assert [plane.name for plane in planes] == ["plane1", "plane2", "plane3"]
    for plane in planes:
        truth = [
            (normal, distance)
            for normal, distance in ROOM
            if plane.fit.plane.normal @ np.array(normal) > np.cos(np.deg2rad(0.3))
        ]
        assert len(truth) == 1
        assert plane.fit.plane.offset == pytest.approx(-truth[0][1], abs=0.005)
        assert np.std(plane.s) == pytest.approx(0.003, rel=0.1)
        assert plane.incidence_rad < SEARCH.incidence_rad
        assert np.ptp(cloud.xyz[plane.rows], axis=0).max() <= SEARCH.extent_m
        assert plane.tilt_rad == pytest.approx(np.arccos(abs(truth[0][0][2])), abs=np.deg2rad(0.3))
    assert len(np.unique(np.concatenate([plane.rows for plane in planes]))) == sum(
        len(plane.rows) for plane in planes
    )


def test_a_plane_is_no_slice():
    alone, findings = plane_search.find_planes(hedge(), SEARCH)
    assert alone == []
    assert len(findings) == 1
    assert findings[0].startswith("no plane found: among 6000 points")
    both = together(scan([WALL]), hedge())
    planes, findings = plane_search.find_planes(both, SEARCH)
    assert findings == []
    for plane in planes:
        assert abs(plane.fit.plane.normal @ WALL[0]) > np.cos(np.deg2rad(1.0))


def test_a_plane_does_not_span_a_gap():
    """Two coplanar walls, 20 degrees of azimuth apart, are not one."""
    cloud = scan([WALL])
    apart = np.abs(np.rad2deg(cloud.phi + np.pi) % 360.0 - 180.0) > 10.0
    split = cloud_of(
        cloud.distance_m[apart], cloud.phi[apart], cloud.laser_id[apart], cloud.parameters
    )
    planes, _ = plane_search.find_planes(split, SEARCH)
    assert len(planes) >= 2
    for plane in planes:
        assert len(np.unique(np.sign(split.xyz[plane.rows, 0]))) == 1


def test_a_plane_across_north_is_one():
    planes, _ = plane_search.find_planes(scan([WALL]), SEARCH)
    x = scan([WALL]).xyz[planes[0].rows, 0]
    assert x.min() < -1.0
    assert x.max() > 1.0


@pytest.mark.parametrize("n", [0, 3, 150])
def test_few_points_are_a_finding(n):
    cloud = scan([WALL])
    few = cloud_of(cloud.distance_m[:n], cloud.phi[:n], cloud.laser_id[:n], cloud.parameters)
    planes, findings = plane_search.find_planes(few, SEARCH)
    assert planes == []
    assert f"among {n} points" in findings[0]


def test_search_is_deterministic():
    first, second = (plane_search.find_planes(scan(), SEARCH)[0] for _ in range(2))
    assert len(first) == len(second)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.rows, other.rows)
        np.testing.assert_array_equal(one.fit.plane.normal, other.fit.plane.normal)
        np.testing.assert_array_equal(one.s, other.s)


def test_residuals_are_along_the_beam():
    """Behind the plane is positive, and longer than the orthogonal distance by 1 / cos(i)."""
    cloud = scan([WALL], noise_m=0.0)
    plane = planes_in_data.fit_robustly("wall", cloud, np.arange(len(cloud.phi)), SEARCH).fit.plane
    further = cloud_of(cloud.distance_m + 0.05, cloud.phi, cloud.laser_id, cloud.parameters)
    rows = np.arange(0, len(cloud.phi), 7)
    np.testing.assert_allclose(further.s(rows, plane), 0.05, atol=1e-6)
    np.testing.assert_allclose(
        plane.distance(further.xyz[rows]),
        0.05 * np.cos(further.incidence(rows, plane)),
        atol=1e-6,
    )


def test_outliers_are_trimmed_and_counted():
    cloud = scan([WALL])
    steep = np.flatnonzero(np.arccos(cloud.direction[:, 1]) < 1.1)
    rng = np.random.default_rng(5)
    bad = rng.choice(steep, 60, replace=False)
    distance = cloud.distance_m.copy()
    distance[bad] += rng.choice([-1.0, 1.0], 60) * rng.uniform(0.1, 2.0, 60)
    cloud = cloud_of(distance, cloud.phi, cloud.laser_id, cloud.parameters)
    plane = planes_in_data.fit_robustly("wall", cloud, steep, SEARCH)
    assert not np.intersect1d(plane.rows, bad).size
    # 0.27 % of normal noise lies beyond three sigmas, somewhat more beyond an estimate of them.
    assert 60 <= plane.trimmed <= 60 + 0.012 * len(steep)
    assert len(plane.rows) + plane.trimmed == len(steep)
    assert np.std(plane.s) == pytest.approx(0.003, rel=0.05)
    assert plane.fit.plane.offset == pytest.approx(-5.0, abs=1e-3)


def test_grazing_returns_are_left_out_but_not_called_outliers():
    cloud = scan([WALL])
    plane = planes_in_data.fit_robustly("wall", cloud, np.arange(len(cloud.phi)), SEARCH)
    assert len(plane.rows) + plane.trimmed < len(cloud.phi)
    assert cloud.incidence(plane.rows, plane.fit.plane).max() <= SEARCH.incidence_rad + 1e-3
    assert plane.trimmed < 0.012 * len(plane.rows)


def test_offsets_of_lasers_are_not_trimmed():
    """They are what is looked for: rms_cm holds them, std_cm does not."""
    rng = np.random.default_rng(2)
    offsets = rng.normal(0.0, 0.08, 32)
    cloud = scan([WALL], offsets=offsets)
    rows = planes_in_data.patch_points(cloud.xyz, Box(x_m=(-3, 3), y_m=(4, 6), z_m=(-2, 2)))
    plane = planes_in_data.fit_robustly("wall", cloud, rows, SEARCH)
    assert plane.trimmed < 0.015 * len(rows)
    medians = {"count": np.full(len(cloud.phi), 9), "spread": np.full(len(cloud.phi), 2.0)}
    (row,), lasers = planes_in_data.tabulate([plane], cloud, medians, {"sample": "a"}, 0.02)
    assert row["rms_cm"] > 4.0
    assert 0.28 < row["std_cm"] < 0.4
    assert row["spread_cm"] == pytest.approx(0.4)
    seen = offsets[lasers["laser_id"]]
    difference = lasers["mean_cm"] - seen * 100
    assert np.std(difference) < 0.35 * np.std(seen * 100)
    assert np.corrcoef(lasers["mean_cm"], seen)[0, 1] > 0.9


def test_spread_needs_enough_returns():
    cloud = scan([WALL])
    plane = planes_in_data.fit_robustly("wall", cloud, np.arange(len(cloud.phi)), SEARCH)
    medians = {"count": np.full(len(cloud.phi), 4), "spread": np.full(len(cloud.phi), 2.0)}
    (row,), _ = planes_in_data.tabulate([plane], cloud, medians, {}, 0.02)
    assert np.isnan(row["spread_cm"])


def test_patches():
    cloud = scan()
    patches = {
        "wall": {"x_m": [-2, 2], "y_m": [4.5, 5.5], "z_m": [-1, 1]},
        "air": {"x_m": [1, 2], "y_m": [1, 2], "z_m": [0, 1]},
        "crumb": {"x_m": [0, 0.1], "y_m": [4.5, 5.5], "z_m": [-1, 1]},
    }
    boxes = {name: Box(**box) for name, box in patches.items()}
    planes, findings = planes_in_data.fit_patches(cloud, boxes, SEARCH)
    assert [plane.name for plane in planes] == ["wall"]
    assert planes[0].fit.plane.offset == pytest.approx(-5.0, abs=1e-3)
    assert findings[0].startswith("air: 0 points of 0 lasers")
    assert findings[1].startswith("crumb: ")
    assert "allowed: 200 points of 4 lasers" in findings[0]
    assert len(plane_search.find_planes(cloud, SEARCH)[0]) == 3


def test_three_lasers_fix_no_plane():
    cloud = scan([WALL], step_deg=0.1)
    rows = np.flatnonzero(np.isin(cloud.laser_id, [10, 12, 14]))
    with pytest.raises(SurveyError, match="of 3 lasers"):
        planes_in_data.fit_robustly("wall", cloud, rows, SEARCH)


def test_search_from_config():
    search = planes_in_data.Search.from_config(
        PlaneSearch(planes=3, distance_cm=6, extent_m=6, min_points=200,
                    incidence_deg=np.rad2deg(1.2), seed=1)
    )  # fmt: skip
    assert search.distance_m == pytest.approx(SEARCH.distance_m)
    assert search.incidence_rad == pytest.approx(SEARCH.incidence_rad)


@pytest.mark.parametrize(("tick_m", "outliers"), [(0.002, True), (0.004, False)])
def test_one_tick_of_the_scanner_is_no_outlier(tick_m, outliers):
    """Medians without noise: most agree to the tick, and some are the next one."""
    cloud = scan([WALL], noise_m=0.0)
    distance = cloud.distance_m + np.where(np.arange(len(cloud)) % 10, 0.0, 0.004)
    beams = Beams(distance, cloud.phi, cloud.laser_id, tick_m)
    every = np.arange(len(cloud))
    seen = planes_in_data.Cloud.from_beams(beams, cloud.parameters)
    plane = planes_in_data.fit_robustly("w", seen, every, SEARCH)
    assert (plane.trimmed > 0) == outliers


def test_medians_become_points():
    """Ticks, and the turn of the head while later lasers of a firing wait."""
    medians = {
        "laser_id": np.array([0, 31], dtype=np.uint8),
        "azimuth": np.array([9000, 9000], dtype=np.float32),
        "distance": np.array([5000, 5000], dtype=np.float32),
    }
    beams = Beams.from_ticks(medians, SCANNER, 10.0)
    cloud = planes_in_data.Cloud.from_beams(beams, nominal(SCANNER))
    np.testing.assert_allclose(cloud.distance_m, 10.0)
    np.testing.assert_allclose(
        cloud.phi, np.deg2rad([90.0, 90.0 + 3600 * 31 * 1.152e-6]), rtol=1e-9
    )
    down = np.deg2rad(92 / 3)
    assert cloud.xyz[0] == pytest.approx(
        [10 * np.cos(down), 0.0, -10 * np.sin(down) + 0.01717], abs=1e-6
    )


def medians_of(cloud: planes_in_data.Cloud) -> dict[str, np.ndarray]:
    return {
        "laser_id": cloud.laser_id,
        "azimuth": np.rad2deg(cloud.phi) * 100,
        "distance": cloud.distance_m / 0.002,
        "spread": np.full(len(cloud.phi), 1.5),
        "count": np.full(len(cloud.phi), 7),
    }


def fit(folder: Path, root: Path, cloud: planes_in_data.Cloud, **changed) -> dict[str, Path]:
    main = runpy.run_path(str(root / "scripts/fit_field_planes.py"))["main"]
    folder.mkdir()
    path = folder / "medians.parquet"
    storage.write_table(path, schemas.MEDIANS, medians_of(cloud), rotation_rate_hz=10.0)
    outputs = {name: folder / f"planes.{name}" for name in ("svg", "png")}
    outputs |= {"planes": folder / "planes.json", "lasers": folder / "lasers.csv"}
    outputs["members"] = folder / "planes.parquet"
    search = PlaneSearch(planes=2, distance_cm=6, extent_m=6, min_points=200,
              incidence_deg=70, seed=1)  # fmt: skip
    arguments = {"sample": "a", "scanner": "HDL-32E", "patches": None, "search": search,
                 "sigma_cm": 2.0, "near_points": True, **changed}  # fmt: skip
    main(medians=path, calibration=None, description=None, **outputs, **arguments)
    return outputs


def test_scripts(tmp_path, root):
    outputs = [fit(tmp_path / name, root, scan()) for name in ("one", "two")]
    for name, path in outputs[0].items():
        assert path.read_bytes() == outputs[1][name].read_bytes(), name
    found = storage.read_json(outputs[0]["planes"])
    assert found["calibration"] == "nominal"
    assert found["findings"] == []
    assert np.linalg.norm(found["planes"][0]["normal"]) == pytest.approx(1.0)
    lasers = pd.read_csv(outputs[0]["lasers"])
    assert list(lasers) == [
        "sample", "scanner", "plane", "laser_id", "count", "rms_cm", "mean_cm", "std_cm",
        "within_1sigma_pct", "within_3sigma_pct",
    ]  # fmt: skip
    assert set(lasers["plane"]) == {"plane1", "plane2"}
    assert (lasers["within_3sigma_pct"] == 100).all()
    assert lasers.groupby("plane")["count"].sum().to_dict() == {
        plane["plane"]: plane["points"] for plane in found["planes"]
    }

    nothing = fit(tmp_path / "none", root, hedge())
    assert all(path.stat().st_size > 0 for path in nothing.values())
    assert len(pd.read_csv(nothing["lasers"])) == 0

    main = runpy.run_path(str(root / "scripts/tabulate_field.py"))["main"]
    csv, md = tmp_path / "table.csv", tmp_path / "table.md"
    main(planes=[outputs[0]["planes"], nothing["planes"]], csv=csv, md=md)
    table = pd.read_csv(csv)
    assert list(table) == list(TABLE)
    assert list(table["plane"][:2]) == ["plane1", "plane2"]
    assert table["finding"].notna().tolist() == [False, False, True]
    assert "no plane found" in md.read_text()
    assert md.read_text().count("\n| a |") == 3


def test_markdown_escapes_and_leaves_empty():
    row = dict.fromkeys(TABLE) | {"sample": "a", "finding": "x | y", "std_cm": 1.234}
    line = field_markdown(pd.DataFrame([row])).splitlines()[4]
    assert line.startswith("| a |")
    assert "| 1.23 |" in line
    assert line.endswith(r"| x \| y |")


def test_many_planes_differ_in_the_picture(tmp_path):
    """Seven and more planes: colours come again, with another marker."""
    cloud = scan()
    members = {f"p{i}": np.arange(100 * i, 100 * i + 100) for i in range(8)}
    lasers = pd.DataFrame(
        {"plane": list(members), "laser_id": range(8), "rms_cm": 1.0, "std_cm": np.nan}
    )
    facts = {"sample": "a", "scanner": "HDL-32E", "calibration": "x", "sigma_cm": 2.0}
    figure = field_planes(cloud.xyz, members, lasers, facts, [], 32)
    lines = figure.axes[1].get_lines()
    looks = {(line.get_color(), line.get_marker()) for line in lines}
    assert len(looks) == 9
    save(figure, tmp_path / "a.svg", tmp_path / "a.png")
    assert (tmp_path / "a.svg").stat().st_size < 1_000_000
