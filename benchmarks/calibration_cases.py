"""The studies of `benchmarks/calibration.py`: units, surveys and sites whose truth is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from calibration_judge import study_trial
from calibration_methods import METHODS

from velocal.simulation.independent.plan import Noise, Plan, SurveyErrors, UnitErrors
from velocal.simulation.independent.trial import Trial, draw

#: The seeds of the page begin here; others are for the development of methods.
FIRST_SEED = 1001
ALL = tuple(name for names in METHODS for name in names)
FEW = tuple(name for name in ALL if not name.startswith("paper"))


@dataclass(frozen=True)
class Case:
    """One study.

    Attributes
    ----------
    text : str
        For people.
    make : callable
        Trial of a seed.
    methods : tuple of str
        Methods that are run on it.
    """

    text: str
    make: Callable[[int], Trial]
    methods: tuple[str, ...] = ALL


def _independent(text: str, methods: tuple[str, ...] = ALL, **options: object) -> Case:
    return Case(text, partial(draw, Plan(**options)), methods)  # type: ignore[arg-type]


def _study(scanner: str, stations: int, seed: int, *, two_point: bool = False) -> Trial:
    return study_trial(scanner, stations, seed - FIRST_SEED, two_point=two_point)


#: What a table on the accuracy of surveys needs.
SURVEYED = ("factory", "joint", "truth")
#: Surveys of different accuracy, all else alike: distance of the base targets from the middle
#: (metres), standard deviations of a coordinate of a base target in the site frame, and of a
#: target on a wall (mm). Base targets have 0.7 of the former in the scanner frame.
SURVEYS = (
    (0.3, 0.2, 1.0), (0.3, 1.0, 1.0), (0.1, 1.0, 1.0), (0.1, 3.0, 1.0), (0.1, 10.0, 1.0),
    (0.1, 1.0, 0.3), (0.1, 1.0, 3.0), (0.1, 1.0, 10.0), (0.3, 0.2, 0.3),
)  # fmt: skip
#: A survey whose poses are good to 0.02 deg.
ACCURATE = SurveyErrors(base_m=0.3, scanner_mm=0.1, site_mm=0.2, wall_targets=30, wall_mm=0.4)
WIDE = SurveyErrors(base_m=0.3)
_THINNED = {"scanner": "HDL-64E", "stations": 2, "every": 4, "windows": 1}


def _cases() -> dict[str, Case]:
    found = {}
    for scanner in ("HDL-64E", "HDL-32E", "VLP-16"):
        for n in (1, 2, 4):
            name, text = f"{scanner}-{n}", f"{scanner}, {n} station{'s' * (n > 1)}"
            found[name] = _independent(text, scanner=scanner, stations=n)
    for scanner in ("HDL-64E", "HDL-32E"):
        for n in (1, 2):
            found[f"{scanner}-{n}-study"] = Case(
                f"study's world, {scanner}, {n}", partial(_study, scanner, n)
            )
    found["HDL-64E-2-study-two-point"] = Case(
        "study's world, HDL-64E, 2, two-point file",
        partial(_study, "HDL-64E", 2, two_point=True),
        FEW,
    )
    for scanner in ("HDL-64E", "HDL-32E"):
        for n in (1, 2):
            found[f"{scanner}-{n}-wide"] = _independent(
                f"{scanner}, {n}, base of 0.3 m",
                FEW,
                scanner=scanner,
                stations=n,
                survey=WIDE,
                windows=1,
            )
    for tilt in (10.0, 20.0):
        found[f"tilt-{tilt:g}"] = _independent(
            f"HDL-64E, 2, tilt {tilt:g} deg", FEW, tilt_deg=tilt, **_THINNED
        )
    found["walls-1"] = _independent(
        "HDL-64E, 1, walls only", FEW, surfaces=("long", "short"), **_THINNED | {"stations": 1}
    )
    found["walls-2"] = _independent(
        "HDL-64E, 2, walls only", FEW, surfaces=("long", "short"), **_THINNED
    )
    found["board"] = _independent(
        "HDL-64E, 1, five surfaces", FEW,
        surfaces=("long", "short", "floor", "board", "far"), **_THINNED | {"stations": 1},
    )  # fmt: skip
    found["pattern"] = _independent(
        "pattern of 2 deg", FEW, noise=Noise(pattern_deg=2.0, pattern_gaussian=True), **_THINNED
    )
    for offset in (0.1, 0.3):
        found[f"common-{offset:g}"] = _independent(
            f"common offset {offset:g} deg, accurate survey", FEW, survey=ACCURATE,
            unit=UnitErrors(alpha_mean_deg=offset, v_mean_deg=offset), **_THINNED,
        )  # fmt: skip
    found["offsets"] = _independent(
        "hoff and voff off by 3 mm", FEW, unit=UnitErrors(hoff_mm=3.0, voff_mm=3.0), **_THINNED
    )
    found["offsets-accurate"] = _independent(
        "hoff and voff off by 3 mm, accurate survey", FEW, survey=ACCURATE,
        unit=UnitErrors(hoff_mm=3.0, voff_mm=3.0), **_THINNED,
    )  # fmt: skip
    found["surfaces"] = _independent(
        "surfaces shift lasers by 2-5 mm", FEW, noise=Noise(surface_mm=(2.0, 5.0)), **_THINNED
    )
    found["near"] = _independent(
        "error of 1.5 cm below 2 m", FEW, noise=Noise(near_cm=1.5), **_THINNED
    )
    for angle in (0.015, 0.05, 0.2):
        found[f"angles-{angle:g}"] = _independent(
            f"angle errors {angle:g} deg", FEW,
            unit=UnitErrors(alpha_deg=angle, v_deg=angle), **_THINNED,
        )  # fmt: skip
    for n in (1, 2, 4):
        found[f"two-point-{n}"] = _independent(
            f"two-point file, {n}", FEW, unit=UnitErrors(two_point_cm=2.0),
            **_THINNED | {"stations": n},
        )  # fmt: skip
    for base_m, base_mm, wall_mm in SURVEYS:
        found[f"survey-{base_m:g}-{base_mm:g}-{wall_mm:g}"] = _independent(
            f"base {base_m:g} m, {base_mm:g} mm; walls {wall_mm:g} mm", SURVEYED,
            survey=SurveyErrors(
                base_m=base_m, scanner_mm=0.7 * base_mm, site_mm=base_mm, wall_mm=wall_mm
            ), **_THINNED,
        )  # fmt: skip
    return found


CASES = _cases()
