"""Maps of residuals: bins of angle against single residuals, and their picture."""

from dataclasses import replace

import numpy as np
import pytest

from velocal.adjustment.observations import Observations
from velocal.evaluation.candidates import Candidate, Role
from velocal.evaluation.residual_map import BINS, STEP_DEG, as_image, residual_map
from velocal.io import schemas, storage
from velocal.reporting.figures.residual_map import residual_images
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal

FACTORY = nominal(SCANNERS["VLP-16"])


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(3)
    n = 5000
    plane = rng.integers(0, 2, n)
    normals = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])
    # In front of the wall that is hit, on both sides of the angle 0.
    angle = rng.uniform(-60.0, 60.0, n) + 90.0 * plane
    return Observations(
        rng.uniform(3.0, 5.0, n), np.deg2rad(angle), rng.integers(0, 16, n),
        normals[plane], np.full(n, -4.0), plane,
    )  # fmt: skip


def test_cells_are_means_of_their_residuals(data):
    before = Candidate(Role.FACTORY, FACTORY)
    after = Candidate(Role.UNIT, replace(FACTORY, dl=FACTORY.dl + 0.01), "all")
    found = residual_map(data, before, after)
    assert set(vars(found)) == set(schemas.RESIDUAL_MAP.names)
    assert found.count.sum() == len(data.phi)
    azimuth_bin = np.floor(np.rad2deg(data.phi) % 360.0 / STEP_DEG).astype(int)
    s = before.misclosure(data)
    for row in range(0, len(found.azimuth_bin), 97):
        own = (
            (azimuth_bin == found.azimuth_bin[row])
            & (data.laser_id == found.laser_id[row])
            & (data.plane == found.plane[row])
        )
        assert own.sum() == found.count[row]
        assert found.before_m[row] == pytest.approx(s[own].mean(), rel=1e-6)  # float32
    # A longer distance makes s longer by as much.
    np.testing.assert_allclose(found.after_m - found.before_m, 0.01, atol=1e-4)


def test_nothing_measured_is_an_empty_map(data):
    one = Candidate(Role.FACTORY, FACTORY)
    found = residual_map(data.take(slice(0, 0)), one, one)
    assert all(len(column) == 0 for column in vars(found).values())


def test_file_and_picture(data, tmp_path):
    one = Candidate(Role.FACTORY, FACTORY)
    found = residual_map(data, one, one)
    file = tmp_path / "map.parquet"
    storage.write_table(file, schemas.RESIDUAL_MAP, vars(found), planes=["a", "b"])
    read, facts = storage.read_table(file, schemas.RESIDUAL_MAP)
    assert facts["planes"] == ["a", "b"]
    np.testing.assert_array_equal(read["azimuth_bin"], found.azimuth_bin)
    order = np.argsort(FACTORY.v)
    image = as_image(found, found.before_m, order.tolist())
    assert image.shape == (16, BINS)
    row = int(np.flatnonzero(found.laser_id == order[-1])[0])
    assert np.isfinite(image[-1, found.azimuth_bin[row]])
    figure = residual_images(found, ["a", "b"], order.tolist(), "t", 0.03, simulated=False)
    assert [ax.get_title(loc="left") for ax in figure.axes[:2]] == ["before", "after"]
