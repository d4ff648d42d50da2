"""Properties of the scanners decide; no program text asks for one by its name."""

import ast
import re
from pathlib import Path

import pytest

from velocal.scanner.models import SCANNERS, Family

ROOT = Path(__file__).resolve().parents[2]
#: A name of a scanner or the beginning of one.
NAME = re.compile(r"(HDL|VLP|VLS)(-|$)")


def names_in(node: ast.AST) -> bool:
    """Whether a constant, or a tuple, list or set of constants, names a scanner."""
    return any(
        isinstance(part, ast.Constant) and isinstance(part.value, str) and NAME.match(part.value)
        for part in ast.walk(node)
    )


def comparisons(source: str) -> list[int]:
    """Lines in which text is compared with the name of a scanner, or cut as if it were one."""
    found = []
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Compare(left=left, comparators=others):
                hit = any(names_in(part) for part in (left, *others))
            case ast.MatchValue(value=value):
                hit = names_in(value)
            case ast.Call(func=ast.Attribute(attr="startswith" | "endswith"), args=args):
                hit = any(names_in(part) for part in args)
            case ast.Subscript(value=value, slice=ast.Slice()):
                hit = bool(re.search(r"scanner(_name)?\W*$|\.name$", ast.unparse(value)))
            case _:
                hit = False
        if hit:
            found.append(node.lineno if hasattr(node, "lineno") else 0)
    return found


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ('if scanner.name == "HDL-64E":\n    pass', [1]),
        ('x = 1\ny = name in ("VLP-16", "VLS-128")', [2]),
        ('name.startswith("HDL")', [1]),
        ('row["scanner"][4:6]', [1]),
        ("scanner_name[4:]\nscanner.name[:3]\nscanner.flags[:2]", [1, 2]),
        ('match name:\n    case "VLP-32C":\n        pass', [2]),
        ('scanner = SCANNERS["HDL-64E"]\nprint(f"not an HDL-64E: {scanner.name}")', []),
        ('head.startswith(b"#ROSBAG")\nheader[4:6]', []),
    ],
)
def test_comparisons_are_found(source, lines):
    assert comparisons(source) == lines


def test_no_source_compares_names_of_scanners():
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for folder in ("src", "scripts")
        for path in sorted((ROOT / folder).rglob("*.py"))
        if path != ROOT / "src/velocal/scanner/models.py"
        for line in comparisons(path.read_text(encoding="utf-8"))
    ]
    assert found == []


@pytest.mark.parametrize("name", SCANNERS)
def test_properties_of_the_scanners(name):
    scanner = SCANNERS[name]
    hdl64 = {"HDL-64E", "HDL-64E-S1", "HDL-64E-S3"}
    assert (scanner.family is Family.HDL64) == (name in hdl64)
    assert scanner.paired == (name in hdl64)
    assert scanner.coarse_encoder == (name in hdl64)
    assert scanner.has_factory_file == (name in hdl64)
    assert scanner.embeds_calibration == (name in {"HDL-64E", "HDL-64E-S3"})
    assert scanner.range_sigma_m == (0.02 if name in hdl64 | {"HDL-32E"} else 0.03)
    assert scanner.short_name == str(scanner.n_lasers)
    # The beam model waits for each laser but where the manual's formula does not.
    assert scanner.azimuth_delay_s.any() == (name not in hdl64)
    assert (scanner.firing_time_s is None) == (name == "HDL-64E-S1")
