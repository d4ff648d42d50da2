"""The public names: documented, with examples that run, and quick to import."""

import ast
import doctest
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest
from support.example import write_example

import velocal

ROOT = Path(__file__).parents[2]
FUNCTIONS = [name for name in velocal._PLACES if inspect.isfunction(getattr(velocal, name))]
CLASSES = [name for name in velocal._PLACES if inspect.isclass(getattr(velocal, name))]


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    folder = tmp_path_factory.mktemp("example")
    write_example(folder)
    return folder


def section(docstring, title):
    """Lines of one numpydoc section, or None where there is no such section."""
    found = re.search(rf"^{title}\n-+\n(.*?)(?=^\w+\n-+\n|\Z)", docstring, re.M | re.S)
    return None if found is None else found[1]


def missing(function):
    """What the docstring of a function does not say."""
    docstring = inspect.getdoc(function) or ""
    signature = inspect.signature(function)
    listed = section(docstring, "Parameters") or ""
    entries = re.findall(r"^(\w[\w, *]*?) *(?::|$)", listed, re.M)
    names = {name.strip(" *") for entry in entries for name in entry.split(",")}
    faults = [f"parameter {name}" for name in signature.parameters if name not in names]
    returned = str(signature.return_annotation)
    if returned != "None" and not (section(docstring, "Returns") or section(docstring, "Yields")):
        faults.append("section Returns")
    if section(docstring, "Examples") is None:
        faults.append("section Examples")
    return faults


def test_the_check_of_docstrings_sees_what_is_missing():
    def undocumented(first: int, second: int) -> int:
        """Add.

        Parameters
        ----------
        first : int
        """
        return first + second

    assert missing(undocumented) == ["parameter second", "section Returns", "section Examples"]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_are_documented(name):
    assert not missing(getattr(velocal, name))


@pytest.mark.parametrize("name", CLASSES)
def test_classes_and_their_methods_are_documented(name):
    kind = getattr(velocal, name)
    assert inspect.getdoc(kind)
    for key, value in vars(kind).items():
        if not key.startswith("_") and (inspect.isfunction(value) or isinstance(value, property)):
            assert inspect.getdoc(value), f"{name}.{key}"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_examples_run(name, example, monkeypatch):
    monkeypatch.chdir(example)
    found = doctest.DocTestFinder(recurse=False).find(
        getattr(velocal, name), name, globs={"velocal": velocal}
    )
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    for each in found:
        assert each.examples
        assert runner.run(each, out=lambda text: print(text)).failed == 0


def test_the_names_are_listed_once_more_for_type_checkers():
    tree = ast.parse((ROOT / "src/velocal/__init__.py").read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    stated = {
        alias.name: str(node.module).removeprefix("velocal.")
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert stated == velocal._PLACES
    assert sorted(velocal._PLACES) == list(velocal._PLACES)


def test_other_names_are_no_attributes():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = velocal.nothing
    assert set(velocal.__all__) <= set(dir(velocal))


def test_the_import_loads_no_numerics():
    code = "import sys, velocal; print([m for m in ('numpy', 'pydantic') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_program_of_the_readme_runs(example, monkeypatch, capsys):
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.M | re.S)
    assert len(blocks) == 1
    program = blocks[0]
    lines = [line for line in program.splitlines() if line and not line.startswith("#")]
    assert len(lines) <= 10, "README: the whole calibration is at most ten lines"
    monkeypatch.chdir(example)
    exec(compile(program, "README.md", "exec"), {})  # the README is ours
    assert "dl" in capsys.readouterr().out
    assert (example / "refined.yaml").is_file()
