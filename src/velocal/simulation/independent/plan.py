"""What `trial.draw` makes: a unit, its noise, a site and a survey, by the sizes of their errors.

The constants are plausible, not tuned: the noise of a shot is that of real recordings at 3-15 m.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

#: Corner and two sides of every surface, metres. The walls and the floor meet at the origin, the
#: board leans in front of them.
SURFACES: Mapping[str, tuple[tuple[float, float, float], ...]] = {
    "long": ((0.0, 0.0, 0.0), (6.5, 0.0, 0.0), (0.0, 0.0, 2.6)),
    "short": ((0.0, 0.0, 0.0), (0.0, 4.6, 0.0), (0.0, 0.0, 2.6)),
    "floor": ((0.0, 0.0, 0.0), (6.5, 0.0, 0.0), (0.0, 4.6, 0.0)),
    "board": ((6.4, 1.8, 0.1), (0.0, 1.6, 0.0), (0.7, 0.0, 1.3)),
    "far": ((0.0, 4.9, 0.0), (6.5, 0.0, 0.0), (0.0, 0.0, 2.6)),
}


@dataclass(frozen=True, kw_only=True)
class UnitErrors:
    """True parameters of a unit minus those of its factory file: sizes of the errors.

    Attributes
    ----------
    dl_cm, alpha_deg, v_deg : float
        Standard deviations over the lasers.
    dl_mean_cm, alpha_mean_deg, v_mean_deg : float
        What is common to all lasers.
    hoff_mm, voff_mm : float
        Standard deviations over the lasers.
    two_point_cm : float
        If not zero, the file has a two-point correction that is right at the far point and
        beyond it, and this is the standard deviation of the error of its near point. The errors
        `dl_cm` and `dl_mean_cm` are then not used.
    """

    dl_cm: float = 1.9
    alpha_deg: float = 0.1
    v_deg: float = 0.1
    dl_mean_cm: float = 0.5
    alpha_mean_deg: float = 0.0
    v_mean_deg: float = 0.0
    hoff_mm: float = 0.0
    voff_mm: float = 0.0
    two_point_cm: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Errors of the measured distances: standard deviations.

    Attributes
    ----------
    shot_cm : float
        Of a single shot; every laser has its own, within a factor of about 1.35.
    pattern_cm : float
        Median over the lasers of the size of a pattern along azimuth, which is the same in all
        recordings of a station.
    pattern_log : float
        Scatter of the logarithm of that size over the lasers.
    pattern_deg : float
        Length over which the pattern is correlated.
    pattern_gaussian : bool
        Whether its correlation is ``exp(-d^2 / 4 pattern_deg^2)``, as that of the project's world,
        or ``exp(-d / pattern_deg)``.
    shift_cm : float
        Of a shift per laser and station.
    drift_cm : float
        Of a change per laser and window.
    surface_mm : tuple of float
        Least and largest size of a shift per laser and surface, the same at all stations, which
        some of the lasers have.
    surface_share : float
        Share of the lasers that have it, for every surface.
    near_cm : float
        Of an error per laser below about 2 m.
    azimuth_deg : float
        Of the azimuth of a median.
    """

    shot_cm: float = 0.65
    pattern_cm: float = 0.75
    pattern_log: float = 0.5
    pattern_deg: float = 0.5
    pattern_gaussian: bool = False
    shift_cm: float = 0.1
    drift_cm: float = 0.05
    surface_mm: tuple[float, float] = (0.0, 0.0)
    surface_share: float = 0.3
    near_cm: float = 0.0
    azimuth_deg: float = 0.005


@dataclass(frozen=True, kw_only=True)
class SurveyErrors:
    """How the surveyor works.

    Attributes
    ----------
    base_m : float
        Distance of the base targets from the middle of the base.
    base_targets : int
        Their number.
    scanner_mm, site_mm : float
        Standard deviations of a coordinate of a base target in the scanner frame, which is
        measured once, and in the site frame, which is measured at every station.
    wall_targets : int
        Targets on every surface.
    wall_mm : float
        Standard deviation of a coordinate of such a target.
    flatness_mm : float
        Root mean square of the relief of every surface.
    """

    base_m: float = 0.1
    base_targets: int = 6
    scanner_mm: float = 0.7
    site_mm: float = 1.0
    wall_targets: int = 12
    wall_mm: float = 1.0
    flatness_mm: float = 1.0


#: Noise of other scanners than the HDL-64E, which has the default values.
NOISE: Mapping[str, Noise] = {
    "HDL-32E": Noise(shot_cm=0.5, pattern_cm=0.3),
    "VLP-16": Noise(shot_cm=0.75, pattern_cm=0.4),
}
#: Places of the scanner: x, y (metres), heading (degrees). The first four are for calibrations.
PLACES = (
    (2.0, 1.9, 35.0),
    (4.1, 2.7, -120.0),
    (1.5, 3.3, 160.0),
    (3.3, 1.3, -40.0),
    (2.8, 3.0, 80.0),
    (4.9, 1.7, -10.0),
)
UNSEEN = 2


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A unit, a site and a survey, of which `draw` makes any number of examples.

    Attributes
    ----------
    scanner : str
    stations : int
        Stations of the calibration, 1 to 4.
    tilt_deg : float
        Tilt of the scanner at these stations, each to another side.
    windows : int
        Recorded windows of a station.
    shots : int
        Shots of a median.
    surfaces : tuple of str
        Surfaces that are surveyed and seen, out of `SURFACES`.
    every : int
        One azimuth bin of this number is used.
    unit : UnitErrors
    noise : Noise, optional
        That of the scanner in `NOISE` if left out.
    survey : SurveyErrors
    """

    scanner: str = "HDL-64E"
    stations: int = 1
    tilt_deg: float = 0.0
    windows: int = 3
    shots: int = 100
    surfaces: tuple[str, ...] = ("long", "short", "floor")
    every: int = 1
    unit: UnitErrors = field(default_factory=UnitErrors)
    noise: Noise | None = None
    survey: SurveyErrors = field(default_factory=SurveyErrors)

    @property
    def errors(self) -> Noise:
        """Noise of the scanner."""
        return self.noise or NOISE.get(self.scanner, Noise())
