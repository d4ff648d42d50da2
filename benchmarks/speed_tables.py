"""Speed of medians, tables and points, against pandas, polars and DuckDB."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

import numpy as np
from speed_measure import Measures, Recorded, read, table

from velocal.io import schemas, storage
from velocal.io.output import new_file
from velocal.points import files
from velocal.points.files import FORMATS, cloud_writer
from velocal.points.placing import Settings
from velocal.points.stream import stream
from velocal.recording.recording import open_recording
from velocal.recording.scan import inspect
from velocal.reduction.medians import binned_medians
from velocal.scanner.models import SCANNERS

BIN_TICKS = SCANNERS["HDL-64E"].azimuth_bin_ticks
MIN_COUNT = 5


def medians(of: Recorded, rounds: int) -> str:
    """Table of medians and numbers of returns by laser and azimuth bin."""
    columns = open_recording(of.files["bin"], "HDL-64E").returns("all").columns()
    azimuth, laser, distance = (columns[n] for n in ("azimuth", "laser_id", "distance"))
    width, measures = SCANNERS["HDL-64E"].lasers_per_firing, Measures()

    def ours() -> int:
        found = binned_medians(
            azimuth, laser, distance,
            lasers_per_firing=width, bin_ticks=BIN_TICKS, min_count=MIN_COUNT,
        )  # fmt: skip
        return len(found.distance)

    def key() -> dict[str, np.ndarray]:
        """One number by laser and bin: all three peers are slower with two columns."""
        seen = distance > 0
        by = laser[seen].astype(np.uint32) * np.uint32(36000) + azimuth[seen] // BIN_TICKS
        return {"cell": by, "distance": distance[seen]}

    def with_pandas() -> int:
        import pandas as pd

        found = pd.DataFrame(key()).groupby("cell")["distance"].agg(["median", "size"])
        return int((found["size"] >= MIN_COUNT).sum())

    def with_polars() -> int:
        import polars as pl

        by = pl.DataFrame(key()).group_by("cell")
        found = by.agg(pl.col("distance").median(), pl.len().alias("n"))
        return found.filter(pl.col("n") >= MIN_COUNT).height

    def with_duckdb() -> int:
        import duckdb
        import pyarrow as pa

        returns = pa.table(key())  # found by its name
        query = (
            "SELECT cell, median(distance), count(*) AS n FROM returns GROUP BY cell HAVING n >= ?"
        )
        with duckdb.connect() as connection:
            connection.register("returns", returns)
            return connection.execute(query, [MIN_COUNT]).to_arrow_table().num_rows

    measures.add("copy the distances in memory", distance.copy)
    measures.add("velocal, with quartiles", ours)
    peers = {"pandas": with_pandas, "polars": with_polars, "duckdb": with_duckdb}
    counts = {"velocal": ours()}
    for name, work in peers.items():
        measures.add(name, work, needs=name)
        if name in measures.works:
            counts[name] = work()
    if len(set(counts.values())) > 1:
        raise SystemExit(f"medians differ in number: {counts}")
    measures.run(rounds)
    names = [*measures.works, *measures.missing]
    ratios = [measures.ratio("velocal, with quartiles", name) for name in names]
    return table(
        ["what", "ms", "times as long as velocal"],
        [[name, measures.time_of(name), r] for name, r in zip(names, ratios, strict=True)],
    )


def parquet(of: Recorded, folder: Path, rounds: int) -> str:
    """Table of writing and reading the table of returns."""
    columns = open_recording(of.files["bin"], "HDL-64E").returns("all").columns()
    path, peer, measures = folder / "ours.parquet", folder / "pandas.parquet", Measures()
    storage.write_table(path, schemas.RETURNS, columns)

    def write_bytes() -> None:
        with (folder / "plain").open("wb") as file:
            for values in columns.values():
                file.write(values)

    def with_pandas() -> None:
        import pandas as pd

        pd.DataFrame(columns, copy=False).to_parquet(peer, compression="zstd")

    def pandas_read() -> int:
        import pandas as pd

        return len(pd.read_parquet(peer))

    measures.add("write the bytes of all columns", write_bytes)
    measures.add(
        "write Parquet, velocal", lambda: storage.write_table(path, schemas.RETURNS, columns)
    )
    measures.add("write Parquet, pandas (zstd)", with_pandas)
    with_pandas()
    measures.add("read the bytes of the file", lambda: read(path))
    measures.add("read Parquet, velocal", lambda: storage.read_table(path, schemas.RETURNS))
    measures.add("read Parquet, pandas", pandas_read)
    measures.run(rounds)
    peers = {
        "write Parquet, velocal": "write Parquet, pandas (zstd)",
        "read Parquet, velocal": "read Parquet, pandas",
    }
    sizes = {
        "write the bytes of all columns": folder / "plain",
        "write Parquet, velocal": path,
        "write Parquet, pandas (zstd)": peer,
    }
    rows = []
    for name in measures.works:
        size = f"{sizes[name].stat().st_size / 1e6:.0f}" if name in sizes else ""
        other = measures.ratio(name, peers[name]) if name in peers else ""
        rows.append([name, measures.time_of(name), size, other])
    return table(["what", "ms", "MB", "times as fast as pandas"], rows)


class _Nowhere(io.RawIOBase):
    """Takes all bytes and keeps none: what is left is the time of velocal alone."""

    def writable(self) -> bool:
        """Writers ask for it."""
        return True

    def write(self, data: memoryview) -> int:  # type: ignore[override]
        """Number of the bytes, as a file tells it."""
        return memoryview(data).nbytes

    def seek(self, offset: int, whence: int = 0) -> int:
        """Only to the header, which is written last."""
        return offset


@contextmanager
def _nowhere(path: Path) -> Iterator[_Nowhere]:
    yield _Nowhere()


def points(of: Recorded, folder: Path, rounds: int) -> str:
    """Table of files of points by format, scan included."""
    from speed_decoding import theirs

    path, scanner, measures = of.files["bin"], SCANNERS["HDL-64E"], Measures()
    settings = Settings(scanner, of.factory)

    def write(suffix: str) -> int:
        found, count = inspect(path), 0
        with cloud_writer(
            folder / f"points{suffix}", shift=False, facts={"scanner": scanner.name}
        ) as append:
            for columns, _ in stream(path, found, np.arange(len(found.index)), settings):
                append(columns)
                count += len(columns["x"])
        return count

    def nothing() -> int:
        found = inspect(path)
        pieces = stream(path, found, np.arange(len(found.index)), settings)
        return sum(len(columns["x"]) for columns, _ in pieces)

    def to_nowhere(suffix: str) -> int:
        with (
            mock.patch.object(files, "new_file", _nowhere),
            mock.patch.object(storage, "new_file", _nowhere),
        ):
            return write(suffix)

    peer, none = "velodyne-decoder, nothing written", "velocal, nothing written"
    measures.add(peer, lambda: theirs(of, "bin"), needs="velodyne_decoder")
    measures.add(none, nothing)
    for suffix in (".pcd", ".parquet"):
        name = f"velocal, {suffix} without the writing of the system"
        measures.add(name, lambda suffix=suffix: to_nowhere(suffix))
    for suffix in FORMATS:
        measures.add(f"velocal, {suffix}", lambda suffix=suffix: write(suffix))
        measures.works[f"velocal, {suffix}"]()
        size = (folder / f"points{suffix}").stat().st_size

        def plain(size: int = size, suffix: str = suffix) -> None:
            piece = bytes(1 << 20)
            with new_file(folder / f"plain{suffix}") as file:
                for _ in range(size // len(piece)):
                    file.write(piece)

        measures.add(f"as many bytes as {suffix}, of zeros", plain)
    measures.run(rounds)
    rows = []
    for name in [*measures.missing, *measures.works]:
        if name.startswith("as many"):
            continue
        suffix = name.removeprefix("velocal, ")
        known = name in measures.seconds
        speed = f"{of.seconds / measures.took(name):.0f}" if known else ""
        file = folder / f"points{suffix}"
        size = f"{file.stat().st_size / 1e6:.0f}" if suffix in FORMATS else ""
        zeros = measures.time_of(f"as many bytes as {suffix}, of zeros") if size else ""
        rows.append([name, measures.time_of(name), speed, measures.ratio(name, peer), size, zeros])
    headings = [
        "what", "ms", "times real time", "times as fast as velodyne-decoder", "MB",
        "ms to write as many zeros",
    ]  # fmt: skip
    return table(headings, rows)
