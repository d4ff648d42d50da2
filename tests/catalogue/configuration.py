"""Faulty configurations of a study."""

from __future__ import annotations

from pathlib import Path

from catalogue.case import PLAN, Case, Outcome
from catalogue.study import CONFIG, ROOT, replaced, rewritten


def _for(old: str, new: str) -> object:
    return replaced((CONFIG, old, new))


def _first(lines: str) -> object:
    return rewritten(CONFIG, lambda text: lines + "\n" + text)


_LETTERS = "bcdefghi"
_LISTS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{k}: &{k} [{', '.join([f'*{chr(ord(k) - 1)}'] * 9)}]\n" for k in _LETTERS
)
_KEYS = "a: &a {x: 1}\n" + "".join(
    f"{k}: &{k} {{{', '.join(f'k{n}: *{chr(ord(k) - 1)}' for n in range(9))}}}\n" for k in _LETTERS
)
_SHORT = """\
study: a
results: results
samples: samples.tsv
survey: folder
reduction: {min_count: 5}
"""
_ADJUSTMENT = "adjustment: {method: %s, parameters: %s, noise_cm: 2.0, prior: {dl_cm: 2.0}}"
_TITLE = 'study: "Calibration of an HDL-32E"'
_ROTATIONS, _SIGMA = "rotations: 100", "# sigma_cm: 2.0"

_REFUSED = {
    "empty file": rewritten(CONFIG, lambda _: ""),
    "a list": rewritten(CONFIG, lambda _: "- study\n"),
    "no YAML": _first("study: [1"),
    "indented with a tab": _for("  planes: survey", "\tplanes: survey"),
    "a colon in a title without quotes": _for(_TITLE, "study: Calibration: my scanner"),
    "not UTF-8": rewritten(
        CONFIG, lambda text: text.replace("Calibration", "Kalibrierung f\xfcr").encode("latin-1")
    ),
    "a control character": rewritten(
        CONFIG, lambda text: text.replace("Calibration", "\x1b[31mCalibration")
    ),
    "a control character, written as an escape": _for("Calibration", "\\x1b[31mCalibration"),
    "no such file": lambda folder: None,
    "aliases of lists that multiply": _first(_LISTS),
    "aliases of keys that multiply": _first(_KEYS),
    "an alias that contains itself": _first("x: &x {y: *x}"),
    "lists 3000 deep": _first("x: " + "[" * 3000 + "]" * 3000),
    "a key twice": _first("results: elsewhere"),
    "`!!int ''`": _for(_ROTATIONS, "rotations: !!int ''"),
    "`!!float ''`": _for(_ROTATIONS, "rotations: !!float ''"),
    "`!!timestamp x`": _for(_ROTATIONS, "rotations: !!timestamp x"),
    "`!!bool x`": _for(_ROTATIONS, "rotations: !!bool x"),
    "`!!binary` of no base 64": _for(_ROTATIONS, "rotations: !!binary é"),
    "a tag of Python": _for(_ROTATIONS, "rotations: !!python/name:os.system"),
    "expressions for Snakemake (`__use_yte__`)": _first("__use_yte__: true\nx: ?print('run')"),
    "a date that is none": _for(_ROTATIONS, "rotations: 2020-99-99"),
    "a date": _for(_ROTATIONS, "rotations: 2020-01-01"),
    "a whole number of 5000 digits": _for(_ROTATIONS, "rotations: " + "9" * 5000),
    "a whole number of 400 digits": _for(_ROTATIONS, "rotations: " + "9" * 400),
    "an unknown key": _first("windws: {rotations: 3}"),
    "an unknown key in a section": _for(_ROTATIONS, "rotation: 100"),
    "a missing section": _for("validation:\n", "validation_:\n"),
    "`survey` is text": rewritten(CONFIG, lambda _: _SHORT),
    "`samples` is a number": _for("samples: samples.tsv", "samples: 5"),
    "`results: a/../..`": _for("results: results ", "results: a/../.. "),
    "`results: /tmp`": _for("results: results ", "results: /tmp "),
    "`results: .`": _for("results: results ", "results: . "),
    "`results: ..`": _for("results: results ", "results: .. "),
    "`results: a/./b`": _for("results: results ", "results: a/./b "),
    "`results` with braces": _for("results: results ", "results: 'a{b}' "),
    "a title with braces": _for("Calibration", "{x} Calibration"),
    "a title of 2000 characters": _for("Calibration", "x" * 2000),
    "a path with braces": _for("survey/planes.csv", "'survey/{x}.csv'"),
    "a plane with braces": _for("[wall1, wall2, floor]", "[wall1, wall2, '{floor}']"),
    "a serial number with braces": _for('# serials: {HDL-32E: "..."}', "serials: {HDL-32E: '{1}'}"),
    "a survey file that does not exist": _for("survey/planes.csv", "survey/plane.csv"),
    "a sample table that does not exist": _for("samples: samples.tsv", "samples: sample.tsv"),
    "an unquoted number as a key": _for('  "2":', "  2:"),
    "an unquoted number with a zero as a key": _for('  "01":', "  01:"),
    "a truth value as a key": _first("on: 1"),
    "null as a key": _first("~: 1"),
    "a number as a name": _for("[wall1, wall2, floor]", "[1, wall2, floor]"),
    "a truth value as a name": _for("[wall1, wall2, floor]", "[no, wall2, floor]"),
    "null as a name": _for("[wall1, wall2, floor]", "[~, wall2, floor]"),
    "a number as a title": _for(_TITLE, "study: 2024"),
    "a truth value as a number": _for(_ROTATIONS, "rotations: true"),
    "text as a number": _for(_ROTATIONS, "rotations: ten"),
    "a decimal comma": _for(_SIGMA, "sigma_cm: 2,0"),
    "a number in quotes": _for(_SIGMA, "sigma_cm: '2.0'"),
    "a number with a unit": _for(_SIGMA, "sigma_cm: 2 cm"),
    "0 rotations": _for(_ROTATIONS, "rotations: 0"),
    "half a rotation": _for(_ROTATIONS, "rotations: 0.5"),
    "`.inf`": _for(_SIGMA, "sigma_cm: .inf"),
    "`-.inf`": _for(_SIGMA, "sigma_cm: -.inf"),
    "`.nan`": _for(_SIGMA, "sigma_cm: .nan"),
    "1e308": _for(_SIGMA, "sigma_cm: 1.0e+308"),
    "1e-320": _for(_SIGMA, "sigma_cm: 1.0e-320"),
    "a negative standard deviation": _for(_SIGMA, "sigma_cm: -2.0"),
    "an angle of 90 deg": _for("incidence_deg: 80", "incidence_deg: 90"),
    "a width of an azimuth bin that does not divide 360": _for("{HDL-32E: 0.1}", "{HDL-32E: 0.07}"),
    "a width of an azimuth bin of 1e308": _for("{HDL-32E: 0.1}", "{HDL-32E: 1.0e+308}"),
    "an unknown scanner": _for("{HDL-32E: 0.1}", "{HDL-32: 0.1}"),
    "a scanner without samples": _for("{HDL-32E: 0.1}", "{VLP-16: 0.2}"),
    "an unknown sample": _for("all: [sample1, sample2]", "all: [sample1, sample3]"),
    "no sample": _for("all: [sample1, sample2]", "all: []"),
    "an unknown kind of figure": _for("kind: std", "kind: stdd"),
    "a figure without its kind": _for("kind: std, ", ""),
    "a figure with a number of three digits": _for('"01"', '"001"'),
    "table 7": _for('  "2":', '  "7":'),
    "an unknown program": _for("# export: {xml: veloview,", "export: {xml: veloviewer} # "),
    "an unknown method": _first(_ADJUSTMENT % ("magic", "[dl]")),
    "an adjusted parameter without prior": _first(_ADJUSTMENT % ("prior", "[dl, v]")),
    "a parameter twice": _first(_ADJUSTMENT % ("prior", "[dl, dl]")),
    "methods judged on what they are adjusted on": _for("other: [sample2]", "other: [sample1]"),
    "comparison with the paper without its tables": _first("compare_with_paper: true"),
}


_USED = {
    "nothing: the template with a survey": replaced(),
    "a byte order mark": rewritten(CONFIG, lambda text: "\ufeff" + text),
    "JSON in place of YAML sections": _for(_SIGMA, '"sigma_cm": 2.0'),
    "a title in another script": _for("Calibration of", "標定 <b>&amp; $x$"),
    "a calibration called NA": _for("    all: [", "    NA: ["),
}


def _world(old: str, new: str) -> object:
    """Change the file of the simulated world."""

    def make(folder: Path) -> None:
        text = (ROOT / "config/world.yaml").read_text()
        assert old in text
        (folder / "world.yaml").write_text(text.replace(old, new, 1))

    return make


_WORLD = {
    "world: an unknown key": _world("seed:", "sead:"),
    "world: `seed: .inf`": _world("seed: ", "seed: .inf  # "),
    "world: a negative seed": _world("seed: ", "seed: -"),
    "world: a key twice": _world("seed: ", "seed: 1\nseed: "),
    "world: an unknown scanner": _world("HDL-64E:", "HDL-65E:"),
    "world: indented with a tab": _world("seed: ", "\tseed: "),
}

CASES = (
    *(Case(wrong, Outcome.REFUSED, make, PLAN) for wrong, make in _REFUSED.items()),
    *(Case(wrong, Outcome.USED, make, PLAN) for wrong, make in _USED.items()),
    *(
        Case(wrong, Outcome.REFUSED, make, ("read", "world", "world.yaml"))
        for wrong, make in _WORLD.items()
    ),
)
