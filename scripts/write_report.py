"""Everything that the study has found on one page of HTML."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from velocal import report, storage
from velocal.calibration_files import formats
from velocal.errors import reported
from velocal.sensors import scanner_named


def frame(path: Path | None) -> pd.DataFrame | None:
    return pd.DataFrame(storage.read_csv(path)) if path else None


def main(
    files: Mapping[str, list[Path]],
    output: Path,
    *,
    title: str,
    simulated: bool,
    tables: Mapping[str, Any],
    figures: Mapping[str, Any],
    factories: Mapping[str, str],
) -> None:
    """Write the report; `files` are the rule's inputs by name, and any may be missing."""
    one = {name: next(iter(files[name]), None) for name in ("summary", "agreement")}
    pictures = {path.with_suffix(""): path for path in files["figures"] if path.suffix == ".png"}
    sets: dict[str, dict[str, Any]] = {}
    for path in files["sets"]:
        sets.setdefault(path.parent.name, {})[path.stem] = storage.read_csv(path)
    field = {path.suffix: [p for p in files["field"] if p.suffix == path.suffix]
             for path in files["field"]}  # fmt: skip
    study = report.Study(
        title=title,
        simulated=simulated,
        ledgers={path.parent.name: storage.read_json(path) for path in files["ledgers"]},
        tables=tables,
        summary=frame(one["summary"]),
        agreement=frame(one["agreement"]),
        figures=[
            report.Figure(
                stem.name[-2:], figures[stem.name[-2:]],
                pd.DataFrame(storage.read_csv(stem.with_suffix(".csv"))), path.read_bytes(),
            )
            for stem, path in pictures.items()
        ],
        surveys=[storage.read_json(path) for path in files["surveys"]],
        sets=sets,
        factories={
            name: formats.read_or_nominal(
                None if path == "nominal" else Path(path), scanner_named(name)
            )
            for name, path in factories.items()
        },
        field_table=frame(next(iter(field.get(".csv", [])), None)),
        field_pictures={path.parent.name: path.read_bytes() for path in field.get(".png", [])},
    )  # fmt: skip
    storage.write_text(output, report.render(study))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        names = ("ledgers", "figures", "agreement", "summary", "surveys", "sets", "field")
        given = {name: snakemake.input.get(name) or [] for name in names}
        main(
            {n: [Path(p) for p in ([v] if isinstance(v, str) else v)] for n, v in given.items()},
            Path(snakemake.output.report),
            title=snakemake.params.study,
            simulated=snakemake.params.simulated,
            tables=snakemake.params.tables,
            figures=snakemake.params.figures,
            factories=snakemake.params.factories,
        )
