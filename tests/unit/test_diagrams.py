"""Drawings of packet, frame, residual, flow and procedure: what they show is what the code does."""

import draw_diagram
import numpy as np
import pandas as pd
import pytest
from support.results import TABLES

from velocal.packets.data import BLOCKS, CHANNELS, encode
from velocal.reporting.captions import caption
from velocal.reporting.figures import beam_geometry, flow, packet
from velocal.scanner.models import SCANNERS
from velocal.study.figures import FlowFigure, FrameFigure, PacketFigure, ResidualFigure

DIAGRAMS = [
    {"kind": "packet", "scanner": "HDL-64E"},
    {"kind": "frame", "scanner": "VLP-16"},
    {"kind": "residual"},
    {"kind": "flow"},
]


def test_every_field_lies_where_the_table_says():
    """Bytes of an encoded packet, read by the offsets and sizes of the table alone."""
    random = np.random.default_rng(3)
    values = {
        "flag": random.integers(0, 2**16, (1, BLOCKS)),
        "azimuth": random.integers(0, 36000, (1, BLOCKS)),
        "distance": random.integers(0, 2**16, (1, BLOCKS, CHANNELS)),
        "intensity": random.integers(0, 2**8, (1, BLOCKS, CHANNELS)),
    }
    end = {"timestamp": np.array([123456789]), "status": np.array([[7, 9]])}
    payload = bytes(encode(**values, **end)[0])
    table = packet.packet_table(packet.packet_fields(SCANNERS["HDL-64E"]))
    rows = {(row.part, row.field): row for row in table.itertuples()}

    def number(start, row):
        begin = start + row.offset_bytes
        return int.from_bytes(payload[begin : begin + row.bytes], "little")

    blocks, channels = rows["payload", "blocks"], rows["block", "channels"]
    assert (blocks.repeats, channels.repeats) == (BLOCKS, CHANNELS)
    for block in range(blocks.repeats):
        start = blocks.offset_bytes + block * blocks.bytes
        for name in ("flag", "azimuth"):
            assert number(start, rows["block", name]) == values[name][0, block]
        for channel in range(channels.repeats):
            inside = start + channels.offset_bytes + channel * channels.bytes
            for name in ("distance", "intensity"):
                assert number(inside, rows["channel", name]) == values[name][0, block, channel]
    assert number(0, rows["payload", "timestamp"]) == 123456789
    assert number(0, rows["payload", "status"]) == 7 + 256 * 9
    assert rows["record", "payload"].offset_bytes + rows["record", "payload"].bytes == 1248


@pytest.mark.parametrize("name", SCANNERS)
def test_flags_are_those_of_the_scanner(name):
    scanner = SCANNERS[name]
    fields = {each.name: each for each in packet.packet_fields(scanner)}
    assert fields["flag"].content.count("lasers") == len(scanner.flags)
    assert fields["flag"].content.startswith("FF EE lasers 1-")
    assert fields["flag"].content.endswith(f"-{scanner.n_lasers}")
    packet.draw_packet(packet.packet_fields(scanner), scanner)


def test_the_drawn_point_fulfils_the_printed_equations():
    """Equations (1) and (2), written out."""
    table = beam_geometry.frame_table(FrameFigure(kind="frame", scanner="HDL-64E"))
    rows = table.set_index(["panel", "name"])
    theta, v = (np.deg2rad(rows.loc[key, "value"]) for key in (("above", "theta"), ("side", "v")))
    phi, alpha = (np.deg2rad(rows.loc[("above", name), "value"]) for name in ("phi", "alpha"))
    np.testing.assert_allclose(theta, phi - alpha, atol=1e-5)
    origin = rows.loc[("above", "beam origin"), ["x", "y"]].to_numpy(dtype=float)
    point = rows.loc[("above", "point"), ["x", "y"]].to_numpy(dtype=float)
    flat, up = rows.loc[("side", "point"), ["x", "y"]]
    voff = rows.loc[("side", "beam origin"), "y"]
    hoff = np.hypot(*origin)
    length = flat / np.cos(v)
    expected = [
        flat * np.sin(theta) - hoff * np.cos(theta), flat * np.cos(theta) + hoff * np.sin(theta)
    ]  # fmt: skip
    np.testing.assert_allclose(point, expected, atol=2e-4)
    np.testing.assert_allclose(up, length * np.sin(v) + voff, atol=2e-4)


def test_lasers_are_those_of_the_scanner():
    table = beam_geometry.frame_table(FrameFigure(kind="frame", scanner="HDL-64E"))
    lasers = table[table["kind"] == "laser"]
    scanner = SCANNERS["HDL-64E"]
    np.testing.assert_allclose(lasers["y"], np.rad2deg(scanner.vertical_rad), atol=1e-4)
    np.testing.assert_allclose(lasers["x"], np.rad2deg(scanner.rotational_rad), atol=1e-4)
    assert list(lasers["value"]) == [1.0] * 32 + [2.0] * 32


def test_the_drawn_residual_is_that_of_the_paper():
    rows = beam_geometry.residual_table().set_index("name")
    point, hit, foot, first, second = (
        rows.loc[name, ["x", "y"]].to_numpy(dtype=float)
        for name in ("point", "on the plane", "foot", "end 1", "end 2")
    )
    along = (second - first) / np.linalg.norm(second - first)
    for on_wall in (hit, foot):
        across = on_wall - first
        np.testing.assert_allclose(across[0] * along[1] - across[1] * along[0], 0.0, atol=2e-4)
    np.testing.assert_allclose((point - foot) @ along, 0.0, atol=2e-4)
    s, of_paper, distance = (rows.loc[name, "value"] for name in ("s", "s of the paper", "D"))
    np.testing.assert_allclose(np.linalg.norm(point - hit), s, atol=2e-4)
    np.testing.assert_allclose(np.linalg.norm(point - foot), distance, atol=2e-4)
    np.testing.assert_allclose(of_paper, s, atol=2e-4)
    assert rows.loc["beta", "value"] == rows.loc["theta", "value"] - rows.loc["omega", "value"]


def test_boxes_of_the_flow_do_not_overlap():
    places = [(each.column, each.row) for each in flow.STEPS]
    assert len(set(places)) == len(places)
    names = [each.rule for each in flow.STEPS]
    for each in flow.STEPS:
        for needed in (*each.needs, *each.also):
            assert names.index(needed) < names.index(each.rule)
        assert all(name in flow.SHORT for name in each.also)


SAMPLES = [("sa3", "HDL-64E", "P2"), ("sa4", "HDL-64E", "P2"), ("sa5", "HDL-32E", "P5")]
SETS = {"HDL-64E": {"set1": ["sa3"]}, "HDL-32E": {"set1": ["sa5"]}}


def test_procedure_tells_calibration_from_validation():
    used = [flow.UsedSample(*each) for each in SAMPLES]
    table = flow.procedure_table(used, SETS, TABLES)
    uses = {(row.sample, row.column.split("\n")[0]): row.use for row in table.itertuples()}
    assert uses["sa3", "set1"] == flow.AVERAGED
    assert uses["sa4", "set1"] == flow.VALIDATED
    assert uses["sa3", "Table II"] == flow.MEDIANS
    assert uses["sa3", "Table IV"] == flow.SCANS
    # A set is not validated on samples of another scanner.
    assert len(table[table["sample"] == "sa5"]) == 3


def draw(folder, selection):
    files = {suffix: folder / f"f.{suffix}" for suffix in ("svg", "png", "csv")}
    samples, scanners, positions = map(list, zip(*SAMPLES, strict=True))
    draw_diagram.main(
        **files, selection=selection, samples=samples, scanners=scanners, positions=positions,
        parameter_sets=SETS, tables=TABLES, simulated=True,
    )  # fmt: skip
    return files


@pytest.mark.parametrize("chosen", DIAGRAMS, ids=lambda each: each["kind"])
def test_script(tmp_path, chosen):
    files = draw(tmp_path, chosen)
    assert all(path.stat().st_size > 0 for path in files.values())
    assert len(pd.read_csv(files["csv"])) > 5


def test_procedure_script(tmp_path):
    files = draw(tmp_path, {"kind": "procedure"})
    assert set(pd.read_csv(files["csv"])["sample"]) == {"sa3", "sa4", "sa5"}
    assert all(path.stat().st_size > 0 for path in files.values())


def test_captions_of_drawings():
    for selection in (
        PacketFigure(kind="packet", scanner="VLP-16"),
        FrameFigure(kind="frame", scanner="VLP-16"),
    ):
        assert "VLP-16" in caption(selection, pd.DataFrame())
    assert "equation" not in caption(FlowFigure(kind="flow"), pd.DataFrame())
    assert "Table I" in caption(ResidualFigure(kind="residual"), pd.DataFrame())
