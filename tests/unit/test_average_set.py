"""The script that writes parameter sets: the same points in every file that it exports."""

import average_set
import numpy as np
from unit.test_lint import unit

from velocal.calibration.convert import apart
from velocal.calibration.dialects import DIALECTS, PAPER
from velocal.calibration.files import formats
from velocal.io import storage
from velocal.study.config import Export


def write_adjustment(path, correction):
    """Corrections of a window, the same for dl, alpha and v, and their covariances."""
    columns = {"laser_id": np.arange(64), "count": np.full(64, 9)}
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
        "noise": np.tile([-5e-7 if a != b else 1e-6 for a, b in pairs], 64),
    }
    storage.write_csv(path.with_suffix(".covariance.csv"), covariance)


def test_windows_belong_to_the_samples_that_are_named(tmp_path):
    """Windows in any order: the scatter is that of the samples' means, 0.01 and 0.05."""
    samples, corrections = ["sa3", "sa4", "sa3", "sa4"], (0.00, 0.04, 0.02, 0.06)
    paths = [tmp_path / f"{number}.csv" for number in range(4)]
    for path, correction in zip(paths, corrections, strict=True):
        write_adjustment(path, np.full(64, correction))
    formats.write(tmp_path / "factory.xml", unit())
    files = {suffix: tmp_path / f"set.{suffix}" for suffix in ("csv", "json", "yaml", "xml")}
    average_set.main(
        adjustments=paths, covariances=[path.with_suffix(".covariance.csv") for path in paths],
        calibration=tmp_path / "factory.xml", **files, scatter=tmp_path / "scatter.csv",
        scanner="HDL-64E", weights="equal", samples=samples, positions=["P2", "P1", "P2", "P1"],
        export={},
    )  # fmt: skip
    found = formats.read(files["csv"], 64)
    np.testing.assert_allclose(found.dl, unit().dl + (0.01 + 0.05) / 2, atol=1e-15)
    scatter = storage.read_csv(tmp_path / "scatter.csv")["scatter"]
    np.testing.assert_allclose(scatter, np.std([0.01, 0.05], ddof=1))


def test_files_of_a_set_give_their_readers_the_same_points(tmp_path):
    adjustment = tmp_path / "sa3" / "middle.csv"
    write_adjustment(adjustment, np.linspace(-0.01, 0.01, 64))
    formats.write(tmp_path / "factory.xml", unit())
    files = {suffix: tmp_path / f"set.{suffix}" for suffix in ("csv", "json", "yaml", "xml")}
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
        assert found.dialect == dialect
        pair = (PAPER, parameters), (DIALECTS[dialect], found.parameters)
        assert apart(*pair).max() < 1e-12
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
