"""A tiny study: one sample of each scanner, windows of four rotations, in a copy of the project."""

from pathlib import Path

import yaml

from support.running import snakemake

SHEET = """\
sample	scanner	position	recording	calibration
sa3	HDL-64E	P2	results/simulation/recordings/sa3.bin	results/simulation/factory/HDL-64E.xml
sa5	HDL-32E	P5	results/simulation/recordings/sa5.bin	results/simulation/factory/HDL-32E.xml
"""
_OUTDOOR_SHEET = "\n".join(
    "\t".join(cells)
    for cells in (
        ("sample", "kind", "scanner", "scene", "distance_m", "azimuth_deg", "recording",
         "calibration"),
        *(
            (name, kind, scanner, f"{kind}1", "10", "8",
             f"results/simulation/recordings/{name}.bin",
             f"results/simulation/factory/{scanner}.xml")
            for name, kind, scanner in (("o1", "ideal", "HDL-64E"), ("o2", "real", "HDL-32E"))
        ),
        (),
    )
)  # fmt: skip
NEW_ROW = """\
sa6	HDL-32E	P6	results/simulation/recordings/sa6.bin	results/simulation/factory/HDL-32E.xml
"""

SECOND_POSITION = """\
sa1	HDL-64E	P1	results/simulation/recordings/sa1.bin	results/simulation/factory/HDL-64E.xml
"""


def make_tiny(folder: Path) -> None:
    """Turn the configuration of a copied project into that of a tiny study."""
    path = folder / "config/config.yaml"
    config = yaml.safe_load(path.read_text())
    config["simulation"]["rotations"] = 12
    config["windows"]["rotations"] = 4
    config["reduction"]["min_count"] = 1
    config["parameter_sets"] = {"HDL-64E": {"set1": ["sa3"]}, "HDL-32E": {"set1": ["sa5"]}}
    config["calibrations"] = {"HDL-32E": {"unit": ["sa5"]}}
    config["compare_with_paper"] = False
    del config["methods"]  # one position is too few
    config["tables"] = {
        "2": {"scanner": "HDL-64E", "samples": ["sa3"], "data": "calibration"},
        "5": {"scanner": "HDL-32E", "samples": ["sa5"], "data": "validation"},
    }
    config["figures"] = {
        "07": {"kind": "residual"},
        "10": {"kind": "procedure"},
        "11": {"kind": "plan", "scanner": "HDL-64E", "samples": ["sa3"]},
        "13": {"kind": "std", "scanner": "HDL-64E", "samples": ["sa3"], "data": "calibration"},
        "18": {
            "kind": "histogram", "scanner": "HDL-64E", "samples": ["sa3"],
            "data": "calibration", "laser": 1,
        },
        "24": {"kind": "within", "scanner": "HDL-32E", "samples": ["sa5"], "data": "validation"},
        "30": {"kind": "corrections", "scanner": "HDL-64E"},
    }  # fmt: skip
    config["outdoor"]["rotations"] = 3
    config["outdoor"]["figures"] = {"25": ["ideal", "HDL-64E"], "27": ["real", "HDL-32E"]}
    path.write_text(yaml.safe_dump(config, sort_keys=False))
    (folder / "config/samples.tsv").write_text(SHEET)
    (folder / "config/outdoor_samples.tsv").write_text(_OUTDOOR_SHEET)


def run_tiny(folder: Path, cores: int) -> Path:
    """Run the tiny study in a copied project, which it returns."""
    make_tiny(folder)
    done = snakemake(folder, "--cores", str(cores))
    assert done.returncode == 0, done.stdout + done.stderr
    return folder
