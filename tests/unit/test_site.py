"""The documentation site is built without a warning, and needs no network."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import velocal

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_site_is_built_without_a_warning(tmp_path):
    """A link to nowhere, a page in no list and a docstring that cannot be read are warnings."""
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html"]
    done = subprocess.run(
        [*command, "-d", str(tmp_path / "doctrees"), str(ROOT / "docs"), str(tmp_path / "site")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    site = tmp_path / "site"
    for page in (ROOT / "docs").glob("*.md"):
        assert (site / f"{page.stem}.html").is_file()
    assert (site / "model.html").read_text(encoding="utf-8").count("<math") > 20
    api = (site / "generated/api.html").read_text(encoding="utf-8")
    for name in velocal.__all__:
        assert name.startswith("_") or f'id="velocal.{name}"' in api
    commands = (site / "generated/commands.html").read_text(encoding="utf-8")
    assert 'id="velocal-inspect"' in commands
    for page in site.rglob("*.html"):
        loaded = re.findall(
            r'<(?:script|img|link)[^>]*(?:src|href)="(https?:[^"]*)"',
            page.read_text(encoding="utf-8"),
        )
        assert not loaded, page
