"""Every case of the catalogue does what its page says."""

import pytest

from catalogue.case import Case, Outcome, run
from catalogue.page import KINDS, PAGE, PYTHON, row
from velocal.io.markup import marked

CASES = [(kind, case) for kind, cases in KINDS.items() for case in cases]
AGAIN = "python tests/catalogue/page.py writes the page again"


@pytest.mark.parametrize(
    ("kind", "case"), CASES, ids=[f"{kind}: {case.wrong}" for kind, case in CASES]
)
def test_case(kind: str, case: Case, tmp_path):
    result = run(case, tmp_path)
    assert result.outcome == case.outcome, result.message
    if case.outcome is Outcome.REFUSED:
        assert result.message
    page = marked(PAGE.read_text(encoding="utf-8"))
    if PYTHON in page["count"][1]:
        assert row(case, result) in page[kind][1].splitlines(), AGAIN


def test_the_page_has_these_cases_and_no_others():
    assert len(CASES) >= 160
    found = marked(PAGE.read_text(encoding="utf-8"))
    assert found.keys() == {"count", *KINDS}
    assert found["count"][1].startswith(f"{len(CASES)} cases;"), AGAIN
    for kind, cases in KINDS.items():
        names = [case.wrong for case in cases]
        assert len(set(names)) == len(names)
        rows = found[kind][1].splitlines()[2:]
        assert [line.split(" | ")[0].removeprefix("| ") for line in rows] == names, AGAIN
