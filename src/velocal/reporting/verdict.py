"""What a calibration has brought, in words: the first thing on the page of a study."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from velocal.evaluation.candidates import Role
from velocal.evaluation.certificate import Certificate
from velocal.reporting.templates import fixed

#: Parameters with their names in sentences.
_PARAMETERS = {
    "dl": "distance",
    "alpha": "rotational angle",
    "v": "vertical angle",
}
#: A parameter of which the data decide less than this share, for most lasers, is called open.
_LEAST_SHARE = 0.5


@dataclass(frozen=True)
class Verdict:
    """What the page says of one calibration at its top.

    Attributes
    ----------
    scanner, name, serial : str
        Serial number: empty if it was not given.
    good : bool
        Whether the calibration is better than the factory's.
    found : tuple of str
        What was found, a sentence each; the first one is the verdict.
    next : tuple of str
        What to do now, a sentence each.
    """

    scanner: str
    name: str
    serial: str
    good: bool
    found: tuple[str, ...]
    next: tuple[str, ...]


def verdict(one: Certificate, summary: pd.DataFrame | None) -> Verdict:
    """Put the result of a calibration into sentences.

    Parameters
    ----------
    one : Certificate
    summary : DataFrame or None
        Statistics of all windows of the study, if stations were surveyed.

    Returns
    -------
    Verdict
    """
    return Verdict(
        one.scanner,
        one.name,
        one.serial,
        one.recommended,
        (
            _judgement(one),
            *_within(one, summary),
            *(_known(one, name) for name in _PARAMETERS),
        ),
        (*_use(one), *_more(one)),
    )


def _judgement(one: Certificate) -> str:
    """Whether it is better, on what was held out."""
    gain = one.held_out_centred
    if gain is None:
        return f"The calibration could not be judged: {one.verdict}."
    numbers = (
        f"on what was held out, the residuals without the mean of all lasers go from "
        f"{_cm(gain.before_m)} to {_cm(gain.after_m)} cm (gain {_cm(gain.gain_m)} cm, 95 % "
        f"interval {_cm(gain.low_m)} to {_cm(gain.high_m)} cm)"
    )
    if one.recommended:
        return f"The calibration is better than the factory's: {numbers}."
    return f"The calibration is not recommended ({one.verdict}): {numbers}."


def _within(one: Certificate, summary: pd.DataFrame | None) -> list[str]:
    """Lasers within the datasheet before and after, on validation data if there are any."""
    if summary is None:
        return []
    rows = summary[(summary["scanner"] == one.scanner) & (summary["data"] == "validation")]
    before = rows.loc[rows["role"] == Role.FACTORY, "complies_correlated"].mean()
    of_unit = (rows["role"] == Role.UNIT) & (rows["parameter_set"] == one.name)
    after = rows.loc[of_unit, "complies_correlated"].mean()
    if not (np.isfinite(before) and np.isfinite(after)):
        return []
    return [
        f"Before, {before:.0f} of {len(one.lasers)} lasers were within the datasheet (mean over "
        f"the windows, test for correlated residuals); now there are {after:.0f}."
    ]


def _known(one: Certificate, name: str) -> str:
    """How well a parameter is known, and for how many lasers it is significant."""
    significant, lasers = one.significant(name), len(one.lasers)
    size = f"{one.expanded(name):.1f} mm" if name == "dl" else f"{one.expanded(name):.3f} deg"
    sentence = f"The correction of the {_PARAMETERS[name]} is known to {size} (k = 2)"
    if significant == lasers:
        return f"{sentence}; it is significant for all lasers."
    return f"{sentence}; it is not significant for {lasers - significant} of {lasers} lasers."


def _use(one: Certificate) -> list[str]:
    """Which files to use."""
    files = f"parameter_sets/{one.scanner}/{one.name}"
    if not one.recommended:
        return [
            "Keep the factory's file. The files for programs that were written contain its values.",
            "Read the warnings and the checks of the survey, then measure again.",
        ]
    sentences = [
        f"Use {files}.yaml with the ROS driver, {files}.xml with VeloView, and "
        f"{files}.velodyne_decoder.yaml with velodyne_decoder."
    ]
    if one.far_point_m:
        sentences.append(
            "At long range the distance correction stays that of the factory. Programs that "
            "cannot fade the correction out get the new angles only, unless the key "
            "export: distance asks for the distances too."
        )
    return sentences


def _more(one: Certificate) -> list[str]:
    """What would make the calibration better."""
    sentences = []
    if len(one.stations) == 1:
        sentences.append(
            "Record at a second position: with one, nothing independent checks the result."
        )
    open_ = [
        _PARAMETERS[name]
        for name in _PARAMETERS
        if np.median([getattr(laser, f"{name}_from_data") for laser in one.lasers]) < _LEAST_SHARE
    ]
    if open_:
        sentences.append(
            f"The data decide little of the {' and the '.join(open_)} of most lasers. Planes at "
            "another height, or a tilted scanner, decide more."
        )
    return sentences


def _cm(value_m: float) -> str:
    return f"{value_m * 1e2:.2f}"


def laser_note(one: Certificate, laser: int) -> str:
    """Say of one laser what is known of it.

    Parameters
    ----------
    one : Certificate
    laser : int
        Counted from 0.

    Returns
    -------
    str
    """
    row = one.lasers[laser]
    weak = [
        _PARAMETERS[name]
        for name in _PARAMETERS
        if getattr(row, f"{name}_from_data") < _LEAST_SHARE
    ]
    decided = "Every parameter is decided by the data for the larger part."
    if weak:
        decided = (
            f"Weakly determined: {', '.join(weak)}. What the data do not decide stays near the "
            "factory's value."
        )
    return (
        f"Distance {fixed(row.dl_mm, 1)} mm (± {fixed(row.dl_expanded_mm, 1)}) at "
        f"{row.range_m:.1f} m; rotational angle {fixed(row.alpha_deg, 3)} deg "
        f"(± {fixed(row.alpha_expanded_deg, 3)}); vertical angle {fixed(row.v_deg, 3)} deg "
        f"(± {fixed(row.v_expanded_deg, 3)}). {decided}"
    )
