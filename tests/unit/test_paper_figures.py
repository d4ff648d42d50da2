"""The table of the paper's figures: it agrees with the configuration and with the page."""

from pathlib import Path

from velocal.paper import figures
from velocal.study.config import StudyConfig
from velocal.study.model import validated
from velocal.study.reading import read_yaml

ROOT = Path(__file__).parents[2]
TABLE = figures.figures()


def configured():
    """Kind of every figure of the study, by number."""
    config = validated(StudyConfig, read_yaml(ROOT / "config/config.yaml"), "config")
    assert config.outdoor is not None
    kinds = {number: each.kind for number, each in config.figures.items()}
    return kinds | dict.fromkeys(config.outdoor.figures, "panels")


def test_every_figure_of_the_paper_has_one_row():
    of_paper = [int(each.number) for each in TABLE if int(each.number) <= figures.LAST]
    assert of_paper == [*range(1, figures.LAST + 1)]
    assert all(each.paper == "not in the paper" for each in TABLE[figures.LAST :])


def test_what_is_drawn_is_what_the_study_draws():
    assert {each.number: each.kind for each in TABLE if each.drawn} == configured()


def test_what_is_not_drawn_has_a_reason():
    for each in TABLE:
        assert each.drawn == bool(each.kind)
        assert each.drawn or each.note


def test_the_page_is_up_to_date():
    """Otherwise: python -m velocal.paper.figures."""
    text = (ROOT / figures.PAGE).read_text(encoding="utf-8")
    assert figures.with_table(text) == text
    assert text.count("| `figure_") == sum(each.drawn for each in TABLE)
