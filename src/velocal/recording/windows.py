"""Windows of rotations: the index as a file, the rotations of a window, and their packets."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from velocal.capture.chunk import Chunk
from velocal.capture.reading import open_capture
from velocal.capture.source import ANY_SOURCE, SourceFilter
from velocal.errors import ConfigError, RecordingError
from velocal.io import schemas, storage
from velocal.io.identity import FileIdentity, identify
from velocal.io.plain import from_plain, to_plain
from velocal.packets.data import BLOCKS
from velocal.packets.status import TRAILING, StatusReader
from velocal.recording.rotation_index import Loss, RotationIndex
from velocal.study.windows import WINDOWS

#: Number of rotations, evenly spaced, from which the temperature of a window is read.
TEMPERATURE_ROTATIONS = 10
#: Stands in the file for every offset of a recording that is not seekable.
_NOT_SEEKABLE = -1


def write_index(path: Path, index: RotationIndex) -> None:
    """Write an index as Parquet (`schemas.ROTATIONS`).

    Parameters
    ----------
    path : Path
        File, which appears when it is complete.
    index : RotationIndex
        It must name its recording.
    """
    columns = {
        "offset": index.offset if index.seekable else np.full_like(index.offset, _NOT_SEEKABLE),
        "block": index.block,
        "packet": index.packet,
        "time_s": index.time_s,
        "complete": np.append(index.complete, False),
    }
    storage.write_table(
        path,
        schemas.ROTATIONS,
        columns,
        recording=to_plain(index.recording),
        **asdict(index.loss),
        step_ticks=index.step_ticks,
        mean_rate_hz=index.mean_rate_hz,
        dual=index.dual,
    )


def read_index(path: Path) -> RotationIndex:
    """Read what `write_index` wrote.

    Raises
    ------
    StorageError
        If the file is damaged, of another kind or version, or does not name its recording.
    """
    columns, facts = storage.read_table(path, schemas.ROTATIONS)
    offset = columns["offset"]
    return RotationIndex(
        offset,
        columns["block"],
        columns["packet"],
        columns["time_s"],
        columns["complete"][:-1],
        seekable=bool(offset[0] != _NOT_SEEKABLE),
        recording=from_plain(FileIdentity, facts.get("recording"), str(path)),
        loss=Loss(facts["gaps"], facts["packets"], facts["largest"]),
        step_ticks=facts["step_ticks"],
        mean_rate_hz=facts["mean_rate_hz"],
        dual=facts["dual"],
    )


def window_rotations(
    index: RotationIndex, window: str, length: int | None, where: str
) -> NDArray[np.int64]:
    """Rotations of a window.

    Parameters
    ----------
    index : RotationIndex
    window : {"beginning", "middle", "end", "all"}
        Which complete rotations; "all" takes every rotation, the cut ones as well.
    length : int or None
        Number of rotations of a window; not used by "all".
    where : str
        Recording, for the error.

    Returns
    -------
    ndarray of int64
        Numbers of the rotations.

    Raises
    ------
    ConfigError
        If the recording has fewer complete rotations than the three windows need.
    """
    if window == "all":
        return np.arange(len(index))
    complete = np.flatnonzero(index.complete)
    if length is None or len(complete) < 3 * length:
        lossy = index.loss.gaps > 0 and len(complete) < len(index) - 2
        lost = f"; of {len(index)} rotations, with gaps: {index.loss}" if lossy else ""
        allow = ", or allow more missing packets (`windows: max_missing`)" if lossy else ""
        raise ConfigError(
            f"{len(complete)} complete rotations, too few for three windows of {length}{lost}",
            where=where,
            allowed=f"at least {3 * (length or 0)}",
            hint=f"Record longer, or lower `windows: rotations` in the configuration{allow}.",
        )
    start = {
        "beginning": 0,
        "middle": (len(complete) - length) // 2,
        "end": len(complete) - length,
    }[window]
    return complete[start : start + length]


@dataclass(frozen=True)
class SingleRotations:
    """Single rotations of a recording that stand for a window.

    Attributes
    ----------
    numbers : ndarray of int64
        Numbers of the rotations, ascending.
    origin : {"outside", "window"}
        Whether they are outside all windows, or the window's own.
    """

    numbers: NDArray[np.int64]
    origin: str


def single_rotations(
    index: RotationIndex, window: str, length: int, count: int, where: str
) -> SingleRotations:
    """Choose the rotations nearest to a window that belong to no window.

    What was adjusted on a window can be validated with them: they are other measurements at about
    the same time. Where the windows leave fewer rotations than needed, the first ones of the window
    are chosen.

    Parameters
    ----------
    index : RotationIndex
    window : {"beginning", "middle", "end"}
    length : int
        Number of rotations of a window.
    count : int
        How many to choose.
    where : str
        Recording, for the error.

    Returns
    -------
    SingleRotations
        Of two that are equally near, the later one.

    Raises
    ------
    ConfigError
        If the recording has fewer complete rotations than the three windows need.
    """
    windows = {name: window_rotations(index, name, length, where) for name in WINDOWS}
    own = windows[window]
    spare = np.setdiff1d(np.flatnonzero(index.complete), np.concatenate(list(windows.values())))
    if len(spare) < count:
        return SingleRotations(own[:count], "window")
    away = np.maximum(own[0] - spare, spare - own[-1])
    nearest = np.lexsort((-spare, away))[:count]
    return SingleRotations(np.sort(spare[nearest]), "outside")


def read_rotations(
    path: Path,
    index: RotationIndex,
    rotations: NDArray[np.int64],
    source: SourceFilter = ANY_SOURCE,
) -> Iterator[tuple[Chunk, NDArray[np.int64]]]:
    """Read the packets of some rotations.

    A recording that is not seekable is read from its beginning to the last of them.

    Parameters
    ----------
    path : Path
        Capture file.
    index : RotationIndex
        Of that file.
    rotations : ndarray of int64
        Rotations to read.
    source : SourceFilter
        Which of several scanners, as when the file was scanned.

    Yields
    ------
    chunk : Chunk
        Valid packets; the first and last of a run may also hold blocks of a neighbour.
    rotation : ndarray of int64, shape (n, 12)
        Rotation of every block, -1 where it was not asked for.

    Raises
    ------
    RecordingError
        If the recording is not the file that the index was made from.
    """
    _check_recording(path, index)
    capture = open_capture(path, source)
    wanted = np.zeros(len(index) + 1, dtype=bool)
    wanted[rotations] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wanted]).astype(np.int8)))
    runs = list(zip(edges[::2], edges[1::2], strict=True))
    if not index.seekable:
        yield from _counted(capture.read(), 0, index, wanted)
        return
    for first, last in runs:
        # A rotation that ends inside a packet needs that packet too.
        stop = int(index.offset[last]) + (1 if index.block[last] else 0)
        chunks = capture.read_between(int(index.offset[first]), stop)
        # Only this run: a rotation shorter than a packet lets two runs share that packet.
        run = np.zeros_like(wanted)
        run[first:last] = True
        yield from _counted(chunks, int(index.packet[first]), index, run)


def _check_recording(path: Path, index: RotationIndex) -> None:
    """Raise an error if a file has changed since its index was made."""
    made_from = index.recording
    if made_from is None:
        return
    try:
        found = identify(path)
    except OSError as error:
        raise RecordingError(f"cannot be read: {error.strerror}", where=str(path)) from None
    if found != made_from:
        sizes = f"it has {found.bytes} bytes, and had {made_from.bytes}"
        other = sizes if found.bytes != made_from.bytes else "its bytes are others"
        raise RecordingError(
            f"has changed since its rotations were indexed: {other}",
            where=str(path),
            hint="Scan it again (`Recording.scan`); `snakemake` does so in a study.",
        )


def temperature_deg_c(
    path: Path,
    index: RotationIndex,
    rotations: NDArray[np.int64],
    source: SourceFilter = ANY_SOURCE,
) -> float:
    """Mean temperature of the scanner during a window, as its status bytes give it.

    Parameters
    ----------
    path, index, rotations, source
        As for `read_rotations`. Up to `TEMPERATURE_ROTATIONS` of the rotations are read.

    Returns
    -------
    float
        Degrees Celsius; NaN where the scanner sends no temperature.
    """
    places = np.linspace(0, len(rotations) - 1, min(len(rotations), TEMPERATURE_ROTATIONS))
    status = {int(number): StatusReader() for number in rotations[places.astype(np.int64)]}
    for chunk, rotation in read_rotations(path, index, np.array(list(status)), source):
        trailing = chunk.payloads[:, -TRAILING.itemsize :]
        for number, reader in status.items():
            reader.consume(trailing[(rotation == number).any(axis=1)])
    found = [reader.result().temperature_deg_c for reader in status.values()]
    readings = [np.mean(each) for each in found if each is not None]
    return float(np.mean(readings)) if readings else float("nan")


def _counted(
    chunks: Iterable[Chunk], done: int, index: RotationIndex, wanted: NDArray[np.bool_]
) -> Iterator[tuple[Chunk, NDArray[np.int64]]]:
    """Packets of wanted rotations among chunks of which the first begins with packet `done`."""
    boundaries = index.packet * BLOCKS + index.block
    end = boundaries[np.flatnonzero(wanted)[-1] + 1] if wanted.any() else 0
    for chunk in chunks:
        n = len(chunk)
        # Rotations that begin are counted along the blocks. To search the rotation of each block
        # would take longer.
        blocks = done * BLOCKS, (done + n) * BLOCKS
        first, last = np.searchsorted(boundaries[:-1], blocks)
        begins = np.bincount(boundaries[first:last] - blocks[0], minlength=n * BLOCKS)
        rotation = (first - 1 + np.cumsum(begins)).reshape(n, BLOCKS)
        if wanted[max(first - 1, 0) : last].all():  # as of most chunks
            yield chunk, rotation
        else:
            rotation = np.where(wanted[rotation], rotation, -1)
            used = np.flatnonzero((rotation >= 0).any(axis=1))
            if len(used):
                rows = slice(int(used[0]), int(used[-1]) + 1)
                yield chunk.select(rows), rotation[rows]
        done += n
        if done * BLOCKS >= end:
            return
