"""pyproject.toml, requirements.lock and environment.yml must ask for the same things."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LOCK = (ROOT / "requirements.lock").read_text()
CONDA = yaml.safe_load((ROOT / "environment.yml").read_text())

# environment.yml carries these for conda's sake only
CONDA_ONLY = {"python", "pip"}


def declared() -> dict[str, SpecifierSet]:
    """The ranges of pyproject.toml: what velocal runs on, and what it is developed with."""
    lines = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["dev"]]
    requirements = [Requirement(line) for line in lines]
    ranges = {canonicalize_name(req.name): req.specifier for req in requirements}
    assert len(ranges) == len(lines), "a package is listed twice"
    return ranges


def of_conda() -> dict[str, SpecifierSet]:
    lines: list[str] = []
    for entry in CONDA["dependencies"]:
        lines += entry["pip"] if isinstance(entry, dict) else [entry]
    requirements = [Requirement(line) for line in lines]
    ranges = {canonicalize_name(req.name): req.specifier for req in requirements}
    assert len(ranges) == len(lines), "a package is listed twice"
    return ranges


def locked() -> list[tuple[str, Version, str, str]]:
    """Name, version, marker and the rest of every entry of the lock."""
    text = "\n".join(line for line in LOCK.splitlines() if not line.startswith("#"))
    entries = []
    for entry in text.replace("\\\n", " ").splitlines():
        match = re.fullmatch(r"([\w.-]+)==(\S+)(?: ; (.*?))?((?: +--hash=\S+)*) *", entry)
        assert match, f"not of the form name==version --hash=...: {entry[:120]}"
        name, version, marker, hashes = match.groups()
        entries.append((canonicalize_name(name), Version(version), marker or "", hashes))
    return entries


DECLARED = declared()
OF_CONDA = of_conda()
LOCKED = locked()


@pytest.mark.parametrize("name", sorted(DECLARED))
def test_conda_range_is_that_of_pyproject(name):
    assert name in OF_CONDA, f"{name} is missing from environment.yml"
    assert OF_CONDA[name] == DECLARED[name]


def test_conda_has_nothing_else():
    assert set(OF_CONDA) - set(DECLARED) == CONDA_ONLY


def test_conda_asks_for_the_same_python():
    assert OF_CONDA["python"] == SpecifierSet(PROJECT["requires-python"])


@pytest.mark.parametrize("name", sorted(DECLARED))
def test_locked_versions_satisfy_the_range(name):
    versions = [version for locked_name, version, _, _ in LOCKED if locked_name == name]
    assert versions, f"{name} is missing from requirements.lock. Hint: make lock"
    for version in versions:
        assert version in DECLARED[name]


@pytest.mark.parametrize("python", ["3.11.0", "3.12.0", "3.13.0", "3.14.0"])
@pytest.mark.parametrize("platform", ["linux", "darwin", "win32"])
def test_each_package_is_locked_once_for_a_given_machine(python, platform):
    machine = {
        "python_full_version": python,
        "python_version": python.rpartition(".")[0],
        "sys_platform": platform,
    }
    names = [
        name
        for name, _, marker, _ in LOCKED
        if not marker or Marker(marker).evaluate({**machine, "extra": ""})
    ]
    assert len(names) == len(set(names))
    assert set(DECLARED) <= set(names)


def test_every_locked_entry_has_sha256_hashes():
    without = [
        name
        for name, _, _, hashes in LOCKED
        if not re.fullmatch(r"(?: +--hash=sha256:[0-9a-f]{64})+", hashes)
    ]
    assert not without


def test_lock_holds_no_address():
    found = re.findall(r".*(?:://|file:|--index|--extra-index|--find-links|-i |-f ).*", LOCK)
    assert not found


def test_nist_archives_have_hashes_and_no_address():
    text = (ROOT / "tests/reference/nist-requirements.txt").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    for line in lines:
        assert re.fullmatch(r"[\w-]+==[\w.]+ --hash=sha256:[0-9a-f]{64}", line)


def test_actions_are_named_by_commit():
    for path in (ROOT / ".github/workflows").iterdir():
        used = re.findall(r"uses: *(\S+)(.*)", path.read_text())
        assert used
        for action, comment in used:
            assert re.fullmatch(r"[\w./-]+@[0-9a-f]{40}", action), action
            assert re.fullmatch(r" # v[\d.]+", comment), f"{action}: the version as a comment"


def test_a_container_leaves_out_what_git_ignores():
    """podman and docker look in the top folder only where no ``**/`` stands before a name."""
    lines = {
        name: [
            line for line in (ROOT / name).read_text().splitlines()
            if line and not line.startswith("#")
        ]
        for name in (".gitignore", ".dockerignore")
    }  # fmt: skip
    anchored = [
        line.rstrip("/") if "/" in line.rstrip("/") else "**/" + line.rstrip("/")
        for line in lines[".gitignore"]
    ]
    assert lines[".dockerignore"] == anchored
