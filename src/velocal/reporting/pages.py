"""Numbers in the pages of the project: results of the study, written between marks.

``python -m velocal.reporting.pages`` in the root of a checkout writes all of them (`make pages`).
With ``--check COMMAND`` nothing is written, but the pages are compared with the results that
COMMAND made: `make results` ends with this. The marks hold a digest of what goes into the results
too, so that a test notices old numbers without making any results.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from velocal.calibration.files import formats
from velocal.errors import StorageError, VelocalError, reported
from velocal.io import storage
from velocal.io.markup import inserted, markdown_table, marked
from velocal.paper.printed import PREFIX, TOLERANCES, printed_rows, printed_statements
from velocal.reporting.figures import methods
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import PARAMETERS
from velocal.survey.station import read_station

#: Pictures in the pages, by the figure that they are.
PICTURES = {"docs/images/figure_13.svg": "figures/figure_13.svg"}

#: What goes into the results of every command: files of the checkout, or a section of one. The
#: frozen numbers of the tiny study change when those of the calibration or of the simulated world
#: do, and not with every change of the library.
_STUDY = (
    "config/world.yaml",
    *(
        f"config/config.yaml:{section}"
        for section in (
            "simulation", "windows", "reduction", "assignment", "adjustment", "parameter_sets",
            "validation", "methods",
        )
    ),
    "tests/golden/tiny_study/statistics/summary.csv",
    "tests/golden/tiny_study/parameter_sets/HDL-64E/set1.csv",
    "tests/golden/tiny_study/parameter_sets/HDL-32E/set1.csv",
)  # fmt: skip
INPUTS = {
    "make results": _STUDY,
    "make coverage": (
        *_STUDY,
        "scripts/coverage.py",
        "src/velocal/simulation/coverage.py",
        "src/velocal/simulation/draws.py",
    ),
    "make seeds": (
        *_STUDY,
        "src/velocal/paper/data/tables.csv",
        "src/velocal/paper/data/statements.csv",
    ),
    "make field": ("config/unsurveyed.yaml", "config/unsurveyed_samples.tsv"),
}


@dataclass(frozen=True)
class Numbers:
    """What stands between two marks.

    Attributes
    ----------
    page : str
        Path of the page in the checkout.
    command : str
        Makes the results.
    write : callable
        Gives the Markdown from the folder of the results.
    """

    page: str
    command: str
    write: Callable[[Path], str]


def _frame(path: Path, *text: str) -> pd.DataFrame:
    return pd.DataFrame(storage.read_csv(path, text=text))


def _table(rows: list[dict[str, Any]], texts: int) -> str:
    """Markdown table of rows that are equal in their keys; the first `texts` columns hold text."""
    heads = list(rows[0])
    cells = [[str(cell) for cell in row.values()] for row in rows]
    return "\n".join(markdown_table(heads, cells, [i >= texts for i in range(len(heads))]))


def _files(results: Path, pattern: str) -> list[Path]:
    found = sorted(results.glob(pattern))
    if not found:
        raise StorageError("no such file", where=str(results / pattern))
    return found


def _agreement(results: Path) -> dict[str, dict[Any, Any]]:
    """Rows of the agreement, by item."""
    rows = _frame(results / "published/agreement.csv", "item", "within")
    return {row["item"]: row for row in rows.to_dict(orient="records")}


def statements(results: Path, *names: str) -> str:
    """Numbers in the paper's text beside those of the study.

    Parameters
    ----------
    results : Path
    *names : str
        What the items of the statements begin with.

    Returns
    -------
    str
    """
    found = _agreement(results)
    return _table(
        [
            {
                "what": row["what"],
                "unit": row["unit"],
                "paper": f"{row['paper']:g}",
                "study": f"{found[PREFIX + row['item']]['reproduced']:.2f}",
            }
            for row in printed_statements().to_dict(orient="records")
            if str(row["item"]).startswith(names)
        ],
        texts=2,
    )


def agreement(results: Path) -> str:
    """How many printed entries are reproduced within their tolerance."""
    found, rows = _agreement(results), []
    names = {quantity: [row.item(quantity) for row in printed_rows()] for quantity in TOLERANCES}
    of_text = [item for item in found if item.startswith(PREFIX)]
    for what, items in (names | {"numbers in the text": of_text}).items():
        within = sum(found[item]["within"] == "true" for item in items)
        allowed = f"{TOLERANCES[what]:g}" if what in TOLERANCES else "each its own"
        rows.append({"entries": what, "tolerance": allowed, "within": f"{within} of {len(items)}"})
    return _table(rows, texts=1)


def misses(results: Path) -> str:
    """Known misses by their reason."""
    rows = _frame(results / "published/misses.csv", "item", "reason")
    counted = rows.groupby("reason", sort=False).size()
    table = [{"why": why, "entries": count} for why, count in counted.items()]
    return _table(table, texts=1) if table else "No entry is missed."


def seeds(results: Path) -> str:
    """Entries whose mean over the seeds is outside the tolerance of means."""
    rows = _frame(results / "seeds/agreement.csv", "item", "within")
    outside = rows[rows["within"] != "true"]
    within = f"{len(rows) - len(outside)} of {len(rows)}"
    head = (
        f"Over {rows['seeds'].max():g} seeds the means of {within} entries are within the "
        "tolerance of means. These are the others:"
    )
    table = [
        {
            "entry": row["item"],
            "paper": f"{row['paper']:g}",
            "mean": f"{row['mean']:.2f}",
            "from seed to seed": f"{row['std']:.2f}",
            "tolerance": f"{row['tolerance']:g}",
        }
        for row in outside.to_dict(orient="records")
    ]
    return f"{head}\n\n{_table(table, texts=1)}" if table else head


def shown_lasers(results: Path) -> str:
    """Picture of the standard deviations of all lasers, with their means in the caption."""
    numbers = _frame(results / "figures/figure_13.csv", "calibration")
    mean = numbers.groupby("calibration")["rms_cm"].mean()
    return (
        "![Standard deviation of the residuals of 64 lasers, before and after]"
        "(docs/images/figure_13.svg)\n"
        "*Residuals of every laser of the simulated HDL-64E about the surveyed planes (figure 13 "
        f"of the study). The mean standard deviation is {mean['before']:.1f} cm with the factory's "
        f"calibration and {mean['after']:.1f} cm with ours.*"
    )


def survey(results: Path) -> str:
    """Pose of every position: standard deviations of the scanner's origin and of its rotation."""
    rows = []
    for path in _files(results, "survey/P*.json"):
        station = read_station(path)
        turned = np.rad2deg(np.sqrt(np.diag(station.pose.covariance)[:3]))
        rows.append(
            {
                "position": station.position,
                "scanner": station.scanner,
                "origin along X, Y, Z [mm]": _joined(1e3 * station.pose.origin_std_m(), 2),
                "rotation about X, Y, Z [deg]": _joined(turned, 3),
            }
        )
    return _table(rows, texts=2)


def _joined(values: np.ndarray[Any, Any], decimals: int) -> str:
    return ", ".join(f"{value:.{decimals}f}" for value in values)


def compared_methods(results: Path) -> str:
    """Methods of adjustment, compared, with what the report says of them."""
    names = ("method", "name", "reference", "parameters")
    numbers = _frame(results / "methods/comparison.csv", *names)
    left_out = ("reference", "planes", "parameters", "_within_1sigma_pct")
    shown = [name for name in map(str, numbers) if not name.endswith(left_out)]
    headings, rows = methods.rows(numbers[shown])
    table = markdown_table(headings, rows, [i > 0 for i in range(len(headings))])
    return "\n\n".join(["\n".join(table), *methods.verdict(numbers)])


_CASES = {
    "white": "white",
    "full: sizes unit": "all errors",
    "full: sizes configured": "all errors, sizes as configured",
}


def coverage(results: Path) -> str:
    """Stated standard deviations against true errors."""
    rows = []
    for row in _frame(
        results / "methods/coverage.csv", "case", "scanner", "method", "parameter", "compared_with"
    ).to_dict(orient="records"):
        case, _, names = (
            row["case"].partition(": ") if "white" in row["case"] else (row["case"],) * 3
        )
        weak = "" if row["observable"] else " (weakly determined)"
        rows.append(
            {
                "case": f"white, {names}" if case == "white" else _CASES[case],
                "scanner": row["scanner"],
                "method": f"`{row['method']}`",
                "parameter": row["parameter"] + weak,
                "runs x lasers": f"{row['runs']:g} x {row['lasers']:g}",
                "ratio": f"{row['ratio']:.2f} ({row['least_ratio']:.2f} to "
                f"{row['greatest_ratio']:.2f})",
                "95 % intervals cover (%)": f"{row['coverage_95_pct']:.1f}",
            }
        )
    runs = sorted({int(row["runs x lasers"].split()[0]) for row in rows}, reverse=True)
    scatter = ", ".join(f"{100 / np.sqrt(2 * n):.1f} % ({n} runs)" for n in runs)
    note = f"The ratio of a single laser is known to {scatter}: the extremes scatter by more."
    return f"{_table(rows, texts=4)}\n\n{note}"


def errors_of_sets(results: Path) -> str:
    """Errors of the parameter sets against the truth, in stated standard deviations."""
    rows = []
    for path in _files(results, "parameter_sets/*/*.json"):
        scanner = SCANNERS[path.parent.name]
        found = formats.read_calibration(path, scanner.n_lasers)
        truth = results / f"simulation/truth/{scanner.name}.csv"
        true = formats.read_calibration(truth, scanner.n_lasers).parameters
        row: dict[str, Any] = {"set": f"{scanner.name} {path.stem}"}
        for name in (name for name in PARAMETERS if name in found.std):
            error = (getattr(found.parameters, name) - getattr(true, name)) / found.std[name]
            inside = 100 * np.mean(np.abs(error) < _QUANTILE)
            row[name] = f"{np.sqrt(np.mean(error**2)):.2f} ({inside:.0f} %)"
        rows.append(row)
    return _table(rows, texts=1)


#: Two-sided quantile of the normal distribution, 95 %.
_QUANTILE = 1.96


def field(results: Path) -> str:
    """Planes found in recordings without a survey: ranges over the planes of each."""
    rows = _frame(results / "field-samples/field/table.csv", "sample", "scanner", "plane")
    return _table(
        [
            {"sample": f"`{sample}`", "planes": len(of)}
            | {f"`{name}`": _range(of[name], decimals) for name, decimals in _FIELD.items()}
            for sample, of in rows.groupby("sample", sort=False)
        ],
        texts=1,
    )


#: Columns of the planes that are shown, and their decimals.
_FIELD = {"range_m": 1, "incidence_deg": 0, "rms_cm": 1, "std_cm": 1, "spread_cm": 1}


def _range(values: pd.Series[Any], decimals: int) -> str:
    known = values.dropna()
    ends = [f"{value:.{decimals}f}" for value in (known.min(), known.max())]
    return " to ".join(ends) if len(known) else "–"


#: All numbers in pages, by their name.
NUMBERS: Mapping[str, Numbers] = {
    "lasers": Numbers("README.md", "make results", shown_lasers),
    "improvement": Numbers("docs/how-to.md", "make results", lambda at: statements(at, "indoor")),
    "methods": Numbers("docs/methods.md", "make results", compared_methods),
    "errors_of_sets": Numbers("docs/uncertainty.md", "make results", errors_of_sets),
    "coverage": Numbers("docs/uncertainty.md", "make coverage", coverage),
    "accuracy": Numbers(
        "docs/simulated-world.md",
        "make results",
        lambda at: statements(at, "gcp_mse", "target_mse", "base_local_mse", "base_scanner_mse"),
    ),
    "pose": Numbers("docs/simulated-world.md", "make results", survey),
    "outdoor": Numbers(
        "docs/simulated-world.md", "make results", lambda at: statements(at, "outdoor")
    ),
    "agreement": Numbers("docs/simulated-world.md", "make results", agreement),
    "misses": Numbers("docs/simulated-world.md", "make results", misses),
    "seeds": Numbers("docs/simulated-world.md", "make seeds", seeds),
    "field": Numbers("docs/field.md", "make field", field),
}


def maker(command: str, root: Path) -> str:
    """What the mark of numbers says after "made by".

    Parameters
    ----------
    command : str
    root : Path
        A checkout.

    Returns
    -------
    str
        The command, and a digest of what goes into its results. Comments and the order of keys in
        YAML files do not change the digest.
    """
    digest = hashlib.sha256()
    names = dict.fromkeys(each.partition(":")[0] for each in INPUTS[command])
    texts = {name: (root / name).read_text(encoding="utf-8") for name in names}
    values = {name: yaml.safe_load(texts[name]) for name in names if name.endswith(".yaml")}
    for each in INPUTS[command]:
        name, _, key = each.partition(":")
        if name in values:
            content = values[name].get(key) if key else values[name]
            texts[name] = json.dumps(content, sort_keys=True)
        digest.update(f"{each}\0{texts[name]}\0".encode())
    return f"{command}, inputs {digest.hexdigest()[:12]}"


def old(root: Path) -> list[str]:
    """Numbers in pages that were made from other inputs than those of a checkout.

    Parameters
    ----------
    root : Path
        A checkout; it does not need results.

    Returns
    -------
    list of str
        What is old, and which command makes it again.
    """
    now = {command: maker(command, root) for command in {n.command for n in NUMBERS.values()}}
    return [
        f"{numbers.page}: numbers {name}: made by {said}; now it is {now[numbers.command]}"
        for name, numbers in NUMBERS.items()
        if (said := _mark(root, name)[0]) != now[numbers.command]
    ]


def _mark(root: Path, name: str) -> tuple[str, str]:
    page = NUMBERS[name].page
    try:
        return marked((root / page).read_text(encoding="utf-8"))[name]
    except KeyError:
        raise VelocalError(f"no marks with the name {name!r}", where=page) from None


def different(root: Path, results: Path, command: str) -> list[str]:
    """Numbers in pages that are not those of the results of a command.

    Parameters
    ----------
    root, results : Path
    command : str
        As in `Numbers`.

    Returns
    -------
    list of str
        Page, name, and the first line that differs by more than one unit of the last digit.
    """
    faults = []
    for name, numbers in NUMBERS.items():
        if numbers.command != command:
            continue
        stated = _mark(root, name)[1].splitlines()
        found = numbers.write(results).strip().splitlines()
        pairs = zip([*stated, *[""] * len(found)], [*found, *[""] * len(stated)], strict=False)
        for line, new in pairs:
            if not same_numbers(line, new):
                faults.append(
                    f"{numbers.page}: numbers {name}\n    page    {line}\n    results {new}"
                )
                break
    return faults


_NUMBER = re.compile(r"\d+(?:\.\d+)?")


def same_numbers(one: str, other: str) -> bool:
    """Whether two lines are the same but for a unit of the last digit of numbers with decimals.

    Parameters
    ----------
    one, other : str

    Returns
    -------
    bool
        Machines round in different ways, so that a last digit may differ.
    """
    if _NUMBER.sub("0", one) != _NUMBER.sub("0", other):
        return False
    pairs = zip(_NUMBER.findall(one), _NUMBER.findall(other), strict=True)
    return all(_close(a, b) for a, b in pairs)


def _close(a: str, b: str) -> bool:
    decimals = len(a.partition(".")[2])
    if decimals != len(b.partition(".")[2]):
        return False
    return abs(float(a) - float(b)) < (1.5 * 10.0**-decimals if decimals else 0.5)


def write(root: Path, results: Path) -> list[str]:
    """Write all numbers into their pages, where results have what they need.

    Parameters
    ----------
    root, results : Path

    Returns
    -------
    list of str
        One line per text between marks: written, or which file is missing.
    """
    said = []
    for name, numbers in NUMBERS.items():
        page = root / numbers.page
        text = page.read_text(encoding="utf-8")
        try:
            content = numbers.write(results)
        except StorageError as error:
            said.append(f"{numbers.page}: {name} left as it is: {error}")
            continue
        storage.write_text(page, inserted(text, name, content, maker=maker(numbers.command, root)))
        said.append(f"{numbers.page}: {name}")
    for picture, figure in PICTURES.items():
        shutil.copyfile(results / figure, root / picture)
    return said


def main(arguments: list[str] | None = None) -> None:
    """Write the numbers, or compare them with the results of one command.

    Parameters
    ----------
    arguments : list of str, optional
        Of the command line.

    Raises
    ------
    VelocalError
        If a page has other numbers than the results.
    """
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--check", metavar="COMMAND", choices={n.command for n in NUMBERS.values()})
    options = parser.parse_args(arguments)
    if options.check is None:
        print("\n".join(write(Path(), options.results)))
    elif faults := different(Path(), options.results, options.check):
        raise VelocalError(
            f"{len(faults)} pages have other numbers than {options.results}:\n  "
            + "\n  ".join(faults),
            where="documents",
            hint="If the new numbers are meant: make pages, and commit the pages.",
        )


if __name__ == "__main__":
    with reported():
        main()
