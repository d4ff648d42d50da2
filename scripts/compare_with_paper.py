"""Every printed cell of the paper's tables beside the reproduced one."""

from pathlib import Path

import pandas as pd

from velocal import storage
from velocal.errors import reported
from velocal.published import agreement


def main(summary: Path, tables: list[Path], output: Path) -> None:
    """Write the comparison as CSV."""
    reproduced = pd.concat(
        [pd.DataFrame(storage.read_csv(path)) for path in tables], ignore_index=True
    )
    storage.write_csv(output, agreement(pd.DataFrame(storage.read_csv(summary)), reproduced))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.summary),
            [Path(path) for path in snakemake.input.tables],
            Path(snakemake.output.agreement),
        )
