"""The commands of docs/tutorial.md, run in order in a clean environment from the wheel.

``python tests/support/tutorial.py`` writes what they print into the page again.
"""

from __future__ import annotations

import re
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

if __name__ == "__main__":  # as pytest sets it
    sys.path.insert(0, str(Path(__file__).parents[1]))

from support.running import ROOT

PAGE = ROOT / "docs/tutorial.md"
#: In place of pipx: installs the wheel from the disk, as tests use no network.
_PIPX = """#!/bin/sh
test "$*" = "install velocal" || exit 2
exec "{python}" -m pip --python "{venv}/bin/python" install --quiet --no-index --no-deps '{wheel}'
"""


def clean_environment(folder: Path) -> Path:
    """Make a virtual environment with the packages that velocal needs, and `pipx`, in a folder.

    The packages are those of the environment that runs; velocal itself is not among them, as
    Python does not follow the editable installation from there.

    Returns
    -------
    Path
        Folder of the programs.
    """
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    build = ("wheel", "--no-deps", "--no-index", "--no-build-isolation", "--wheel-dir")
    subprocess.run([*pip, *build, folder / "wheel", ROOT], check=True)
    venv = folder / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
    packages = Path(sysconfig.get_path("purelib", vars={"base": str(venv)}))
    (packages / "needed.pth").write_text(sysconfig.get_path("purelib") + "\n")
    (wheel,) = (folder / "wheel").glob("*.whl")
    pipx = venv / "bin/pipx"
    pipx.write_text(_PIPX.format(python=sys.executable, venv=venv, wheel=wheel))
    pipx.chmod(0o755)
    return venv / "bin"


def blocks() -> list[str]:
    """Blocks of commands of the page, in order."""
    return re.findall(r"^```sh\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)


def run(programs: Path, folder: Path) -> dict[str, str]:
    """Run all blocks in one shell; what each prints, by its text.

    A block that fails ends it with an `AssertionError` that shows what was printed.
    """
    shell = "set -e\n" + "".join(
        f"exec > '{folder}/{number}.txt' 2>&1\n{block}" for number, block in enumerate(blocks())
    )
    environment = {
        "PATH": f"{programs}:/usr/bin:/bin", "HOME": str(folder), "COLUMNS": "100",
        "NO_COLOR": "1", "LANG": "C.UTF-8", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
    }  # fmt: skip
    done = subprocess.run(["bash", "-c", shell], cwd=folder, env=environment, check=False)
    said = {
        block: path.read_text(encoding="utf-8")
        for number, block in enumerate(blocks())
        if (path := folder / f"{number}.txt").exists()
    }
    assert done.returncode == 0, "\n".join(said.values())
    return said


def shown(said: dict[str, str]) -> dict[str, str]:
    """What the page shows of it, by the name of its marks."""
    of = {block.split()[1]: text for block, text in said.items()}
    unsurveyed = next(text for block, text in said.items() if "--recording" in block)
    parts = {
        "verdict": of["run"].splitlines()[-1],
        "diff": of["calibration"].rstrip(),
        "unsurveyed_verdict": unsurveyed.splitlines()[-1],
    }
    return {name: f"```text\n{text}\n```" for name, text in parts.items()}


def write() -> None:
    """Write the page again."""
    from velocal.io import storage
    from velocal.io.markup import inserted

    with tempfile.TemporaryDirectory() as name:
        found = shown(run(clean_environment(Path(name)), Path(name)))
    text = PAGE.read_text(encoding="utf-8")
    for part, content in found.items():
        text = inserted(text, part, content)
    storage.write_text(PAGE, text)


if __name__ == "__main__":
    write()
