"""Scanners that a YAML file describes: what is read, and one clear message for every fault."""

import numpy as np
import pytest
from support.example import DESCRIBED

from velocal.errors import ConfigError
from velocal.scanner.models import SCANNERS, Family
from velocal.study.scanner_file import read_scanner, scanner_of


def described(folder, *changes):
    text = DESCRIBED
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "scanner.yaml"
    path.write_text(text)
    return path


def test_it_is_a_scanner(tmp_path):
    found = scanner_of(str(described(tmp_path)))
    assert (found.name, found.n_lasers, found.lasers_per_firing) == ("ACME-4", 4, 4)
    assert (found.family, found.flags, found.sends_status) == (Family.DESCRIBED, (), False)
    np.testing.assert_allclose(np.rad2deg(found.vertical_rad), [-9, -3, 3, 9])
    assert not found.horizontal_offset_m.any()
    assert found.azimuth_bin(None) == 20
    assert scanner_of("VLP-16") is SCANNERS["VLP-16"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("lasers: 4", "lasers: 5", "vertical_deg: 4 values (allowed: 5, one a laser)"),
        ("lasers: 4", "lasers: 1000", "lasers: 1000"),
        ("name: ACME-4", "name: VLP-16", "'VLP-16' is known already"),
        ("name: ACME-4", "name: ../x", "is not a name"),
        ("-9,", "-91,", "vertical_deg.0: -91"),
        ("azimuth_bin_deg: 0.2", "azimuth_bin_deg: 0.7", "0.7 does not divide the turn"),
        ("azimuth_bin_deg: 0.2", "azimuth_bin_deg: 0.001", "0.001 does not divide the turn"),
        ("azimuth_bin_deg: 0.2\n", "", "key 'azimuth_bin_deg' is missing"),
        ("max_range_m: 100", "max_range_m: 200", "200 m in ticks of 0.002 m"),
        ("max_range_m: 100", "maximal_range_m: 100", "Did you mean 'max_range_m'?"),
        ("range_sigma_m: 0.02", "range_sigma_m: -1", "range_sigma_m: -1"),
        ("name: ACME-4", "name: [", "is not YAML"),
    ],
)
def test_a_fault_is_one_message(old, new, message, tmp_path):
    path = described(tmp_path, (old, new))
    with pytest.raises(ConfigError) as caught:
        read_scanner(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        scanner_of(str(tmp_path / "gone.yaml"))
