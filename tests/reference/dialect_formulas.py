"""The point formulas of other programs, written out one by one from their sources.

Nothing of the project is used here: these are what its dialects are compared with. Each takes
the raw distance (m), the azimuth (rad), the numbers of one laser, and gives the point in the
program's own axes, turned to X right, Y forward, Z up at the end.
"""

from dataclasses import dataclass
from math import cos, inf, sin


@dataclass(frozen=True)
class Laser:
    rot: float
    vert: float
    dist: float
    dist_x: float
    dist_y: float
    vert_offset: float
    horiz_offset: float
    two_point: bool


def paper(raw, phi, c):
    """Equations (1) and (2)."""
    theta, length = phi - c.rot, raw + c.dist
    l_xy = length * cos(c.vert)
    x = l_xy * sin(theta) - c.horiz_offset * cos(theta)
    y = l_xy * cos(theta) + c.horiz_offset * sin(theta)
    return x, y, length * sin(c.vert) + c.vert_offset


def manual(raw, phi, c, limit=25.0, with_offset=False):
    """HDL-64E S3 manual, appendix F: beyond 25 m of raw distance only the far correction."""
    cos_rot = cos(phi) * cos(c.rot) + sin(phi) * sin(c.rot)
    sin_rot = sin(phi) * cos(c.rot) - cos(phi) * sin(c.rot)
    xy = (raw + c.dist) * cos(c.vert)
    xx, yy = xy * sin_rot, xy * cos_rot
    if with_offset:
        xx, yy = xx - c.horiz_offset * cos_rot, yy + c.horiz_offset * sin_rot
    xx, yy = abs(xx), abs(yy)
    corr_x = (c.dist - c.dist_x) * (xx - 2.4) / (25.04 - 2.4) + c.dist_x
    corr_y = (c.dist - c.dist_y) * (yy - 1.93) / (25.04 - 1.93) + c.dist_y
    if raw > limit:
        corr_x = corr_y = c.dist
    x = (raw + corr_x) * cos(c.vert) * sin_rot - c.horiz_offset * cos_rot
    y = (raw + corr_y) * cos(c.vert) * cos_rot + c.horiz_offset * sin_rot
    return x, y, (raw + corr_y) * sin(c.vert) + c.vert_offset


def manual_s2(raw, phi, c):
    """HDL-64E S2 manual, appendix F: no limit in the code, offsets in X and Y."""
    return manual(raw, phi, c, limit=inf, with_offset=True)


def ros(raw, phi, c):
    """velodyne_pointcloud/src/lib/rawdata.cc, RawData::unpack."""
    cos_rot = cos(phi) * cos(c.rot) + sin(phi) * sin(c.rot)
    sin_rot = sin(phi) * cos(c.rot) - cos(phi) * sin(c.rot)
    distance = raw + c.dist
    xy = distance * cos(c.vert) - c.vert_offset * sin(c.vert)
    xx = abs(xy * sin_rot - c.horiz_offset * cos_rot)
    yy = abs(xy * cos_rot + c.horiz_offset * sin_rot)
    corr_x = corr_y = 0.0
    if c.two_point:
        corr_x = (c.dist - c.dist_x) * (xx - 2.4) / (25.04 - 2.4) + c.dist_x - c.dist
        corr_y = (c.dist - c.dist_y) * (yy - 1.93) / (25.04 - 1.93) + c.dist_y - c.dist
    xy = (distance + corr_x) * cos(c.vert) - c.vert_offset * sin(c.vert)
    x = xy * sin_rot - c.horiz_offset * cos_rot
    xy = (distance + corr_y) * cos(c.vert) - c.vert_offset * sin(c.vert)
    y = xy * cos_rot + c.horiz_offset * sin_rot
    z = (distance + corr_y) * sin(c.vert) + c.vert_offset * cos(c.vert)
    forward, left, up = y, -x, z
    return -left, forward, up


def libvelodyne(raw, phi, c):
    """src/lib/sensor/Converter.cpp, toPointCloud."""
    distance = c.dist + raw
    sin_rot = sin(phi) * cos(c.rot) - cos(phi) * sin(c.rot)
    cos_rot = cos(phi) * cos(c.rot) + sin(phi) * sin(c.rot)
    xy = distance * cos(c.vert) - c.vert_offset * sin(c.vert)
    x = xy * sin_rot - c.horiz_offset * cos_rot
    y = xy * cos_rot + c.horiz_offset * sin_rot
    return x, y, distance * sin(c.vert) + c.vert_offset * cos(c.vert)


def veloview(raw, phi, c):
    """VelodynePacketInterpreterCommon.cxx: the offset shortens XY, but is added whole to Z."""
    sin_vert_offset = c.vert_offset * sin(c.vert)
    cos_azimuth = cos(phi) * cos(c.rot) + sin(phi) * sin(c.rot)
    sin_azimuth = sin(phi) * cos(c.rot) - cos(phi) * sin(c.rot)
    distance = raw + c.dist
    xy = distance * cos(c.vert) - sin_vert_offset
    x = xy * sin_azimuth - c.horiz_offset * cos_azimuth
    y = xy * cos_azimuth + c.horiz_offset * sin_azimuth
    return x, y, distance * sin(c.vert) + c.vert_offset


def pcl(raw, phi, c):
    """io/src/hdl_grabber.cpp, computeXYZI."""
    azimuth, distance = phi - c.rot, raw + c.dist
    xy = distance * cos(c.vert)
    x = xy * sin(azimuth) - c.horiz_offset * cos(azimuth)
    y = xy * cos(azimuth) + c.horiz_offset * sin(azimuth)
    return x, y, distance * sin(c.vert) + c.vert_offset


def mrpt(raw, phi, c):
    """libs/obs/src/CObservationVelodyneScan.cpp: no rotational correction anywhere."""
    distance = raw + c.dist
    xy = distance * cos(c.vert)
    if c.vert_offset:
        xy += c.vert_offset * sin(c.vert)
    forward = xy * cos(phi) + c.horiz_offset * sin(phi)
    left = -(xy * sin(phi) - c.horiz_offset * cos(phi))
    return -left, forward, distance * sin(c.vert) + c.vert_offset


def velodyne_decoder(raw, phi, c):
    """src/packet_decoder.cpp, unpackPoint."""
    cos_rot = cos(phi) * cos(c.rot) + sin(phi) * sin(c.rot)
    sin_rot = sin(phi) * cos(c.rot) - cos(phi) * sin(c.rot)
    corr_x = corr_y = corr_z = c.dist
    if c.dist_x != 0 and c.dist_y != 0 and raw < 25.04:
        xy = (raw + c.dist) * cos(c.vert)
        x_share = (abs(xy * sin_rot) - 2.4) / (25.04 - 2.4)
        y_share = (abs(xy * cos_rot) - 1.93) / (25.04 - 1.93)
        corr_x = x_share * c.dist + (1 - x_share) * c.dist_x
        corr_y = y_share * c.dist + (1 - y_share) * c.dist_y
        corr_z = (corr_x + corr_y) / 2
    x = (raw + corr_x) * cos(c.vert) * sin_rot - c.horiz_offset * cos_rot
    y = (raw + corr_y) * cos(c.vert) * cos_rot + c.horiz_offset * sin_rot
    z = (raw + corr_z) * sin(c.vert) + c.vert_offset
    forward, left, up = y, -x, z
    return -left, forward, up


FORMULAS = {
    f.__name__: f
    for f in (
        paper, manual, manual_s2, ros, libvelodyne, veloview, pcl, mrpt, velodyne_decoder,
    )
}  # fmt: skip
