"""The file of the simulated world, typed: every constant with its unit in its name.

The reasons of the constants stand as comments in the file itself.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from velocal.study.model import (
    AcuteAngle,
    Count,
    Name,
    NotNegative,
    Pair,
    Placeholder,
    Positive,
    ScannerName,
    Section,
    Share,
    Span,
    Text,
    fault,
)

PositionName = Annotated[Name, Placeholder("{position}")]
SampleName = Annotated[Name, Placeholder("{sample}")]
BoxName = Annotated[Text, Placeholder("{box}")]
#: A kind of scenes must not end in a digit, as its scenes are numbered: kind1, kind2, ...
KindName = Annotated[str, Field(pattern=r"^[a-z]+$"), Placeholder("{kind}")]
Three = Annotated[tuple[float, float, float], Field(strict=False)]
Four = Annotated[tuple[float, float, float, float], Field(strict=False)]
Six = Annotated[tuple[float, float, float, float, float, float], Field(strict=False)]
ThreePositive = Annotated[tuple[Positive, Positive, Positive], Field(strict=False)]
Places = Annotated[tuple[Three, ...], Field(min_length=2, strict=False)]


class Flatness(Section):
    """Deviation of a surface from its plane."""

    mean_mm: NotNegative = Field(description="mean of the absolute deviations")
    max_mm: NotNegative = Field(description="largest absolute deviation")


class OfSurfaces(Section):
    """Flatness of every surface."""

    short_wall: Flatness = Field(description="of the short wall")
    long_wall: Flatness = Field(description="of the long wall")
    floor: Flatness = Field(description="of the floor")


class TargetCounts(Section):
    """Targets on every surface."""

    short_wall: int = Field(ge=4, description="targets on the short wall")
    long_wall: int = Field(ge=4, description="targets on the long wall")
    floor: int = Field(ge=4, description="targets on the floor")


class Site(Section):
    """Two walls at a right angle with the floor between them; their corner is the origin."""

    long_wall_m: Positive = Field(description="length of the long wall, along X")
    short_wall_m: Positive = Field(description="length of the short wall, along Y")
    wall_height_m: Positive = Field(description="height of both walls")
    floor_m: Pair = Field(description="surveyed part of the floor, from the corner")
    room_x_m: Span = Field(description="room around, along X: from, to")
    room_y_m: Span = Field(description="room around, along Y: from, to")
    room_height_m: Positive = Field(description="height of the room")
    flatness: OfSurfaces = Field(description="deviations of the surfaces from planes")
    targets: TargetCounts = Field(description="targets on the surfaces")


class ControlCounts(Section):
    """Control points on every surface."""

    short_wall: int = Field(ge=2, description="control points on the short wall")
    long_wall: int = Field(ge=2, description="control points on the long wall")
    floor: int = Field(ge=2, description="control points on the floor")


class TotalStation(Section):
    """Standard deviations of polar observations."""

    angle_arcsec: Positive = Field(description="of a direction and of a zenith angle")
    distance_mm: Positive = Field(description="of a distance, the constant part")
    distance_ppm: NotNegative = Field(description="of a distance, the part that grows with it")
    pointing_mm: NotNegative = Field(description="of pointing at a target")


class Camera(Section):
    """Camera of the photogrammetry."""

    principal_distance_mm: Positive = Field(description="principal distance")
    sensor_mm: Pair = Field(description="width and height of the sensor")
    image_um: Positive = Field(description="standard deviation of an image coordinate")
    incidence_deg: AcuteAngle = Field(description="largest angle at which a target is seen")


class SurveyWorld(Section):
    """How control points, targets and bases are observed."""

    control: ControlCounts = Field(description="control points on the surfaces")
    sketch_mm: Positive = Field(description="to which approximate coordinates are rounded")
    total_station: TotalStation = Field(description="accuracy of the instrument")
    stations: Places = Field(description="instrument stations of the network: X, Y, Z in metres")
    setups: dict[PositionName, Places] = Field(
        min_length=1, description="instrument stations for the base at a position"
    )
    camera: Camera = Field(description="camera")
    images: Annotated[tuple[Six, ...], Field(min_length=2, strict=False)] = Field(
        description="X, Y, Z of the camera and of the point that it looks at, metres"
    )


class Pose(Section):
    """True pose of a scanner."""

    x_m: float = Field(description="X of the scanner's origin")
    y_m: float = Field(description="Y of the scanner's origin")
    z_m: float = Field(description="Z of the scanner's origin")
    heading_deg: float = Field(description="clockwise from the Y axis of the site")
    tilt_x_deg: float = Field(description="tilt about X")
    tilt_y_deg: float = Field(description="tilt about Y")


class Position(Pose):
    """A position of the test site."""

    scanner: ScannerName = Field(description="scanner whose base stands here")


class SampleWarmth(Section):
    """Light and temperature of one recording."""

    halogen: bool = Field(description="whether the halogen light is on")
    start_k: float = Field(description="temperature at the start above the steady one")


class WarmthWorld(Section):
    """What drives the drifts: the temperature of the scanner."""

    duration_s: Positive = Field(
        description="duration of the experiment that a recording represents"
    )
    window_s: Positive = Field(
        description="duration of a window of the experiment; a third of a recording represents at "
        "least this duration"
    )
    time_constant_s: Positive = Field(description="time constant of the way to the steady state")
    halogen_k: float = Field(description="how much the halogen light warms in the steady state")
    samples: dict[SampleName, SampleWarmth] = Field(description="of single recordings")

    @model_validator(mode="after")
    def _windows_fit(self) -> WarmthWorld:
        if 3.0 * self.window_s > self.duration_s:
            raise fault(
                f"three windows of {self.window_s:g} s are longer than {self.duration_s:g} s",
                key="window_s",
            )
        return self


class PanelWorld(Section):
    """Two panels beside each other."""

    width_m: Positive = Field(description="width of a panel")
    height_m: Positive = Field(description="height of a panel")
    bottom_m: NotNegative = Field(description="height of the lower edge above the ground")
    gap_m: NotNegative = Field(description="gap between the panels")
    turned_deg: NotNegative = Field(description="turn of each panel about the vertical")
    flatness: Flatness = Field(description="deviation of a panel from its plane")


class Fog(Section):
    """What fog does to returns."""

    lost_per_m: NotNegative = Field(description="share of returns that is lost per metre")
    early_per_m: NotNegative = Field(description="share of returns that come from the fog")
    noise: NotNegative = Field(description="additional noise, as a share of that of the laser")


class People(Section):
    """People who walk through the scene."""

    count: int = Field(ge=0, description="number of people")
    radius_m: Positive = Field(description="radius of a person")
    height_m: Positive = Field(description="height of a person")
    speed_m_s: NotNegative = Field(description="speed")


class OutdoorKind(Section):
    """Scenes of one kind, numbered from 1."""

    distances_m: Annotated[tuple[Positive, ...], Field(min_length=1, strict=False)] = Field(
        description="distance of the panels in every scene"
    )
    fog: Fog = Field(description="fog")
    people: People = Field(description="people")


class OutdoorWorld(Section):
    """Outdoor scenes."""

    panel: PanelWorld = Field(description="the panels")
    azimuth_deg: float = Field(description="middle between the panels, from the scanner's Y axis")
    base_height_m: Positive = Field(description="height of the scanner")
    tilt_deg: NotNegative = Field(description="tilt of the scanner about X and Y, per scene")
    position_share: NotNegative = Field(
        description="share of the errors that stay with a position indoors"
    )
    kinds: dict[KindName, OutdoorKind] = Field(description="kinds of scenes")


class Reflectance(Section):
    """Intensity of the returns."""

    walls: float = Field(ge=0, le=240, description="from walls")
    floor: float = Field(ge=0, le=240, description="from the floor")


class BuildingBox(Section):
    """A wall or pillar from floor to ceiling."""

    x_m: Span = Field(description="from, to")
    y_m: Span = Field(description="from, to")
    openings_m: Annotated[tuple[Four, ...], Field(strict=False)] = Field(
        default=(),
        description="doors and windows through the box, along its longer side: from, to, bottom, "
        "top",
    )


class Building(Section):
    """Interior that is mapped from several positions."""

    scanner: ScannerName = Field(description="scanner that maps the building")
    size_m: Pair = Field(description="inside along X and Y, corner at the origin")
    height_m: Positive = Field(description="height of the storey")
    reflectance: Reflectance = Field(description="intensity of the returns")
    base_std_mm: Positive = Field(description="standard deviation of the targets on the base")
    boxes: dict[BoxName, BuildingBox] = Field(min_length=1, description="walls and pillars")
    positions: dict[PositionName, Pose] = Field(min_length=1, description="positions")


class BaseTargets(Section):
    """Targets on the base of a scanner."""

    layout: Literal["two_sides", "half_circle"] = Field(description="how the targets are arranged")
    count: int = Field(ge=3, description="number of targets")
    radius_m: Positive = Field(description="distance of the targets from the axis")


class BaseScanner(Section):
    """How the targets are measured in the scanner frame."""

    readings: Count = Field(description="number of repeated coordinates of every target")
    std_mm: ThreePositive = Field(description="standard deviation of one coordinate: X, Y, Z")


class FactoryWorld(Section):
    """How the factory's values of a unit scatter about the design; standard deviations."""

    dist_mean_m: NotNegative = Field(description="mean distance correction")
    dist_cm: NotNegative = Field(description="of a distance correction")
    rotational_unit_deg: NotNegative = Field(description="of a unit's common rotational angle")
    rotational_deg: NotNegative = Field(description="of a rotational angle")
    vertical_unit_deg: NotNegative = Field(description="of a unit's common vertical angle")
    vertical_deg: NotNegative = Field(description="of a vertical angle")
    near_cm: NotNegative = Field(description="of the near-point corrections X and Y")


class Errors(Section):
    """True value minus factory value, and noise; standard deviations if not named otherwise."""

    dl_mean_cm: float = Field(description="mean of the distance corrections at the far point")
    dl_cm: NotNegative = Field(description="of a distance correction at the far point")
    dl_limit: Positive = Field(description="largest one, in standard deviations")
    alpha_deg: NotNegative = Field(description="of a rotational angle")
    v_deg: NotNegative = Field(description="of a vertical angle")
    range_scale_cm_per_m: NotNegative = Field(description="of a range scale per laser")
    far_point_m: Positive = Field(description="range at which the factory calibrated")
    pattern_median_cm: NotNegative = Field(description="median size of a pattern along azimuth")
    pattern_log: NotNegative = Field(description="of the logarithm of its size")
    pattern_kernel_deg: Positive = Field(description="length over which the pattern is alike")
    noise_median_cm: NotNegative = Field(description="median size of the noise of a shot")
    noise_log: NotNegative = Field(description="of the logarithm of its size")
    noise_range_m: NotNegative = Field(description="range from which the noise grows")
    shift_mean_cm: dict[PositionName, float] = Field(description="shift of all lasers")
    shift_cm: NotNegative = Field(description="of the shift of a laser at a position")
    drift_laser_cm: NotNegative = Field(description="of the drift of a laser in a sample")
    drift_common_cm: NotNegative = Field(description="of the drift of all lasers in a sample")
    drift_window_cm: NotNegative = Field(description="of the drift of a laser in a window")
    thermal_cm_per_k: float = Field(description="change of all distances with temperature")
    thermal_laser_cm_per_k: NotNegative = Field(description="of that change per laser")
    outlier_share: Share = Field(description="share of outliers")
    outlier_cm: NotNegative = Field(description="of an outlier")


class ScannerUnit(Section):
    """A simulated unit of a scanner."""

    rotation_rate_hz: Positive = Field(description="rotations per second")
    rotation_rate_variation: float = Field(
        ge=0, le=0.1, description="share by which the rate varies, a slow sine"
    )
    encoder_step_ticks: Count = Field(description="step of the azimuths on the wire, 0.01 deg")
    min_range_m: NotNegative = Field(description="smallest range")
    dropout: Share = Field(description="share of shots without a return")
    base_targets: BaseTargets = Field(description="targets on the base")
    base_scanner: BaseScanner = Field(description="their coordinates in the scanner frame")
    base_pointing_mm: Positive = Field(description="standard deviation of pointing at them")
    factory: FactoryWorld | None = Field(description="the factory's values; `null` for nominal")
    errors: Errors = Field(description="errors of the unit")


class WorldFile(Section):
    """Constants of the simulated world."""

    seed: int = Field(ge=0, description="seed of everything that is random")
    tuned: tuple[str, ...] = Field(
        default=(),
        strict=False,
        description="constants that tuning may change, as `scanners/HDL-64E/errors/dl_cm`",
    )
    site: Site = Field(alias="field", description="the test site")
    survey: SurveyWorld = Field(description="how the site is surveyed")
    positions: dict[PositionName, Position] = Field(
        min_length=1, description="positions of the scanners"
    )
    warmth: WarmthWorld = Field(description="temperature of the scanners")
    outdoor: OutdoorWorld | None = Field(default=None, description="outdoor scenes")
    building: Building | None = Field(default=None, description="interior that is mapped")
    scanners: dict[ScannerName, ScannerUnit] = Field(min_length=1, description="units")

    @model_validator(mode="after")
    def _tuned_exist(self) -> WorldFile:
        for path in self.tuned:
            found: object = self.plain()
            for key in path.split("/"):
                found = found.get(key) if isinstance(found, dict) else None
            if isinstance(found, bool) or not isinstance(found, int | float):
                raise fault(f"{path!r} names no constant of this file", key="tuned")
        return self
