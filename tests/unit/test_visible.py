"""Text from files and devices is shown as it is, and never acts on a terminal or a figure."""

import json
import os
import unicodedata

import pytest
from matplotlib.figure import Figure
from support.capture import pcap, spin, write
from support.containers import write_ros1
from typer.testing import CliRunner

from velocal.calibration.files import formats
from velocal.cli import main
from velocal.cli.common import escape
from velocal.errors import VelocalError, hidden, visible
from velocal.reporting.style import save
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal

ESCAPES = {
    "escape sequence": "\x1b[2J\x1b[31m",
    "title of the terminal": "\x1b]0;gone\x07",
    "C1 control": "\x9b31m",
    "carriage return": "fine\rError",
    "new line": "fine\nHint: run this",
    "bidirectional": "\u202egnp.exe\u2066",
    "invisible": "wa\u200bll\u2060\ufeff",
    "line separator": "a\u2028b",
    "no UTF-8": "\udcff",
    "markup": "[red]wall[/red] \\[bold]x",
}


@pytest.mark.parametrize("text", ESCAPES.values(), ids=ESCAPES.keys())
def test_nothing_acts(text):
    from rich.console import Console

    shown = visible(text)
    assert hidden(shown) is None
    shown.encode("utf-8")
    assert visible(shown) == shown
    if hidden(text) is None:
        assert shown == text
    else:
        assert hidden(text) == f"U+{ord(next(c for c in text if not c.isprintable())):04X}"
    console = Console(width=200, color_system="truecolor", force_terminal=True, highlight=False)
    with console.capture() as printed:
        console.print(escape(text))
    assert printed.get() == shown + "\n"


def test_visible_text_stays():
    text = "Wand 3 (größer) – стена № 5, 壁 $x^2$ <b>&amp;"
    assert visible(text) is text
    assert all(unicodedata.category(one) != "Cf" for one in text)


def test_messages_are_visible():
    error = VelocalError("\x1b[31m", where="a\u202eb", allowed="\x07", hint="x\x00")
    assert str(error) == "a\\u202eb: \\x1b[31m (allowed: \\x07)\nHint: x\\x00"


def run(capsys, *arguments):
    """What a command writes, and its code."""
    import sys
    from unittest.mock import patch

    with patch.object(sys, "argv", ["velocal", *map(str, arguments)]), pytest.raises(SystemExit):
        main()
    done = capsys.readouterr()
    return done.out + done.err


def test_names_of_files(tmp_path, capsys):
    name = "a\x1b[31m\n[bold]\u202e.pcap"
    path = write(tmp_path, pcap(spin(200)), name)
    for arguments in (["inspect", path], ["decode", path, "-o", tmp_path / "\x1b[2J.parquet"],
                      ["inspect", tmp_path / "\x1b]0;x\x07"], ["calibration", "lint", path],
                      ["inspect", path, "--scanner", "\x1b[2J"]):  # fmt: skip
        said = run(capsys, *arguments)
        assert said
        assert hidden(said.replace("\n", "")) is None, said


@pytest.mark.skipif(os.name != "posix", reason="names of files are text elsewhere")
def test_a_name_that_is_no_utf8(tmp_path, capsys):
    path = os.fsencode(tmp_path) + b"/a\xff.pcap"
    said = run(capsys, "inspect", os.fsdecode(path))
    assert "a\\udcff.pcap" in said


def test_topics(tmp_path, capsys):
    topic = "/points\x1b[31m\u202e"
    payloads = [bytes(row) for row in spin(60)]
    bag = write_ros1(tmp_path / "two.bag", {topic: payloads, "/[bold]b": payloads})
    said = run(capsys, "inspect", bag)
    assert "[bold]b" in said
    assert "\\x1b[31m\\u202e" in said
    assert hidden(said.replace("\n", "")) is None


def test_nmea(tmp_path):
    from velocal.cli.recordings import _print_facts
    from velocal.recording.recording import open_recording

    recording = open_recording(write(tmp_path, pcap(spin(200))), "HDL-32E")
    inspection = recording.scan()
    inspection.ledger.nmea = "$GPRMC,\x1b[2J[red]\x07"
    runner = CliRunner()
    with runner.isolation() as (out, *_):
        _print_facts(inspection, recording.scanner, ["\x1b[31m"])
        said = out.getvalue().decode()
    assert "$GPRMC,\\x1b[2J[red]\\x07" in said
    assert "\\x1b[31m" in said
    assert "\x1b" not in said


def test_a_calibration_that_carries_texts(tmp_path, capsys):
    path = tmp_path / "a.json"
    formats.write(path, nominal(SCANNERS["VLP-16"]))
    content = json.loads(path.read_text())
    content["provenance"] = {"by\x1b[31m": "[bold]\u202e"}
    path.write_text(json.dumps(content))
    said = run(capsys, "calibration", "show", path)
    assert "by\\x1b[31m" in said
    assert hidden(said.replace("\n", "")) is None


def test_figures_show_a_dollar(tmp_path):
    figure = Figure()
    ax = figure.add_subplot()
    ax.plot([1, 10], [1, 10])
    ax.set_xscale("log")
    ax.set_title(r"wall $\frac{ \x" + "\x1b\u202e")
    save(figure, tmp_path / "a.svg", tmp_path / "a.png")
    text = (tmp_path / "a.svg").read_text()
    assert hidden(text.replace("\n", "")) is None
    assert "wall $\\frac{ \\x\\x1b\\u202e" in text  # the comment that names the text
