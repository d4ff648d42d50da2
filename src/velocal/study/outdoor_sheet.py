"""Rows of the sheet of outdoor samples, and what the configuration says of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from velocal.errors import ConfigError


@dataclass(frozen=True)
class OutdoorSample:
    """A recording of panels outdoors, as its row of the sheet has it.

    Attributes
    ----------
    name, kind, scanner, scene, recording, calibration : str
    distance_m, azimuth_deg : float
        About where the panels stand.
    """

    name: str
    kind: str
    scanner: str
    scene: str
    recording: str
    calibration: str
    distance_m: float
    azimuth_deg: float

    @classmethod
    def of(cls, row: Mapping[str, str]) -> OutdoorSample:
        """Sample of a row."""
        place = float(row["distance_m"]), float(row["azimuth_deg"])
        kind, scanner, scene = row["kind"], row["scanner"], row["scene"]
        return cls(
            row["sample"], kind, scanner, scene, row["recording"], row["calibration"], *place
        )


def check_outdoor(
    samples: Mapping[str, OutdoorSample],
    factories: Mapping[str, str],
    config: Mapping[str, Any],
    where: str,
) -> None:
    """Check that outdoor samples have parameter sets of their unit, and figures have samples.

    Parameters
    ----------
    samples : mapping of str to OutdoorSample
    factories : mapping of str to str
        Calibration file of every scanner that is calibrated.
    config : mapping
        The whole configuration.
    where : str
        How to call it in errors.

    Raises
    ------
    ConfigError
        For the first fault.
    """
    for sample in samples.values():
        if factories.get(sample.scanner) != sample.calibration:
            raise ConfigError(
                f"outdoor sample {sample.name!r}: {sample.calibration!r} is no calibration file "
                f"of a surveyed sample of {sample.scanner}",
                where=where,
                allowed=", ".join(f"{path} ({unit})" for unit, path in factories.items()),
                hint="Parameter sets are made from surveyed samples of the same unit.",
            )
    known = {(sample.kind, sample.scanner) for sample in samples.values()}
    for number, chosen in config.get("outdoor", {}).get("figures", {}).items():
        if tuple(chosen) not in known:
            raise ConfigError(
                f"outdoor.figures.{number}: no {chosen[0]} samples of {chosen[1]}",
                where=where,
                allowed=", ".join(" ".join(pair) for pair in sorted(known)),
            )
        if number in config.get("figures", {}):
            raise ConfigError(f"figure {number} stands in figures and outdoor.figures", where=where)
