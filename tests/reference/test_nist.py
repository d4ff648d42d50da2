"""The library's linear algebra against certified values of NIST's Statistical Reference Datasets.

Asked: 6 digits of the parameters and 4 of their standard deviations, in every set and from both
starts. docs/nist.md has the digits that are reached, and SciPy's.
"""

import re

import numpy as np
import pytest
from reference import nist, nist_fit

from velocal.io.markup import marked

PARAMETER_DIGITS, STD_DIGITS = 6, 4
#: The certified residuals, 8e-14 of values up to 2.5, are a few hundred roundings of a double: the
#: standard deviations, which are proportional to them, are known to three digits only.
STD_DIGITS_OF = {"Lanczos1": 2.5}
#: By how many digits the processor and the linear algebra of NumPy may change what is reached.
LAST_DIGITS = 2
PACKAGED = [name for name in nist.LINEAR if name not in ("Norris", "NoInt2", "Longley")]


@pytest.fixture(autouse=True)
def data(request):
    """Skip what needs the downloaded data where these are not there."""
    name = request.node.callspec.params["name"]
    if (name in nist.MODELS or name in PACKAGED) and not (nist.FOLDER / ".unpacked").exists():
        pytest.skip("no reference data of NIST. Hint: make nist (downloads them once)")


@pytest.mark.parametrize("name", nist.LINEAR)
def test_rational_solution_is_the_certified_one(name):
    printed = nist.linear_source(name).printed
    parameters, std = nist.linear_source(name).exact()
    if printed is None:  # Longley: its first coefficient and standard deviation as NIST has them
        assert nist.digits(parameters[:1], np.array([-3482258.63459582])) > 14
        assert nist.digits(std[:1], np.array([890420.383607373])) > 14
        return
    # 15 digits are printed, sometimes of more than one before the point.
    assert nist.digits(parameters, printed[:, 0]) > 14
    assert nist.digits(std, printed[:, 1]) > 14


@pytest.mark.parametrize("name", nist.LINEAR)
def test_linear_set(name):
    fit = nist_fit.ours(nist.linear(name), 0)
    check(fit)
    assert fit.parameter_digits > stated(name, 0) - LAST_DIGITS


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("name", nist.MODELS)
def test_nonlinear_set(name, start):
    fit = nist_fit.ours(nist.nonlinear(name), start)
    check(fit, STD_DIGITS_OF.get(name, STD_DIGITS))
    assert fit.parameter_digits > stated(name, start) - LAST_DIGITS


def stated(name: str, start: int) -> float:
    """Digits of the parameters that docs/nist.md states."""
    page = marked(nist_fit.DOC.read_text(encoding="utf-8"))
    rows = "\n".join(content for _, content in page.values())
    (digits,) = re.findall(rf"^\| {name} \| \w+ \| {start + 1} \| ([\d.]+) /", rows, re.MULTILINE)
    return float(digits)


def check(fit: nist_fit.Fit, std_digits: float = STD_DIGITS) -> None:
    assert fit.message.startswith("converged")
    assert fit.parameter_digits >= PARAMETER_DIGITS
    assert fit.std_digits >= std_digits
