"""`make nist` takes archives whose code would run in a build, and runs nothing of them."""

import io
import os
import subprocess
import sys
import tarfile
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


def archive(path, marker):
    """A source distribution that tells when its code is run."""
    files = {
        "PKG-INFO": "Metadata-Version: 2.1\nName: nosy\nVersion: 1.0\n",
        "pyproject.toml": '[build-system]\nrequires = ["setuptools"]\n'
        'build-backend = "setuptools.build_meta"\n',
        "setup.py": f"open({str(marker)!r}, 'w').close()\nimport setuptools\nsetuptools.setup()\n",
    }
    with tarfile.open(path, "w:gz") as made:
        for name, text in files.items():
            member = tarfile.TarInfo(f"nosy-1.0/{name}")
            member.size = len(text)
            made.addfile(member, io.BytesIO(text.encode()))


def test_nothing_of_an_archive_is_run(tmp_path):
    marker, target = tmp_path / "ran", tmp_path / "target"
    (tmp_path / "links").mkdir()
    archive(tmp_path / "links/nosy-1.0.tar.gz", marker)
    command = [
        sys.executable, "-m", "pip", "download", "--quiet", "--no-index", "--isolated", "--no-deps",
        "--no-build-isolation", "--find-links", str(tmp_path / "links"), "--no-binary", ":all:",
        "--dest", str(target), "nosy",
    ]  # fmt: skip
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(HERE / "metadata_only")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (target / "nosy-1.0.tar.gz").is_file()
    assert not marker.exists()


def test_make_nist_uses_it():
    makefile = (ROOT / "Makefile").read_text()
    recipe = makefile.split("$(UNPACKED): tests")[1].split("touch")[0]
    assert "PYTHONPATH=$(CURDIR)/tests/reference/metadata_only" in recipe
    assert "--no-build-isolation" in recipe
    assert "--require-hashes" in recipe
