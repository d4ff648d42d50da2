"""Changing key K of the configuration changes output O, for every key that changes a result.

For a key with an output, the job that makes it runs twice on the same inputs, as the rules of the
configuration and of the changed one describe it, and the bytes must differ. Where a job is too
dear, or needs too much before it, only what the rule gives to the script is compared.
"""

import copy
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from support import capture
from support.in_process import Rules, put_aside
from support.running import copy_project
from support.tiny import NEW_ROW, SECOND_POSITION, make_tiny

from velocal.errors import VelocalError
from velocal.study.config import StudyConfig
from velocal.study.schema import keys

SA3 = "sa3/beginning"
ADJUSTMENT = f"results/adjustment/{SA3}.csv"
COVARIANCE = f"results/adjustment/{SA3}.covariance.csv"
HDL32 = "results/adjustment/sa5/beginning.covariance.csv"
MEDIANS = f"results/medians/{SA3}.parquet"
ASSIGNED = f"results/assigned/{SA3}.parquet"
SET = "results/parameter_sets/HDL-64E/set1"
PANELS = "results/outdoor/o1.csv"
PLANES = "results/field/room/planes.json"
BOX = "unsurveyed.patches.{sample}.{plane}"
FIGURE = 'figures."NN"'
MAP = f"{FIGURE}.sections.{{section}}"


@dataclass(frozen=True)
class Given:
    """The name that a rule gives to its script, where the key must be seen."""

    rule: str
    name: str
    wildcards: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Change:
    """A change of the configuration, and where it must be seen.

    `before` are other changes, made to the configuration that this one is compared with too.
    """

    path: tuple[str, ...]
    value: Any
    seen: tuple[str | Given, ...]
    before: tuple[tuple[tuple[str, ...], Any], ...] = ()


def change(path: str, value: Any, *seen: str | Given, before=()) -> Change:
    return Change(tuple(path.split(".")), value, seen, before)


def table(name: str) -> Given:
    return Given("make_table", name)


def figure(name: str, rule: str = "draw_lasers") -> Given:
    return Given(rule, name)


PANEL_KIND = Given("draw_panels", "kind")
DRAWN = Given("draw_map", "selection")
SEARCHED = ((("unsurveyed", "patches"), {}),)


def offset(name: str) -> tuple[tuple[tuple[str, ...], Any], ...]:
    """A configuration that adjusts an offset of the lasers."""
    return (
        (("adjustment", "method"), "prior"),
        (("adjustment", "parameters"), ["dl", name]),
        (("adjustment", "prior", f"{name}_cm"), 1.0),
    )


OF_UNIT = (("scanner", "HDL-64E"), ("unit", "unit"))
OF_SAMPLE = (("sample", "sa3"),)
UNIT = ((("calibrations",), {"HDL-64E": {"unit": ["sa3"]}}),)
WITHOUT_SURVEY = (("scanner", "HDL-32E"), ("unit", "walls"))
UNSURVEYED_UNIT = (
    (("unsurveyed", "calibrations"), {"HDL-32E": {"walls": ["room"]}}),
    (("unsurveyed", "judged"), {}),
)

CHANGES = {
    "study": change("study", "Another title", Given("write_report", "title")),
    "simulation.rotations": change(
        "simulation.rotations", 13, "results/simulation/recordings/sa3.bin"
    ),
    "simulation.seeds.count": change(
        "simulation.seeds.count", 3, Given("summarise_seeds", "replicas")
    ),
    "simulation.seeds.rotations": change(
        "simulation.seeds.rotations", 5, Given("replicate_study", "rotations", (("seed", "1"),))
    ),
    "windows.rotations": change("windows.rotations", 3, f"results/returns/{SA3}.parquet"),
    "windows.max_missing": change(
        "windows.max_missing", 0.2, Given("index_recording", "max_missing", (("sample", "sa3"),))
    ),
    "reduction.min_count": change("reduction.min_count", 3, MEDIANS),
    "reduction.return": change("reduction.return", "last", "results/returns/dual/all.parquet"),
    "reduction.azimuth_bin_deg.{scanner}": change(
        "reduction.azimuth_bin_deg.HDL-64E", 1.8, MEDIANS
    ),
    "assignment.planes": change(
        "assignment.planes", ["short_wall", "floor"], "results/survey/P2.json"
    ),
    "assignment.limits.distance_cm": change("assignment.limits.distance_cm", 1, ASSIGNED),
    "assignment.limits.edge_cm": change("assignment.limits.edge_cm", 40, ASSIGNED),
    "assignment.limits.incidence_deg": change("assignment.limits.incidence_deg", 30, ASSIGNED),
    "adjustment.method": change("adjustment.method", "prior", ADJUSTMENT),
    "adjustment.robust": change("adjustment.robust", "huber", ADJUSTMENT),
    "adjustment.parameters": change("adjustment.parameters", ["dl"], ADJUSTMENT),
    "adjustment.noise_cm": change("adjustment.noise_cm", 4.0, ADJUSTMENT),
    "adjustment.angle_deg": change("adjustment.angle_deg", 0.5, COVARIANCE),
    "adjustment.block_deg": change("adjustment.block_deg", None, COVARIANCE),
    "adjustment.range_scale_cm_per_m": change(
        "adjustment.range_scale_cm_per_m", 0.5, COVARIANCE
    ),
    "adjustment.repeatability_cm": change("adjustment.repeatability_cm", 3.0, COVARIANCE),
    "adjustment.prior.dl_cm": change("adjustment.prior.dl_cm", 0.1, ADJUSTMENT),
    "adjustment.prior.alpha_deg": change("adjustment.prior.alpha_deg", 0.01, ADJUSTMENT),
    "adjustment.prior.v_deg": change("adjustment.prior.v_deg", 0.01, ADJUSTMENT),
    "adjustment.prior.voff_cm": change(
        "adjustment.prior.voff_cm", 0.1, ADJUSTMENT, before=offset("voff")
    ),
    "adjustment.prior.hoff_cm": change(
        "adjustment.prior.hoff_cm", 0.1, ADJUSTMENT, before=offset("hoff")
    ),
    "adjustment.prior.scale_cm_per_m": change(
        "adjustment.prior.scale_cm_per_m", 0.1, Given("compare_methods", "adjustment")
    ),
    "adjustment.truncate_at": change("adjustment.truncate_at", 0.05, ADJUSTMENT),
    "adjustment.average": change("adjustment.average", "covariance", f"{SET}.csv"),
    "adjustment.by_scanner.{scanner}.noise_cm": change(
        "adjustment.by_scanner.HDL-32E.noise_cm", 5.0, HDL32
    ),
    "adjustment.by_scanner.{scanner}.angle_deg": change(
        "adjustment.by_scanner.HDL-32E.angle_deg", 0.5, HDL32
    ),
    "adjustment.by_scanner.{scanner}.range_scale_cm_per_m": change(
        "adjustment.by_scanner.HDL-32E.range_scale_cm_per_m", 0.5, HDL32
    ),
    "adjustment.by_scanner.{scanner}.repeatability_cm": change(
        "adjustment.by_scanner.HDL-32E.repeatability_cm", 3.0, HDL32
    ),
    "parameter_sets.{scanner}.{set}": change(
        "parameter_sets.HDL-64E.set1", ["sa1"], Given("average_set", "adjustments")
    ),
    "export.yaml": change("export", {"yaml": "velodyne_decoder"}, f"{SET}.yaml"),
    "export.xml": change("export", {"xml": "pcl"}, f"{SET}.xml"),
    "validation.sigma_cm": change(
        "validation.sigma_cm", 1.0,
        f"results/statistics/calibration/{SA3}.csv", f"results/statistics/validation/{SA3}.csv",
    ),
    "validation.rotations": change(
        "validation.rotations", 2, f"results/statistics/validation/{SA3}.csv"
    ),
    "methods.scanner": change(
        "methods", {"scanner": "HDL-32E", "calibration": ["sa5"], "other": ["sa6"]},
        Given("compare_methods", "scanner"),
    ),
    "methods.runs": change("methods.runs", 7, Given("coverage", "runs")),
    "calibrations.{scanner}.{set}": change(
        "calibrations", {"HDL-64E": {"unit": ["sa3"]}}, Given("adjust_unit", "positions", OF_UNIT),
        before=((("calibrations",), {"HDL-64E": {"unit": ["sa1", "sa3"]}}),),
    ),
    "serials.{scanner}": change(
        "serials", {"HDL-64E": "17"}, Given("write_certificate", "serials"), before=UNIT
    ),
    **{
        f"joint.prior.{key}": change(
            f"joint.prior.{key}", 0.1, Given("adjust_unit", "joint", OF_UNIT), before=UNIT
        )
        for key in ("dl_cm", "alpha_deg", "v_deg", "scale_cm_per_m")
    },
    "joint.near_points": change(
        "joint.near_points", False, Given("adjust_unit", "joint", OF_UNIT),
        Given("residuals_calibration", "near_points", OF_SAMPLE),
        Given("residuals_validation", "near_points", OF_SAMPLE),
        before=(*UNIT, (("joint", "near_points"), True)),
    ),
    "export.distance": change(
        "export.distance", "single", Given("adjust_unit", "export", OF_UNIT), before=UNIT
    ),
    "methods.calibration": change(
        "methods", {"scanner": "HDL-64E", "calibration": ["sa1"], "other": ["sa3"]},
        Given("compare_methods", "calibrate_on"),
    ),
    "methods.other": change(
        "methods", {"scanner": "HDL-64E", "calibration": ["sa1"], "other": ["sa3"]},
        Given("compare_methods", "check_on"),
    ),
    "outdoor.rotations": change(
        "outdoor.rotations", 4,
        Given("simulate_outdoor", "rotations"),
    ),
    "outdoor.panels.{panel}.across_m": change(
        "outdoor.panels.left.across_m", [-1.8, -0.8], PANELS
    ),
    "outdoor.panels.{panel}.up_m": change("outdoor.panels.left.up_m", [-1.3, 0.4], PANELS),
    "outdoor.fit.depth_m": change("outdoor.fit.depth_m", 0.05, PANELS),
    "outdoor.fit.min_points": change("outdoor.fit.min_points", 100_000, PANELS),
    "outdoor.fit.min_lasers": change("outdoor.fit.min_lasers", 64, PANELS),
    "outdoor.fit.incidence_deg": change("outdoor.fit.incidence_deg", 12, PANELS),
    'outdoor.figures."NN"': change(
        "outdoor.figures.27", ["ideal", "HDL-64E"], PANEL_KIND
    ),
    "unsurveyed.sigma_cm": change("unsurveyed.sigma_cm", 1.0, "results/field/room/lasers.csv"),
    f"{BOX}.x_m": change("unsurveyed.patches.room.wall.x_m", [-0.5, 0.5], PLANES),
    f"{BOX}.y_m": change("unsurveyed.patches.room.wall.y_m", [-9, 0], PLANES),
    f"{BOX}.z_m": change("unsurveyed.patches.room.wall.z_m", [-9, 0], PLANES),
    "unsurveyed.calibrations.{scanner}.{set}": change(
        "unsurveyed.calibrations", {"HDL-32E": {"walls": ["room"]}},
        Given("write_certificate", "samples"), before=((("unsurveyed", "calibrations"), {}), *UNIT),
    ),
    **{
        f"unsurveyed.judged.{key}": change(
            f"unsurveyed.judged.{key}", value, Given("adjust_unsurveyed", "chosen", WITHOUT_SURVEY),
            before=UNSURVEYED_UNIT,
        )
        for key, value in (("names", ["room/wall"]), ("share", 0.5), ("seed", 2))
    },
    "unsurveyed.search.planes": change(
        "unsurveyed.search.planes", 1, PLANES, before=SEARCHED
    ),
    "unsurveyed.search.distance_cm": change(
        "unsurveyed.search.distance_cm", 1, PLANES, before=SEARCHED
    ),
    "unsurveyed.search.extent_m": change(
        "unsurveyed.search.extent_m", 0.3, PLANES, before=SEARCHED
    ),
    "unsurveyed.search.min_points": change("unsurveyed.search.min_points", 100_000, PLANES),
    "unsurveyed.search.incidence_deg": change("unsurveyed.search.incidence_deg", 10, PLANES),
    "unsurveyed.search.seed": change(
        "unsurveyed.search.seed", 2, Given("fit_field_planes", "search", (("sample", "room"),))
    ),
    'tables."2" ... "5".scanner': change(
        "tables.2", {"scanner": "HDL-32E", "samples": ["sa5"], "data": "calibration"},
        table("selection"),
    ),
    'tables."2" ... "5".samples': change("tables.2.samples", ["sa1"], table("selection")),
    'tables."2" ... "5".data': change("tables.2.data", "validation", table("selection")),
    f"{FIGURE}.kind": change("figures.13.kind", "within", figure("selection")),
    f"{FIGURE}.scanner": change(
        "figures.13", {"kind": "std", "scanner": "HDL-32E", "samples": ["sa5"],
        "data": "calibration"}, figure("selection"),
    ),
    f"{FIGURE}.samples": change(
        "figures.11.samples", ["sa1"], figure("selection", "draw_plan"),
        figure("medians", "draw_plan"),
    ),
    f"{FIGURE}.data": change("figures.13.data", "validation", figure("selection")),
    f"{FIGURE}.laser": change("figures.18.laser", 2, "results/figures/figure_18.csv"),
    f"{FIGURE}.sets": change(
        "figures.30.sets", ["set2"], figure("sets", "draw_corrections"),
        figure("adjustments", "draw_corrections"),
    ),
    f"{FIGURE}.set": change("figures.28.set", "set2", Given("map_building", "refined")),
    f"{MAP}.x_m": change("figures.28.sections.a.x_m", [0.5, 5], DRAWN),
    f"{MAP}.y_m": change("figures.28.sections.a.y_m", [8, 9], DRAWN),
    f"{MAP}.z_m": change("figures.28.sections.a.z_m", [0, 0.7], DRAWN),
}  # fmt: skip

#: Keys that have no entry above, with the reason.
_FILE = "names a file or folder; Snakemake compares what it holds, and check_files that it exists"
WITHOUT_AN_OUTPUT = {
    "results": "the place of the results, not what they are",
    "samples": _FILE,
    "survey.planes": _FILE,
    "survey.base_scanner": _FILE,
    "survey.base_site": _FILE,
    "survey.observations.points": _FILE,
    "survey.observations.polar": _FILE,
    "survey.observations.images": _FILE,
    "survey.observations.base_polar": _FILE,
    "survey.observations.base_coordinates": _FILE,
    "simulation.world": _FILE,
    "outdoor.samples": _FILE,
    "unsurveyed.samples": _FILE,
    "unsurveyed.recordings": _FILE,
    "compare_with_paper": "asks for further files, and adds their section to the report",
}


def leaves() -> list[str]:
    """Keys of the configuration below which there is no other."""
    every = list(dict.fromkeys(key for key, _ in keys(StudyConfig)))
    return [key for key in every if not any(other.startswith(f"{key}.") for other in every)]


def test_every_key_is_accounted_for():
    assert sorted([*CHANGES, *WITHOUT_AN_OUTPUT]) == sorted(leaves())


def changed(config: dict[str, Any], path: tuple[str, ...], value: Any) -> dict[str, Any]:
    config = copy.deepcopy(config)
    place = config
    for key in path[:-1]:
        place = place.setdefault(key, {})
    place[path[-1]] = value
    return config


UNSURVEYED = "sample\tscanner\trecording\tcalibration\n" + "".join(
    f"{name}\tHDL-32E\t{name}.bin\tnominal\n" for name in ("room", "dual")
)
RANGE = {"x_m": [0.3, 5.7], "y_m": [8.72, 9.28], "z_m": [0.5, 0.7]}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A tiny study with every stage in the current folder: configuration, and its rules."""
    folder = copy_project(tmp_path_factory.mktemp("keys") / "project")
    make_tiny(folder)
    path = folder / "config/config.yaml"
    config = yaml.safe_load(path.read_text())
    config["methods"] = {"scanner": "HDL-64E", "calibration": ["sa3"], "other": ["sa1"]}
    config["parameter_sets"]["HDL-64E"]["set2"] = ["sa1"]
    config["figures"]["28"] = {
        "kind": "map", "scanner": "HDL-64E", "set": "set1", "sections": {"a": RANGE}
    }  # fmt: skip
    # Wide bins: fewer medians, less time.
    config["reduction"]["azimuth_bin_deg"] = {"HDL-64E": 0.9, "HDL-32E": 1.0}
    config["unsurveyed"] = {
        "samples": "config/unsurveyed_samples.tsv", "recordings": "captures", "sigma_cm": 2.0,
        "patches": {"room": {"wall": {"x_m": [-9, 9], "y_m": [-9, 9], "z_m": [-9, 9]}}},
        "search": {"planes": 3, "distance_cm": 6, "extent_m": 6, "min_points": 100,
                   "incidence_deg": 70, "seed": 1},
    }  # fmt: skip
    (folder / "config/unsurveyed_samples.tsv").write_text(UNSURVEYED)
    with (folder / "config/samples.tsv").open("a") as file:
        file.write(SECOND_POSITION + NEW_ROW)
    (folder / "captures").mkdir()
    shots = capture.spin(300, interval_us=276, status=(0x39, 0x21))
    twice = capture.as_bytes(capture.two_returns(shots))
    (folder / "captures/dual.bin").write_bytes(b"".join(twice))
    (folder / "captures/room.bin").touch()
    here = Path.cwd()
    os.chdir(folder)
    rules = Rules(folder, config)
    rules.make("results/simulation/recordings/sa5.bin")
    source = folder / "results/simulation/recordings/sa5.bin"
    (folder / "captures/room.bin").write_bytes(source.read_bytes()[: 1248 * 400])
    yield folder, config, rules
    os.chdir(here)


def outcome(rules: Rules, path: str) -> bytes | str:
    """Bytes of a file as the job of some rules writes it, or the error that ends the job."""
    try:
        rules.job_of(path).run()
    except VelocalError as error:
        return str(error)
    return Path(path).read_bytes()


#: Outputs before a change, by the changes before it and path.
BEFORE: dict[tuple[object, str], bytes | str] = {}


@pytest.mark.parametrize("key", CHANGES)
def test_a_key_changes_its_output(study, key):
    folder, config, rules = study
    asked = CHANGES[key]
    for path, value in asked.before:
        config = changed(config, path, value)
    before = Rules(folder, config) if asked.before else rules
    after = Rules(folder, changed(config, asked.path, asked.value))
    for seen in asked.seen:
        if isinstance(seen, Given):
            jobs = [each.job(seen.rule, **dict(seen.wildcards)).given() for each in (before, after)]
            assert jobs[0][seen.name] != jobs[1][seen.name]
            continue
        rules.make(seen)
        with put_aside(list(rules.job_of(seen).output)):
            if not asked.before:
                first = Path(seen).read_bytes()
            else:
                known = repr(asked.before), seen
                first = BEFORE.setdefault(known, BEFORE.get(known) or outcome(before, seen))
            assert isinstance(first, bytes), first
            assert outcome(after, seen) != first


def test_an_unchanged_configuration_changes_nothing(study):
    """What the comparison of bytes rests on: a job gives the same bytes again."""
    folder, config, rules = study
    again = Rules(folder, copy.deepcopy(config))
    for path in (MEDIANS, COVARIANCE, f"{SET}.xml", PLANES):
        rules.make(path)
        with put_aside(list(rules.job_of(path).output)):
            first = Path(path).read_bytes()
            Path(path).unlink()
            assert outcome(again, path) == first
