"""Outputs never destroy: complete or absent, no input and no device replaced, faults are told.

The cases stand in tables with a short description each.
"""

import errno
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from support.capture import as_bytes, record_list, spin
from support.running import small_disk
from typer.testing import CliRunner

from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.cli import app
from velocal.errors import OutputError
from velocal.io import output, schemas, storage
from velocal.io.output import PART, check_outputs, new_file, stopped_cleanly
from velocal.io.scripts import run
from velocal.points.files import FORMATS, cloud_writer, fields
from velocal.scanner import parameters
from velocal.scanner.models import SCANNERS

ROWS = 3000


def medians():
    return {
        "laser_id": np.arange(ROWS).astype(np.uint8),
        "azimuth": np.arange(ROWS, dtype=np.float32),
        "distance": np.arange(ROWS, dtype=np.float32),
        "spread": np.arange(ROWS, dtype=np.float32),
        "count": np.arange(ROWS).astype(np.uint16),
    }


def write_points(path):
    columns = {name: np.arange(ROWS) % 16 for name in fields(shift=True)}
    kinds = {field.name: field.type.to_pandas_dtype() for field in schemas.POINTS}
    with cloud_writer(path, shift=True, facts={"scanner": "VLP-16"}) as write:
        write({name: values.astype(kinds[name]) for name, values in columns.items()})


def write_picture(path):
    from matplotlib.figure import Figure

    from velocal.reporting.style import save

    figure = Figure()
    figure.subplots().plot(np.arange(9))
    save(figure, path.with_suffix(".svg"), path.with_suffix(".png"))


def write_calibration(path):
    dialect = "paper" if path.suffix in (".csv", ".json") else None
    nominal = parameters.nominal(SCANNERS["VLP-16"])
    formats.write(path, CalibrationFile(nominal, dialect=dialect))


#: Every kind of file that is written, and its writer.
WRITERS = {
    "records.bin": lambda path: storage.write_blocks(path, [bytes(1248)] * 20),
    "report.html": lambda path: storage.write_text(path, "<p>" * 2000),
    "ledger.json": lambda path: storage.write_json(path, {"a": np.arange(3000)}),
    "table.csv": lambda path: storage.write_csv(path, pd.DataFrame({"a": np.arange(3000)})),
    "medians.parquet": lambda path: storage.write_table(path, schemas.MEDIANS, medians()),
    "picture.svg": write_picture,
    **{f"cloud{suffix}": write_points for suffix in FORMATS},
    **{f"unit{suffix}": write_calibration for suffix in (".xml", ".yaml", ".csv", ".json")},
}


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("name", WRITERS)
def test_no_room_for_a_file(name, share, tmp_path):
    """No byte, half of the bytes and all but one of them fit: an error, and the old file stays."""
    path = tmp_path / name
    WRITERS[name](path)
    before = {each: each.read_bytes() for each in tmp_path.iterdir()}
    room = int(share * (path.stat().st_size - 1))
    message = rf"{path.name}: cannot be written: File too large"
    with small_disk(room), pytest.raises(OutputError, match=message):
        WRITERS[name](path)
    assert {each: each.read_bytes() for each in tmp_path.iterdir()} == before


@dataclass(frozen=True)
class Fault:
    """A call of the operating system that fails, and what is told."""

    what: str
    call: str
    number: int
    hint: str


FAULTS = (
    Fault("the disk is full when the bytes reach it", "fsync", errno.ENOSPC, "Make room"),
    Fault("the quota is used up", "fsync", errno.EDQUOT, "quota"),
    Fault("the disk is broken", "fsync", errno.EIO, "all right"),
    Fault("the folder is on a read-only disk", "open", errno.EROFS, "read-only"),
    Fault("the folder must not be written to", "open", errno.EACCES, "permissions"),
    Fault("the disk has no room for another file", "open", errno.ENOSPC, "Make room"),
)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.what)
@pytest.mark.parametrize("name", WRITERS)
def test_faults_of_the_disk(name, fault, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise OSError(fault.number, os.strerror(fault.number))

    monkeypatch.setattr(output.os, fault.call, fail)
    with pytest.raises(OutputError, match="cannot be written") as caught:
        WRITERS[name](tmp_path / name)
    monkeypatch.undo()
    assert os.strerror(fault.number) in str(caught.value)
    assert fault.hint in str(caught.value.hint)
    assert names(tmp_path) == []


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write all")
@pytest.mark.parametrize("what", ["folder", "file"])
def test_write_protected(what, tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("old")
    (path if what == "file" else tmp_path).chmod(0o500)
    with pytest.raises(OutputError, match="write-protected"):
        storage.write_text(path, "new")
    tmp_path.chmod(0o700)
    assert path.read_text() == "old"


def test_write_protected_as_the_system_says(tmp_path, monkeypatch):
    """The same for root, who may write everything."""
    monkeypatch.setattr(output.os, "access", lambda *_: False)
    with pytest.raises(OutputError, match=r"folder .* is write-protected"):
        storage.write_text(tmp_path / "x.csv", "new")


def fifo(path):
    os.mkfifo(path)


def link_to_device(path):
    path.symlink_to("/dev/null")


#: What may be in the way of an output, and the message.
IN_THE_WAY = {
    "a FIFO": (fifo, "is no regular file"),
    "a link to a device": (link_to_device, "is no regular file"),
    "a folder": (Path.mkdir, "is a folder"),
    "a link that leads to itself": (lambda path: path.symlink_to(path), "cannot be written"),
}


@pytest.mark.parametrize("what", IN_THE_WAY)
def test_only_regular_files_are_replaced(what, tmp_path):
    make, message = IN_THE_WAY[what]
    path = tmp_path / "x.csv"
    make(path)
    before = path.lstat()
    with pytest.raises(OutputError, match=message):
        storage.write_text(path, "text")
    after = path.lstat()
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert names(tmp_path) == ["x.csv"]


def test_missing_folders_are_an_error(tmp_path):
    with pytest.raises(OutputError, match=r"there is no folder .*\n?Hint: Make the folder"):
        storage.write_text(tmp_path / "mistyped/x.csv", "text")
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=r"there is no folder .*\n?Hint: Check the path"):
        storage.write_text(tmp_path / "file/x.csv", "text")
    assert names(tmp_path) == ["file"]


def test_the_file_behind_a_link_is_not_changed(tmp_path):
    (tmp_path / "other").write_text("old")
    link = tmp_path / "link"
    link.symlink_to("other")
    storage.write_text(link, "new")
    assert (link.read_text(), (tmp_path / "other").read_text()) == ("new", "old")


def test_a_planted_temporary_file_is_not_followed(tmp_path, monkeypatch):
    """Even somebody who guesses the random name cannot have another file overwritten."""
    (tmp_path / "victim").write_text("old")
    monkeypatch.setattr(output.secrets, "token_hex", lambda _: "guessed")
    (tmp_path / f".x.csv.guessed{PART}").symlink_to("victim")
    with pytest.raises(OutputError, match="cannot be written: File exists"):
        storage.write_text(tmp_path / "x.csv", "new")
    assert (tmp_path / "victim").read_text() == "old"
    assert not (tmp_path / "x.csv").exists()


def test_temporary_names_are_random_and_in_the_same_folder(tmp_path):
    found = set()
    for _ in range(2):
        with new_file(tmp_path / ("x" * 255)):
            found |= set(names(tmp_path))
        (tmp_path / ("x" * 255)).unlink()
    assert len(found) == 2
    assert all(name.endswith(PART) for name in found)


def test_permissions_of_the_old_file_are_kept(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("old")
    path.chmod(0o600)
    storage.write_text(path, "new")
    assert path.stat().st_mode & 0o777 == 0o600


def test_bytes_reach_the_disk_before_the_name(tmp_path, monkeypatch):
    """A loss of power leaves the old file or the new one: file, then name, then folder."""
    done = []
    real = os.fsync, Path.replace

    def fsync(descriptor):
        done.append("folder" if Path(f"/proc/self/fd/{descriptor}").is_dir() else "file")
        real[0](descriptor)

    def replace(self, target):
        done.append("name")
        return real[1](self, target)

    monkeypatch.setattr(output.os, "fsync", fsync)
    monkeypatch.setattr(output.Path, "replace", replace)
    storage.write_text(tmp_path / "x.csv", "new")
    assert done == ["file", "name", "folder"]


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT"])
def test_signals_leave_no_unfinished_file(name, tmp_path):
    code = f"""
import os, signal, sys
from pathlib import Path
import velocal.points.stream as library
from velocal.cli import main
# As in a terminal: a shell lets what it runs in the background ignore SIGINT.
signal.signal(signal.SIGINT, signal.default_int_handler)
def stop(*_):
    os.kill(os.getpid(), signal.{name})
library.stream = stop
sys.argv = ["velocal", "points", "{tmp_path}/x.bin", "-o", "{tmp_path}/x.ply"]
main()
"""
    (tmp_path / "x.bin").write_bytes(recording())
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == (130 if name == "SIGINT" else 128 + getattr(signal, name))
    assert "Traceback" not in done.stderr
    assert names(tmp_path) == ["x.bin"]


def test_signals_are_handled_as_before_afterwards():
    before = signal.getsignal(signal.SIGTERM)
    with stopped_cleanly():
        assert signal.getsignal(signal.SIGTERM) != before
    assert signal.getsignal(signal.SIGTERM) == before


# --------------------------------------------------------------------------- commands and scripts


def recording():
    return b"".join(as_bytes(record_list(spin(200, step=17, interval_us=553), 42)))


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "cap.bin").write_bytes(recording())
    for name in ("cal.csv", "other.csv"):
        formats.write(
            tmp_path / name, CalibrationFile(parameters.nominal(SCANNERS["HDL-32E"]), "paper")
        )
    return tmp_path


#: Every way in which a command names a file to be written: {i} is its input, {o} the output.
COMMANDS = {
    "decode -o": ("cap.bin", "decode {i} -o {o}"),
    "points -o": ("cap.bin", "points {i} -o {o}"),
    "points -c, -o": ("cal.csv", "points {f}/cap.bin -c {i} -o {o}"),
    "points --before, -o": ("cal.csv", "points {f}/cap.bin --before {i} -o {o}"),
    "points --picture": (
        "cal.csv", "points {f}/cap.bin --before {i} -o {f}/new.ply --picture {o}",
    ),
    "from-recording -o": ("cap.bin", "calibration from-recording {i} -o {o}"),
    "convert": ("cal.csv", "calibration convert {i} {o}"),
    "diff --csv": ("cal.csv", "calibration diff {i} {f}/other.csv --csv {o}"),
    "diff, second": ("cal.csv", "calibration diff {f}/other.csv {i} --csv {o}"),
    "diff --figure": ("cal.csv", "calibration diff {i} {f}/other.csv --figure {o}"),
}  # fmt: skip
PICTURES = ("points --picture", "diff --figure")


def call(command, folder, out, *more):
    name, text = COMMANDS[command]
    words = [word.format(i=folder / name, o=out, f=folder) for word in text.split()]
    return CliRunner().invoke(app, [*words, *more], env={"COLUMNS": "200"})


def hard_link(link, file):
    link.hardlink_to(file)


def soft_link(link, file):
    link.symlink_to(file)


@pytest.mark.parametrize("link", [None, hard_link, soft_link])
@pytest.mark.parametrize("command", COMMANDS)
def test_an_input_is_never_an_output(command, link, folder):
    """Not with --force either, nor by another name of the same file."""
    file = folder / COMMANDS[command][0]
    picture = command in PICTURES
    out = folder / "out.png" if picture else file
    if link or picture:
        out = folder / "out.png"
        (link or hard_link)(out, file)
    before = {each: each.read_bytes() for each in folder.iterdir()}
    done = call(command, folder, out, "--force")
    assert isinstance(done.exception, OutputError)
    assert f"is the same file as the input '{file}'" in str(done.exception)
    assert {each: each.read_bytes() for each in folder.iterdir()} == before


@pytest.mark.parametrize("command", COMMANDS)
def test_existing_files_need_force(command, folder):
    out = folder / "old.png"
    out.write_text("mine")
    before = names(folder)
    done = call(command, folder, out)
    assert "old.png: exists already" in str(done.exception)
    assert "Hint: Choose another name, or overwrite it with --force." in str(done.exception)
    assert (out.read_text(), names(folder)) == ("mine", before)


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_make_no_folder(command, folder):
    before = names(folder)
    done = call(command, folder, folder / "mistyped/x.png")
    assert "there is no folder" in str(done.exception)
    assert names(folder) == before


@pytest.mark.parametrize(
    ("command", "suffix"),
    [("decode -o", "parquet"), ("points -o", "ply"), ("convert", "json"), ("diff --csv", "csv")],
)
def test_force_overwrites(command, suffix, folder):
    out = folder / f"old.{suffix}"
    out.write_text("mine")
    done = call(command, folder, out, "--force")
    assert done.exit_code == 0, done.output
    assert out.read_bytes() != b"mine"


def test_one_file_for_two_outputs(folder):
    with pytest.raises(OutputError, match="is named for two outputs"):
        check_outputs([folder / "x.csv", folder / "." / "x.csv"])


def test_a_file_in_a_folder_that_is_read(folder):
    """A ROS 2 bag is a folder of files."""
    (folder / "bag").mkdir()
    (folder / "bag/metadata.yaml").touch()
    with pytest.raises(OutputError, match="is the same file as the input"):
        check_outputs([folder / "bag/metadata.yaml"], [folder / "bag"])


def test_a_script_does_not_write_onto_its_input(folder):
    """A rule that says so is a mistake; other files of results/ are overwritten."""

    def main(*, data: Path, table: Path) -> None:
        storage.write_text(table, "lost")

    def job(out):
        parts = {"params": {}, "wildcards": {}, "log": []}
        return SimpleNamespace(
            rule="r", input={"data": str(folder / "cal.csv")}, output={"table": out}, **parts
        )

    before = (folder / "cal.csv").read_bytes()
    with pytest.raises(SystemExit) as stopped:
        run(main, job(str(folder / "cal.csv")))
    assert stopped.value.code == 1
    assert (folder / "cal.csv").read_bytes() == before
    run(main, job(str(folder / "other.csv")))
    assert (folder / "other.csv").read_text() == "lost"
