"""A drawing that needs no data: layout of a packet, frame, residual, or rules of the workflow."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from velocal.io import storage
from velocal.io.scripts import for_each, run
from velocal.reporting.figures import beam_geometry, flow, packet
from velocal.reporting.style import save
from velocal.scanner.models import scanner_named
from velocal.study.figures import Diagram, FrameFigure, PacketFigure, ResidualFigure

DIAGRAM: TypeAdapter[Diagram] = TypeAdapter(Annotated[Diagram, Field(discriminator="kind")])


@for_each("svg", "png", "csv", "selection")
def main(*, svg: Path, png: Path, csv: Path, selection: Mapping[str, Any]) -> None:
    """Write the drawing as SVG and PNG and what is drawn as CSV."""
    drawn = DIAGRAM.validate_python(selection)
    if isinstance(drawn, PacketFigure):
        scanner = scanner_named(drawn.scanner)
        fields = packet.packet_fields(scanner)
        numbers, figure = packet.packet_table(fields), packet.draw_packet(fields, scanner)
    elif isinstance(drawn, FrameFigure):
        numbers = beam_geometry.frame_table(drawn)
        figure = beam_geometry.draw_frame(numbers, drawn)
    elif isinstance(drawn, ResidualFigure):
        numbers = beam_geometry.residual_table()
        figure = beam_geometry.draw_residual(numbers)
    else:
        numbers, figure = flow.flow_table(), flow.draw_flow()
    save(figure, svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    run(main, snakemake)
