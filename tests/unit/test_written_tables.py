"""Tables of people: what can mean one thing only is read, and means that."""

import numpy as np
import pytest

from velocal.errors import SurveyError
from velocal.io.written_tables import number, read_written_table
from velocal.survey.targets import read_targets

HEAD = "target,plane,x_m,y_m,z_m,std_x_mm,std_y_mm,std_z_mm"
ROWS = ["a,w,1.5,-2.25,3,1.5,1,1", "b,w,-1000.125,0,1e-3,1,1,2"]
EXPECTED = [[1.5, -2.25, 3.0], [-1000.125, 0.0, 1e-3]]


def written(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "planes.csv"
    path.write_bytes(text.encode(encoding))
    return path


def with_commas(text):
    return text.replace(",", ";").replace(".", ",")


@pytest.mark.parametrize(
    "text",
    [
        "\n".join([HEAD, *ROWS]),
        "\r\n".join([HEAD, *ROWS, ""]),
        "\n".join([HEAD, *ROWS]).replace(",", ";"),
        "\n".join([HEAD, *ROWS]).replace(",", "\t"),
        with_commas("\n".join([HEAD, *ROWS])),
        "\ufeff# note; of, all\n\n"
        + "\n".join([HEAD + ",,", *(row + ",," for row in ROWS), ",,,"]),
        "\n".join(" , ".join(f'"{cell}"' for cell in row.split(",")) for row in (HEAD, *ROWS)),
    ],
    ids=["as stated", "Windows", "semicolons", "tabs", "decimal commas", "spreadsheet", "quotes"],
)
def test_one_meaning(tmp_path, text):
    targets = read_targets(written(tmp_path, text), "plane")
    assert targets.name == ("a", "b")
    np.testing.assert_array_equal(targets.xyz, EXPECTED)
    np.testing.assert_array_equal(targets.std[:, 2], [1e-3, 2e-3])


def test_commas_before_decimals_are_never_thousands(tmp_path):
    """A point anywhere among the numbers: then a comma may stand between thousands."""
    text = "\n".join([HEAD, *ROWS]).replace(",", ";").replace("-1000.125", "-1,000.125")
    with pytest.raises(SurveyError, match=r"row 3: x_m is no number: '-1,000.125'"):
        read_targets(written(tmp_path, text), "plane")
    text = "\n".join([HEAD, *ROWS]).replace(",", ";").replace("-1000.125", "-1000,125")
    with pytest.raises(SurveyError, match=r"row 3: .*\n.*write points only"):
        read_targets(written(tmp_path, text), "plane")


def test_rows_are_those_of_the_file(tmp_path):
    text = f"# one\n\n# three\n{HEAD}\n# five\n{ROWS[0]}\n\n{ROWS[1].replace('1e-3', 'x')}\n"
    with pytest.raises(SurveyError, match="row 8: z_m is no number: 'x'"):
        read_targets(written(tmp_path, text), "plane")
    text = f"# one\n{HEAD}\n\n{ROWS[0]}\n# five\n{ROWS[0]}\n"
    with pytest.raises(SurveyError, match="row 6: target 'a' occurs twice\nHint: Row 4"):
        read_targets(written(tmp_path, text), "plane")


def test_a_name_may_hold_anything_that_is_seen(tmp_path):
    names = ["NA", "null", "1", "1.0", "true", "a#b", "a,b", "a;b", "größe", '"']
    rows = ['"{}",w,0,0,0,1,1,1'.format(name.replace('"', '""')) for name in names]
    targets = read_targets(written(tmp_path, "\n".join([HEAD, *rows])), "plane")
    assert list(targets.name) == names


@pytest.mark.parametrize(
    ("text", "expected"),
    [("1", 1.0), ("-.5", -0.5), ("+1.", 1.0), ("1e3", 1000.0), ("1E-3", 1e-3), ("1,5", None),
     ("", None), ("nan", None), ("inf", None), ("0x1", None), ("1_0", None), ("1 000", None),
     ("١", None), ("1e", None), (".", None), ("1.2.3", None)],
)  # fmt: skip
def test_numbers(text, expected):
    assert number(text) == expected
    assert number("1,5", decimal_comma=True) == 1.5
    assert number("1,000,5", decimal_comma=True) is None


def test_headings_in_any_order_with_optional_ones(tmp_path):
    path = written(tmp_path, "b\ta\tc\n1\t2\t3\n")
    table = read_written_table(path, ["a", "b"], SurveyError, optional=["c", "d"])
    assert table.columns == {"b": ["1"], "a": ["2"], "c": ["3"]}
    with pytest.raises(SurveyError, match=r"unknown column 'c' \(allowed: a, b\)"):
        read_written_table(path, ["a", "b"], SurveyError)
