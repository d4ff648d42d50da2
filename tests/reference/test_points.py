"""Files of points of real recordings against velodyne-decoder."""

import numpy as np
import pytest
from reference.test_recordings import (
    CASES,
    nominal_yaml,
    sound_payloads,
    velodyne_decoder_points,
)
from typer.testing import CliRunner
from unit.test_points import read_ply

from velocal.cli import app
from velocal.scanner.models import SCANNERS


@CASES
def test_a_written_file_agrees_with_velodyne_decoder(name, file, nearer_m, shared, tmp_path):
    """Azimuths within a firing are rounded there (see `test_recordings.py`), the rest is alike."""
    path, out = shared / "recordings" / file, tmp_path / "points.ply"
    done = CliRunner().invoke(app, ["points", str(path), "-o", str(out), "--scanner", name])
    assert done.exit_code == 0, done.output
    rows = read_ply(out)
    ours = np.column_stack([rows[axis] for axis in "xyz"]).astype(float)
    payloads, scanner = sound_payloads(path), SCANNERS[name]
    theirs = velodyne_decoder_points(payloads, scanner, nominal_yaml(scanner))
    assert len(ours) == len(theirs)
    apart = ours - theirs
    # Single precision at 130 m, on both sides.
    np.testing.assert_allclose(apart[:, 2], 0, atol=3e-5)
    np.testing.assert_allclose(
        np.hypot(*ours[:, :2].T), np.hypot(*theirs[:, :2].T), rtol=0, atol=6e-5
    )
    assert np.quantile(np.linalg.norm(apart, axis=1), 0.99) < nearer_m
    assert np.median(apart, axis=0) == pytest.approx(0, abs=2e-5)
