"""A drawing that needs no results: packet, frame, residual, rules, or uses of the samples."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from velocal.io import storage
from velocal.io.scripts import for_each, run
from velocal.reporting.figures import beam_geometry, flow, packet
from velocal.reporting.style import save
from velocal.scanner.models import scanner_named
from velocal.study.figures import (
    Diagram,
    FlowFigure,
    FrameFigure,
    PacketFigure,
    ResidualFigure,
    Table,
)

DIAGRAM: TypeAdapter[Diagram] = TypeAdapter(Annotated[Diagram, Field(discriminator="kind")])


@for_each("svg", "png", "csv", "selection")
def main(
    *,
    svg: Path,
    png: Path,
    csv: Path,
    selection: Mapping[str, Any],
    samples: list[str],
    scanners: list[str],
    positions: list[str],
    parameter_sets: Mapping[str, Mapping[str, list[str]]],
    tables: Mapping[str, Table],
    simulated: bool,
) -> None:
    """Write the drawing as SVG and PNG and what is drawn as CSV.

    `scanners` and `positions` are those of `samples`.
    """
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
    elif isinstance(drawn, FlowFigure):
        numbers, figure = flow.flow_table(), flow.draw_flow()
    else:
        used = map(flow.UsedSample, samples, scanners, positions)
        numbers = flow.procedure_table(list(used), parameter_sets, tables)
        figure = flow.draw_procedure(numbers, simulated=simulated)
    save(figure, svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    run(main, snakemake)
