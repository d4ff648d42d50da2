"""The workflow on real recordings without a survey, as `make field` runs it."""

import json
from pathlib import Path

import pandas as pd
import pytest
from support.running import copy_project, snakemake

from velocal.reporting import pages

pytestmark = pytest.mark.workflow

SAMPLES = {"hdl64e_s1": "HDL-64E-S1", "hdl32e": "HDL-32E", "vlp16": "VLP-16"}


def run(folder: Path, recordings: Path, *arguments: str):
    return snakemake(
        folder, "--cores", "2", "--configfile", "config/unsurveyed.yaml",
        "--config", f"unsurveyed={{recordings: {recordings}}}", *arguments,
    )  # fmt: skip


@pytest.fixture(scope="module")
def finished(shared, tmp_path_factory) -> Path:
    folder = copy_project(tmp_path_factory.mktemp("field") / "project")
    done = run(folder, shared / "recordings")
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def results(finished) -> Path:
    return finished / "results/field-samples"


@pytest.fixture(scope="module")
def table(results) -> pd.DataFrame:
    return pd.read_csv(results / "field/table.csv")


def test_three_samples_with_planes(table):
    assert dict(zip(table["sample"], table["scanner"], strict=True)) == SAMPLES
    assert (table.groupby("sample").size() == 5).all()
    assert table["finding"].isna().all()
    assert (table["lasers"] >= 4).all()
    assert (table["points"] >= 300).all()
    assert (table["incidence_deg"] < 70).all()


@pytest.mark.parametrize("sample", ["hdl32e", "vlp16"])
def test_lasers_agree_within_the_datasheet(table, sample):
    """Nominal values are good for these two models: every plane is flat to 2 cm (1 sigma)."""
    of = table[table["sample"] == sample]
    assert (of["rms_cm"] < 2.0).all()
    assert (of["rms_cm"] > 0.3).all()
    assert (of["std_cm"] < 1.3).all()
    assert (of["std_cm"] <= of["rms_cm"]).all()
    assert (of["trimmed"] < 0.2 * of["points"]).all()


def test_the_page_has_these_numbers(finished, root):
    assert pages.different(root, finished / "results", "make field") == []


def test_walls_and_ground(table):
    tilt = table.set_index("sample")["tilt_deg"]
    assert (tilt["hdl32e"] < 5).all()  # asphalt around a high mast
    assert (tilt["vlp16"] > 85).all()  # a corridor
    assert (tilt["hdl64e_s1"] > 85).all()
    near = table[(table["sample"] == "vlp16") & (table["plane"] == "plane1")]
    assert near["range_m"].item() == pytest.approx(0.9, abs=0.1)
    assert near["spread_cm"].item() == pytest.approx(0.6, abs=0.2)


def test_missing_distance_corrections_of_the_s1(results, table):
    """Without the unit's file the lasers are centimetres apart, the same on every stretch."""
    of = table[table["sample"] == "hdl64e_s1"].set_index("plane")
    assert (of["rms_cm"] > 4.0).all()
    assert (of.loc[["bay1", "pier", "bay2"], "std_cm"] < 1.2).all()
    lasers = pd.read_csv(results / "field/hdl64e_s1/lasers.csv")
    mean = lasers.pivot(index="laser_id", columns="plane", values="mean_cm")
    assert mean["bay1"].corr(mean["bay2"]) > 0.97
    assert of["trimmed"].sum() < 0.02 * of["points"].sum()


def test_ledger_of_the_s1(results):
    facts = json.loads((results / "recordings/hdl64e_s1/ledger.json").read_text())
    ledger = facts["ledger"]
    assert ledger["data"]["packets"] == 306
    assert ledger["rejected"] == {
        "packet cut short at the end of the file": {"packets": 1, "bytes": 1192}
    }
    assert ledger["unaccounted_bytes"] == 0
    assert facts["block_counts"] == {"upper": 2754, "lower": 918}


def test_the_vlp16_is_remarked_upon(results):
    facts = json.loads((results / "recordings/vlp16/ledger.json").read_text())
    assert "0x21" in facts["remarks"][0]


def test_pictures_and_report(results):
    for sample in SAMPLES:
        for name in ("planes.svg", "planes.png", "planes.json", "lasers.csv"):
            assert (results / "field" / sample / name).stat().st_size > 1000
    text = (results / "field/table.md").read_text()
    assert text.count("\n| ") == 1 + 15
    assert "hdl64e_s1" in (results / "report.html").read_text()


def test_second_run_is_idle(finished, shared):
    done = run(finished, shared / "recordings")
    assert done.returncode == 0
    assert "Nothing to be done" in done.stdout + done.stderr


def test_missing_captures_are_one_clear_error(tmp_path):
    """As on a fresh checkout: nothing was fetched yet."""
    folder = copy_project(tmp_path / "project")
    done = snakemake(folder, "--cores", "2", "--configfile", "config/unsurveyed.yaml")
    said = done.stdout + done.stderr
    assert done.returncode == 1
    assert "no file 'data/recordings/hdl64e-s1-outdoor-wall.pcap'" in said
    assert "Hint:" in said
    assert "Traceback" not in said
    assert not (folder / "results").exists()
