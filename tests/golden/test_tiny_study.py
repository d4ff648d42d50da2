"""Packets, scripts and rules of the tiny study give the numbers that were frozen.

After a change of numbers that is meant: `pytest tests/golden --freeze`, and say in CHANGELOG.md
why they change.
"""

import pytest
from support.frozen import FILES, differences, freeze

pytestmark = pytest.mark.workflow


def test_numbers_are_those_that_were_frozen(tiny_study, pytestconfig):
    results = tiny_study / "results"
    if pytestconfig.getoption("--freeze"):
        freeze(results)
    assert [line for name in FILES for line in differences(name, results)] == []
