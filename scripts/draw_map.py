"""Map of an interior with a section of one wall before and after, and its numbers."""

from pathlib import Path

from velocal.evaluation.interior_map import clouds, section, summary_table
from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.reporting.figures.interior_map import draw_map, section_table
from velocal.reporting.style import save
from velocal.study.figures import MapFigure


def main(
    *,
    points: Path,
    svg: Path,
    png: Path,
    csv: Path,
    summary: Path,
    selection: MapFigure,
    simulated: bool,
) -> None:
    """Write the figure as SVG and PNG, its section as CSV, and the summary of the map as CSV."""
    columns, facts = storage.read_table(points, schemas.MAP)
    xyz = clouds(columns)
    sections = {name: section(xyz, box, name) for name, box in selection.sections.items()}
    shown = next(iter(sections.values()))
    numbers = section_table(shown, columns, facts["positions"])
    scanners = dict(zip(facts["positions"], facts["scanners_m"], strict=True))
    figure = draw_map(xyz["refined"], scanners, numbers, selection, simulated=simulated)
    save(figure, svg, png)
    storage.write_csv(csv, numbers)
    storage.write_csv(summary, summary_table(columns, sections))


if "snakemake" in globals():
    run(main, snakemake)
