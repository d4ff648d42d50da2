"""Scanners that a user describes in a YAML file, whose clouds of points can be calibrated."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from velocal.errors import ConfigError
from velocal.io.yaml_text import read_yaml
from velocal.scanner.models import (
    AZIMUTH_TICK_DEG,
    AZIMUTH_TICKS,
    SCANNERS,
    Family,
    Scanner,
    scanner_named,
)
from velocal.study.model import Count, Name, NotNegative, Positive, Section, fault, validated

#: Numbers of lasers, and raw distances in ticks, that a table of returns can hold.
MOST_LASERS, MOST_TICKS = 256, 65535
_Angles = Annotated[tuple[Annotated[float, Field(ge=-90, le=90)], ...], Field(strict=False)]
_Rotations = Annotated[tuple[Annotated[float, Field(ge=-360, le=360)], ...], Field(strict=False)]
_Offsets = Annotated[tuple[Annotated[float, Field(ge=-1, le=1)], ...], Field(strict=False)]


class ScannerFile(Section):
    """Description of a scanner whose packets are not read, but whose clouds of points are."""

    name: Name = Field(description="name of the scanner, for files and reports")
    lasers: Count = Field(le=MOST_LASERS, description="number of lasers")
    vertical_deg: _Angles = Field(
        description="nominal vertical angle of every laser, positive up, in the order in which the "
        "cloud numbers them"
    )
    rotational_deg: _Rotations = Field(
        default=(),
        description="nominal rotational correction of every laser, which is subtracted from the "
        "azimuth; zeros if left out",
    )
    vertical_offset_m: _Offsets = Field(
        default=(), description="height of every laser's origin; zeros if left out"
    )
    horizontal_offset_m: _Offsets = Field(
        default=(),
        description="offset of every laser's origin across its beam; zeros if left out",
    )
    distance_tick_m: Positive = Field(
        default=0.002, description="smallest step of a distance: distances are rounded to it"
    )
    azimuth_bin_deg: Positive = Field(
        description="width of the bins in which distances are reduced to medians: about the step "
        "from shot to shot, a divisor of 360 and a multiple of 0.01"
    )
    range_sigma_m: Positive = Field(
        description="standard deviation of a distance, by the datasheet"
    )
    min_range_m: NotNegative = Field(
        default=0.0, description="nearest distance; nearer points are left out"
    )
    max_range_m: Positive = Field(description="farthest distance")

    @model_validator(mode="after")
    def _of_one_scanner(self) -> ScannerFile:
        """Check what belongs together."""
        for key in ("vertical_deg", "rotational_deg", "vertical_offset_m", "horizontal_offset_m"):
            given = len(getattr(self, key))
            if given != self.lasers and (given or key == "vertical_deg"):
                raise fault(
                    f"{given} values",
                    key=key,
                    allowed=[f"{self.lasers}, one a laser"],
                    hint="Give one value for each laser, or correct `lasers`.",
                )
        if self.name in SCANNERS:
            raise fault(f"{self.name!r} is known already", key="name", hint="Choose another name.")
        ticks = self.azimuth_bin_deg / AZIMUTH_TICK_DEG
        if abs(ticks - round(ticks)) > 1e-6 or AZIMUTH_TICKS % max(round(ticks), 1):
            raise fault(
                f"{self.azimuth_bin_deg:g} does not divide the turn",
                key="azimuth_bin_deg",
                allowed=["a divisor of 360 that is a multiple of 0.01"],
            )
        if self.max_range_m > MOST_TICKS * self.distance_tick_m:
            raise fault(
                f"{self.max_range_m:g} m in ticks of {self.distance_tick_m:g} m",
                key="max_range_m",
                allowed=[f"up to {MOST_TICKS} ticks"],
                hint="Give a larger `distance_tick_m`.",
            )
        return self

    def scanner(self) -> Scanner:
        """Build the description that everything else works with."""

        def rows(values: tuple[float, ...]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
            return np.array(values or (0.0,) * self.lasers)

        return Scanner(
            name=self.name,
            family=Family.DESCRIBED,
            n_lasers=self.lasers,
            flags=(),
            firings_per_block=1,
            firing_cycle_s=float("nan"),
            packet_rate_hz=float("nan"),
            dual_packet_rate_hz=float("nan"),
            azimuth_bin_ticks=round(self.azimuth_bin_deg / AZIMUTH_TICK_DEG),
            max_range_m=self.max_range_m,
            factory_byte=None,
            firing_time_s=np.zeros(self.lasers),
            vertical_rad=np.deg2rad(rows(self.vertical_deg)),
            rotational_rad=np.deg2rad(rows(self.rotational_deg)),
            horizontal_offset_m=rows(self.horizontal_offset_m),
            vertical_offset_m=rows(self.vertical_offset_m),
            distance_tick_m=self.distance_tick_m,
            range_sigma_m=self.range_sigma_m,
            min_range_m=self.min_range_m,
        )


def read_scanner(path: str | Path) -> Scanner:
    """Read the description of a scanner that is not among `SCANNERS`.

    Its packets are not read, but clouds of points of it are (`read_cloud`).

    Parameters
    ----------
    path : str or Path
        YAML with the keys of `ScannerFile`; docs/file-formats.md has an example.

    Returns
    -------
    Scanner

    Raises
    ------
    ConfigError
        If the file cannot be read, or a key is unknown, missing or wrong.

    Examples
    --------
    >>> scanner = velocal.read_scanner("scanner.yaml")
    >>> scanner.n_lasers, scanner.azimuth_bin_ticks
    (4, 20)
    """
    content = read_yaml(Path(path), ConfigError)
    return validated(ScannerFile, content, str(path)).scanner()


def is_scanner_file(name: str) -> bool:
    """Whether a scanner is named by a file that describes it, which its suffix tells."""
    return name.lower().endswith((".yaml", ".yml"))


def scanner_of(name: str | Path, *, where: str | None = None) -> Scanner:
    """Scanner by its name, or by the file that describes it.

    Parameters
    ----------
    name : str or Path
        As in `SCANNERS`, or the path of a YAML file.
    where : str, optional
        Where the name stands, for the error.

    Returns
    -------
    Scanner

    Raises
    ------
    ConfigError
        As `read_scanner`, or if no scanner of that name is known.
    """
    named = str(name)
    return read_scanner(named) if is_scanner_file(named) else scanner_named(named, where=where)
