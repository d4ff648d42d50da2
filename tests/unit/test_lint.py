"""Faults that are planted in good files are found, and nothing else is said of good files."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from velocal.calibration.files import formats
from velocal.calibration.fit import fitting
from velocal.calibration.lint import lint
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters, nominal


def unit(scanner: str = "HDL-64E") -> LaserParameters:
    """A unit as it might come from the factory."""
    design, rng = nominal(SCANNERS[scanner]), np.random.default_rng(1)
    if scanner != "HDL-64E":
        return design
    found = design.corrected(
        {
            "dl": rng.normal(1.4, 0.05, 64),
            "alpha": rng.normal(0.01, 0.002, 64),
            "v": rng.normal(0.004, 0.002, 64),
        }
    )
    near = found.dl + rng.normal(0.02, 0.01, (2, 64))
    found.carried.update(
        dist_correction_x=near[0],
        dist_correction_y=near[1],
        two_pt_correction_available=np.ones(64),
        focal_distance=np.full(64, 12.0),
        focal_slope=np.full(64, 1.4),
        min_intensity=np.full(64, 30.0),
        max_intensity=np.full(64, 235.0),
    )
    return found


Lasers = list[dict[str, object]]


def each(key: str, change: Callable[[float], object]) -> Callable[[dict, Lasers], None]:
    def plant(document: dict, lasers: Lasers) -> None:
        for laser in lasers:
            laser[key] = change(laser[key])

    return plant


def one(key: str, change: Callable[[float], object], laser: int = 5) -> Callable:
    def plant(document: dict, lasers: Lasers) -> None:
        lasers[laser][key] = change(lasers[laser][key])

    return plant


def drop(document: dict, lasers: Lasers) -> None:
    del lasers[7]
    document["num_lasers"] = 63


def double(document: dict, lasers: Lasers) -> None:
    lasers[7]["laser_id"] = 8


def from_one(document: dict, lasers: Lasers) -> None:
    for laser in lasers:
        laser["laser_id"] += 1


def half(document: dict, lasers: Lasers) -> None:
    del lasers[32:]
    document["num_lasers"] = 32


def exchange(document: dict, lasers: Lasers) -> None:
    """The lower block for the upper one."""
    for laser in lasers:
        laser["laser_id"] = (laser["laser_id"] + 32) % 64


def copied(document: dict, lasers: Lasers) -> None:
    lasers[9] |= {k: v for k, v in lasers[8].items() if k != "laser_id"}


def resolution(metres: float) -> Callable:
    def plant(document: dict, lasers: Lasers) -> None:
        document["distance_resolution"] = metres

    return plant


def no_minima(document: dict, lasers: Lasers) -> None:
    for laser in lasers[::3]:
        del laser["min_intensity"]


def lost(key: str, laser: int = 5) -> Callable:
    def plant(document: dict, lasers: Lasers) -> None:
        del lasers[laser][key]

    return plant


def state(key: str, value: object) -> Callable:
    def plant(document: dict, lasers: Lasers) -> None:
        document[key] = value

    return plant


def no_near(document: dict, lasers: Lasers) -> None:
    for laser in lasers:
        laser |= {"dist_correction_x": 0, "dist_correction_y": 0}


DEGREES, CENTIMETRES = math.degrees, (lambda x: 100.0 * x)
IN_YAML = {
    "laser missing": (drop, "missing-laser", "of 64 lasers are missing: 7"),
    "laser doubled": (double, "doubled", "laser 8 occurs 2 times"),
    "laser doubled, and so missing": (double, "missing-laser", "missing: 7"),
    "ids from one": (from_one, "unknown-laser", "laser 64: .* count from 1"),
    "id is text": (
        one("laser_id", lambda _: "five"),
        "id",
        "entry 5 of lasers: laser_id is 'five'",
    ),
    "count stated wrongly": (
        state("num_lasers", 65),
        "count",
        "num_lasers is 65, but there are 64",
    ),
    "NaN": (one("vert_correction", lambda _: float("nan")), "number", "laser 5: vert.* is nan"),
    "infinite": (
        one("dist_correction", lambda _: float("inf")),
        "number",
        "laser 5: dist.* is inf",
    ),
    "text": (one("rot_correction", lambda _: "west"), "number", "laser 5: rot.* is 'west'"),
    "value missing": (lost("vert_correction"), "missing-value", "vert_correction is missing"),
    "one distance missing": (lost("dist_correction"), "missing-value", "laser 5 is missing"),
    "one offset missing": (
        lost("horiz_offset_correction"),
        "missing-value",
        "of laser 5 is missing",
    ),
    "vertical angles in degrees": (each("vert_correction", DEGREES), "angle", "degrees for rad"),
    "rotational in degrees": (
        each("rot_correction", DEGREES),
        "angle",
        "rot_.* degrees for radians",
    ),
    "one angle in degrees": (one("rot_correction", DEGREES), "angle", "of laser 5: degrees for"),
    "radians taken for degrees": (each("vert_correction", math.radians), "angle", "wrong unit"),
    "distances in cm": (each("dist_correction", CENTIMETRES), "length", "centimetres for metres"),
    "one distance in cm": (one("dist_correction", CENTIMETRES), "length", "of laser 5 is beyond"),
    "near points in cm": (each("dist_correction_x", CENTIMETRES), "length", "_x of .* centimetres"),
    "heights in cm": (each("vert_offset_correction", CENTIMETRES), "length", "centimetres for met"),
    "sides in cm": (
        each("horiz_offset_correction", CENTIMETRES),
        "length",
        "centimetres for metres",
    ),
    "focal distances in cm": (each("focal_distance", CENTIMETRES), "length", "focal_distance of"),
    "metres taken for cm": (each("dist_correction", lambda x: x / 100), "length", "wrong unit"),
    "heights 100 times too small": (
        each("vert_offset_correction", lambda x: x / 100),
        "length",
        "wrong unit",
    ),
    "signs of vertical angles": (each("vert_correction", lambda x: -x), "sign", "throughout"),
    "sign of a vertical angle": (
        one("vert_correction", lambda x: -x),
        "sign",
        "vert.* laser 5 has",
    ),
    "signs of rotational angles": (each("rot_correction", lambda x: -x), "sign", "throughout"),
    "sign of a rotational angle": (
        one("rot_correction", lambda x: -x, laser=34),
        "sign",
        "rot_correction of laser 34 has",
    ),
    "signs of sides": (each("horiz_offset_correction", lambda x: -x), "sign", "throughout"),
    "sign of a side": (one("horiz_offset_correction", lambda x: -x), "sign", "laser 5 has"),
    "sign of a height": (one("vert_offset_correction", lambda x: -x), "sign", "laser 5 has"),
    "sign of a distance": (one("dist_correction", lambda x: -x), "distance", "laser 5 is unlike"),
    "distance of zero": (one("dist_correction", lambda _: 0.0), "distance", "laser 5 is zero"),
    "half of the lasers": (half, "missing-laser", "of 64 lasers are missing: 32, 33"),
    "blocks exchanged": (exchange, "order", "not in the order of the HDL-64E"),
    "laser copied": (copied, "twins", "lasers 8 and 9 have the same values"),
    "angle of another laser": (
        one("vert_correction", lambda x: x + 0.09),
        "value",
        "laser 5 is far from the nominal",
    ),
    "near point of zero": (one("dist_correction_x", lambda _: 0.0), "two-point", "_x of laser 5"),
    "no near points, but used": (no_near, "two-point", "are zero, but enabled"),
    "tick in cm": (resolution(0.2), "tick", "distance_resolution is 0.2 m"),
    "tick of nothing known": (resolution(0.001), "tick", "0.001 m; 0.002 or 0.004 are known"),
    "flag no flag": (one("two_pt_correction_available", lambda _: "x"), "number", "of type str"),
    "intensities of some": (no_minima, "intensity", "given for 42 of 64 lasers"),
    "intensities swapped": (
        one("min_intensity", lambda _: 255),
        "intensity",
        "least above largest",
    ),
    "intensity beyond a byte": (
        one("max_intensity", lambda _: 300),
        "intensity",
        "not within 0 to",
    ),
    "dialect unknown": (state("dialect", "klingon"), "dialect", "unknown dialect 'klingon'"),
}


@pytest.mark.parametrize(("plant", "code", "text"), IN_YAML.values(), ids=IN_YAML)
def test_faults_planted_in_yaml(tmp_path: Path, plant: Callable, code: str, text: str) -> None:
    path = tmp_path / "a.yaml"
    formats.write(path, unit())
    assert lint(path, SCANNERS["HDL-64E"]) == []
    document = yaml.safe_load(path.read_text())
    plant(document, document["lasers"])
    path.write_text(yaml.safe_dump(document))
    found = lint(path, SCANNERS["HDL-64E"])
    assert [each for each in found if each.code == code and re.search(text, each.text)], found


def sub(pattern: str, by: str, count: int = 0) -> Callable[[str], str]:
    return lambda text: re.sub(pattern, by, text, count=count)


IN_XML = {
    "web page": (lambda text: f"<!DOCTYPE html><html><pre>{text}</pre></html>", "is a web page"),
    "cut short": (lambda text: text[:5000], "is not XML"),
    "another XML": (lambda text: "<svg/>", "not a Velodyne calibration"),
    "entities": (
        sub("<!DOCTYPE boost_serialization>", '<!DOCTYPE a [<!ENTITY b "c">]>'),
        "entities",
    ),
    "empty": (lambda text: "", "is not XML"),
    "radians for degrees": (
        sub(r"<vertCorrection_>(-?)\d+\.", r"<vertCorrection_>\g<1>0."),
        "span",
    ),
    "a laser turned off": (
        sub("<item>1</item>\n</enabled_>", "<item>0</item>\n</enabled_>"),
        "of 64 lasers are missing: 63",
    ),
    "a list too short": (sub("<item>30</item>\n", "", count=1), "differ in length"),
    "tag misspelt": (sub("distCorrection_>", "distCorection_>"), "distCorrection_ is missing"),
    "comma for point": (sub(r"<rotCorrection_>(-?\d+)\.", r"<rotCorrection_>\1,"), "is '-?\\d+,"),
}


@pytest.mark.parametrize(("plant", "text"), IN_XML.values(), ids=IN_XML)
def test_faults_planted_in_xml(tmp_path: Path, plant: Callable, text: str) -> None:
    path = tmp_path / "db.xml"
    formats.write(path, unit())
    assert lint(path) == []
    path.write_text(plant(path.read_text()))
    found = lint(path)
    assert [each for each in found if re.search(text, each.text)], found


@pytest.mark.parametrize("scanner", SCANNERS)
@pytest.mark.parametrize("suffix", [".xml", ".yaml", ".csv", ".json"])
def test_good_files_are_silent(tmp_path: Path, scanner: str, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    formats.write(path, unit("HDL-64E" if scanner.startswith("HDL-64E") else scanner))
    assert lint(path) == lint(path, SCANNERS[scanner]) == []


def test_file_of_another_scanner(tmp_path: Path) -> None:
    formats.write(tmp_path / "a.csv", unit("VLP-16"))
    (found,) = lint(tmp_path / "a.csv", SCANNERS["HDL-32E"])
    assert found.code == "missing-laser"
    formats.write(tmp_path / "b.csv", unit())
    (found,) = lint(tmp_path / "b.csv", SCANNERS["HDL-32E"])
    assert found.text == "laser 32, 33, 34, 35, 36, 37, 38, 39 ...: the HDL-32E has 32"


def test_model_is_told_by_the_vertical_angles(tmp_path: Path) -> None:
    """Both models have 16 lasers, so that a file of the one is read for the other."""
    path = tmp_path / "hires.yaml"
    formats.write(path, unit("VLP-16-Hi-Res"))
    (found,) = lint(path, SCANNERS["VLP-16"])
    assert found.code == "scanner"
    assert "VLP-16-Hi-Res, not of the VLP-16" in found.text
    for name in SCANNERS:
        v = SCANNERS[name].vertical_rad
        first = next(fitting(v))
        np.testing.assert_array_equal(first.vertical_rad, v)
        assert next(fitting(v + np.deg2rad(0.4))) is first  # as real units are off


@pytest.mark.parametrize(
    ("scanner", "key", "factor", "text"),
    [
        ("VLP-16-Hi-Res", "vert_offset_correction", 100.0, "centimetres for metres"),
        ("HDL-32E", "vert_offset_correction", 0.01, "wrong unit"),
        ("VLP-32C", "rot_correction", np.pi / 180.0, "wrong unit"),
        ("VLP-32C", "vert_correction", np.pi / 180.0, "wrong unit"),
        ("VLS-128", "rot_correction", 180.0 / np.pi, "degrees for radians"),
    ],
)
def test_units_are_checked_for_every_scanner(tmp_path, scanner, key, factor, text):
    path = tmp_path / "a.yaml"
    formats.write(path, unit(scanner))
    document = yaml.safe_load(path.read_text())
    for laser in document["lasers"]:
        laser[key] *= factor
    path.write_text(yaml.safe_dump(document))
    assert [each for each in lint(path, SCANNERS[scanner]) if re.search(text, each.text)]


def test_small_corrections_of_other_scanners_are_no_fault(tmp_path: Path) -> None:
    """The distance corrections of an HDL-64E are a metre; a VLS-128 has none, or millimetres."""
    refined = unit("VLS-128").corrected({"dl": np.linspace(0.001, 0.01, 128)})
    formats.write(tmp_path / "a.csv", refined)
    assert lint(tmp_path / "a.csv") == []


@pytest.mark.parametrize("scanner", SCANNERS)
def test_vertical_offsets_left_out_are_named(tmp_path: Path, scanner: str) -> None:
    path, whole = tmp_path / "a.yaml", unit("HDL-64E" if "HDL-64E" in scanner else scanner)
    formats.write(path, replace(whole, voff=np.zeros(len(whole))))
    (found,) = lint(path)
    assert found.code == "offsets"
    nominal = 1e3 * SCANNERS[scanner].vertical_offset_m
    assert f"from {nominal.min():.1f} to {nominal.max():.1f} mm" in found.text


#: What is truly odd in real files.
NO_OFFSETS = "vert.* is zero for every laser; the {} has offsets from {} to {} mm"
SHIFTED = "min_intensity is given for {} of 64 lasers: converters that leave out defaults"
ODD = {
    # Values of zero were left out, and the others moved to other lasers (the XML has them all).
    "64e_s2.1-sztaki.yaml": [SHIFTED.format(44), "max_intensity is given for 2 of 64"],
    "64e_s3-xiesc.yaml": [SHIFTED.format(12), "max_intensity is given for 5 of 64"],
    # An S1, which has no two-point calibration; the flag was set all the same.
    "64e_utexas.yaml": [
        "near-point corrections of laser 0, .* are zero, but enabled",
        NO_OFFSETS.format("HDL-64E", 105.8, 209.5),
    ],
    # The ROS driver and VeloView leave the offsets of the maker's drawings out.
    "32db.yaml": [NO_OFFSETS.format("HDL-32E", -5.5, 17.2)],
    "veloview_HDL-32.xml": [NO_OFFSETS.format("HDL-32E", -5.5, 17.2)],
    "VLP16db.yaml": [NO_OFFSETS.format("VLP-16", -11.2, 11.2)],
}


def test_real_files_are_silent_but_for_what_is_odd_in_them(shared: Path) -> None:
    for path in sorted((shared / "calibrations").iterdir()):
        found, odd = lint(path), ODD.get(path.name, [])
        assert len(found) == len(odd), (path.name, found)
        for finding, text in zip(found, odd, strict=True):
            assert re.search(text, finding.text)


def test_missing_file_and_unknown_suffix(tmp_path: Path) -> None:
    assert "cannot be read" in lint(tmp_path / "a.xml")[0].text
    assert "unknown suffix" in lint(tmp_path / "a.txt")[0].text
