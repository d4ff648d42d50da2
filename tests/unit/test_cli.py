"""The command line as a user meets it."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from support.capture import as_bytes, record_list, spin, two_returns, write
from support.chain import study_world
from support.containers import ethernet, ip_packet, pcap_of

from velocal.calibration.files import formats
from velocal.cli import EXIT_CODES
from velocal.io import schemas, storage
from velocal.packets.data import view
from velocal.packets.status import TABLE_PACKETS
from velocal.scanner import parameters
from velocal.scanner.models import SCANNERS
from velocal.simulation import capture
from velocal.simulation.status import encode_table, status_bytes, table_packets


def velocal(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "velocal.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        env={
            "PATH": "",
            "COLUMNS": "100",
            "NO_COLOR": "1",
            "PYTHONPATH": os.environ.get("PYTHONPATH", ""),
        },
    )


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("cli") / "x.bin"
    path.write_bytes(b"".join(capture.records(study_world(), "HDL-32E", "P5", "x", 3)) + b"tail")
    return path


def test_inspect(recording):
    done = velocal("inspect", recording)
    assert done.returncode == 0, done.stderr
    for part in ("HDL-32E", "records of 1248 bytes", "cut short", "embedded calibration"):
        assert part in done.stdout
    facts = json.loads(velocal("inspect", "--json", recording).stdout)
    assert facts["scanner"] == "HDL-32E"
    assert facts["ledger"]["unaccounted_bytes"] == 0
    assert facts["ledger"]["rejected"]["record cut short at the end of the file"]["bytes"] == 4


def test_decode(recording, tmp_path):
    out = tmp_path / "returns.parquet"
    done = velocal("decode", recording, "-o", out, "--window", "beginning", "--rotations", 1)
    assert done.returncode == 0, done.stderr
    columns, facts = storage.read_table(out, schemas.RETURNS)
    assert facts["scanner"] == "HDL-32E"
    assert set(columns["rotation"]) == {1}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["inspect", "nowhere.bin"], "nowhere.bin: cannot be read"),
        (["decode", "{r}", "-o", "{t}/x.parquet", "--scanner", "HDL-65"], "allowed: HDL-64E"),
        (["decode", "{r}", "-o", "{t}/x.parquet", "--scanner", "HDL-64E"], "Hint: Correct"),
        (["decode", "{r}", "-o", "{t}/x.parquet", "--window", "dusk"], "allowed: all, beginning"),
        (["decode", "{r}", "-o", "{t}/x.parquet", "--window", "end"], "too few"),
        (["decode", "{r}", "-o", "{t}/x.parquet", "--return", "first"], "allowed: both, strongest"),
        (["decode", "{r}", "-o", "{t}/x.parquet", "--port", "9"], "no data packets to port 9"),
        (["inspect", "{r}", "--address", "localhost"], "is not an IP address"),
    ],
)
def test_wrong_calls(recording, tmp_path, arguments, message):
    done = velocal(*(a.format(r=recording, t=tmp_path) for a in arguments))
    assert done.returncode == 1
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def streaming(tmp_path_factory):
    """Packets of an HDL-64E S2 that sends its calibration twice."""
    number, factory = np.arange(2 * TABLE_PACKETS), parameters.nominal(SCANNERS["HDL-64E"])
    payloads = spin(len(number), start=9, step=18, interval_us=288, paired=True)
    stamps = view(payloads)["timestamp"].astype(np.int64)
    table = table_packets(encode_table(factory))
    view(payloads)["status"] = status_bytes(table, number, stamps, np.full(len(number), 46.0))
    return write(tmp_path_factory.mktemp("stream"), record_list(payloads, 0))


def test_inspect_tells_the_status(streaming):
    told = " ".join(velocal("inspect", streaming).stdout.split())
    for part in (
        "temperature 46 deg C",
        "firmware 4.07",
        "GPS time 2014-06-12 09:00:05 (GPS: not connected, clock runs free)",
        "embedded calibration complete, S2, 2 equal tables",
    ):
        assert part in told
    facts = json.loads(velocal("inspect", "--json", streaming).stdout)
    assert facts["calibration_in_stream"] is True
    assert facts["status"]["unit"]["rpm"] == 600


@pytest.mark.parametrize("suffix", ["xml", "yaml", "csv"])
def test_calibration_from_recording(streaming, tmp_path, suffix):
    out = tmp_path / f"factory.{suffix}"
    done = velocal("calibration", "from-recording", streaming, "-o", out)
    assert done.returncode == 0, done.stderr
    assert "2 equal tables" in done.stdout
    design, found = parameters.nominal(SCANNERS["HDL-64E"]), formats.read(out, 64)
    np.testing.assert_allclose(found.v, design.v, atol=np.deg2rad(0.005) * (1 + 1e-9))
    np.testing.assert_allclose(found.hoff, design.hoff, atol=1e-12)


def test_no_calibration_in_the_recording(recording, tmp_path):
    done = velocal("calibration", "from-recording", recording, "-o", tmp_path / "x.xml")
    assert done.returncode == 1
    assert "no usable calibration table" in done.stderr
    assert "Hint:" in done.stderr
    assert not list(tmp_path.iterdir())


def test_several_scanners(tmp_path):
    frames = [
        ethernet(ip_packet(payload, port=port))
        for pair in zip(as_bytes(spin(90)), as_bytes(two_returns(spin(90, seed=2))), strict=True)
        for port, payload in zip((2368, 2370), pair, strict=True)
    ]
    path = write(tmp_path, pcap_of(frames), "two.pcap")
    done = velocal("inspect", path)
    assert done.returncode == 1
    assert "two.pcap: holds data packets of 2 scanners" in done.stderr
    assert "192.168.1.201:2368, 90 packets; 192.168.1.201:2370, 90 packets" in done.stderr
    assert "Hint: Choose one by its port or its address (--port, --address)." in done.stderr
    facts = json.loads(velocal("inspect", path, "--port", 2370, "--json").stdout)
    assert facts["returns"] == "dual"
    assert facts["ledger"]["senders"] == {"192.168.1.201:2368": 90, "192.168.1.201:2370": 90}
    assert facts["ledger"]["unaccounted_bytes"] == 0


def test_one_of_two_returns(tmp_path):
    interval = round(1e6 / SCANNERS["HDL-32E"].dual_packet_rate_hz)
    payloads = two_returns(spin(90, interval_us=interval, status=(0x39, 0x21)))
    path = write(tmp_path, record_list(payloads, 0))
    assert "dual" in velocal("inspect", path).stdout
    columns = {}
    for returns in ("both", "strongest", "last"):
        out = tmp_path / f"{returns}.parquet"
        done = velocal("decode", path, "-o", out, "--return", returns)
        assert done.returncode == 0, done.stderr
        columns[returns], _ = storage.read_table(out, schemas.RETURNS)
    assert set(columns["both"]["return"]) == {1, 2}
    assert set(columns["last"]["return"]) == {2}
    assert len(columns["both"]["distance"]) == 2 * len(columns["last"]["distance"])
    assert len(columns["strongest"]["distance"]) == 90 * 6 * 32


@pytest.mark.parametrize("code", [129, 130, 143])
def test_a_signal_ends_a_command_with_its_exit_code(code, tmp_path):
    fifo = tmp_path / "x.mcap"
    script = (
        "import os, signal, time; from velocal.cli import points, main; import sys;"
        f"points.scanned = lambda *_: os.kill(os.getpid(), {code} - 128) or time.sleep(60);"
        f"sys.argv = ['velocal', 'points', 'x', '-o', {str(fifo)!r}]; main()"
    )
    environment = {"PYTHONPATH": os.environ.get("PYTHONPATH", ""), "PATH": ""}
    # The handler of SIGINT that a terminal gives: a job in the background may ignore it.
    started = f"import signal; signal.signal(signal.SIGINT, signal.default_int_handler); {script}"
    done = subprocess.run([sys.executable, "-c", started], capture_output=True, env=environment)
    assert done.returncode == code
    assert code in EXIT_CODES
    assert not list(tmp_path.iterdir())


def test_exit_codes_are_documented(root):
    rows = re.findall(r"^\| (\d+) \| (.*) \|$", (root / "docs/how-to.md").read_text(), re.M)
    assert {int(code): text for code, text in rows} == EXIT_CODES


def test_shells_complete_commands():
    environment = {
        "_VELOCAL_COMPLETE": "complete_bash", "COMP_WORDS": "velocal calib", "COMP_CWORD": "1",
        "PYTHONPATH": os.environ.get("PYTHONPATH", ""), "PATH": "",
    }  # fmt: skip
    script = "import sys; sys.argv = ['velocal']; from velocal.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment
    )
    assert done.stdout.split() == ["calibration"]


def test_help_and_version():
    assert "inspect" in velocal("--help").stdout
    told = velocal("--version").stdout
    assert told.startswith("velocal ")
    assert re.search(r"^commit (unknown|[0-9a-f]{40}(-dirty)?)$", told, re.M)
    assert all(f"\n{name} " in told for name in ("python", "numpy", "pandas", "snakemake"))
    bare = velocal("calibration")
    assert (bare.returncode, bare.stderr) == (2, "")
    assert "from-recording" in bare.stdout


@pytest.mark.parametrize(
    ("arguments", "message", "command"),
    [
        (["inspect"], "Missing argument 'FILE'.", "velocal inspect"),
        (["inspect", "--nope"], "No such option: --nope", "velocal inspect"),
        (["calibration", "shwo"], "No such command 'shwo'.", "velocal calibration"),
        (
            ["decode", "x", "--rotations", "many"],
            "Invalid value for '--rotations'",
            "velocal decode",
        ),
    ],
)
def test_calls_that_no_command_takes(arguments, message, command):
    done = velocal(*arguments)
    assert (done.returncode, done.stdout) == (2, "")
    error, hint = done.stderr.splitlines()
    assert error.startswith("Error: ")
    assert message in error
    # Run as a module the program has another name.
    assert hint.replace("python -m velocal.cli", "velocal") == (
        f"Hint: `{command} --help` shows what is possible."
    )
