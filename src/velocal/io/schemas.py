"""Arrow schemas of every Parquet file of the project, with units and version in the metadata."""

from __future__ import annotations

import pyarrow as pa

#: Version of the file contracts; raised when a column changes its meaning.
VERSION = "2"


def _field(name: str, type_: pa.DataType, unit: str, description: str) -> pa.Field:
    return pa.field(
        name, type_, nullable=False, metadata={"unit": unit, "description": description}
    )


def _schema(kind: str, fields: list[pa.Field]) -> pa.Schema:
    return pa.schema(fields, metadata={"velocal.kind": kind, "velocal.version": VERSION})


_LASER = _field("laser_id", pa.uint8(), "1", "laser, 0-based, order of the wire")
#: 2 mm, or 4 mm of a VLP-32C or VLS-128; metadata `distance_tick_m` of the table says which.
_TICK = "distance_tick_m"

RETURNS = _schema(
    "returns",
    [
        _field("rotation", pa.uint32(), "1", "rotation in the recording"),
        _field("timestamp", pa.uint32(), "us", "device clock of the packet, microseconds of hour"),
        _field("azimuth", pa.uint16(), "0.01 deg", "raw azimuth of the firing"),
        _LASER,
        _field("distance", pa.uint16(), _TICK, "raw distance; 0 where nothing came back"),
        _field("intensity", pa.uint8(), "1", "raw intensity"),
        _field("return", pa.uint8(), "1", "0 the only one of its shot, 1 strongest, 2 last of two"),
    ],
)

ROTATIONS = _schema(
    "rotations",
    [
        _field("offset", pa.int64(), "byte", "where the packet of the first block begins"),
        _field("block", pa.int8(), "1", "number of the first block in that packet"),
        _field("packet", pa.int64(), "1", "running number of that packet"),
        _field("time_s", pa.float64(), "s", "time since the first packet"),
        _field("complete", pa.bool_(), "1", "whole and without gap; the last row is the end"),
    ],
)

MEDIANS = _schema(
    "medians",
    [
        _LASER,
        _field("azimuth", pa.float32(), "0.01 deg", "mean raw azimuth of the firings in the cell"),
        _field("distance", pa.float32(), _TICK, "median raw distance"),
        _field("spread", pa.float32(), _TICK, "interquartile range / 1.349 of the distance"),
        _field("count", pa.uint16(), "1", "returns in the cell"),
    ],
)

ASSIGNED = _schema(
    "assigned",
    [
        _LASER,
        _field("plane", pa.uint8(), "1", "plane hit, index into metadata `planes`"),
        _field("phi_rad", pa.float64(), "rad", "rotational angle when the laser fired"),
        _field("distance_m", pa.float64(), "m", "raw distance"),
    ],
)

MEMBERS = _schema(
    "members",
    [
        _field("row", pa.uint32(), "1", "row of the median in the table of medians"),
        _field("plane", pa.uint8(), "1", "plane that it lies on, index into metadata `planes`"),
    ],
)

RESIDUALS = _schema(
    "residuals",
    [
        _LASER,
        _field("plane", pa.uint8(), "1", "plane hit, index into metadata `planes`"),
        _field("x_m", pa.float32(), "m", "point in the scanner frame, factory parameters"),
        _field("y_m", pa.float32(), "m", "point in the scanner frame, factory parameters"),
        _field("z_m", pa.float32(), "m", "point in the scanner frame, factory parameters"),
        _field("before_m", pa.float32(), "m", "s with the factory parameters"),
        _field("after_m", pa.float32(), "m", "s with the adjusted parameters"),
    ],
)

RESIDUAL_MAP = _schema(
    "residual_map",
    [
        _LASER,
        _field("plane", pa.uint8(), "1", "plane hit, index into metadata `planes`"),
        _field("azimuth_bin", pa.uint16(), "0.5 deg", "bin of the rotational angle"),
        _field("count", pa.uint16(), "1", "medians in the bin"),
        _field("x_m", pa.float32(), "m", "mean point in the scanner frame, factory parameters"),
        _field("y_m", pa.float32(), "m", "mean point in the scanner frame, factory parameters"),
        _field("z_m", pa.float32(), "m", "mean point in the scanner frame, factory parameters"),
        _field("before_m", pa.float32(), "m", "mean s with the factory parameters"),
        _field("after_m", pa.float32(), "m", "mean s with the calibration of metadata `after`"),
    ],
)

MAP = _schema(
    "map",
    [
        _field("position", pa.uint8(), "1", "position, index into metadata `positions`"),
        _LASER,
        *(
            _field(f"{axis}_{state}_m", pa.float32(), "m", f"point in one frame, {what}")
            for state, what in (
                ("factory", "factory parameters"),
                ("refined", "parameter set of metadata `set`"),
            )
            for axis in "xyz"
        ),
    ],
)

POINTS = _schema(
    "points",
    [
        _field(
            "x", pa.float32(), "m", "point in the scanner frame, or the frame that was asked for"
        ),
        _field("y", pa.float32(), "m", "likewise"),
        _field("z", pa.float32(), "m", "likewise"),
        _field("intensity", pa.uint8(), "1", "raw intensity"),
        _LASER,
        _field("rotation", pa.uint32(), "1", "rotation in the recording"),
        _field("time", pa.float64(), "s", "of the shot, since the first packet; NaN without clock"),
        _field("shift", pa.float32(), "m", "way from the point that the calibration before gives"),
    ],
)
