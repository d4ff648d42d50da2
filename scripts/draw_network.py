"""Picture of the adjusted network of a survey."""

from pathlib import Path

from velocal.io import storage
from velocal.io.scripts import run
from velocal.reporting.figures.network import draw_network
from velocal.reporting.style import save


def main(
    *,
    quality: Path,
    svg: Path,
    png: Path,
    simulated: bool,
) -> None:
    """Draw set-ups, points with error ellipses, and how good all points are."""
    save(draw_network(storage.read_json(quality), simulated=simulated), svg, png)


if "snakemake" in globals():
    run(main, snakemake)
