"""Status bytes against velodyne-decoder, and those of real recordings."""

from datetime import UTC, datetime

import numpy as np
import pytest
from support.chain import study_world

from velocal.packets.data import BLOCKS, CHANNELS, encode
from velocal.packets.status import TABLE_PACKETS, StatusReader
from velocal.recording.scan import inspect
from velocal.scanner.parameters import PARAMETERS
from velocal.simulation.status import encode_table, status_bytes, table_packets
from velocal.simulation.truth import factory_parameters

hdl64e = pytest.importorskip("velodyne_decoder.hdl64e")

#: Its names and units.
NAMES = {
    "v": ("Vertical Correction", np.deg2rad),
    "alpha": ("Rotational Correction", np.deg2rad),
    "dl": ("Far Distance Correction", np.asarray),
    "voff": ("Vertical Offset Correction", np.asarray),
    "hoff": ("Horizontal Offset Correction", np.asarray),
    "dist_correction_x": ("Distance Correction X", np.asarray),
    "dist_correction_y": ("Distance Correction Y", np.asarray),
    "focal_distance": ("Focal Distance", np.asarray),
    "focal_slope": ("Focal Slope", np.asarray),
    "min_intensity": ("Min Intensity", np.asarray),
    "max_intensity": ("Max Intensity", np.asarray),
}


@pytest.mark.parametrize("series", ["S2", "S3"])
def test_velodyne_decoder_reads_the_same(series):
    """It finds the table that we send, its check right, and in it what we find."""
    factory = factory_parameters(study_world(), "HDL-64E")
    number = 1234 + np.arange(2 * TABLE_PACKETS)
    time_us = 288 * np.arange(len(number), dtype=np.int64)
    table = table_packets(encode_table(factory, series=series), series)
    status = status_bytes(table, number, time_us, np.full(len(number), 51.0))
    blocks = np.zeros((len(number), BLOCKS), np.uint16)
    channels = np.zeros((len(number), BLOCKS, CHANNELS), np.uint8)
    payloads = encode(blocks, blocks, channels, channels, time_us.astype(np.uint32), status)
    theirs = hdl64e.read_status_info(bytes(payload) for payload in payloads)
    reader = StatusReader()
    reader.consume(payloads[:, -6:])
    ours = reader.result()
    assert theirs["Model"] == ours.series == series
    assert theirs["Temperature"] == 51 == ours.temperature_deg_c[0]
    assert theirs["Current Time"].replace(tzinfo=UTC, second=0) == ours.gps_time.replace(second=0)
    assert theirs["Calibration Time"] == datetime.fromisoformat(ours.unit.calibrated)
    assert (theirs["RPM"], theirs["FOV Max"]) == (600, 36000) == (ours.unit.rpm, 36000)
    assert theirs["IP Source"] == ours.unit.source == "192.168.1.201"
    parameters = ours.calibration("x")
    columns = {name: getattr(parameters, name) for name in PARAMETERS} | parameters.carried
    assert set(columns) == set(NAMES)
    for name, (key, unit) in NAMES.items():
        expected = unit([laser[key] for laser in theirs["Calibration"]])
        np.testing.assert_allclose(columns[name], expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("file", "kind", "temperature", "firmware"),
    [
        # Two messages by turns: 32 deg C ("O DegC", "Q DegC") and version "v25c".
        ("hdl64e-s1-outdoor-wall.pcap", "text", (32.0, 32.0), "v25c"),
        ("hdl32e-static-outdoor.pcap", "none", None, None),
        ("vlp16-indoor-50-rotations.pcap", "none", None, None),
    ],
)
def test_real_recordings(shared, file, kind, temperature, firmware):
    found = inspect(shared / "recordings" / file).status
    assert (found.kind, found.temperature_deg_c, found.firmware) == (kind, temperature, firmware)
    assert (found.gps, found.gps_time, found.parameters) == (None, None, None)
    assert found.packets == {"text": 306}.get(kind, found.packets)
