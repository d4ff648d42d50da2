"""From one capture to a calibration file in two commands, as docs/field.md tells, without a survey.

The capture is simulated, but nothing that runs knows.
"""

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from support.capture import pcap_head, pcap_packet
from support.chain import study_world
from support.running import snakemake

from velocal.calibration.files import formats
from velocal.io import schemas, storage
from velocal.scanner.models import scanner_named
from velocal.simulation import capture, truth

pytestmark = pytest.mark.workflow

SCANNER, ROTATIONS = "HDL-32E", 12


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("user") / "my scanner"
    recording = folder.parent / "walls.pcap"
    stream = b"".join(capture.records(study_world(), SCANNER, "P5", "user", ROTATIONS))
    frames = [stream[at : at + 1248] for at in range(0, len(stream), 1248)]
    packets = [pcap_packet(frame, number) for number, frame in enumerate(frames)]
    recording.write_bytes(pcap_head() + b"".join(packets))
    first = subprocess.run(
        [sys.executable, "-m", "velocal.cli", "init", folder, "--scanner", SCANNER,
         "--recording", recording],
        capture_output=True, text=True,
    )  # fmt: skip
    assert first.returncode == 0, first.stderr
    second = snakemake(folder, "--cores", "2")
    assert second.returncode == 0, second.stdout + second.stderr
    return folder / "results"


def test_distances_are_nearer_to_the_truth(finished):
    """Relative to the mean of all lasers, which no recording without a survey shows."""
    true = truth.unit_truth(study_world(), SCANNER).parameters.dl
    found = formats.read_or_nominal(
        finished / f"parameter_sets/{SCANNER}/all.yaml", scanner_named(SCANNER)
    ).dl
    lasers = pd.read_csv(finished / f"calibrations/{SCANNER}/all.csv")
    seen = lasers["dl_relative_std"].notna()
    assert seen.sum() >= 16
    before, after = true[seen], (true - found)[seen]
    assert np.std(after) < 0.5 * np.std(before)
    limits = 3.0 * lasers["dl_relative_std"][seen]
    assert np.mean(np.abs(after - after.mean()) < limits) > 0.9


def test_it_is_judged_on_planes_left_out(finished):
    found = json.loads((finished / f"calibrations/{SCANNER}/all.json").read_text())
    parts = found["hold_out"]["parts"]
    assert len(parts) >= 2
    assert all(part["total"]["after_m"] < part["total"]["before_m"] for part in parts)
    assert "better" in (finished / "calibrations/verdicts.txt").read_text()


def test_one_more_plane_is_judged_beforehand(finished):
    more = pd.read_csv(finished / f"calibrations/{SCANNER}/all.more.csv")
    assert more["planes"][0] == "as it is"
    assert len(more) >= 4
    assert (more["dl_mm"][1:] < 1.1 * more["dl_mm"][0]).all()


def test_two_halves_of_the_recording_are_compared(finished):
    """The twelve rotations are divided into two windows. The lasers drift by less than 1.3 mm."""
    table = pd.read_csv(finished / f"calibrations/{SCANNER}/all.drift.csv")
    assert sorted(table["window"].unique()) == [1, 2]
    assert table["compared"].nunique() == 1
    singles = table[table["part"] == "laser"]
    assert singles["laser_id"].nunique() >= 16
    assert (singles["std_cm"] < 0.1).all()
    assert np.sqrt(np.mean(singles["change_cm"] ** 2)) < 0.13


def test_report_and_certificate_speak_of_it(finished):
    report = (finished / "report.html").read_text()
    assert f"Calibration {SCANNER}/all" in report
    assert 'class="map" data-sample="sample1"' in report
    assert "a common correction of the distances of all lasers is hardly seen" in report
    assert f"Changes of the distances of {SCANNER}/all over time" in report
    certificate = json.loads((finished / "certificate.json").read_text())["certificates"][0]
    assert certificate["recordings"][0]["position"] == ""
    assert not [file for file in certificate["files"] if "survey" in file["role"]]


def test_the_returns_of_a_cloud_are_those_of_its_packets(finished):
    """`velocal points`, and a study of the cloud up to its returns."""
    folder, capture_file = finished.parents[1] / "cloud", finished.parents[1] / "walls.pcap"
    cloud = folder.parent / "walls.pcd"
    for command in (
        ["points", capture_file, "-o", cloud, "--scanner", SCANNER],
        ["init", folder, "--scanner", SCANNER, "--recording", cloud, "--dialect", "paper"],
    ):  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-m", "velocal.cli", *command], capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
    done = snakemake(folder, "--cores", "2", "results/medians/sample1/all.parquet")
    assert done.returncode == 0, done.stdout + done.stderr
    found, expected = (
        storage.read_table(place / "medians/sample1/all.parquet", schemas.MEDIANS)[0]
        for place in (folder / "results", finished)
    )
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)
    ledger = json.loads((folder / "results/recordings/sample1/ledger.json").read_text())
    assert ledger["points_used"] == ledger["points"] > 100_000
    assert ledger["ledger"]["unaccounted_bytes"] == 0
