"""Results name the file that they were made from, and a file that has changed since is refused."""

import os

import numpy as np
import pytest
from support.capture import record_list, spin, write

from velocal.errors import RecordingError, StorageError
from velocal.io import identity, schemas, storage
from velocal.io.identity import identify
from velocal.recording.recording import open_recording
from velocal.recording.scan import inspect
from velocal.recording.windows import read_index, read_rotations, write_index


def cut_in_half(path):
    os.truncate(path, path.stat().st_size // 2)


def longer(path):
    with path.open("ab") as file:
        file.write(path.read_bytes()[:1248])


def change(at):
    def changed(path):
        content = bytearray(path.read_bytes())
        content[at] ^= 1
        path.write_bytes(content)

    return changed


#: Changes of a file, all with the old time.
CHANGES = {
    "cut in half": cut_in_half,
    "a packet more": longer,
    "another first byte": change(0),
    "another last byte": change(-1),
}


def altered(path, what):
    before = path.stat()
    CHANGES[what](path)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


@pytest.mark.parametrize("whole", [True, False], ids=["whole", "ends"])
@pytest.mark.parametrize("what", CHANGES)
def test_a_change_is_seen(what, whole, tmp_path, monkeypatch):
    if not whole:
        monkeypatch.setattr(identity, "WHOLE_BYTES", 2000)
        monkeypatch.setattr(identity, "END_BYTES", 100)
    path = tmp_path / "x"
    path.write_bytes(bytes(range(250)) * 20)
    before = identify(path)
    assert before.bytes == 5000
    altered(path, what)
    assert identify(path) != before


def test_a_byte_in_the_middle_of_a_small_file(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(bytes(5000))
    before = identify(path)
    change(2500)(path)
    assert identify(path) != before


def test_only_the_ends_of_a_large_file_are_read(tmp_path):
    """A file with 64 GiB of holes; to read it would take a minute."""
    path = tmp_path / "x"
    path.touch()
    os.truncate(path, 64 << 30)
    assert identify(path).bytes == 64 << 30


def test_a_folder_of_files(tmp_path):
    (tmp_path / "bag").mkdir()
    for name in ("metadata.yaml", "x.db3"):
        (tmp_path / "bag" / name).write_text(name)
    before = identify(tmp_path / "bag")
    (tmp_path / "bag/x.db3").rename(tmp_path / "bag/y.db3")
    assert identify(tmp_path / "bag").digest != before.digest
    assert identify(tmp_path / "bag").bytes == before.bytes == 18


@pytest.mark.parametrize("stored", [False, True], ids=["scanned", "index from a file"])
@pytest.mark.parametrize("what", CHANGES)
def test_a_recording_that_has_changed_since_its_index(what, stored, tmp_path):
    """Before, half of a file gave half of its returns without a word."""
    path = write(tmp_path, record_list(spin(800), 42))
    recording = open_recording(path, "HDL-32E")
    index = recording.rotations
    if stored:
        write_index(tmp_path / "rotations.parquet", index)
        index = read_index(tmp_path / "rotations.parquet")
    assert index.recording == identify(path)
    altered(path, what)
    with pytest.raises(RecordingError, match="has changed since its rotations were indexed") as e:
        list(read_rotations(path, index, np.array([1])))
    sizes = "bytes, and had" if what in ("cut in half", "a packet more") else "bytes are others"
    assert sizes in str(e.value)
    assert "Hint: Scan it again" in str(e.value)
    if not stored:
        with pytest.raises(RecordingError, match="has changed since"):
            recording.returns([1])


def test_a_recording_that_is_gone(tmp_path):
    path = write(tmp_path, record_list(spin(300), 42))
    index = inspect(path).index
    path.unlink()
    with pytest.raises(RecordingError, match="cannot be read: No such file"):
        list(read_rotations(path, index, np.array([1])))


def test_an_index_that_names_no_recording(tmp_path):
    path = tmp_path / "rotations.parquet"
    columns = {field.name: np.zeros(2, field.type.to_pandas_dtype()) for field in schemas.ROTATIONS}
    storage.write_table(path, schemas.ROTATIONS, columns)
    with pytest.raises(StorageError, match="is no FileIdentity"):
        read_index(path)
