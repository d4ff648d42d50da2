"""Digest of the library files behind a script."""

from velocal import provenance


def files(tmp_path, text):
    script = tmp_path / f"script_{len(list(tmp_path.iterdir()))}.py"
    script.write_text(text)
    return {f.relative_to(provenance.PACKAGE).as_posix() for f in provenance.library_files(script)}


def test_imports_are_followed(tmp_path):
    found = files(tmp_path, "from velocal.medians import cell_medians\n")
    assert {"__init__.py", "medians.py", "errors.py", "sensors.py"} <= found
    assert not {"figures.py", "storage.py", "adjustment/solvers.py"} & found


def test_modules_imported_by_name_and_inside_functions(tmp_path):
    found = files(tmp_path, "def f():\n    from velocal import storage\n    import velocal.rigid\n")
    assert {"storage.py", "rigid.py"} <= found


def test_data_files_that_a_module_names(tmp_path):
    assert "data/published_tables.csv" in files(tmp_path, "from velocal import published\n")
    assert "data/report.html.j2" in files(tmp_path, "from velocal import report\n")
    assert "data/report.html.j2" not in files(tmp_path, "from velocal import published\n")


def test_digest_changes_with_the_content(tmp_path, monkeypatch):
    package = tmp_path / "velocal"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "a.py").write_text("x = 1\n")
    (package / "b.py").write_text("y = 1\n")
    script = tmp_path / "script.py"
    script.write_text("from velocal import a\n")
    monkeypatch.setattr(provenance, "PACKAGE", package)
    provenance._imported.cache_clear()
    before = provenance.library_digest(script)
    (package / "b.py").write_text("y = 2\n")
    assert provenance.library_digest(script) == before
    (package / "a.py").write_text("x = 2\n")
    assert provenance.library_digest(script) != before
    provenance._imported.cache_clear()


def test_versions_name_what_matters():
    assert {"python", "velocal", "numpy", "matplotlib", "snakemake"} <= set(provenance.versions())
