"""Calibration files: what is read, and what is said about files that cannot be used."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from velocal.calibration_files import db_xml, formats, ros_yaml, table
from velocal.errors import CalibrationFileError
from velocal.parameters import PARAMETERS, ParameterSet

N = 3
WITHOUT_X_Y = {"dist_correction_x", "dist_correction_y"}


def made_up(**carried: list[float]) -> ParameterSet:
    return ParameterSet(
        dl=np.array([1.2, 1.3, -0.0]),
        alpha=np.array([-0.1, 0.0, 0.1]),
        v=np.array([-0.4, 0.01, 0.1]),
        voff=np.array([0.2, 0.1, 0.0]),
        hoff=np.array([0.026, -0.026, 0.026]),
        carried={name: np.array(values) for name, values in carried.items()},
    )


def px(laser: object, **tags: object) -> str:
    known = {"rotCorrection_": 9, "vertCorrection_": -18, "distCorrection_": 120, **tags}
    inner = "".join(f"<{tag}>{value}</{tag}>" for tag, value in known.items() if value is not None)
    return f"<item><px><id_>{laser}</id_>{inner}</px></item>"


def xml(items: str, before: str = "", dtd: str = "<!DOCTYPE boost_serialization>") -> str:
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>{dtd}<boost_serialization><DB>{before}'
        f"<points_><count>3</count>{items}</points_></DB></boost_serialization>"
    )


THREE = px(0) + px(1) + px(2)


def entry(laser: object, **keys: object) -> dict[str, object]:
    known = {"rot_correction": 0, "vert_correction": -0.1, "dist_correction": 1.2}
    return {"laser_id": laser, **known, **keys}


def yaml_text(*entries: object, **keys: object) -> str:
    return yaml.safe_dump({"lasers": list(entries), **keys})


def csv_text(*rows: str, more: str = "") -> str:
    return "\n".join(["laser_id,dl_m,alpha_rad,v_rad,voff_m,hoff_m" + more, *rows, ""])


def put(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_xml_is_converted_to_radians_and_metres(tmp_path: Path) -> None:
    tags = {"vertOffsetCorrection_": 20, "horizOffsetCorrection_": 2.6, "focalDistance_": 1200}
    path = put(tmp_path, "db.xml", xml(px("0.0", **tags) + px(1) + px(2)))
    found = db_xml.read(path, N)
    assert found.alpha[0] == pytest.approx(np.pi / 20)
    assert found.v[0] == pytest.approx(-np.pi / 10)
    assert found.dl.tolist() == [1.2, 1.2, 1.2]
    assert found.voff.tolist() == [0.2, 0.0, 0.0]
    assert found.hoff.tolist() == [0.026, 0.0, 0.0]
    assert found.carried["focal_distance"].tolist() == [12.0, 0.0, 0.0]
    assert set(found.carried) == {"focal_distance"}


def test_xml_with_the_misspelt_tag(tmp_path: Path) -> None:
    path = put(tmp_path, "db.xml", xml(px(0, horizOffsetCorection_=2.6) + px(1) + px(2)))
    assert db_xml.read(path, N).hoff[0] == 0.026


def test_xml_enabled_selects_and_intensities_go_by_laser_id(tmp_path: Path) -> None:
    before = (
        "<enabled_><count>4</count><item>1</item><item>1</item><item>1</item><item>0</item>"
        "</enabled_><minIntensity_><item>5</item><item>6</item><item>7</item></minIntensity_>"
    )
    path = put(tmp_path, "db.xml", xml(px(2) + px(3) + px(1) + px(0), before))
    found = db_xml.read(path, N)
    assert len(found) == N
    assert found.carried["min_intensity"].tolist() == [5, 6, 7]


def test_xml_without_enabled_skips_zeros_behind_the_lasers_only(tmp_path: Path) -> None:
    zeros = {"rotCorrection_": 0, "vertCorrection_": 0, "distCorrection_": 0}
    assert len(db_xml.read(put(tmp_path, "db.xml", xml(THREE + px(3, **zeros))), N)) == N
    with pytest.raises(CalibrationFileError, match="holds 4 lasers"):
        db_xml.read(put(tmp_path, "db.xml", xml(THREE + px(3))), N)


@pytest.mark.parametrize(
    ("suffix", "n_items", "n_lasers"), [(".xml", 64, 3), (".yaml", 3, 3), (".csv", 3, 3)]
)
def test_written_files(tmp_path: Path, suffix: str, n_items: int, n_lasers: int) -> None:
    path, again = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    formats.write(path, made_up(focal_slope=[1.4, 1.5, 0.3]))
    formats.write(again, made_up(focal_slope=[1.4, 1.5, 0.3]))
    text = path.read_text()
    assert text == again.read_text()
    ids = {".xml": text.count("<id_>"), ".yaml": text.count("laser_id:"), ".csv": text.count("\n")}
    assert ids[suffix] == n_items + (suffix == ".csv")
    found = formats.read(path, n_lasers)
    for name in PARAMETERS:
        assert getattr(found, name).tobytes() == getattr(made_up(), name).tobytes()
    assert found.carried["focal_slope"].tolist() == [1.4, 1.5, 0.3]


def test_xml_numbers_are_short(tmp_path: Path) -> None:
    source = put(tmp_path, "source.xml", xml(THREE.replace(">-18<", ">-8.7686234<")))
    db_xml.write(tmp_path / "db.xml", db_xml.read(source, N))
    assert "<vertCorrection_>-8.7686234<" in (tmp_path / "db.xml").read_text()


def test_yaml_without_two_point_correction_stays_without(tmp_path: Path) -> None:
    zeros = {"dist_correction_x": 0, "dist_correction_y": 0}
    path = put(tmp_path, "a.yaml", yaml_text(entry(0, **zeros), entry(1), entry(2)))
    found = ros_yaml.read(path, N)
    assert not WITHOUT_X_Y & set(found.carried)
    ros_yaml.write(path, found)
    first = yaml.safe_load(path.read_text())["lasers"][0]
    assert first["two_pt_correction_available"] is False
    # Readers that do not know the flag interpolate between equal values.
    assert first["dist_correction_x"] == first["dist_correction_y"] == 1.2
    assert (first["min_intensity"], first["max_intensity"]) == (0, 255)


def test_yaml_two_point_correction_of_some_lasers(tmp_path: Path) -> None:
    near = {"dist_correction_x": 1.3, "dist_correction_y": 1.4, "two_pt_correction_available": True}
    path = put(tmp_path, "a.yml", yaml_text(entry(2), entry(1, **near), entry(0)))
    assert formats.read(path, N).carried["dist_correction_x"].tolist() == [1.2, 1.3, 1.2]


def test_yaml_with_exponents_that_yaml_takes_for_text(tmp_path: Path) -> None:
    text = yaml_text(*map(entry, range(N))).replace("-0.1", "-1e-05")
    assert ros_yaml.read(put(tmp_path, "a.yaml", text), N).v[0] == -1e-5


def test_csv_with_standard_deviations(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    table.write(path, made_up(), std={"dl": np.array([0.001, np.nan, 0.002])})
    header, first, second, _ = path.read_text().splitlines()
    assert header == "laser_id,dl_m,alpha_rad,v_rad,voff_m,hoff_m,dl_std_m"
    assert first.endswith(",0.001")
    assert second.endswith(",")
    assert table.read(path).dl.tolist() == [1.2, 1.3, 0.0]


def test_csv_from_a_spreadsheet(tmp_path: Path) -> None:
    text = "\ufeff" + csv_text("0,1,0,0,0,0").replace("\n", "\r\n") + "\r\n"
    assert table.read(put(tmp_path, "a.csv", text)).dl.tolist() == [1.0]


BOMB = '<!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;&b;&b;">]>'
BAD = {
    "unknown suffix": ("a.txt", "", r"unknown suffix '.txt' \(allowed: .xml, .yaml, .yml, .csv\)"),
    "web page": ("a.xml", "\n<!DOCTYPE html><html>", "is a web page.*\nHint: Download the file"),
    "xml empty": ("a.xml", "", "is not XML"),
    "xml broken": ("a.xml", xml(THREE)[:-9], "is not XML"),
    "xml encoding": ("a.xml", '<?xml version="1.0" encoding="utf-7"?><a/>', "is not XML"),
    "xml no encoding": ("a.xml", '<?xml version="1.0" encoding="x"?><a/>', "is not XML"),
    "xml entities": ("a.xml", xml(THREE, "&c;", BOMB), "declares XML entities"),
    "xml of others": ("a.xml", "<a><DB/></a>", "not a Velodyne calibration"),
    "xml no lasers": ("a.xml", xml(""), "holds no lasers"),
    "xml tick": ("a.xml", xml(THREE, "<distLSB_>0.4</distLSB_>"), "distLSB_ is 0.004 m"),
    "xml text": ("a.xml", xml(px(0, distCorrection_="x")), "laser 0: distCorrection_ is 'x'"),
    "xml nan": ("a.xml", xml(px(0, distCorrection_="nan")), "distCorrection_ is nan"),
    "xml signalling": ("a.xml", xml(px(0, distCorrection_="snan")), "distCorrection_ is 'snan'"),
    "xml huge": ("a.xml", xml(px(0, distCorrection_="1e999")), "distCorrection_ is inf"),
    "xml vast": ("a.xml", xml(px(0, distCorrection_="1e999999")), "distCorrection_ is inf"),
    "xml missing": ("a.xml", xml(px(0, vertCorrection_=None)), "vertCorrection_ is missing"),
    "xml angle": ("a.xml", xml(px(0, vertCorrection_=91)), "vertical angle is 1.58825 rad"),
    "xml id": ("a.xml", xml(px(0.5)), "item 0: id_ is 0.5"),
    "xml doubled": ("a.xml", xml(THREE + px(1)), "laser 1: the laser id is doubled"),
    "xml gap": ("a.xml", xml(px(0) + px(2)), "laser ids missing: 1 "),
    "yaml broken": ("a.yaml", "lasers: [", "is not YAML"),
    "yaml deep": ("a.yaml", "[" * 2000, "is not YAML"),
    "yaml binary": ("a.yaml", b"\xff\xfe\x00\xd8", "is not YAML"),
    "yaml date": ("a.yaml", "2001-99-99", "is not YAML"),
    "yaml object": ("a.yaml", "!!python/object/apply:os.getcwd []", "is not YAML"),
    "yaml of others": ("a.yaml", "a: 1", "holds no list 'lasers'"),
    "yaml entry": ("a.yaml", yaml_text(1), "entry 0 of lasers: is of type int"),
    "yaml few": ("a.yaml", yaml_text(entry(0), entry(1)), r"holds 2 lasers \(allowed: 3, as"),
    "yaml count": ("a.yaml", yaml_text(entry(0), num_lasers=3), "num_lasers is 3, but .* 1 entr"),
    "yaml tick": ("a.yaml", yaml_text(distance_resolution=1), "distance_resolution is 1 m"),
    "yaml one-based": ("a.yaml", yaml_text(*map(entry, [1, 2, 3])), "missing: 0; .*unknown: 3"),
    "yaml degrees": ("a.yaml", yaml_text(entry(0, vert_correction=-24)), "Hint: .* degrees where"),
    "yaml list": ("a.yaml", yaml_text(entry(0, vert_correction=[1])), "is of type list"),
    "yaml bool": ("a.yaml", yaml_text(entry(True)), "laser_id is of type bool"),
    "yaml long": (
        "a.yaml",
        yaml_text(entry(0)).replace("1.2", "0x" + "f" * 5000),
        "dist_correction is too large",
    ),
    "yaml inf": ("a.yaml", yaml_text(entry(0, rot_correction=-np.inf)), "rot_correction is -inf"),
    "yaml flag": (
        "a.yaml",
        yaml_text(entry(0, two_pt_correction_available=1)),
        "two_pt_correction_available is of type int",
    ),
    "csv empty": ("a.csv", "", "columns missing: laser_id, dl_m"),
    "csv binary": ("a.csv", b"\xff", "is not CSV"),
    "csv quote": ("a.csv", 'a"b,"c', "is not CSV"),
    "csv unknown": ("a.csv", csv_text(more=",dl_cm"), "columns unknown: dl_cm"),
    "csv doubled": ("a.csv", csv_text(more=",dl_m"), "columns doubled: dl_m"),
    "csv fields": ("a.csv", csv_text("0,1,2"), "row 2: has 3 fields"),
    "csv value": ("a.csv", csv_text("0,,0,0,0,0"), "dl_m is ''"),
    "csv degrees": ("a.csv", csv_text("0,0,0,-24,0,0"), "Hint: .* degrees where"),
    "csv few": ("a.csv", csv_text("0,0,0,0,0,0"), "holds 1 lasers"),
}


@pytest.mark.parametrize(("name", "text", "message"), BAD.values(), ids=BAD.keys())
def test_bad_files(tmp_path: Path, name: str, text: str | bytes, message: str) -> None:
    with pytest.raises(CalibrationFileError, match=message) as caught:
        formats.read(put(tmp_path, name, text), N)
    assert str(tmp_path / name) in str(caught.value)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(CalibrationFileError, match="cannot be read: No such file"):
        formats.read(tmp_path / "a.xml", N)


@pytest.mark.parametrize("suffix", [".xml", ".yaml", ".csv"])
def test_writers_refuse_what_cannot_be_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    with pytest.raises(CalibrationFileError, match="focal_slope of laser 1 is not finite"):
        formats.write(path, made_up(focal_slope=[1.0, np.nan, 1.0]))
    with pytest.raises(CalibrationFileError, match=r"focal_slope has shape \(1,\)"):
        formats.write(path, made_up(focal_slope=[1.0]))
    assert not path.exists()


def test_unknown_standard_deviations(tmp_path: Path) -> None:
    with pytest.raises(CalibrationFileError, match="standard deviations of range"):
        table.write(tmp_path / "a.csv", made_up(), std={"range": np.zeros(N)})
