"""A wrong survey is found: every blunder that once ran to a finished report, and no other."""

from dataclasses import replace

import numpy as np
import pytest
from support.small_survey import POSES, SIGMA_M, Small, pose, record, small

from velocal.errors import SurveyError
from velocal.geometry.rigid import RigidTransformation, rotation_from_vector
from velocal.scanner.models import SCANNERS
from velocal.survey.checks.findings import raise_errors
from velocal.survey.targets import Targets

RIGHT = small()
FLAT = small(flat_base=True)
SWAP = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]])
UP = np.array([0.0, 0.0, 0.1])
ROS = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])


def by(matrix):
    return lambda xyz: xyz @ np.asarray(matrix).T


def times(factor):
    return lambda xyz: xyz * factor


def planes(known: Small, plane: str, change) -> Small:
    own = np.array(known.planes.group) == plane
    xyz = known.planes.xyz.copy()
    xyz[own] = change(xyz[own])
    return replace(known, planes=replace(known.planes, xyz=xyz))


def in_metres(targets: Targets) -> Targets:
    return replace(targets, std=targets.std * 1e-3)


def one_height(xyz):
    return np.column_stack([xyz[:, :2], 1.2 + 0.002 * np.sin(np.arange(len(xyz)))])


def wrong_wall(known: Small) -> Small:
    group = list(known.planes.group)
    group[known.planes.name.index("wall1_9")] = "wall2"
    return replace(known, planes=replace(known.planes, group=tuple(group)))


def planes_exchanged() -> Small:
    """In a room whose corner is the origin the walls would only exchange their names."""
    known = RIGHT.site(lambda xyz: xyz + np.array([0.4, 0.9, 0.0]))
    return replace(known, planes=replace(known.planes, xyz=by(SWAP)(known.planes.xyz)))


def nearly_collinear() -> Small:
    """A base of 1 cm across: measured anew, with the errors of the targets."""
    rng, wide = np.random.default_rng(4), RIGHT.base_scanner.xyz * [0.03, 1.0, 0.03]
    site = {
        name: replace(targets, xyz=pose(name).apply(wide) + rng.normal(0.0, 5e-4, wide.shape))
        for name, targets in RIGHT.base_site.items()
    }
    return replace(RIGHT.base(lambda _: wide), base_site=site)


def base_target_off(known: Small, change) -> Small:
    site = known.base_site["P1"]
    xyz = site.xyz.copy()
    xyz[2] += change
    return replace(known, base_site={**known.base_site, "P1": replace(site, xyz=xyz)})


def counted_from_bottom(known: Small) -> Small:
    return known.base(lambda xyz: xyz + 10.0 * UP * SCANNERS[known.scanner].origin_height_m)


def moved(known: Small, turn_deg: float, shift_m: float) -> Small:
    """The scanner turns and moves before the last window."""
    rng, at = np.random.default_rng(9), pose("P1")
    nudge = rotation_from_vector(np.deg2rad([0.0, 0.0, turn_deg]))
    shift = np.array([shift_m, 0.0, 0.0])
    after = RigidTransformation(nudge @ at.rotation, at.translation + shift, at.covariance)
    windows = {**known.windows["P1"], "end": record(known.scanner, known.stated, after, rng)}
    still = {"beginning": record(known.scanner, known.stated, at, rng)}
    return replace(known, windows={**known.windows, "P1": windows | still})


def nominal_values() -> Small:
    """Real files of an HDL-64E have corrections of more than a metre."""
    return replace(small("HDL-64E", dl_m=1.3), from_file=False)


#: Blunder: broken study, check that finds it, parts of the message.
ERRORS = {
    "X and Y of the base exchanged": (
        lambda: RIGHT.base(by(SWAP)), "handedness", ["base_scanner.csv", "mirror image"]),
    "the same on a flat base, which a rotation can mirror": (
        lambda: FLAT.base(by(SWAP)), "share on the planes", ["X and Y of the base are exchanged"]),
    "X and Y of the planes exchanged": (
        planes_exchanged,
        "share on the planes", ["coordinates of the planes are (y, x, z) of the right x, y, z"]),
    "mirrored base": (
        lambda: FLAT.base(by(np.diag([-1, 1, 1]))), "share on the planes", ["the sign of X"]),
    "ROS axes": (
        lambda: RIGHT.base(by(ROS)), "share on the planes", ["ROS axes (X forward"]),
    "turned by 180 deg": (
        lambda: RIGHT.base(by(np.diag([-1, -1, 1]))), "share on the planes", ["180 deg about Z"]),
    "nearly collinear base": (
        nearly_collinear, "pose", ["nearly on one line: add one off it"]),
    "left-handed site": (
        lambda: RIGHT.site(by(SWAP)), "handedness", ["mirror image"]),
    "left-handed site, flat base": (
        lambda: FLAT.site(by(SWAP)), "share on the planes", ["site frame is left-handed"]),
    "target on the wrong wall": (
        lambda: wrong_wall(RIGHT), "targets of a plane", ["planes.csv, plane wall2", "wall1_9"]),
    "standard deviations of the base in metres": (
        lambda: replace(RIGHT, base_scanner=in_metres(RIGHT.base_scanner)),
        "standard deviations", ["base_scanner.csv", "these look like metres"]),
    "standard deviations of the planes in metres": (
        lambda: replace(RIGHT, planes=in_metres(RIGHT.planes)),
        "standard deviations", ["planes.csv", "these look like metres"]),
    "floor too low by 10 cm": (
        lambda: planes(RIGHT, "floor", lambda xyz: xyz - UP),
        "plane against the medians", ["plane floor", "nearer to"]),
    "floor too high by 10 cm": (
        lambda: planes(RIGHT, "floor", lambda xyz: xyz + UP),
        "share on the planes", ["floor lies 1", "farther away"]),
    "wall targets at one height": (
        lambda: planes(RIGHT, "wall1", one_height), "extent of a plane", ["plane wall1", "wide"]),
    "captures exchanged": (
        lambda: replace(RIGHT, order={"P1": "P2", "P2": "P1"}),
        "share on the planes", ["this is a recording of position P2: captures are exchanged"]),
    "an HDL-64E with nominal values": (
        nominal_values, "share on the planes", ["name the file in the sample table"]),
    "base of an HDL-32E counted from its bottom": (
        lambda: counted_from_bottom(RIGHT),
        "origin of the scanner frame", ["counted from its bottom", "90.81 mm"]),
    "all in millimetres": (
        lambda: RIGHT.site(times(1e3)).base(times(1e3)), "units", ["look like millimetres"]),
    "all in centimetres": (
        lambda: RIGHT.site(times(1e2)).base(times(1e2)), "units", ["or centimetres"]),
    "site in millimetres": (
        lambda: RIGHT.site(times(1e3)), "units", ["1000 times larger in the site frame"]),
    "planes in centimetres": (
        lambda: replace(RIGHT, planes=replace(RIGHT.planes, xyz=RIGHT.planes.xyz * 100)),
        "share on the planes", ["the planes are in centimetres"]),
    "a wrong target of the base": (
        lambda: base_target_off(RIGHT, [0.0, 0.06, 0.0]),
        "targets of the base", ["position P1, target B3", "Correct or remove B3"]),
}  # fmt: skip
WARNINGS = {
    "base of a VLP-16 counted from its bottom": (
        lambda: counted_from_bottom(small("VLP-16")),
        "origin of the scanner frame", ["counted from its bottom", "37.7 mm"]),
    "a target of the base off by 3 mm": (
        lambda: base_target_off(RIGHT, [0.0, 0.004, 0.0]),
        "targets of the base", ["position P1, target B3"]),
    "scanner turned by 0.3 deg while recording": (
        lambda: moved(RIGHT, 0.3, 0.0), "motion of the scanner",
        ["position P1", "window beginning and sample of_P1, window end", "has turned by 0."]),
    "scanner moved by 2 cm while recording": (
        lambda: moved(RIGHT, 0.0, 0.02), "motion of the scanner", ["window end", "and moved by"]),
    "something in front of a wall, which is no error of the survey": (
        lambda: obstructed(RIGHT), "share on the planes", ["of_P2", "(0 % behind it)"]),
    "one position only": (
        lambda: replace(RIGHT, base_site={"P1": RIGHT.base_site["P1"]}),
        "independent check", ["scanner HDL-32E", "two positions or more"]),
    "a base of 3 cm": (
        lambda: small(radius_m=0.03, base_mm=(0.7, 1.0)), "pose", ["farther from each other"]),
}  # fmt: skip


def obstructed(known: Small) -> Small:
    """Something stands before the scanner, and takes most of the beams to wall 2."""
    windows = {}
    for name, window in known.windows["P2"].items():
        forward = np.cos(window.phi - np.deg2rad(10.0)) > 0.3
        short = np.where(forward, np.minimum(window.distance_m, 0.9), window.distance_m)
        windows[name] = replace(window, distance_m=short)
    return replace(known, windows={**known.windows, "P2": windows})


def found(known: Small, severity: str) -> list[tuple[str, str]]:
    return [(f.check, str(f)) for f in known.check().findings if f.severity == severity]


@pytest.mark.parametrize("blunder", ERRORS)
def test_a_blunder_stops_the_run(blunder):
    broken, check, parts = ERRORS[blunder]
    errors = found(broken(), "error")
    assert any(name == check and all(part in text for part in parts) for name, text in errors), (
        errors
    )


@pytest.mark.parametrize("blunder", WARNINGS)
def test_a_doubt_is_a_warning(blunder):
    broken, check, parts = WARNINGS[blunder]
    known = broken()
    assert found(known, "error") == []
    warnings = found(known, "warning")
    assert any(name == check and all(part in text for part in parts) for name, text in warnings), (
        warnings
    )


@pytest.mark.parametrize("scanner", ["HDL-64E", "HDL-32E", "VLP-16"])
def test_a_right_survey_passes(scanner):
    checked = small(scanner, 3).check()
    assert checked.findings == ()
    assert {row.sample for row in checked.planes} == {f"of_{name}" for name in POSES}
    for row in checked.planes:
        assert row.seen.within == 1.0
        # Simulated without an error of the planes: four standard deviations of what is stated.
        assert abs(row.shift_m) < 4.0 * row.shift_std_m


def test_poor_surveys_give_no_false_alarm():
    """As poor as the examples of the templates; the chance of a false alarm is 0.1 % a check."""
    for seed in range(10):
        poor = small(seed=seed, radius_m=0.1, base_mm=(0.7, 1.0), targets=2)
        assert poor.check().findings == ()


def test_large_coordinates_change_nothing():
    """UTM coordinates: the pose, its covariance and the planes are those of a site near zero."""
    far = np.array([500_000.0, 5_400_000.0, 300.0])
    here, there = RIGHT.stations(), RIGHT.site(lambda xyz: xyz + far).stations()
    for name in POSES:
        near, moved_away = here[name], there[name]
        origin = moved_away.site_origin_m
        assert np.abs(origin - far).max() <= 50.0
        same = RigidTransformation(
            near.pose.rotation,
            near.pose.translation - near.pose.rotation @ (far - origin),
            near.pose.covariance,
        )
        # Double precision resolves 1e-9 m at five million metres.
        np.testing.assert_allclose(moved_away.pose.rotation, same.rotation, atol=1e-7)
        np.testing.assert_allclose(moved_away.pose.translation, same.translation, atol=1e-5)
        for one, other in zip(near.planes, moved_away.planes, strict=True):
            np.testing.assert_allclose(other.patch.plane.normal, one.patch.plane.normal, atol=1e-7)
    assert RIGHT.site(lambda xyz: xyz + far).check().findings == ()


def test_a_station_keeps_its_reduction():
    station = RIGHT.site(lambda xyz: xyz + 1e5).stations()["P1"]
    again = type(station).from_json(station.to_json())
    assert again.site_origin_m.tolist() == station.site_origin_m.tolist() != [0.0, 0.0, 0.0]
    assert "site_origin_m" not in RIGHT.stations()["P1"].to_json()


def test_all_errors_are_in_one_message():
    broken = RIGHT.base(by(ROS)).check().findings
    with pytest.raises(SurveyError) as raised:
        raise_errors(broken)
    text = str(raised.value)
    assert "nothing is exported" in text
    assert text.count("ROS axes") == 1  # both samples have the same cause
    assert "The same at sample of_P2 at position P2" in text
    raise_errors([])


def test_the_size_of_an_effect_decides():
    """Significant and larger than three sigma of the datasheet: no scanner does that."""
    large, slight = (base_target_off(RIGHT, [0.0, y, 0.0]) for y in (0.06, 0.004))
    assert found(large, "error")
    assert not found(slight, "error")
    assert SIGMA_M == 0.02
