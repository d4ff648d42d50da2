"""The paper's printed tables, as the package carries them."""

import csv

import pytest

from velocal.paper import printed as published

ROWS = published.printed_rows()


def test_packaged_copy_equals_the_printed_tables(shared):
    original = shared / "paper" / "tables.csv"
    if not original.is_file():
        pytest.skip(f"no {original}")
    with original.open() as printed, published.TABLES.open() as packaged:
        assert list(csv.reader(packaged)) == list(csv.reader(printed))


def test_rows_per_table():
    counts = {name: sum(row.table == name for row in ROWS) for name in published.DATA}
    assert counts == {"II": 12, "III": 6, "IV": 24, "V": 12}


@pytest.mark.parametrize(
    ("item", "value"),
    [
        # Means that the paper's text quotes: indoors 3.6 to 2.1 cm, and 2.3 to 0.4 cm.
        (("IV", "before"), 3.6),
        (("IV", "after"), 2.1),
        (("V", "before"), 2.3),
        (("V", "after"), 0.4),
    ],
)
def test_means_quoted_in_the_text_follow_from_the_cells(item, value):
    std = [row.values["std_cm"] for row in ROWS if (row.table, row.calibration) == item]
    assert round(sum(std) / len(std), 1) == value


def test_contradictory_cells_are_kept_as_printed():
    cells = {row.item(quantity): row.values[quantity] for row in ROWS for quantity in row.values}
    assert {item: cells[item] for item in published.CONTRADICTIONS} == {
        "II HDL-64E sa3 beginning after within_1sigma_pct": 67.4,
        "III HDL-32E sa5 end before std_cm": 3.4,
    }


def test_every_label_is_read_as_one_of_the_six_samples():
    samples = {
        "II": {"sa3", "sa4"},
        "III": {"sa5"},
        "IV": {"sa1", "sa2", "sa3", "sa4"},
        "V": {"sa5", "sa6"},
    }
    for table, expected in samples.items():
        for calibration in ("before", "after"):
            rows = [r for r in ROWS if (r.table, r.calibration) == (table, calibration)]
            assert {row.reproduced_sample for row in rows} == expected
            # Every sample and window once.
            assert len({row.key for row in rows}) == len(rows) == 3 * len(expected)
