"""Calibration files: what is read, and what is said about files that cannot be used."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from velocal.calibration.convert import convert
from velocal.calibration.dialects import DIALECTS, PAPER
from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.errors import CalibrationFileError, ConfigError
from velocal.scanner.parameters import PARAMETERS, LaserParameters

N = 3


def read(path: Path, n_lasers: int = N) -> LaserParameters:
    return formats.read_calibration(path, n_lasers).parameters


def made_up(**carried: list[float]) -> LaserParameters:
    return LaserParameters(
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


def json_text(**changed: object) -> str:
    known = {"format": "velocal calibration", "version": 1, "dialect": "paper", "provenance": {}}
    return json.dumps({**known, "lasers": [], **changed})


def put(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_xml_is_converted_to_radians_and_metres(tmp_path: Path) -> None:
    tags = {"vertOffsetCorrection_": 20, "horizOffsetCorrection_": 2.6, "focalDistance_": 1200}
    path = put(tmp_path, "db.xml", xml(px("0.0", **tags) + px(1) + px(2)))
    found = read(path, N)
    assert found.alpha[0] == pytest.approx(np.pi / 20)
    assert found.v[0] == pytest.approx(-np.pi / 10)
    assert found.dl.tolist() == [1.2, 1.2, 1.2]
    assert found.voff.tolist() == [0.2, 0.0, 0.0]
    assert found.hoff.tolist() == [0.026, 0.0, 0.0]
    assert found.carried["focal_distance"].tolist() == [12.0, 0.0, 0.0]
    assert set(found.carried) == {"focal_distance"}


def test_xml_with_the_misspelt_tag(tmp_path: Path) -> None:
    path = put(tmp_path, "db.xml", xml(px(0, horizOffsetCorection_=2.6) + px(1) + px(2)))
    assert read(path, N).hoff[0] == 0.026


def test_xml_enabled_selects_and_intensities_go_by_laser_id(tmp_path: Path) -> None:
    before = (
        "<enabled_><count>4</count><item>1</item><item>1</item><item>1</item><item>0</item>"
        "</enabled_><minIntensity_><item>5</item><item>6</item><item>7</item></minIntensity_>"
    )
    path = put(tmp_path, "db.xml", xml(px(2) + px(3) + px(1) + px(0), before))
    found = read(path, N)
    assert len(found) == N
    assert found.carried["min_intensity"].tolist() == [5, 6, 7]


def test_xml_without_enabled_skips_zeros_behind_the_lasers_only(tmp_path: Path) -> None:
    zeros = {"rotCorrection_": 0, "vertCorrection_": 0, "distCorrection_": 0}
    assert len(read(put(tmp_path, "db.xml", xml(THREE + px(3, **zeros))), N)) == N
    with pytest.raises(CalibrationFileError, match="holds 4 lasers"):
        read(put(tmp_path, "db.xml", xml(THREE + px(3))), N)


@pytest.mark.parametrize(
    ("suffix", "key", "count"),
    [(".xml", "<id_>", 64), (".yaml", "laser_id:", 3), (".csv", "\n", 4), (".json", "laser_id", 3)],
)
def test_written_files(tmp_path: Path, suffix: str, key: str, count: int) -> None:
    path, again = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    formats.write(path, made_up(focal_slope=[1.4, 1.5, 0.3]))
    formats.write(again, made_up(focal_slope=[1.4, 1.5, 0.3]))
    text = path.read_text()
    assert text == again.read_text()
    assert text.count(key) == count
    found = formats.read(path, N)
    for name in PARAMETERS:
        assert getattr(found, name).tobytes() == getattr(made_up(), name).tobytes()
    assert found.carried["focal_slope"].tolist() == [1.4, 1.5, 0.3]


def test_xml_numbers_are_short(tmp_path: Path) -> None:
    source = put(tmp_path, "source.xml", xml(THREE.replace(">-18<", ">-8.7686234<")))
    formats.write(tmp_path / "db.xml", read(source, N))
    assert "<vertCorrection_>-8.7686234<" in (tmp_path / "db.xml").read_text()


def test_yaml_without_two_point_correction_stays_without(tmp_path: Path) -> None:
    zeros = {"dist_correction_x": 0, "dist_correction_y": 0}
    path = put(tmp_path, "a.yaml", yaml_text(entry(0, **zeros), entry(1), entry(2)))
    found = read(path)
    assert not found.carried["two_pt_correction_available"].any()
    formats.write(path, found)
    first, second, _ = yaml.safe_load(path.read_text())["lasers"]
    assert first["two_pt_correction_available"] is False
    assert first["dist_correction_x"] == 0.0
    # Readers that do not know the flag interpolate between equal values.
    assert second["dist_correction_x"] == second["dist_correction_y"] == 1.2
    assert (first["min_intensity"], first["max_intensity"]) == (0, 255)
    # The XML has no flag: there, what is turned off gets no effect.
    formats.write(tmp_path / "a.xml", found)
    assert read(tmp_path / "a.xml").carried["dist_correction_x"].tolist() == [1.2] * 3


def test_yaml_flags_of_sets_without_flags_are_those_of_the_converter_of_ros(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    formats.write(path, made_up(dist_correction_x=[1.3, 0, 1.0], dist_correction_y=[1.3, 1, 0.0]))
    flags = [e["two_pt_correction_available"] for e in yaml.safe_load(path.read_text())["lasers"]]
    assert flags == [True, False, False]


def test_yaml_two_point_correction_of_some_lasers(tmp_path: Path) -> None:
    near = {"dist_correction_x": 1.3, "dist_correction_y": 1.4, "two_pt_correction_available": True}
    path = put(tmp_path, "a.yml", yaml_text(entry(2), entry(1, **near), entry(0)))
    found = formats.read(path, N)
    assert found.carried["dist_correction_x"].tolist() == [1.2, 1.3, 1.2]
    assert found.carried["two_pt_correction_available"].tolist() == [0, 1, 0]


def test_yaml_of_velodyne_decoder_leaves_out_what_is_zero(tmp_path: Path) -> None:
    lasers = [{"laser_id": k, "rot_correction": 0.1, "vert_correction": 0.2} for k in range(N)]
    found = read(put(tmp_path, "a.yml", yaml_text(*lasers, distance_resolution=0.002)))
    assert found.dl.tolist() == found.voff.tolist() == [0.0] * N


@pytest.mark.parametrize("suffix", [".xml", ".yaml", ".json"])
def test_another_distance_tick_is_carried(tmp_path: Path, suffix: str) -> None:
    """A VLS-128 counts in 4 mm; the scanners of this project do not."""
    path = put(tmp_path, "a.xml", xml(THREE, "<distLSB_>0.4</distLSB_>"))
    found = formats.read_calibration(path)
    assert found.tick_m == 0.004
    formats.write(tmp_path / f"b{suffix}", found)
    assert formats.read_calibration(tmp_path / f"b{suffix}").tick_m == 0.004
    with pytest.raises(CalibrationFileError, match=r"made for a distance tick of 0\.004 m"):
        formats.read(path, N)


def complete() -> CalibrationFile:
    return CalibrationFile(
        made_up(dist_correction_x=[1.3, 0, 1.0], two_pt_correction_available=[1, 0, 1]),
        dialect="manual",
        scanner="VLP-16",
        tick_m=0.004,
        std={"dl": np.array([0.1, np.nan, 1 / 3]), "v": np.array([1e-9, 2e-300, 0.0])},
        covariance={("dl", "alpha"): np.array([1e-7, -1 / 3, np.nan])},
        provenance={"velocal": "0.1.0", "sources": ["a", {"b": 1.5}]},
    )


def test_complete_format_keeps_everything(tmp_path: Path) -> None:
    written, path = complete(), tmp_path / "a.json"
    formats.write(path, written)
    found = formats.read_calibration(path, N)
    for name in ("dialect", "scanner", "tick_m", "provenance"):
        assert getattr(found, name) == getattr(written, name)
    for name in PARAMETERS:
        before, after = (getattr(each.parameters, name) for each in (written, found))
        assert after.tobytes() == before.tobytes()
    for kind in ("std", "covariance"):
        assert getattr(found, kind).keys() == getattr(written, kind).keys()
        for key, values in getattr(written, kind).items():
            np.testing.assert_array_equal(getattr(found, kind)[key], values)
    np.testing.assert_equal(dict(found.parameters.carried), dict(written.parameters.carried))
    formats.write(tmp_path / "b.json", found)
    assert (tmp_path / "b.json").read_bytes() == path.read_bytes()
    assert sum("laser_id" in line for line in path.read_text().splitlines()) == N


def test_stated_dialects_are_read_back_as_parameters_of_the_model(tmp_path: Path) -> None:
    for suffix, dialect in ((".xml", "veloview"), (".yaml", "ros"), (".json", "mrpt")):
        numbers = convert(replace(made_up(), alpha=np.zeros(N)), PAPER, DIALECTS[dialect])
        path = tmp_path / f"a{suffix}"
        formats.write(path, CalibrationFile(numbers, dialect=dialect))
        assert formats.read_calibration(path).dialect == dialect
        found = formats.read(path, N)
        for name in ("dl", "v", "voff", "hoff"):
            np.testing.assert_allclose(getattr(found, name), getattr(made_up(), name), atol=1e-15)


def test_unknown_dialect_in_a_file(tmp_path: Path) -> None:
    path = put(tmp_path, "a.yaml", yaml_text(*map(entry, range(N)), dialect="klingon"))
    with pytest.raises(ConfigError, match="unknown dialect 'klingon'"):
        formats.read(path, N)


def test_yaml_with_exponents_that_yaml_takes_for_text(tmp_path: Path) -> None:
    text = yaml_text(*map(entry, range(N))).replace("-0.1", "-1e-05")
    assert read(put(tmp_path, "a.yaml", text), N).v[0] == -1e-5


def test_csv_with_standard_deviations(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    formats.write(path, CalibrationFile(made_up(), std={"dl": np.array([0.001, np.nan, 0.002])}))
    header, first, second, _ = path.read_text().splitlines()
    assert header == "laser_id,dl_m,alpha_rad,v_rad,voff_m,hoff_m,dl_std_m"
    assert first.endswith(",0.001")
    assert second.endswith(",")
    assert read(path).dl.tolist() == [1.2, 1.3, 0.0]


def test_csv_from_a_spreadsheet(tmp_path: Path) -> None:
    text = "\ufeff" + csv_text("0,1,0,0,0,0").replace("\n", "\r\n") + "\r\n"
    assert read(put(tmp_path, "a.csv", text), 1).dl.tolist() == [1.0]


BOMB = '<!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;&b;&b;">]>'
BAD = {
    "unknown suffix": ("a.txt", "", r"suffix '.txt' \(allowed: .xml, .yaml, .yml, .csv, .json\)"),
    "web page": ("a.xml", "\n<!DOCTYPE html><html>", "is a web page.*\nHint: Download the file"),
    "xml empty": ("a.xml", "", "is not XML"),
    "xml broken": ("a.xml", xml(THREE)[:-9], "is not XML"),
    "xml encoding": ("a.xml", '<?xml version="1.0" encoding="utf-7"?><a/>', "is not XML"),
    "xml no encoding": ("a.xml", '<?xml version="1.0" encoding="x"?><a/>', "is not XML"),
    "xml entities": ("a.xml", xml(THREE, "&c;", BOMB), "declares XML entities"),
    "xml of others": ("a.xml", "<a><DB/></a>", "not a Velodyne calibration"),
    "xml no lasers": ("a.xml", xml(""), "holds no lasers"),
    "xml tick": ("a.xml", xml(THREE, "<distLSB_>0.4</distLSB_>"), "distance tick of 0.004 m"),
    "xml tick in metres": ("a.xml", xml(THREE, "<distLSB_>20</distLSB_>"), "distLSB_ is 0.2 m"),
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
    "json broken": ("a.json", "{", "is not JSON"),
    "json deep": ("a.json", "[" * 100_000, "is not JSON"),
    "json of others": ("a.json", "{}", "is JSON, but not a calibration"),
    "json version": ("a.json", json_text(version=2), "version is 2 .*\nHint: Use the version"),
    "json key": ("a.json", json_text(lazers=[]), "unknown: lazers"),
    "json lasers": ("a.json", json_text(lasers={}), "lasers is of type dict"),
    "json laser": ("a.json", json_text(lasers=[1]), "entry 0 of lasers: is of type int"),
    "json dialect": ("a.json", json_text(dialect=None), "dialect is of type NoneType"),
    "json value": ("a.json", json_text(lasers=[{"laser_id": 0, "dl_cm": 1}]), "unknown: dl_cm"),
    "json missing": ("a.json", json_text(lasers=[{"laser_id": 0}]), "dl_m is missing"),
    "json std": ("a.json", json_text(lasers=[{"laser_id": 0, "std": {"dl": 1}}]), "unknown: dl"),
    "json covariance": ("a.json", json_text(lasers=[{"covariance": 1}]), "is of type int"),
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


@pytest.mark.parametrize("suffix", [".xml", ".yaml", ".csv", ".json"])
def test_writers_refuse_what_cannot_be_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    with pytest.raises(CalibrationFileError, match="focal_slope of laser 1 is not finite"):
        formats.write(path, made_up(focal_slope=[1.0, np.nan, 1.0]))
    with pytest.raises(CalibrationFileError, match=r"focal_slope has shape \(1,\)"):
        formats.write(path, made_up(focal_slope=[1.0]))
    assert not path.exists()


def test_unknown_standard_deviations(tmp_path: Path) -> None:
    with pytest.raises(CalibrationFileError, match="standard deviations of range"):
        formats.write(tmp_path / "a.csv", CalibrationFile(made_up(), std={"range": np.zeros(N)}))


def test_who_writes_one_format_does_not_load_the_others(tmp_path):
    program = f"""
import sys
from pathlib import Path
from velocal.calibration.files import formats
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
formats.write(Path({str(tmp_path / "a.csv")!r}), nominal(SCANNERS["VLP-16"]))
print(*sorted(name.rsplit(".", 1)[1] for name in sys.modules if "calibration.files." in name))
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["decimals", "document", "formats", "velocal_csv"]
