"""Tables and checks from the draws of `benchmarks/calibration.py`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from calibration_cases import ALL, CASES, SURVEYS
from calibration_judge import RANGES_M

from velocal.io.markup import markdown_table

#: The method that people get, the one that is told the true spread, what nobody can do, and what
#: people had before.
DEFAULT, ORACLE, TRUTH, FACTORY = "joint", "oracle", "truth", "factory"
#: A set counts as worse than the factory's if its s at unseen stations is larger by this factor.
HARM = 1.02
PARAMETERS = {"dl": "dl_cm", "alpha": "alpha_deg", "v": "v_deg"}
#: Cases of the table in the issue that asked for the bench, and the methods that it shows.
ISSUE = [f"{scanner}-{n}" for scanner in ("HDL-64E", "HDL-32E", "VLP-16") for n in (1, 2, 4)]


def summarised(draws: pd.DataFrame) -> pd.DataFrame:
    """Median, mean, worst and share of harm of every case and method."""
    values = [c for c in draws.columns if c not in ("case", "seed", "method")]
    grouped = draws.groupby(["case", "method"], sort=False)
    parts = {
        "median": grouped[values].median(),
        "worst": grouped[values].max(),
        "mean": grouped[values].mean(),
        "rms": grouped[values].agg(lambda column: np.sqrt(np.mean(np.square(column)))),
    }
    table = pd.concat(parts, axis=1)
    table.columns = [f"{value}_{part}" for part, value in table.columns]
    harm = against(draws, FACTORY) > HARM
    table["harm"] = harm.groupby([draws["case"], draws["method"]]).mean().reindex(table.index)
    table["draws"] = grouped.size()
    order = {name: number for number, name in enumerate(ALL)}
    table = table.reset_index()
    table["place"] = [list(CASES).index(case) for case in table["case"]]
    table["rank"] = [order[method] for method in table["method"]]
    return table.sort_values(["place", "rank"]).drop(columns=["place", "rank"])


def complete(draws: pd.DataFrame) -> pd.DataFrame:
    """Rows of the draws that all methods of their case have run on, so that means compare."""
    methods = draws.groupby(["case", "seed"])["method"].transform("nunique")
    return draws[methods == methods.groupby(draws["case"]).transform("max")]


def against(draws: pd.DataFrame, method: str) -> pd.Series:
    """S at unseen stations of every row, divided by that of another method on the same draw."""
    other = draws[draws["method"] == method].set_index(["case", "seed"])["unseen_cm"]
    matched = other.reindex(pd.MultiIndex.from_frame(draws[["case", "seed"]])).to_numpy()
    return draws["unseen_cm"] / matched


def _cell(row: pd.Series, value: str, digits: int) -> str:
    median, worst = row[f"{value}_median"], row[f"{value}_worst"]
    return "" if np.isnan(median) else f"{median:.{digits}f} [{worst:.{digits}f}]"


def _coverage(row: pd.Series) -> str:
    cover = [row[f"cover_{name}_mean"] for name in PARAMETERS]
    known = [f"{100 * each:.0f}" if np.isfinite(each) else "-" for each in cover]
    return " / ".join(known) if any(each != "-" for each in known) else ""


def _rows(summary: pd.DataFrame, cases: Iterable[str]) -> Iterable[tuple[str, pd.Series]]:
    """Name of the study, only in its first row, and the row of every method."""
    for case in cases:
        for number, (_, row) in enumerate(summary[summary["case"] == case].iterrows()):
            yield f"{CASES[case].text} ({row['draws']} draws)" if not number else "", row


def errors_table(summary: pd.DataFrame, cases: Sequence[str]) -> str:
    """Median [worst] over the draws of the errors and of s at unseen stations."""
    headings = [
        "study", "method", "dl cm", "alpha deg", "v deg", "worst laser cm", "unseen cm",
        "centred cm", "induced cm", "cover dl / alpha / v %", "worse than factory %",
    ]  # fmt: skip
    digits = {
        "dl_cm": 2, "alpha_deg": 3, "v_deg": 3, "worst_dl_cm": 1, "unseen_cm": 2,
        "centred_cm": 2, "induced_cm": 2,
    }  # fmt: skip
    rows = [
        [
            study,
            row["method"],
            *(_cell(row, value, n) for value, n in digits.items()),
            _coverage(row),
            f"{100 * row['harm']:.0f}",
        ]
        for study, row in _rows(summary, cases)
    ]
    return "\n".join(markdown_table(headings, rows, [False, False] + [True] * 9))


def range_table(summary: pd.DataFrame, cases: Sequence[str]) -> str:
    """Root mean square error of points at ranges over the draws: in all, and along the beam."""
    headings = ["study", "method", *(f"{range_m:g} m" for range_m in RANGES_M)]
    rows = []
    for study, row in _rows(summary, cases):
        cells = [
            f"{row[f'point_{r:g}_cm_rms']:.2f} / {row[f'along_{r:g}_cm_rms']:.2f}" for r in RANGES_M
        ]
        rows.append([study, row["method"], *cells])
    return "\n".join(markdown_table(headings, rows, [False, False] + [True] * len(RANGES_M)))


def survey_table(summary: pd.DataFrame) -> str:
    """Errors of the default by the accuracy of the survey, and those of the factory."""
    headings = [
        "base: distance, targets", "turn of the pose deg", "targets on walls", "draws", "dl cm",
        "alpha deg", "v deg", "unseen cm", "induced cm",
    ]  # fmt: skip
    rows, before = [], []
    values = {"dl_cm": 2, "alpha_deg": 3, "v_deg": 3, "unseen_cm": 2, "induced_cm": 2}
    found = summary.set_index(["case", "method"])
    for base_m, base_mm, wall_mm in SURVEYS:
        case = f"survey-{base_m:g}-{base_mm:g}-{wall_mm:g}"
        if (case, DEFAULT) not in found.index:
            continue
        row, before = found.loc[case, DEFAULT], found.loc[case, FACTORY]
        # Six targets on a circle, measured in both frames; about the vertical.
        turn = np.rad2deg(np.hypot(1.0, 0.7) * base_mm * 1e-3 / (base_m * np.sqrt(6.0)))
        rows.append(
            [
                f"{base_m:g} m, {base_mm:g} mm", f"{turn:.2f}", f"{wall_mm:g} mm",
                f"{row['draws']:.0f}", *(_cell(row, value, n) for value, n in values.items()),
            ]
        )  # fmt: skip
    if rows:
        cells = [_cell(before, value, n) for value, n in values.items()]
        rows.append(["factory values", "", "", "", *cells])
    return "\n".join(markdown_table(headings, rows, [False, True, False] + [True] * 6))


@dataclass(frozen=True)
class Check:
    """One demand on the default method in one study.

    Attributes
    ----------
    demand : str
        What is demanded, with its limit.
    case : str
    value : float
    kept : bool
    error : float
        Standard error of the value from its scatter over the draws; NaN where it is not known.
    """

    demand: str
    case: str
    value: float
    kept: bool
    error: float = float("nan")


def checks(draws: pd.DataFrame, cost: pd.DataFrame | None) -> list[Check]:
    """Check everything that is demanded of the default, in every study that has its numbers."""
    summary = summarised(draws).set_index(["case", "method"])
    ratio = {name: against(draws, name) for name in (FACTORY, "dl")}
    found: list[Check] = []

    def at_most(demand: str, case: str, value: float, limit: float) -> None:
        found.append(Check(demand, case, value, bool(round(value, 2) <= limit)))

    cases = [c for c in CASES if (c, DEFAULT) in summary.index]
    for case in cases:
        row = summary.loc[case, DEFAULT]
        own = (draws["case"] == case) & (draws["method"] == DEFAULT)
        others = summary.loc[case].drop(index=[DEFAULT, ORACLE, TRUTH], errors="ignore")
        at_most(
            "mean of s at unseen stations, over that of the best other method: at most 1",
            case, row["unseen_cm_mean"] / others["unseen_cm_mean"].min(), 1.0,
        )  # fmt: skip
        at_most(
            "s at unseen stations in the worst draw, over the factory's: at most 1.02",
            case, ratio[FACTORY][own].max(), HARM,
        )  # fmt: skip
        if case.startswith("walls"):
            at_most(
                "walls only: the same over dl only: at most 1", case, ratio["dl"][own].max(), 1.0
            )
        before = summary.loc[case, FACTORY]
        for range_m in RANGES_M:
            for kind, text in (("point", "in all"), ("along", "along the beam")):
                column = f"{kind}_{range_m:g}_cm_rms"
                at_most(
                    f"error of points {text}, over the factory's: at most 1 at any range",
                    f"{case} at {range_m:g} m", row[column] / before[column], 1.0,
                )  # fmt: skip
        for name, column in PARAMETERS.items():
            found += _coverage_checks(name, case, draws[own][f"cover_{name}"])
            if (case, ORACLE) in summary.index:
                told = summary.loc[case, ORACLE]
                at_most(
                    f"error of {name}, over that of the oracle: at most 1.10",
                    case, row[f"{column}_rms"] / told[f"{column}_rms"], 1.1,
                )  # fmt: skip
            # "HDL-64E-2-wide", but not "tilt-20".
            one = "-".join("1" if part == "2" else part for part in case.split("-"))
            if case != one and (one, DEFAULT) in summary.index:
                at_most(
                    f"error of {name} with two stations, over that with one: at most 1",
                    case, _ratio_on_same_seeds(draws, column, case, one), 1.0,
                )  # fmt: skip
    of_default = draws[draws["method"] == DEFAULT]
    for name in PARAMETERS:
        found += _coverage_checks(name, "all studies together", of_default[f"cover_{name}"])[:1]
    for _, row in cost.iterrows() if cost is not None else ():
        if row["stations"] == 2:
            at_most(
                "seconds of a unit with two stations: at most 5",
                row["scanner"],
                row["seconds"],
                5.0,
            )
            at_most("MB of the same: at most 500", row["scanner"], row["peak_mb"], 500.0)
    return found


def _ratio_on_same_seeds(draws: pd.DataFrame, column: str, case: str, other: str) -> float:
    """Root mean square of an error of the default in a study, over that in another one."""
    of_default = draws[draws["method"] == DEFAULT].set_index("seed")
    pair = [of_default[of_default["case"] == each][column] for each in (case, other)]
    seeds = pair[0].index.intersection(pair[1].index)
    first, second = (float((each.loc[seeds] ** 2).mean()) for each in pair)
    return float(np.sqrt(first / second))


def _coverage_checks(name: str, case: str, of_draws: pd.Series) -> list[Check]:
    """Coverage of the intervals of a parameter, as it is and with its own uncertainty.

    The lasers of a draw share the survey and the learnt spread: the standard error is that of the
    mean over draws, not that of independent lasers.
    """
    limits = (93.0, 100.0 if name == "dl" else 97.0)
    text = "at least 93 %" if name == "dl" else "93 to 97 %"
    cover, n = 100.0 * float(of_draws.mean()), len(of_draws)
    error = 100.0 * float(of_draws.std(ddof=1)) / np.sqrt(n) if n > 1 else float("nan")
    demand = f"coverage of {name}: {text}"
    within = bool(limits[0] <= round(cover, 1) <= limits[1])
    found = [Check(demand, case, cover, within, error)]
    if n > 1:
        apart = max(limits[0] - cover, cover - limits[1])
        demand = f"{demand}, within two standard errors (more than one draw)"
        found.append(Check(demand, case, cover, within or apart <= 2.0 * error, error))
    return found


def check_table(found: Sequence[Check]) -> str:
    """One row per demand: how many studies keep it, and those that do not."""
    rows = []
    for demand in dict.fromkeys(check.demand for check in found):
        of_it = [check for check in found if check.demand == demand]
        missed = [f"{check.case}: {_value(check)}" for check in of_it if not check.kept]
        values = [check.value for check in of_it]
        rows.append(
            [
                demand,
                f"{len(of_it) - len(missed)} of {len(of_it)}",
                f"{min(values):.3g} to {max(values):.3g}",
                "; ".join(missed),
            ]
        )
    headings = ["demand on the default", "kept in", "values", "missed in"]
    return "\n".join(markdown_table(headings, rows, [False, True, True, False]))


def _value(check: Check) -> str:
    if not np.isfinite(check.error):
        return f"{check.value:.3g}"
    return f"{check.value:.1f} ± {check.error:.1f}"


def further_table(draws: pd.DataFrame) -> str:
    """Errors over those of the oracle in draws on which only some methods were run.

    The interval is that of the quotient if the draws had been others: 95 % of the quotients of as
    many draws that are taken from these at random, each as often as it comes.
    """
    headings = [
        "study", "draws", *(f"{name} over that of the oracle" for name in PARAMETERS),
        "cover dl / alpha / v %", "s at unseen stations in the worst draw, over the factory's",
    ]  # fmt: skip
    rng, rows = np.random.default_rng(1), []
    harm = against(draws, FACTORY)
    for case in (name for name in CASES if name in set(draws["case"])):
        own = draws[draws["case"] == case].pivot(index="seed", columns="method")
        chosen = rng.integers(0, len(own), (2000, len(own)))
        cells = []
        for column in PARAMETERS.values():
            default, told = (own[column, method].to_numpy() ** 2 for method in (DEFAULT, ORACLE))
            others = np.sqrt(default[chosen].mean(axis=1) / told[chosen].mean(axis=1))
            low, high = np.quantile(others, (0.025, 0.975))
            cells.append(f"{np.sqrt(default.mean() / told.mean()):.2f} ({low:.2f} to {high:.2f})")
        cover = [100.0 * own[f"cover_{name}", DEFAULT].mean() for name in PARAMETERS]
        worst = harm[(draws["case"] == case) & (draws["method"] == DEFAULT)].max()
        rows.append(
            [
                CASES[case].text, str(len(own)), *cells,
                " / ".join(f"{each:.1f}" for each in cover), f"{worst:.2f}",
            ]
        )  # fmt: skip
    return "\n".join(markdown_table(headings, rows, [False] + [True] * 6))


def harm_table(held: pd.DataFrame) -> str:
    """Draws in which the default is worse than the factory, and what the hold-out says of them."""
    headings = [
        "study", "seed", "s at unseen stations, over the factory's",
        "s on the stations that were left out, over the factory's", "verdict of the hold-out",
    ]  # fmt: skip
    rows = [
        [
            CASES[row["case"]].text, str(row["seed"]), f"{row['ratio']:.3f}", f"{row['held']:.3f}",
            row["verdict"],
        ]
        for _, row in held.iterrows()
    ]  # fmt: skip
    return "\n".join(markdown_table(headings, rows, [False, True, True, True, False]))


def cost_table(cost: pd.DataFrame) -> str:
    """CPU time and memory of the adjustment of a unit."""
    headings = ["scanner", "stations", "windows", "medians", "seconds", "peak memory MB"]
    rows = [
        [
            row["scanner"], str(row["stations"]), str(row["windows"]), f"{row['medians']:.0f}",
            f"{row['seconds']:.1f}", f"{row['peak_mb']:.0f}",
        ]
        for _, row in cost.iterrows()
    ]  # fmt: skip
    return "\n".join(markdown_table(headings, rows, [False] + [True] * 5))


def tables(
    draws: pd.DataFrame, cost: pd.DataFrame | None, held: pd.DataFrame | None = None
) -> dict[str, str]:
    """All tables, by the name of their place in the page."""
    further = draws.drop(complete(draws).index)
    draws = complete(draws)
    summary = summarised(draws)
    every = list(dict.fromkeys(summary["case"]))
    cases = [case for case in every if not case.startswith("survey-")]
    groups = {
        "bench_issue": [case for case in cases if case in ISSUE],
        "bench_study": [case for case in cases if "study" in case],
        "bench_other": [c for c in cases if c not in ISSUE and "study" not in c],
    }
    few = summary[summary["method"].isin([FACTORY, "prior", DEFAULT, ORACLE, TRUTH])]
    found = {name: errors_table(summary, group) for name, group in groups.items()}
    found["bench_ranges"] = range_table(few, cases)
    found["bench_surveys"] = survey_table(summary)
    found["bench_checks"] = check_table(checks(draws, cost))
    if len(further):
        found["bench_further"] = further_table(further)
    if cost is not None:
        found["bench_cost"] = cost_table(cost)
    if held is not None:
        found["bench_harm"] = harm_table(held)
    return found
