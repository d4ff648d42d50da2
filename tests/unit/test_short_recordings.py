"""Recordings of less than two rotations, and recordings without a clock."""

import json

import index_recording
import numpy as np
import pytest
import reduce_recording
from support.capture import record_list, scan, spin, write
from typer.testing import CliRunner

from velocal.cli import app
from velocal.errors import RecordingError
from velocal.io import schemas, storage
from velocal.packets.data import view
from velocal.points.stream import stream_points
from velocal.recording.identify import check_scanner
from velocal.recording.recording import open_recording
from velocal.recording.scan import inspect
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal

SENT = {
    "HDL-64E": {"step": 17, "interval_us": 288, "banks": 2},
    "HDL-32E": {"step": 17, "interval_us": 553},
    "VLP-16": {"step": 40, "interval_us": 1327, "status": (0x37, 0x22)},
}


def sent_by(name, rotations, **changes):
    """Payloads of a scanner that turns at about 10 Hz."""
    settings = SENT[name] | changes
    step = settings["step"] * 12 / settings.get("banks", 1)
    return spin(int(np.ceil(rotations * 36_000 / step)), **settings)


def points_of(path, scanner, rotations="all"):
    recording = open_recording(path, scanner)
    parts = list(stream_points(recording, nominal(SCANNERS[scanner]), rotations))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@pytest.mark.parametrize("rotations", [0.1, 0.7, 1.5])
@pytest.mark.parametrize("name", SENT)
def test_points_do_not_depend_on_the_length(name, rotations, tmp_path):
    """Azimuths are interpolated at the rate of the head, which a part of a rotation tells."""
    long = sent_by(name, 6)
    short = long[: len(sent_by(name, rotations))]
    whole = points_of(write(tmp_path, record_list(long, 42), "long"), name)
    part = points_of(write(tmp_path, record_list(short, 42), "short"), name)
    for axis in "xyz":
        np.testing.assert_allclose(part[axis], whole[axis][: len(part[axis])], rtol=0, atol=2e-3)
    np.testing.assert_allclose(part["time"], whole["time"][: len(part["time"])], atol=1e-6)


@pytest.mark.parametrize("rotations", [0.7, 1.5])
@pytest.mark.parametrize("name", SENT)
def test_commands(name, rotations, tmp_path):
    path = write(tmp_path, record_list(sent_by(name, rotations), 42))
    expected = SENT[name]["step"] * 12 / SENT[name].get("banks", 1) / 36_000
    expected /= SENT[name]["interval_us"] * 1e-6
    shown = CliRunner().invoke(app, ["inspect", str(path), "--json"])
    assert shown.exit_code == 0
    assert json.loads(shown.stdout)["rotation_rate_hz"] == pytest.approx(expected, rel=1e-3)
    told = CliRunner().invoke(app, ["inspect", str(path)])
    assert "nan" not in told.stdout
    for command in (["decode"], ["points"]):
        out = tmp_path / f"{command[0]}.parquet"
        done = CliRunner().invoke(app, [*command, str(path), "-o", str(out)])
        assert done.exit_code == 0, done.output
    _, facts = storage.read_table(tmp_path / "decode.parquet", schemas.RETURNS)
    assert facts["rotation_rate_hz"] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("rotations", [0.02, 0.7, 1.5])
@pytest.mark.parametrize("name", SENT)
def test_scripts_of_a_study_without_a_survey(name, rotations, tmp_path):
    path = write(tmp_path, record_list(sent_by(name, rotations), 42))
    index, returns, medians = (tmp_path / f"{k}.parquet" for k in ("index", "returns", "medians"))
    of = {"scanner": name, "port": None, "address": None}
    index_recording.main(
        recording=path, ledger=tmp_path / "ledger.json", rotations=index, calibration=None,
        max_missing=0.05, **of,
    )  # fmt: skip
    window = {
        "recording": path, "rotations": index, "returns": returns, "medians": medians,
        "window": "all", "length": None, "which": "strongest", "azimuth_bin_ticks": 20, **of,
    }  # fmt: skip
    with pytest.raises(RecordingError, match="no azimuth bin of a laser has 99 returns"):
        reduce_recording.main(**window, min_count=99)
    assert not medians.exists()
    reduce_recording.main(**window, min_count=1)
    columns, facts = storage.read_table(medians, schemas.MEDIANS)
    assert len(columns["distance"]) > 0
    assert facts["rotation_rate_hz"] > 5.0


def test_without_a_clock_the_scanner_tells_the_rate(tmp_path):
    """Bare records of an HDL-64E S1: text where others send a time stamp."""
    payloads = sent_by("HDL-64E", 3)
    view(payloads)["timestamp"] = 0x20433134
    recording = open_recording(write(tmp_path, record_list(payloads, 0)), "HDL-64E-S1")
    expected = 17 * 6 / 36_000 * 2500.0
    assert recording.returns("all").rotation_rate_hz == pytest.approx(expected, rel=1e-9)
    told = {fact.label: fact.text for fact in recording.scan().facts(recording.scanner)}
    assert told["rotation rate"].startswith("7.083 Hz, from the azimuth step")
    assert told["packet rate"] == "unknown"
    assert told["duration"] == "unknown: there is no clock"


def test_the_firing_cycle_of_the_recording_is_used(tmp_path):
    """As of a VLS-128 with later firmware: 55.3 us where 53.3 us are nominal."""
    payloads = spin(400, step=20, interval_us=166, banks=4, status=(0x37, 0xA1))
    path = write(tmp_path, record_list(payloads, 42))
    inspection = inspect(path)
    (remark,) = check_scanner(inspection, SCANNERS["VLS-128"], "x")
    assert "the firing cycle is 55.3 us, which is used" in remark
    time_s = points_of(path, "VLS-128", [1])["time"]
    packets = np.unique(np.round(time_s - time_s.min(), 7))
    # Firings of a packet are a third of the time between packets apart.
    firing = packets[(packets > 54e-6) & (packets < 57e-6)]
    assert firing.min() == pytest.approx(166e-6 / 3, abs=2e-7)


def test_a_real_recording(shared, tmp_path):
    payloads = scan(shared / "recordings" / "hdl32e-static-outdoor.pcap")[0]
    whole = points_of(write(tmp_path, record_list(payloads, 42), "all"), "HDL-32E")
    part = points_of(write(tmp_path, record_list(payloads[:120], 42), "short"), "HDL-32E")
    n = len(part["x"])
    apart = sum((part[axis] - whole[axis][:n]) ** 2 for axis in "xyz") ** 0.5
    assert n > 10_000
    assert apart.max() < 2e-3
