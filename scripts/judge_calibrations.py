"""Say in the end whether every calibration is better than what it replaces, and fail if not."""

from pathlib import Path

from velocal.evaluation.holdout import JudgedCalibration, judge
from velocal.io import storage
from velocal.io.plain import from_plain
from velocal.io.scripts import run


def main(*, units: list[Path], report: Path, verdicts: Path, names: list[str]) -> None:
    """Write what was held out says of every calibration; `names` are those of the files.

    The report is written before, so that it is there when this fails. The last line is what a run
    says at its end.
    """
    found = {
        name: from_plain(JudgedCalibration, storage.read_json(path), str(path))
        for name, path in zip(names, units, strict=True)
    }
    said = "; ".join(f"{name} is {each.headline}" for name, each in found.items())
    storage.write_text(verdicts, f"{judge(found)}\nThe report is {report}: {said}.\n")


if "snakemake" in globals():
    run(main, snakemake)
