"""Real calibration files, and an independent reader of ours."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from velocal.calibration.files import formats
from velocal.scanner.parameters import PARAMETERS, TWO_POINT, LaserParameters

#: Number of lasers of every real file.
FILES = {
    "32db.yaml": 32,
    "64e_s2.1-sztaki.xml": 64,
    "64e_s2.1-sztaki.yaml": 64,
    "64e_s3-xiesc.yaml": 64,
    "64e_utexas.yaml": 64,
    "VLP16db.yaml": 16,
    "veloview_HDL-32.xml": 32,
    "veloview_HDL-64.xml": 64,
}
#: Keys of ROS by our names.
KEYS = {
    "dl": "dist_correction",
    "alpha": "rot_correction",
    "v": "vert_correction",
    "voff": "vert_offset_correction",
    "hoff": "horiz_offset_correction",
}
NEAR_AND_FOCAL = ("dist_correction_x", "dist_correction_y", "focal_distance", "focal_slope")


def values(parameters: LaserParameters) -> dict[str, np.ndarray]:
    known = {name: getattr(parameters, name) for name in PARAMETERS}
    carried = {name: v for name, v in parameters.carried.items() if name != TWO_POINT}
    return known | carried


def test_no_file_is_left_out(shared: Path) -> None:
    assert {path.name for path in (shared / "calibrations").iterdir()} == set(FILES)


@pytest.mark.parametrize(("name", "n_lasers"), FILES.items())
@pytest.mark.parametrize("suffix", [".xml", ".yaml", ".csv", ".json"])
def test_real_files_survive_every_format(
    shared: Path, tmp_path: Path, name: str, n_lasers: int, suffix: str
) -> None:
    read = formats.read(shared / "calibrations" / name, n_lasers)
    assert len(read) == n_lasers
    assert np.ptp(read.v) > np.deg2rad(25)
    formats.write(tmp_path / f"a{suffix}", read)
    again = values(formats.read(tmp_path / f"a{suffix}", n_lasers))
    for key, column in values(read).items():
        np.testing.assert_array_equal(again[key], column)
    if suffix != ".xml" and TWO_POINT in read.carried:
        flags = formats.read(tmp_path / f"a{suffix}", n_lasers).carried[TWO_POINT]
        np.testing.assert_array_equal(flags, read.carried[TWO_POINT])


def test_xml_and_yaml_of_the_same_scanner_agree(shared: Path) -> None:
    folder = shared / "calibrations"
    xml = values(formats.read(folder / "64e_s2.1-sztaki.xml", 64))
    ros = values(formats.read(folder / "64e_s2.1-sztaki.yaml", 64))
    for name in (*PARAMETERS, *NEAR_AND_FOCAL):
        np.testing.assert_allclose(xml[name], ros[name], rtol=1e-15, atol=0)
    assert xml["focal_distance"][0] == 12.0


def test_intensities_of_the_same_scanner_disagree_as_known(shared: Path) -> None:
    """The script that made this YAML left out the zeros, and so moved the rest to other lasers."""
    folder = shared / "calibrations"
    xml = formats.read(folder / "64e_s2.1-sztaki.xml", 64).carried["min_intensity"]
    ros = formats.read(folder / "64e_s2.1-sztaki.yaml", 64).carried["min_intensity"]
    np.testing.assert_array_equal(xml[xml > 0], ros[ros > 0])
    assert not np.array_equal(xml, ros)


@pytest.mark.parametrize(("name", "n_lasers"), FILES.items())
def test_velodyne_decoder_reads_our_yaml(
    shared: Path, tmp_path: Path, name: str, n_lasers: int
) -> None:
    velodyne_decoder = pytest.importorskip("velodyne_decoder")
    ours = formats.read(shared / "calibrations" / name, n_lasers)
    formats.write(tmp_path / "a.yaml", ours)
    text = velodyne_decoder.Calibration.read(str(tmp_path / "a.yaml")).to_string()
    theirs = yaml.safe_load(text)
    assert theirs["num_lasers"] == n_lasers
    assert theirs["distance_resolution"] == pytest.approx(0.002)
    for key, column in values(ours).items():
        # It leaves out what has its default.
        default = 255 if key == "max_intensity" else 0
        found = [laser.get(KEYS.get(key, key), default) for laser in theirs["lasers"]]
        np.testing.assert_allclose(found, column, rtol=2e-7, atol=1e-8)
