"""What the figures show, in a sentence or two for the report."""

from __future__ import annotations

import numpy as np
import pandas as pd

from velocal.evaluation.candidates import Role
from velocal.evaluation.holdout import LEVEL
from velocal.evaluation.interior_map import STATES
from velocal.reporting.figures.per_laser import TITLES, name_after
from velocal.reporting.figures.plan import MEDIANS
from velocal.study.figures import (
    CorrectionsFigure,
    Figure,
    FlowFigure,
    FrameFigure,
    HistogramFigure,
    LaserFigure,
    MapFigure,
    PacketFigure,
    PlanFigure,
    ProcedureFigure,
    ResidualFigure,
)


def caption(selection: Figure, numbers: pd.DataFrame) -> str:
    """What a figure shows, in a few sentences.

    Parameters
    ----------
    selection : Figure
        Entry of the configuration.
    numbers : DataFrame
        Those of the figure, see the module of its kind in `velocal.reporting.figures`.

    Returns
    -------
    str
    """
    match selection:
        case MapFigure():
            return _map_caption(selection, numbers)
        case PlanFigure():
            return _plan_caption(selection, numbers)
        case HistogramFigure():
            return (
                f"Residuals s of laser {selection.laser} before and after calibration "
                f"({_of_what(selection)}; all windows together, same bins and axes)."
            )
        case LaserFigure():
            return _laser_caption(selection, numbers)
        case CorrectionsFigure():
            return _corrections_caption(selection, numbers)
        case PacketFigure():
            return (
                f"Record of a data packet of the {selection.scanner}, from the whole to one "
                "channel, as the decoder reads it. A block belongs to the lasers of its flag, "
                "wherever it stands. Fields of few bytes are drawn wider than they are."
            )
        case FrameFigure():
            return (
                "Scanner frame and the parameters dl, alpha, v, voff and hoff of a laser in "
                "equations (1) to (3), exaggerated; on the right the nominal angles of the lasers "
                f"of an {selection.scanner}."
            )
        case ResidualFigure():
            return (
                "Residual s along the beam, distance D from the plane, and the angles of the "
                "paper's Table I: omega between the trace of the wall and the Y axis, beta between "
                "the trace and the beam. For a vertical wall the paper's form gives the same s."
            )
        case FlowFigure():
            return (
                "Rules of the workflow and what they pass on. Outputs that many rules take are "
                "named in italics in place of an arrow. Dashed: what the scanner, the surveyor and "
                "the factory hand over."
            )
        case ProcedureFigure():
            return (
                "Recordings that are averaged to each parameter set, those that are only validated "
                "with it, and the tables that show their medians or single scans."
            )


def outdoor_caption(kind: str, scanner: str, numbers: pd.DataFrame) -> str:
    """What a figure of the outdoor validation shows.

    Parameters
    ----------
    kind, scanner : str
        Conditions and scanner of the samples.
    numbers : DataFrame
        As `panels.numbers` gives them.

    Returns
    -------
    str
    """
    near, far = float(numbers["distance_m"].min()), float(numbers["distance_m"].max())
    before, after = (float(numbers[f"{state}_cm"].mean()) for state in ("before", "after"))
    name = numbers["parameter_set"].iloc[0]
    return (
        f"Standard deviation of s against the distance of the panels, {scanner} in {kind} "
        f"conditions, {len(numbers)} samples from {near:.0f} to {far:.0f} m: mean {before:.2f} cm "
        f"with the factory's parameters, {after:.2f} cm with parameter set {name} (dotted lines). "
        "The outdoor figures share one scale."
    )


def _of_what(selection: LaserFigure | HistogramFigure) -> str:
    samples = ", ".join(selection.samples)
    return f"{selection.scanner}, {selection.data} data, samples {samples}"


def _laser_caption(selection: LaserFigure, numbers: pd.DataFrame) -> str:
    role = numbers.loc[numbers["calibration"] == "after", "role"].iloc[0]
    name = f"parameter set {name_after(numbers)}"
    with_what = {
        Role.WINDOW: "the parameters adjusted on each window itself",
        Role.UNIT: f"{name}, the calibration of the unit as a whole",
    }.get(Role(role), f"{name}, that of least mean standard deviation over these samples")
    what = TITLES[selection.kind]
    about = "Root mean square about zero" if selection.kind == "std" else "Of all residuals"
    return (
        f"{what[0].upper()}{what[1:]} per laser before and after calibration "
        f"({_of_what(selection)}). {about}; windows count by their number of residuals. "
        f"After: {with_what}."
    )


def _plan_caption(selection: PlanFigure, numbers: pd.DataFrame) -> str:
    views = numbers[["position", "sample"]].drop_duplicates().itertuples(index=False)
    places = ", ".join(f"{position} (sample {sample})" for position, sample in views)
    return (
        f"Test field in plan with the medians that the {selection.scanner} measured from "
        f"{places}, in the site frame by the surveyed pose, factory parameters, middle "
        f"window. Every n-th median is drawn, {MEDIANS} at most of each plane."
    )


def _corrections_caption(selection: CorrectionsFigure, numbers: pd.DataFrame) -> str:
    parameters = list(dict.fromkeys(numbers["parameter"]))
    weak = numbers[numbers["weakly_determined"] == 1]
    counts = [
        f"{name} of {weak.loc[weak['parameter'] == name, 'laser'].nunique()}"
        for name in parameters
        if (weak["parameter"] == name).any()
    ]
    tail = (
        "Open marks: the data determine less than half of the parameter, and its correction and "
        f"interval are mostly those of the prior ({', '.join(counts)} lasers)."
        if counts
        else "The data determine every parameter."
    )
    sets = ", ".join(dict.fromkeys(numbers["parameter_set"]))
    return (
        f"Corrections of {', '.join(parameters)} to the factory's parameters of every laser of the "
        f"{selection.scanner}, {sets}, with {100 * LEVEL:g} % intervals from the stated standard "
        f"deviations. {tail}"
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
