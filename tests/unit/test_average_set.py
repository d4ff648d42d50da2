"""The script that writes parameter sets: the same points in every file that it exports."""

import average_set
import numpy as np
from unit.test_lint import unit

from velocal.adjustment.result import CalibrationSet, LaserQuality
from velocal.calibration.applied import applied
from velocal.calibration.files import formats
from velocal.io import schemas, storage
from velocal.scanner import beam
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters
from velocal.study.outputs import Export

RATE_HZ = 10.0


def outputs(folder):
    """Files that the script writes, and the medians that it takes the rotation rate from."""
    names = ("csv", "json", "yaml", "xml", "decoder.yaml")
    none = {"laser_id": [], "plane": [], "phi_rad": [], "distance_m": []}
    storage.write_table(
        folder / "assigned.parquet", schemas.ASSIGNED,
        {name: np.array(values) for name, values in none.items()}, rotation_rate_hz=RATE_HZ,
    )  # fmt: skip
    files = {name.partition(".")[0]: folder / f"set.{name}" for name in names}
    return {**files, "assigned": [folder / "assigned.parquet"]}


def quality(n):
    """Columns of the quality of lasers that all went well."""
    one = LaserQuality(9, 3, 6, 0.01, 1.0, 2.0, 0.9, (), 3, True, "converged")
    parameters = LaserParameters(*np.zeros((5, n)))
    empty = CalibrationSet(
        (), parameters, np.zeros((n, 0)), np.ones(n, dtype=bool), quality=(one,) * n
    )
    return empty.to_columns()


def write_adjustment(path, correction):
    """Corrections of a window, the same for dl, alpha and v, and their covariances."""
    columns = {"laser_id": np.arange(64), **quality(64)}
    for name, unit_of in (("dl", "m"), ("alpha", "rad"), ("v", "rad")):
        columns[f"{name}_correction_{unit_of}"] = correction
        columns[f"{name}_std_{unit_of}"] = np.full(64, 0.002)
        columns[f"{name}_noise_std_{unit_of}"] = np.full(64, 0.001)
    storage.write_csv(path, columns)
    pairs = [(a, b) for a in ("dl", "alpha", "v") for b in ("dl", "alpha", "v") if a <= b]
    covariance = {
        "laser_id": np.repeat(np.arange(64), len(pairs)),
        "first": np.tile([max(pair) for pair in pairs], 64),
        "second": np.tile([min(pair) for pair in pairs], 64),
        "covariance": np.tile([2e-6 if a != b else 4e-6 for a, b in pairs], 64),
        "correlation": np.tile([0.5 if a != b else 1.0 for a, b in pairs], 64),
        "noise": np.tile([-5e-7 if a != b else 1e-6 for a, b in pairs], 64),
        "prior": np.tile([2.5e-6 if a != b else 3e-6 for a, b in pairs], 64),
    }
    storage.write_csv(path.with_suffix(".covariance.csv"), covariance)


def test_windows_belong_to_the_samples_that_are_named(tmp_path):
    """Windows in any order: the scatter is that of the samples' means, 0.01 and 0.05."""
    samples, corrections = ["sa3", "sa4", "sa3", "sa4"], (0.00, 0.04, 0.02, 0.06)
    paths = [tmp_path / f"{number}.csv" for number in range(4)]
    for path, correction in zip(paths, corrections, strict=True):
        write_adjustment(path, np.full(64, correction))
    formats.write(tmp_path / "factory.xml", unit())
    files = outputs(tmp_path)
    average_set.main(
        adjustments=paths, covariances=[path.with_suffix(".covariance.csv") for path in paths],
        calibration=tmp_path / "factory.xml", **files, scatter=tmp_path / "scatter.csv",
        scanner="HDL-64E", weights="equal", samples=samples, positions=["P2", "P1", "P2", "P1"],
        export=Export(),
    )  # fmt: skip
    found = formats.read(files["csv"], 64)
    np.testing.assert_allclose(found.dl, unit().dl + (0.01 + 0.05) / 2, atol=1e-15)
    scatter = storage.read_csv(tmp_path / "scatter.csv")["scatter"]
    np.testing.assert_allclose(scatter, np.std([0.01, 0.05], ddof=1))


def test_files_of_a_set_give_their_readers_the_same_points(tmp_path):
    adjustment = tmp_path / "sa3" / "middle.csv"
    adjustment.parent.mkdir()
    write_adjustment(adjustment, np.linspace(-0.01, 0.01, 64))
    formats.write(tmp_path / "factory.xml", unit())
    files = outputs(tmp_path)
    export = {"yaml": "velodyne_decoder", "xml": "veloview"}
    average_set.main(
        adjustments=[adjustment], covariances=[tmp_path / "sa3" / "middle.covariance.csv"],
        calibration=tmp_path / "factory.xml", **files, scatter=tmp_path / "scatter.csv",
        scanner="HDL-64E", weights="equal", samples=["sa3"], positions=["P2"],
        export=Export(**export),
    )  # fmt: skip
    parameters = formats.read(files["csv"], 64)
    np.testing.assert_allclose(parameters.dl, unit().dl + np.linspace(-0.01, 0.01, 64), atol=1e-15)
    for suffix, dialect in export.items():
        found = formats.read_calibration(files[suffix])
        assert (found.dialect, found.rotation_rate_hz) == (dialect, RATE_HZ)
        # Both turn azimuths within a firing of an HDL-64E, 22 cm at 80 m, which the model does not.
        read, lasers = applied(found, SCANNERS["HDL-64E"], RATE_HZ), np.arange(64)
        for distance, phi in ((3.0, 0.3), (80.0, 4.0)):
            shots = np.full(64, distance), np.full(64, phi), lasers
            np.testing.assert_allclose(
                read.points(*shots), beam.points(*shots, parameters), rtol=0, atol=1e-12
            )
        still = np.abs(found.parameters.alpha - parameters.alpha)
        assert still.max() * 80.0 > 0.2
        np.testing.assert_allclose(
            formats.read(files[suffix], 64).voff, parameters.voff, atol=1e-15
        )
    known = formats.read_calibration(files["json"])
    assert (known.dialect, known.scanner) == ("paper", "HDL-64E")
    np.testing.assert_array_equal(known.parameters.v, parameters.v)
    np.testing.assert_allclose(known.std["v"], 0.002)
    assert set(known.covariance) == {("dl", "alpha"), ("dl", "v"), ("alpha", "v")}
    for values in known.covariance.values():
        np.testing.assert_allclose(values, 2e-6)
    assert known.provenance["adjustments"] == ["sa3/middle.csv"]


def written(folder, sample, window, value):
    """Write the adjustment of one window, the same correction of dl for all lasers; two paths."""
    n, tables = (
        64,
        (folder / sample / f"{window}.csv", folder / sample / f"{window}.covariance.csv"),
    )
    adjustment = {
        "laser_id": np.arange(n),
        "dl_correction_m": np.full(n, value),
        "dl_std_m": np.full(n, 0.002),
        "dl_noise_std_m": np.full(n, 0.001),
        **quality(n),
    }
    covariance = {
        "laser_id": np.arange(n),
        "first": ["dl"] * n,
        "second": ["dl"] * n,
        "covariance": np.full(n, 4e-6),
        "correlation": np.ones(n),
        "noise": np.full(n, 1e-6),
        "prior": np.full(n, 3e-6),
    }
    (folder / sample).mkdir(exist_ok=True)
    for path, columns in zip(tables, (adjustment, covariance), strict=True):
        storage.write_csv(path, columns)
    return tables


def averaged(folder, corrections):
    """Corrections of dl in the set that the script writes; `corrections` by sample, then window."""
    formats.write(folder / "factory.xml", unit())
    pairs = [
        written(folder, sample, f"window{number}", value)
        for sample, values in corrections.items()
        for number, value in enumerate(values)
    ]
    files = outputs(folder)
    average_set.main(
        adjustments=[path for path, _ in pairs], covariances=[path for _, path in pairs],
        calibration=folder / "factory.xml", **files, scatter=folder / "scatter.csv",
        scanner="HDL-64E", weights="equal", export=Export(),
        samples=[path.parent.name for path, _ in pairs], positions=["P2"] * len(pairs),
    )  # fmt: skip
    return formats.read(files["csv"], 64).dl - unit().dl


def test_samples_of_unequal_numbers_of_windows(tmp_path):
    """Every sample counts once, however many windows it has."""
    found = averaged(tmp_path, {"sa1": [0.01], "sa2": [0.02, 0.03, 0.04]})
    np.testing.assert_allclose(found, (0.01 + 0.03) / 2, atol=1e-12)
