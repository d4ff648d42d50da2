"""Which scanner, whether it is one, whether it turns, and whether it stands still."""

import index_recording
import numpy as np
import pytest
from support.capture import pcap, record_list, spin, write
from typer.testing import CliRunner

from velocal.cli import app
from velocal.errors import RecordingError
from velocal.packets.data import view
from velocal.recording.identify import check_scanner, identify
from velocal.recording.motion import changed_share, check_standing
from velocal.recording.recording import open_recording
from velocal.recording.scan import inspect
from velocal.scanner.models import SCANNERS

N = 800
VLP16 = {"step": 79, "interval_us": 1327, "status": (0x37, 0x22)}
HDL32E = {"step": 17, "interval_us": 553, "status": (0x37, 0x21)}


def found_in(folder, payloads):
    return inspect(write(folder, record_list(payloads, 42)))


# -- product bytes ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sent", "product", "what"),
    [
        (VLP16, 0x42, "its product byte 0x42 is unknown"),
        (HDL32E, 0x42, "its product byte 0x42 is unknown"),
        (HDL32E, 0x22, "its product byte 0x22 is that of VLP-16"),
        (VLP16, 0x28, "its product byte 0x28 is that of VLP-32C"),
        (VLP16, 0x00, "its product byte 0x00 is unknown"),
    ],
)
def test_another_product_byte_is_not_taken_for_a_known_scanner(sent, product, what, tmp_path):
    found = found_in(tmp_path, spin(N, **(sent | {"status": (0x37, product)})))
    with pytest.raises(RecordingError, match=what) as caught:
        identify(found, None, "x")
    assert "they fit" in str(caught.value)
    assert "--scanner" in str(caught.value)
    name = "VLP-16" if sent is VLP16 else "HDL-32E"
    # Whoever knows it can say so, and is told what is unusual.
    scanner, remarks = identify(found, SCANNERS[name], "x")
    assert scanner.name == name
    assert f"product byte is 0x{product:02X}" in remarks[0]


def test_an_early_vlp16_is_known(tmp_path):
    """Units of 2014 send the product byte of the HDL-32E."""
    scanner, remarks = identify(
        found_in(tmp_path, spin(N, **(VLP16 | {"status": (0x37, 0x21)}))), None, "x"
    )
    assert scanner.name == "VLP-16"
    assert "0x21" in remarks[0]
    # One packet has no timing, and the statement is believed.
    one = found_in(tmp_path, spin(1, **(VLP16 | {"status": (0x37, 0x21)})))
    assert identify(one, scanner, "x")[0] is scanner


def test_a_damaged_product_byte_is_no_other_scanner(tmp_path):
    payloads = spin(N, **VLP16)
    view(payloads)["status"][[5, 60], 1] = 0x21
    assert identify(found_in(tmp_path, payloads), None, "x")[0].name == "VLP-16"


# -- several scanners ------------------------------------------------------------------------------


def mixed(one, times, other, other_times):
    order = np.argsort(np.concatenate([times, other_times]), kind="stable")
    return np.concatenate([one, other])[order]


def vlp16_times(n=N):
    return 1327e-6 * np.arange(n)


def unequal_clocks(offset_us):
    """Two VLP-16 whose clocks differ; 0.1 s and less are within what is put in order."""
    other = spin(N, seed=3, **(VLP16 | {"start": 3000, "stamp_us": 5_000_000 + offset_us}))
    return mixed(spin(N, **VLP16), vlp16_times(), other, vlp16_times() + 6e-4)


def as_text(payloads):
    view(payloads)["timestamp"] = 0x20433134
    return payloads


MIXTURES = {
    **{f"clocks {us} us apart": (lambda us=us: unequal_clocks(us)) for us in
       (0, 700, 30_000, 60_000, 3_000_000, 1_000_000_000)},
    "two models": lambda: mixed(
        spin(N, **VLP16), vlp16_times(), spin(2 * N, **HDL32E), 553e-6 * np.arange(2 * N)
    ),
    "HDL-64E S1": lambda: mixed(
        as_text(spin(N, step=24, paired=True)), np.arange(N),
        as_text(spin(N, step=24, start=3000, paired=True, seed=1)), np.arange(N) + 0.3,
    ),
    "20 packets in turn": lambda: mixed(
        spin(N, **VLP16), np.arange(N) // 20 * 1.0,
        spin(N, seed=3, **(VLP16 | {"start": 3000, "stamp_us": 900_000_000})),
        np.arange(N) // 20 + 0.5,
    ),
}  # fmt: skip


@pytest.mark.parametrize("in_pcap", [False, True])
@pytest.mark.parametrize("name", MIXTURES)
def test_several_scanners_behind_one_address(name, in_pcap, tmp_path):
    payloads = MIXTURES[name]()
    path = write(tmp_path, pcap(payloads) if in_pcap else record_list(payloads, 42))
    for stated in (None, "VLP-16", "HDL-64E-S1"):
        with pytest.raises(RecordingError) as caught:
            _ = open_recording(path, stated).scanner
        mixture = "do not belong together" in str(caught.value)
        assert mixture or (stated and "said to come from" in str(caught.value))
    shown = CliRunner().invoke(app, ["inspect", str(path)])
    assert shown.exit_code == 0
    assert "do not belong together" in shown.stdout
    assert "unaccounted" in shown.stdout


@pytest.mark.parametrize("loss", [0.02, 0.2])
def test_loss_is_no_mixture(loss, tmp_path):
    kept = np.random.default_rng(1).random(N) >= loss
    assert identify(found_in(tmp_path, spin(N, **VLP16)[kept]), None, "x")[0].name == "VLP-16"


def test_an_impossible_rate(tmp_path):
    with pytest.raises(RecordingError, match="a rotation rate of 126 Hz is impossible"):
        identify(found_in(tmp_path, spin(N, **(VLP16 | {"step": 500}))), None, "x")


# -- the head --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("step", "how"), [(0, "stands still"), (-79, "turns backward")])
def test_a_head_that_does_not_turn_forward(step, how, tmp_path):
    found = found_in(tmp_path, spin(N, **(VLP16 | {"step": step})))
    assert (found.gaps, found.clock_jumps) == (0, ())
    _, remarks = identify(found, None, "x")
    assert remarks == [f"the head {how}: there are no rotations"]


def test_remarks_reach_those_who_decode(tmp_path):
    path = write(tmp_path, record_list(spin(N, **(VLP16 | {"status": (0x37, 0x21)})), 42))
    for command in ("decode", "points"):
        done = CliRunner().invoke(
            app, [command, str(path), "-o", str(tmp_path / f"{command}.parquet")]
        )
        assert done.exit_code == 0
        assert "product byte is 0x21" in done.stderr


# -- motion ----------------------------------------------------------------------------------------


def in_a_room(speed_m_per_s, turn_deg_per_s=0.0):
    """A VLP-16 in a room of 16 m by 12 m with vertical walls, floor and ceiling, for 1.06 s."""
    payloads = spin(N, **VLP16)
    blocks = view(payloads)["blocks"]
    t = (1327e-6 * np.arange(N))[:, None]
    azimuth = np.deg2rad(blocks["azimuth"] * 0.01 + turn_deg_per_s * t)[:, :, None]
    v = np.tile(SCANNERS["VLP-16"].vertical_rad, 2)
    x, y, z = np.sin(azimuth) * np.cos(v), np.cos(azimuth) * np.cos(v), np.sin(v)
    at = (speed_m_per_s * t)[:, :, None]
    with np.errstate(divide="ignore"):
        walls = [
            np.where(d > 0, (half - p) / d, (-half - p) / d)
            for d, half, p in ((x, 6.0, 0.0), (y, 8.0, at), (z + 0 * x, 1.5, 0.0))
        ]
    distance = np.min(np.broadcast_arrays(*walls), axis=0)
    noise = np.random.default_rng(1).normal(0, 0.01, distance.shape)
    blocks["channels"]["distance"] = np.rint((distance + noise) / 0.002)
    return payloads


@pytest.mark.parametrize(
    ("speed", "turn", "moves"),
    [(0.0, 0.0, False), (0.02, 0.0, False), (2.0, 0.0, True), (0.0, 20.0, True)],
)
def test_motion(speed, turn, moves, tmp_path):
    path = write(tmp_path, record_list(in_a_room(speed, turn), 42))
    recording = open_recording(path)
    assert bool(recording.motion_remarks()) is moves
    scanner, index = recording.scanner, recording.rotations
    assert (changed_share(path, index, scanner) > 0.2) is moves
    if not moves:
        check_standing(path, index, scanner)
        return
    with pytest.raises(RecordingError, match="the scanner moves") as caught:
        check_standing(path, index, scanner)
    assert "stands still" in str(caught.value)
    with pytest.raises(RecordingError, match="the scanner moves"):
        index_recording.main(
            recording=path, ledger=tmp_path / "ledger.json", rotations=tmp_path / "index.parquet",
            calibration=None, scanner="VLP-16", port=None, address=None, max_missing=0.05,
        )  # fmt: skip
    done = CliRunner().invoke(app, ["points", str(path), "-o", str(tmp_path / "out.ply")])
    assert "the scanner moves" in done.stderr


def test_standing_scanners_of_real_recordings(shared):
    for name in ("hdl32e-static-outdoor.pcap", "vlp16-indoor-50-rotations.pcap"):
        recording = open_recording(shared / "recordings" / name)
        assert recording.motion_remarks() == []


def test_check_scanner_refuses_mixtures_too(tmp_path):
    with pytest.raises(RecordingError, match="do not belong together"):
        check_scanner(found_in(tmp_path, unequal_clocks(0)), SCANNERS["VLP-16"], "sa1")
