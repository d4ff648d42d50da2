"""Whether the beams that should hit a plane end on it, and which mistake explains them if not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.functional import misclosure
from velocal.arrays import Array
from velocal.geometry.planes import Patch, Plane
from velocal.geometry.rigid import RigidTransformation
from velocal.reduction.assignment import NO_PLANE, Limits, assign
from velocal.scanner.beam import Beams, laser_beams
from velocal.scanner.models import Scanner, scanner_named
from velocal.scanner.parameters import LaserParameters
from velocal.survey.checks.findings import Finding
from velocal.survey.checks.pose import mirrored_fit
from velocal.survey.station import Station
from velocal.survey.targets import Targets

#: Of the beams that should hit a plane, more than half must end on it: then their median does, so
#: that the plane is where the survey says. A quarter that does not is a warning.
LEAST, USUAL = 0.5, 0.75
#: Name of the check, and what it allows.
SHARE, ALLOWED = "share on the planes", f"at least {LEAST * 100:g} %, usually 100 %"
#: Share of all beams by which an explanation must be better than one before it in the list.
_BETTER = 0.01
#: Vertical component of the normal of a floor or a ceiling, and share by which a vertical shift may
#: differ from the height of the origin to be explained by it.
_LEVEL, _SAME = 0.7, 0.35
#: Largest number of beams that alternatives are tried on.
_TRIED = 2000
_IDENTITY = np.eye(3)
#: What is said of the mistakes that are made most often, by the matrix that takes the right
#: coordinates of the base to the stated ones.
_NAMED: dict[tuple[tuple[int, ...], ...], str] = {
    ((0, 1, 0), (1, 0, 0), (0, 0, 1)): "X and Y of the base are exchanged",
    ((0, 1, 0), (-1, 0, 0), (0, 0, 1)): "the base has ROS axes (X forward, Y to the left)",
    ((-1, 0, 0), (0, -1, 0), (0, 0, 1)): "the base is turned by 180 deg about Z",
    ((0, -1, 0), (1, 0, 0), (0, 0, 1)): "the base is turned by 90 deg about Z (Y to the right)",
    ((-1, 0, 0), (0, 1, 0), (0, 0, 1)): "the base is mirrored (the sign of X is wrong)",
    ((1, 0, 0), (0, -1, 0), (0, 0, 1)): "the base is mirrored (the sign of Y is wrong)",
    ((1, 0, 0), (0, 1, 0), (0, 0, -1)): "the base is mirrored (the sign of Z is wrong)",
}


@dataclass(frozen=True)
class Hits:
    """Beams that should hit the planes of a station, by the direction in which they go.

    Attributes
    ----------
    plane : ndarray of int, shape (n,)
        Plane that each beam meets first, `NO_PLANE` where it meets none.
    s : ndarray, shape (n,)
        Distance from that plane to the measured point, metres; positive behind it.
    """

    plane: NDArray[np.uint8]
    s: Array

    @classmethod
    def of(
        cls, beams: Beams, parameters: LaserParameters, patches: Sequence[Patch], limits: Limits
    ) -> Hits:
        """Find the plane that every beam should hit.

        Parameters
        ----------
        beams : Beams
            Medians.
        parameters : LaserParameters
            Of the factory.
        patches : sequence of Patch
            Scanner frame.
        limits : Limits
            Its largest distance is not used: only the direction of a beam counts.
        """
        plane = assign(beams, parameters, patches, replace(limits, distance_m=np.inf))
        s = np.full(len(beams), np.nan)
        hit = plane != NO_PLANE
        number = plane[hit]
        normal = np.stack([patch.plane.normal for patch in patches])[number]
        offset = np.array([patch.plane.offset for patch in patches])[number]
        s[hit] = misclosure(
            beams.distance_m[hit], beams.phi[hit], beams.laser_id[hit], parameters, normal, offset
        )
        return cls(plane, s)

    def within(self, limits: Limits) -> NDArray[np.bool_]:
        """Beams that end within the limits of the assignment, shape (n,)."""
        return np.abs(np.nan_to_num(self.s, nan=np.inf)) <= limits.distance_m


@dataclass(frozen=True)
class PlaneHits:
    """What a recording says of one plane.

    Attributes
    ----------
    plane : str
    beams : int
        Medians that should lie on it by the direction of their beams.
    within, behind : float
        Share of them within the limits, and share farther away than the limits allow: a beam does
        not go through a wall. NaN where there are no beams.
    median_s_m, mean_s_m : float
        Median of s of all of them, and mean of s of those within the limits, metres.
    """

    plane: str
    beams: int
    within: float
    behind: float
    median_s_m: float
    mean_s_m: float


def plane_hits(hits: Hits, patches: Sequence[Patch], limits: Limits) -> list[PlaneHits]:
    """Count the beams that should hit every plane, and those that do.

    Parameters
    ----------
    hits : Hits
    patches : sequence of Patch
    limits : Limits
    """
    found, good = [], hits.within(limits)
    for number, patch in enumerate(patches):
        own = hits.plane == number
        s = hits.s[own]
        on_it = hits.s[own & good]
        found.append(
            PlaneHits(
                patch.name,
                len(s),
                len(on_it) / len(s) if len(s) else np.nan,
                float(np.mean(s > limits.distance_m)) if len(s) else np.nan,
                float(np.median(s)) if len(s) else np.nan,
                float(np.mean(on_it)) if len(on_it) else np.nan,
            )
        )
    return found


def check_hits(
    seen: Sequence[PlaneHits], limits: Limits, n_lasers: int, where: str
) -> list[Finding]:
    """Check that the planes are where the survey says, and that they are seen.

    Parameters
    ----------
    seen : sequence of PlaneHits
        Of all planes of a sample.
    limits : Limits
    n_lasers : int
        Lasers of the scanner: fewer medians than lasers say nothing of the lasers.
    where : str
        Sample and position.

    Returns
    -------
    list of Finding
        One at most for planes that are elsewhere, one for planes that are not seen.
    """
    found = []
    limit = f"{limits.distance_m * 100:g} cm"
    judged = [each for each in seen if each.beams >= n_lasers]
    wrong = [each for each in judged if each.within < LEAST]
    doubtful = [each for each in judged if each.within < USUAL]
    # Something may stand in front of a plane, but no beam goes through it.
    through = any(each.behind > 1.0 - USUAL for each in wrong)
    if doubtful:
        listed = ", ".join(
            f"{each.plane} {each.within * 100:.0f} % ({each.behind * 100:.0f} % behind it)"
            for each in doubtful
        )
        found.append(
            Finding(
                "error" if through else "warning", SHARE, where,
                f"of the beams that should hit a plane, too few end within {limit} of it: {listed}",
                allowed=ALLOWED,
                hint="Something stands in front of the plane, or the survey of the plane or of "
                "the base is wrong.",
            )
        )  # fmt: skip
    unseen = [each.plane for each in seen if each.beams * np.nan_to_num(each.within) < n_lasers]
    if unseen and not wrong:
        found.append(
            Finding(
                "warning", "planes that are not seen", where,
                f"fewer medians than lasers lie on {', '.join(unseen)}: such a plane does not help",
                hint="This is as it should be if the plane cannot be seen from this position.",
            )
        )  # fmt: skip
    return found


def missed(seen: Sequence[PlaneHits], n_lasers: int) -> bool:
    """Tell whether most of the beams that should hit a plane do not end on it.

    Parameters
    ----------
    seen : sequence of PlaneHits
    n_lasers : int
        Lasers of the scanner; see `check_hits`.
    """
    return any(each.beams >= n_lasers and each.within < LEAST for each in seen)


@dataclass(frozen=True)
class Explanation:
    """A mistake that explains the beams better than the survey does.

    Attributes
    ----------
    mistake : str
    share : float
        Share of the beams that fit then.
    more : float
        How many times as large the surplus is of beams that fit over those that do not.
    """

    mistake: str
    share: float
    more: float

    def __str__(self) -> str:
        return f"It looks as if {self.mistake}: then {self.share * 100:.0f} % of the beams fit."


def explain(
    beams: Beams,
    parameters: LaserParameters,
    station: Station,
    base_site: Targets,
    base_scanner: Targets,
    others: Mapping[str, Station],
    limits: Limits,
) -> Explanation | None:
    """Find a mistake that explains the beams far better than the survey does.

    Parameters
    ----------
    beams : Beams
        Medians of the sample.
    parameters : LaserParameters
    station : Station
        As surveyed.
    base_site, base_scanner : Targets
        The same targets in both frames.
    others : mapping of str to Station
        Other positions of the scanner.
    limits : Limits

    Returns
    -------
    Explanation or None
        None if no alternative explains three quarters of the beams.
    """
    tried = beams[np.arange(0, len(beams), -(-len(beams) // _TRIED) or 1)]

    def score(patches: Sequence[Patch]) -> tuple[float, int]:
        """Share of the beams that fit, and how many more fit than do not."""
        hits = Hits.of(tried, parameters, patches, limits)
        good, expected = int(hits.within(limits).sum()), int((hits.plane != NO_PLANE).sum())
        return (good / expected if expected else 0.0), 2 * good - expected

    _, surplus = score(station.patches)
    best, found = max(surplus, 0), None
    for mistake, patches in (
        *_shifted(tried, parameters, station, limits),
        *_alternatives(station, base_site, base_scanner, others),
    ):
        share, more = score(patches)
        if share > USUAL and more > best + _BETTER * len(tried):
            best, found = more, Explanation(mistake, share, more / max(surplus, 1))
    return found


def counted_from_bottom(nearer_m: float, plane: Plane, scanner: Scanner) -> str:
    """Ask whether the base was measured from its bottom, if the shift of a floor equals that.

    Parameters
    ----------
    nearer_m : float
        By how much the plane lies nearer to the scanner than surveyed, metres.
    plane : Plane
        Scanner frame.
    scanner : Scanner

    Returns
    -------
    str
        A sentence; empty if the plane is upright, or the shift is another.
    """
    height = scanner.origin_height_m
    up = nearer_m * float(plane.normal[2])
    if height == 0.0 or abs(plane.normal[2]) < _LEVEL or abs(up - height) > _SAME * height:
        return ""
    return (
        f"are the coordinates of the base counted from its bottom? The origin of the scanner frame "
        f"of an {scanner.name} is {height * 1000:g} mm above it"
    )


def _shifted(
    beams: Beams, parameters: LaserParameters, station: Station, limits: Limits
) -> Iterator[tuple[str, list[Patch]]]:
    """Stations with one plane where the beams are that should hit it, if not far from there."""
    hits = Hits.of(beams, parameters, station.patches, limits)
    direction, _ = laser_beams(beams.phi, beams.laser_id, parameters)
    for number, patch in enumerate(station.patches):
        own = hits.plane == number
        if not own.any():
            continue
        plane = patch.plane
        across = float(np.median(hits.s[own] * (direction[own] @ plane.normal)))
        if abs(across) > limits.distance_m:
            continue
        moved = replace(plane, offset=plane.offset - across)
        corners = patch.corners + across * plane.normal
        patches = list(station.patches)
        patches[number] = Patch(patch.name, moved, corners)
        side = "farther away" if across > 0 else "nearer"
        text = f"{patch.name} lies {abs(across) * 100:.2g} cm {side} than surveyed"
        if origin := counted_from_bottom(-across, plane, scanner_named(station.scanner)):
            text += f" ({origin})"
        yield text, patches


def _alternatives(
    station: Station, base_site: Targets, base_scanner: Targets, others: Mapping[str, Station]
) -> Iterator[tuple[str, list[Patch]]]:
    pose, site = station.pose, [_moved(station.pose.inverse(), each) for each in station.patches]
    mirrored, _ = mirrored_fit(base_site, base_scanner)
    for name, other in others.items():
        yield f"this is a recording of position {name}: captures are exchanged", other.patches
    for unit, factor in (("millimetres", 1e-3), ("centimetres", 1e-2)):
        shrunk = [_scaled(each, factor) for each in site]
        yield f"the planes are in {unit}", [_moved(pose, each) for each in shrunk]
        yield (
            f"all coordinates are in {unit}",
            [_scaled(each, factor) for each in station.patches],
        )
    yield "the site frame is left-handed", [_moved(mirrored, each) for each in site]
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        stated = _IDENTITY[list(order)] * np.array(signs)[:, None]
        if np.array_equal(stated, _IDENTITY):
            continue
        of_base = pose if np.linalg.det(stated) > 0 else mirrored
        right = RigidTransformation(
            stated.T @ of_base.rotation, stated.T @ of_base.translation, of_base.covariance
        )
        key = tuple(tuple(int(value) for value in row) for row in stated)
        text = _NAMED.get(key, f"the stated coordinates of the base are {_formula(stated)}")
        yield text, [_moved(right, each) for each in site]
    # Other signs would take a plane to where no beam is expected to hit it.
    for order in permutations(range(3)):
        stated = _IDENTITY[list(order)]
        turn = RigidTransformation(stated.T, np.zeros(3), np.zeros((6, 6)))
        yield (
            f"the stated coordinates of the planes are {_formula(stated)}",
            [_moved(pose, _moved(turn, each)) for each in site],
        )


def _formula(stated: Array) -> str:
    """Stated coordinates by the right ones, as in "(-y, x, z) of the right x, y, z"."""
    terms = [("-" if row.sum() < 0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in stated]
    return f"({', '.join(terms)}) of the right x, y, z"


def _moved(transformation: RigidTransformation, patch: Patch) -> Patch:
    """Patch in another frame; the transformation may be a reflection."""
    normal, offset = patch.plane.normal, patch.plane.offset
    turned = transformation.rotation @ normal
    moved = Plane(turned, offset - float(turned @ transformation.translation), np.zeros((4, 4)))
    return Patch(patch.name, moved, transformation.apply(patch.corners))


def _scaled(patch: Patch, factor: float) -> Patch:
    """Patch whose coordinates are multiplied by a factor."""
    plane = Plane(patch.plane.normal, patch.plane.offset * factor, np.zeros((4, 4)))
    return Patch(patch.name, plane, patch.corners * factor)
