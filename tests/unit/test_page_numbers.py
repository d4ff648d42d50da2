"""Numbers in pages: written by commands, and noticed when they are old."""

import shutil

import pandas as pd
import pytest
import yaml

from velocal.errors import VelocalError
from velocal.io import storage
from velocal.io.markup import marked
from velocal.paper.printed import PREFIX, printed_statements
from velocal.reporting import pages


@pytest.fixture
def checkout(root, tmp_path):
    """What the pages need of a checkout, and results with the statements of the paper."""
    inputs = {each.partition(":")[0] for of in pages.INPUTS.values() for each in of}
    for name in {*inputs, *(numbers.page for numbers in pages.NUMBERS.values())}:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(root / name, tmp_path / name)
    for picture, figure in pages.PICTURES.items():
        (tmp_path / picture).parent.mkdir(parents=True)
        (tmp_path / "results" / figure).parent.mkdir(parents=True)
        (tmp_path / "results" / figure).write_text("<svg/>")
    return tmp_path


def agreement(results, shift=0.0):
    rows = printed_statements()
    found = {"item": PREFIX + rows["item"], "reproduced": rows["paper"] + shift, "within": "true"}
    (results / "published").mkdir(parents=True, exist_ok=True)
    storage.write_csv(results / "published/agreement.csv", pd.DataFrame(found))


@pytest.fixture
def statements(monkeypatch):
    """Only the numbers that need nothing but the agreement."""
    names = ("improvement", "accuracy", "outdoor")
    monkeypatch.setattr(pages, "NUMBERS", {name: pages.NUMBERS[name] for name in names})


def test_no_page_has_numbers_from_other_inputs(root):
    """Red: `make pages` writes the numbers again."""
    assert pages.old(root) == []


def test_marks_and_writers_belong_together(root):
    for page in [root / "README.md", *(root / "docs").glob("*.md")]:
        path = page.relative_to(root).as_posix()
        for name, (maker, _) in marked(page.read_text(encoding="utf-8")).items():
            if maker.startswith("make "):
                assert pages.NUMBERS[name].page == path, name


@pytest.mark.parametrize(
    ("file", "key", "command"),
    [
        ("config/world.yaml", "seed", "make coverage"),
        ("config/config.yaml", "adjustment", "make coverage"),
        ("config/config.yaml", "simulation", "make seeds"),
        ("config/config.yaml", "reduction", "make results"),
    ],
)
def test_a_changed_input_makes_numbers_old(checkout, file, key, command):
    path = checkout / file
    content = yaml.safe_load(path.read_text())
    path.write_text("# other comments\n" + yaml.safe_dump(content))
    assert pages.old(checkout) == []
    content[key] = 7
    path.write_text(yaml.safe_dump(content))
    assert [line for line in pages.old(checkout) if f"now it is {command}" in line]


def test_a_changed_frozen_number_makes_numbers_old(checkout):
    path = checkout / "tests/golden/tiny_study/parameter_sets/HDL-64E/set1.csv"
    path.write_text(path.read_text().replace("1", "2", 1))
    commands = [line.split("made by ")[1].split(",")[0] for line in pages.old(checkout)]
    assert set(commands) == {"make results", "make coverage", "make seeds"}


@pytest.mark.usefixtures("statements")
def test_numbers_are_written_and_then_compared(checkout):
    results = checkout / "results"
    agreement(results)
    assert len(pages.write(checkout, results)) == 3
    assert pages.different(checkout, results, "make results") == []
    assert pages.different(checkout, results, "make seeds") == []
    agreement(results, shift=0.05)
    faults = pages.different(checkout, results, "make results")
    assert [fault.splitlines()[0] for fault in faults] == [
        "docs/how-to.md: numbers improvement",
        "docs/simulated-world.md: numbers accuracy",
        "docs/simulated-world.md: numbers outdoor",
    ]
    assert "| 3.6 | 3.60 |" in faults[0]
    assert "| 3.6 | 3.65 |" in faults[0]


@pytest.mark.usefixtures("statements")
def test_the_command_fails_with_the_list(checkout, monkeypatch):
    monkeypatch.chdir(checkout)
    agreement(checkout / "results")
    pages.main([])
    pages.main(["--check", "make results"])
    agreement(checkout / "results", shift=-0.3)
    with pytest.raises(VelocalError, match=r"3 pages(?s:.*)improvement(?s:.*)Hint: .*make pages"):
        pages.main(["--check", "make results"])


def test_what_has_no_results_is_left_as_it_is(checkout):
    before = {path: path.read_text() for path in checkout.glob("docs/*.md")}
    said = pages.write(checkout, checkout / "results")
    assert len(said) == len(pages.NUMBERS)
    assert all("left as it is" in line for line in said)
    assert before == {path: path.read_text() for path in checkout.glob("docs/*.md")}


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("| 2.37 | 3 |", "| 2.38 | 3 |", True),
        ("| 2.37 | 3 |", "| 2.39 | 3 |", False),
        ("| 2.37 | 3 |", "| 2.37 | 4 |", False),
        ("| 2.37 | 3 |", "| 2.4 | 3 |", False),
        ("dl 9.99 cm", "dl 10.00 cm", True),
        ("dl 1.00 cm", "alpha 1.00 cm", False),
        ("1.00", "-1.00", False),
    ],
)
def test_a_unit_of_the_last_decimal_is_no_difference(one, other, same):
    assert pages.same_numbers(one, other) is same


@pytest.mark.parametrize("command", ["make results", "make coverage", "make seeds"])
def test_make_compares_the_pages_with_what_it_made(root, command):
    assert f'$(CHECK_PAGES) "{command}"' in (root / "Makefile").read_text()
