"""What the figures show, in a sentence or two for the report."""

from __future__ import annotations

import numpy as np
import pandas as pd

from velocal.evaluation.interior_map import STATES
from velocal.reporting.figures.per_laser import TITLES, name_after
from velocal.reporting.figures.plan import MEDIANS
from velocal.study.figures import Figure, HistogramFigure, MapFigure, PlanFigure


def caption(selection: Figure, numbers: pd.DataFrame) -> str:
    """What a figure shows, in one or two sentences.

    Parameters
    ----------
    selection : Figure
        Entry of the configuration.
    numbers : DataFrame
        Those of the figure, see `per_laser.per_laser`, `histogram.histogram`, `plan.plan` and
        `interior_map.section_table`.

    Returns
    -------
    str
    """
    if isinstance(selection, MapFigure):
        return _map_caption(selection, numbers)
    if isinstance(selection, PlanFigure):
        views = numbers[["position", "sample"]].drop_duplicates().itertuples(index=False)
        places = ", ".join(f"{position} (sample {sample})" for position, sample in views)
        return (
            f"Test field in plan with the medians that the {selection.scanner} measured from "
            f"{places}, in the site frame by the surveyed pose, factory parameters, middle "
            f"window. Every n-th median is drawn, {MEDIANS} at most of each plane."
        )
    samples = ", ".join(selection.samples)
    of_what = f"{selection.scanner}, {selection.data} data, samples {samples}"
    if isinstance(selection, HistogramFigure):
        return (
            f"Residuals s of laser {selection.laser} before and after calibration ({of_what}; "
            "all windows together, same bins and axes)."
        )
    with_what = (
        "the parameters adjusted on each window itself"
        if selection.data == "calibration"
        else f"parameter set {name_after(numbers)}, that of least mean standard deviation over "
        "these samples"
    )
    what = TITLES[selection.kind]
    about = "Root mean square about zero" if selection.kind == "std" else "Of all residuals"
    return (
        f"{what[0].upper()}{what[1:]} per laser before and after calibration ({of_what}). "
        f"{about}; windows count by their number of residuals. After: {with_what}."
    )


def _map_caption(selection: MapFigure, numbers: pd.DataFrame) -> str:
    name = next(iter(selection.sections)).replace("_", " ")
    before, after = (
        float(np.sqrt(np.mean(numbers[f"across_{state}_cm"] ** 2))) for state in STATES
    )
    return (
        f"Interior mapped by the {selection.scanner} with parameter set {selection.set}, one "
        f"rotation per position, poses by survey. Below, the same {len(numbers)} returns of the "
        f"wall {name} with the factory's parameters and with {selection.set}, from the straight "
        f"line fitted to each: root mean square {before:.2f} and {after:.2f} cm. The points are in "
        "map/points.parquet."
    )
