"""The Statistical Reference Datasets of NIST: their files, their models and their solutions.

The sets come with packages whose licences allow it (see nist-requirements.txt; `make nist` brings
them), with SciPy (Norris) or stand below (NoInt2, Longley). Models are written after the formulas
in the headers of the files; derivatives are complex steps, exact to machine precision.

From the shell: ``python tests/reference/nist.py FOLDER`` unpacks the data out of the archives in
that folder.
"""

from __future__ import annotations

import ast
import re
import sys
import tarfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import Decimal, localcontext
from fractions import Fraction
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Function of parameters, which may be complex, and predictors, shape (predictors, n).
Function = Callable[[NDArray[np.inexact], Array], NDArray[np.inexact]]

FOLDER = Path(__file__).resolve().parents[2] / ".venv" / "nist"
#: What is taken out of the archives, and under which name.
WANTED = (re.compile(r"[^/]+/NIST_STRD/(\w+\.dat)"), re.compile(r"[^/]+/tests/(test_wpolyfit\.py)"))


@dataclass(frozen=True)
class Problem:
    """One set: fit `function(b, x)` to y.

    Attributes
    ----------
    name, level : str
        Level is NIST's: lower, average, higher.
    function : callable
    x : ndarray, shape (predictors, n)
    y : ndarray, shape (n,)
    starts : tuple of ndarray
    parameters, std : ndarray, shape (u,)
        Certified.
    """

    name: str
    level: str
    function: Function
    x: Array
    y: Array
    starts: tuple[Array, ...]
    parameters: Array
    std: Array

    def misclosure(self, b: Array) -> Array:
        """Model minus observations."""
        with np.errstate(all="ignore"):  # some starts overflow on the way
            return np.asarray(self.function(b, self.x)) - self.y

    def jacobian(self, b: Array) -> Array:
        """Derivatives of the misclosures by complex steps, shape (n, u)."""
        columns = []
        for k in range(len(b)):
            h = 2.0 ** (np.frexp(b[k])[1] - 100)  # a power of two: linear models come out exactly
            moved = b.astype(np.complex128)
            moved[k] += 1j * h
            with np.errstate(all="ignore"):
                columns.append(np.asarray(self.function(moved, self.x)).imag / h)
        return np.stack(columns, axis=1)


def digits(found: Array, certified: Array) -> float:
    """Matching digits of the worst of several values: minus log10 of the relative error.

    Absolute where the certified value is zero, as NIST does; 15 at most.
    """
    size = np.where(certified == 0, 1.0, np.abs(certified))
    error = np.abs(found - certified) / size
    worst = float(np.max(error)) if np.all(np.isfinite(error)) else np.inf
    return float(np.clip(-np.log10(max(worst, 1e-300)), -99.0, 15.0))


# -- nonlinear -------------------------------------------------------------------------------------


def _exponential_rise(b, x):
    return b[0] * (1 - np.exp(-b[1] * x[0]))


def _chwirut(b, x):
    return np.exp(-b[0] * x[0]) / (b[1] + b[2] * x[0])


def _lanczos(b, x):
    return sum(b[k] * np.exp(-b[k + 1] * x[0]) for k in (0, 2, 4))


def _gauss(b, x):
    peaks = [b[k] * np.exp(-(((x[0] - b[k + 1]) / b[k + 2]) ** 2)) for k in (2, 5)]
    return b[0] * np.exp(-b[1] * x[0]) + peaks[0] + peaks[1]


def _cubic_over_cubic(b, x):
    above = b[0] + x[0] * (b[1] + x[0] * (b[2] + x[0] * b[3]))
    return above / (1 + x[0] * (b[4] + x[0] * (b[5] + x[0] * b[6])))


def _kirby2(b, x):
    return (b[0] + x[0] * (b[1] + x[0] * b[2])) / (1 + x[0] * (b[3] + x[0] * b[4]))


def _enso(b, x):
    turn = 2 * np.pi * x[0]
    year = b[1] * np.cos(turn / 12) + b[2] * np.sin(turn / 12)
    first = b[4] * np.cos(turn / b[3]) + b[5] * np.sin(turn / b[3])
    return b[0] + year + first + b[7] * np.cos(turn / b[6]) + b[8] * np.sin(turn / b[6])


#: Models by the name of the set.
MODELS: dict[str, Function] = {
    "Bennett5": lambda b, x: b[0] * (b[1] + x[0]) ** (-1 / b[2]),
    "BoxBOD": _exponential_rise,
    "Chwirut1": _chwirut,
    "Chwirut2": _chwirut,
    "DanWood": lambda b, x: b[0] * x[0] ** b[1],
    "ENSO": _enso,
    "Eckerle4": lambda b, x: b[0] / b[1] * np.exp(-0.5 * ((x[0] - b[2]) / b[1]) ** 2),
    "Gauss1": _gauss,
    "Gauss2": _gauss,
    "Gauss3": _gauss,
    "Hahn1": _cubic_over_cubic,
    "Kirby2": _kirby2,
    "Lanczos1": _lanczos,
    "Lanczos2": _lanczos,
    "Lanczos3": _lanczos,
    "MGH09": lambda b, x: b[0] * (x[0] ** 2 + x[0] * b[1]) / (x[0] ** 2 + x[0] * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * np.exp(b[1] / (x[0] + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * np.exp(-x[0] * b[3]) + b[2] * np.exp(-x[0] * b[4]),
    "Misra1a": _exponential_rise,
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x[0] / 2) ** -2),
    "Misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x[0]) ** -0.5),
    "Misra1d": lambda b, x: b[0] * b[1] * x[0] / (1 + b[1] * x[0]),
    # Of the logarithm of the observations.
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * np.exp(-b[2] * x[1]),
    "Rat42": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x[0])),
    "Rat43": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x[0])) ** (1 / b[3]),
    "Roszman1": lambda b, x: b[0] - b[1] * x[0] - np.arctan(b[2] / (x[0] - b[3])) / np.pi,
    "Thurber": _cubic_over_cubic,
}


def _lines(text: str, what: str) -> list[str]:
    """The lines that the header names for a part of the file."""
    match = re.search(rf"{what}\s+\(lines\s+(\d+)\s+to\s+(\d+)\)", text, re.IGNORECASE)
    assert match, f"the header does not say where {what} stand"
    return text.splitlines()[int(match[1]) - 1 : int(match[2])]


@cache
def nonlinear(name: str) -> Problem:
    """One of the 27 nonlinear sets."""
    text = (FOLDER / f"{name}.dat").read_text(encoding="ascii")
    level = re.search(r"(\w+) Level of Difficulty", text)
    assert level
    table = np.array([line.split("=")[1].split() for line in _lines(text, "Starting Values")])
    start_1, start_2, parameters, std = table.astype(float).T
    y, *x = np.array([line.split() for line in _lines(text, "Data")], dtype=float).T
    return Problem(
        name,
        level[1].lower(),
        MODELS[name],
        np.array(x),
        np.log(y) if name == "Nelson" else y,
        (start_1, start_2),
        parameters,
        std,
    )


# -- linear ----------------------------------------------------------------------------------------

#: Level of every linear set and, where it is a polynomial, the powers of x.
LINEAR: dict[str, tuple[str, range]] = {
    "Norris": ("lower", range(2)),
    "Pontius": ("lower", range(3)),
    "NoInt1": ("average", range(1, 2)),
    "NoInt2": ("average", range(1, 2)),
    "Filip": ("higher", range(11)),
    "Longley": ("higher", range(0)),
    **{f"Wampler{k}": ("higher", range(6)) for k in range(1, 6)},
}
#: Names that the file of the package gives to the sets.
NAMES_IN_FILE = {"Filippelli": "Filip", "Pontius": "Pontius", "Eberhardt": "NoInt1"}

#: NIST StRD, NoInt2 (Eberhardt): y, x.
NOINT2 = "3 4; 4 5; 4 6"
#: NIST StRD, Longley, of J. Am. Stat. Assoc. 62 (1967), 819: y, x1 to x6.
LONGLEY = """
    60323  83.0 234289 2356 1590 107608 1947; 61122  88.5 259426 2325 1456 108632 1948;
    60171  88.2 258054 3682 1616 109773 1949; 61187  89.5 284599 3351 1650 110929 1950;
    63221  96.2 328975 2099 3099 112075 1951; 63639  98.1 346999 1932 3594 113270 1952;
    64989  99.0 365385 1870 3547 115094 1953; 63761 100.0 363112 3578 3350 116219 1954;
    66019 101.2 397469 2904 3048 117388 1955; 67857 104.6 419180 2822 2857 118734 1956;
    68169 108.4 442769 2936 2798 120445 1957; 66513 110.8 444546 4681 2637 121950 1958;
    68655 112.6 482704 3813 2552 123366 1959; 69564 114.2 502601 3931 2514 125368 1960;
    69331 115.7 518173 4806 2572 127852 1961; 70551 116.9 554894 4007 2827 130081 1962
"""

Row = tuple[Fraction, ...]


@dataclass(frozen=True)
class Linear:
    """A linear set in exact numbers.

    Attributes
    ----------
    design : list of tuple of Fraction
    y : list of Fraction
    printed : ndarray, shape (u, 2), or None
        Certified parameters and standard deviations where the source has them.
    """

    design: list[Row]
    y: list[Fraction]
    printed: Array | None

    def exact(self) -> tuple[Array, Array]:
        """Parameters and standard deviations, by least squares in rational numbers."""
        u = len(self.design[0])
        normal = [
            [sum(row[i] * row[j] for row in self.design) for j in range(u)]
            + [sum(row[i] * y for row, y in zip(self.design, self.y, strict=True))]
            + [Fraction(int(i == j)) for j in range(u)]
            for i in range(u)
        ]
        for i in range(u):  # Gauss and Jordan; the matrix is positive definite
            normal[i] = [value / normal[i][i] for value in normal[i]]
            for j in set(range(u)) - {i}:
                factor = normal[j][i]
                normal[j] = [a - factor * b for a, b in zip(normal[j], normal[i], strict=True)]
        b = [row[u] for row in normal]
        squares = sum(
            (y - sum(p * q for p, q in zip(row, b, strict=True))) ** 2
            for row, y in zip(self.design, self.y, strict=True)
        )
        variances = [squares / (len(self.y) - u) * row[u + 1 + i] for i, row in enumerate(normal)]
        with localcontext(prec=40):
            std = [(Decimal(v.numerator) / Decimal(v.denominator)).sqrt() for v in variances]
        return np.array([float(p) for p in b]), np.array([float(s) for s in std])


def _table(text: str) -> list[Row]:
    return [tuple(map(Fraction, row.split())) for row in text.replace("\n", " ").split(";")]


def _polynomial(table: list[Row], powers: range, printed: Array | None) -> Linear:
    return Linear([tuple(x**k for k in powers) for _, x in table], [y for y, _ in table], printed)


@cache
def _packaged() -> dict[str, tuple[list[Row], Array]]:
    """Observations and certified values of the linear sets that the package's test holds."""
    tree = ast.parse((FOLDER / "test_wpolyfit.py").read_text(encoding="utf-8"))
    (tests,) = (
        node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "run_tests"
    )
    return dict(_walk(tests))


def _walk(tests: ast.FunctionDef) -> Iterator[tuple[str, tuple[list[Row], Array]]]:
    """Tables as they are assigned, and yielded where they are checked."""
    tables: dict[str, list[Row]] = {}
    for node in tests.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            texts = [each.value for each in ast.walk(node.value) if isinstance(each, ast.Constant)]
            (text,) = (each for each in texts if isinstance(each, str))
            tables[node.targets[0].id] = _table(text)
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            title = ast.literal_eval(node.value.args[0])
            name = NAMES_IN_FILE.get(title.split(",")[0], title)
            yield name, (tables["data"], np.array(tables["target"], dtype=float))


@cache
def linear_source(name: str) -> Linear:
    """One of the 11 linear sets, in exact numbers."""
    powers = LINEAR[name][1]
    if name == "Longley":
        table = _table(LONGLEY)
        return Linear([(Fraction(1), *row[1:]) for row in table], [row[0] for row in table], None)
    if name == "NoInt2":
        return _polynomial(
            _table(NOINT2), powers, np.array([[0.727272727272727, 0.0420827318078432]])
        )
    if name == "Norris":
        file = resources.files("scipy.stats") / "tests/data/nist_linregress/Norris.dat"
        text = file.read_text(encoding="ascii")
        table = _table(";".join(_lines(text, "Data")))
        rows = [line.split() for line in _lines(text, "Certified Values")]
        printed = np.array([row[1:] for row in rows if row[:1] in (["B0"], ["B1"])], dtype=float)
        return _polynomial(table, powers, printed)
    table, printed = _packaged()[name]
    return _polynomial(table, powers, printed[-len(powers) :])  # NoInt1 has a row for B0, too


@cache
def linear(name: str) -> Problem:
    """One of the 11 linear sets, with the exact solution for the certified one."""
    source = linear_source(name)
    parameters, std = source.exact()
    x = np.array(source.design, dtype=float).T
    y = np.array(source.y, dtype=float)
    start = np.zeros(len(parameters))
    return Problem(name, LINEAR[name][0], lambda b, x: b @ x, x, y, (start,), parameters, std)


def unpack(folder: Path) -> list[str]:
    """Take the data, and nothing else, out of the archives in a folder."""
    found = []
    for path in sorted(folder.glob("*.tar.gz")):
        with tarfile.open(path) as archive:
            for member in archive:
                match = next(filter(None, (p.fullmatch(member.name) for p in WANTED)), None)
                if match and (file := archive.extractfile(member)):
                    (folder / match[1]).write_bytes(file.read())
                    found.append(match[1])
    return found


if __name__ == "__main__":
    missing = {*(f"{name}.dat" for name in MODELS), "test_wpolyfit.py"} - set(
        unpack(Path(sys.argv[1]))
    )
    if missing:
        sys.exit(f"error: the archives lack {', '.join(sorted(missing))}")
