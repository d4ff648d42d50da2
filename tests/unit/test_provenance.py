"""Digest of the library files behind a script."""

from pathlib import Path

import pytest

from velocal.io import provenance


def files(tmp_path, text):
    script = tmp_path / f"script_{len(list(tmp_path.iterdir()))}.py"
    script.write_text(text)
    return {f.relative_to(provenance.PACKAGE).as_posix() for f in provenance.library_files(script)}


def test_imports_are_followed(tmp_path):
    found = files(tmp_path, "from velocal.reduction.medians import binned_medians\n")
    assert {"__init__.py", "reduction/medians.py", "errors.py", "scanner/models.py"} <= found
    assert not {"reporting/style.py", "io/storage.py", "adjustment/solvers.py"} & found


def test_modules_imported_by_name_and_inside_functions(tmp_path):
    found = files(
        tmp_path,
        "def f():\n    from velocal.io import storage\n    import velocal.geometry.rigid\n",
    )
    assert {"io/storage.py", "geometry/rigid.py"} <= found


def test_imports_for_type_checkers_do_not_count(tmp_path):
    text = "if TYPE_CHECKING:\n    from velocal.io import storage\nfrom velocal import errors\n"
    found = files(tmp_path, text)
    assert "errors.py" in found
    assert "io/storage.py" not in found


def test_data_files_that_a_module_names(tmp_path):
    assert "paper/data/tables.csv" in files(tmp_path, "from velocal.paper import printed\n")
    assert "reporting/report.html.j2" in files(tmp_path, "from velocal.reporting import report\n")
    assert "reporting/report.html.j2" not in files(tmp_path, "from velocal.paper import printed\n")


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of two modules, of which a script imports one; gives the digest after a change."""
    package = tmp_path / "velocal"
    package.mkdir()
    script = tmp_path / "script.py"
    script.write_text("import numpy as np\nfrom velocal import a\n")
    monkeypatch.setattr(provenance, "PACKAGE", package)

    def forget():
        for cached in (provenance._source, provenance._module_files, provenance._imported_version):
            cached.cache_clear()

    def digest(**modules):
        texts = {"__init__": "", "a": "def f():\n    return 1\n", "b": "y = 1\n"} | modules
        for name, text in texts.items():
            (package / f"{name}.py").write_text(text)
        forget()
        return provenance.library_digest(script)

    yield digest
    forget()


def test_digest_changes_with_the_content(package):
    before = package()
    assert package(b="y = 2\n") == before
    assert package(a="def f():\n    return 2\n") != before
    assert package(a="from velocal import b\ndef f():\n    return 1\n") != before
    assert package(a="def f():\n    return '1'\n") != before


@pytest.mark.parametrize(
    "text",
    [
        "# a comment\ndef f():\n    return 1  # another\n",
        '"""Of the module."""\n\n\ndef f():\n    """Of the function."""\n    return 1\n',
        "def f():\n\n    return (\n        1\n    )\n",
    ],
    ids=["comment", "docstring", "layout"],
)
def test_digest_does_not_see_what_changes_no_result(package, text):
    assert package(a=text) == package()


def test_digest_sees_versions_of_what_is_imported(package, monkeypatch):
    before, version = package(), provenance.metadata.version

    def changed(of):
        monkeypatch.setattr(
            provenance.metadata, "version", lambda name: "0" if name == of else version(name)
        )
        return package()

    assert changed("numpy") != before
    assert changed("matplotlib") == before  # neither the script nor its module draws


def test_versions_name_what_matters():
    assert {"python", "velocal", "numpy", "matplotlib", "snakemake"} <= set(provenance.versions())


SCRIPTS = sorted((Path(__file__).parents[2] / "scripts").glob("*.py"))
#: Scripts that may know the paper's numbers: they compare, or tune the simulator.
COMPARE = {
    "adjust_offsets", "check_agreement", "compare_light", "compare_with_paper", "judge_claims",
    "write_report", "replicate_study", "summarise_seeds", "tune_world",
}  # fmt: skip
#: Scripts that may know how the world is simulated: they make it, or repeat all of it.
SIMULATE = {"replicate_study", "summarise_seeds", "tune_world", "coverage"}


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_nothing_downstream_can_know_the_papers_numbers_or_the_world(script):
    names = {f.relative_to(provenance.PACKAGE).as_posix() for f in provenance.library_files(script)}
    printed = {name for name in names if name.startswith("paper/data/")}
    assert bool(printed) == (script.stem in COMPARE)
    world = {name for name in names if name.startswith("simulation/")} - {"simulation/__init__.py"}
    assert bool(world) == (script.stem in SIMULATE or script.stem.startswith("simulate_"))
