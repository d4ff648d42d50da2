"""Sample tables: one recording a row, typed and checked."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self, TypeVar

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, model_validator

from velocal.calibration.dialects import DIALECTS
from velocal.errors import ConfigError
from velocal.io.written_tables import read_written_table
from velocal.scanner.models import SCANNERS, Scanner
from velocal.study.model import (
    RESULTS_FOLDER,
    Name,
    Positive,
    ScannerName,
    Section,
    Text,
    enum,
    fault,
    known_as,
    near,
    validated,
)
from velocal.study.scanner_file import is_scanner_file, read_scanner
from velocal.study.windows import WHOLE, WINDOWS

#: What the column `calibration` may say instead of naming a file.
NOMINAL, EMBEDDED = "nominal", "embedded"

_DialectName = Annotated[str, known_as("dialect", DIALECTS), enum(DIALECTS)]
#: An empty entry means that nothing is chosen.
_Any = BeforeValidator(lambda cell: None if cell == "" else cell)


def _of_packets(name: str) -> str:
    """Refuse a scanner that a file describes, where packets are read."""
    if is_scanner_file(name):
        raise fault(
            f"{name!r} describes a scanner whose packets are not read",
            allowed=SCANNERS,
            hint="Only clouds of points without a survey may name such a file: give them in "
            "`unsurveyed.samples`, with their `dialect`.",
        )
    return name


def _named_or_file(name: str) -> str:
    """Check the name of a scanner, unless a file describes it."""
    if not is_scanner_file(name) and name not in SCANNERS:
        raise fault(
            f"unknown scanner {name!r}",
            allowed=[*SCANNERS, "a YAML file that describes it"],
            hint=near(name, SCANNERS),
        )
    return name


class Row(Section):
    """What every row of a sample table says; cells are text, and numbers are read from it."""

    model_config = ConfigDict(strict=False)

    name: Name = Field(
        alias="sample", description="name of the recording: letters, digits, `_` and `-`; unique"
    )
    scanner: Annotated[ScannerName, BeforeValidator(_of_packets)] = Field(
        description="scanner that made the recording; `HDL-64E` is an S2"
    )
    recording: Text = Field(
        description="path of the capture: records of 1206 or 1248 bytes, pcap, pcapng, any of "
        "them gzipped, or a file of a ROS bag (`docs/file-formats.md`); or an address "
        "(`s3://...`, `https://...`) from which a storage plugin of Snakemake fetches it"
    )
    calibration: Text = Field(
        description="path of the factory's calibration (`.xml` as Velodyne ships it, ROS `.yaml`, "
        "or our `.csv`), `nominal`, or `embedded`"
    )

    @property
    def is_remote(self) -> bool:
        """Whether the recording is an address, from which a storage plugin fetches it."""
        return "://" in self.recording


class Sample(Row):
    """A recording indoors, one scanner of which may be chosen."""

    port: Annotated[int | None, Field(ge=1, le=65535), _Any] = Field(
        default=None,
        description="UDP port to which this scanner sent, where a capture holds several scanners; "
        "an empty entry means any",
    )
    address: Annotated[str | None, Field(pattern=r"^([0-9.]+|/[A-Za-z0-9_/]+)$"), _Any] = Field(
        default=None,
        description="IPv4 address from which this scanner sent, or its topic in a bag; an empty "
        "cell means any",
    )

    @property
    def windows(self) -> tuple[str, ...]:
        """Windows of the recording that are reduced."""
        return (WHOLE,)


class SurveyedSample(Sample):
    """A recording at a surveyed position."""

    position: Name = Field(
        description="surveyed position, as in `survey.base_site`; a position belongs to one scanner"
    )

    @property
    def windows(self) -> tuple[str, ...]:
        """Windows of the recording that are reduced."""
        return WINDOWS


class UnsurveyedSample(Sample):
    """A recording without a survey, or a cloud of points."""

    scanner: Annotated[str, AfterValidator(_named_or_file)] = Field(
        description="scanner that made the recording, or, where that is a cloud, path of a YAML "
        "file that describes the scanner (`docs/file-formats.md`)"
    )
    dialect: Annotated[_DialectName | None, _Any] = Field(
        default=None,
        description="where the recording is a cloud of points: the program that computed them with "
        "`calibration` (`docs/dialects.md`); an empty entry means packets",
    )
    frame: Annotated[Literal["velocal", "ros"] | None, _Any] = Field(
        default=None,
        description="axes of a cloud: `velocal` (Y forward, X right) or `ros` (X forward, Y left); "
        "an empty entry means those of its format or its program",
    )

    @model_validator(mode="after")
    def _of_a_cloud(self) -> Self:
        """Check what is said of a cloud, and only of a cloud."""
        if self.dialect is None and self.frame is not None:
            raise fault(
                "is said of packets", key="frame", hint="Name the program of a cloud, as `dialect`."
            )
        if self.dialect is not None and self.calibration == EMBEDDED:
            raise fault(
                f"{EMBEDDED!r}, but the recording is a cloud",
                key="calibration",
                allowed=["a file", NOMINAL],
                hint="A cloud holds no packets: name the file that the program used.",
            )
        if self.dialect is None and is_scanner_file(self.scanner):
            _of_packets(self.scanner)
        return self

    @property
    def is_cloud(self) -> bool:
        """Whether the recording is a cloud of points."""
        return self.dialect is not None


class OutdoorSample(Row):
    """A recording of panels outdoors."""

    kind: Literal["ideal", "real"] = Field(
        description='conditions; means, figures and the set shown as "after" are per kind and '
        "scanner"
    )
    scene: Name = Field(
        description="where the recording was made; for a simulated one a scene of the world "
        "(`ideal1`, `real15`)"
    )
    distance_m: Positive = Field(
        description="about how far the panels stand from the scanner, horizontally"
    )
    azimuth_deg: float = Field(
        description="about where the middle between the panels is, clockwise from the scanner's "
        "Y axis"
    )


_Row = TypeVar("_Row", bound=Row)


def read_samples(path: Path, kind: type[_Row], results: str = "results") -> dict[str, _Row]:
    """Read a sample table, see `velocal.io.written_tables`; its columns are separated by tabs.

    Parameters
    ----------
    path : Path
    kind : type of Row
        What a row says.
    results : str
        Folder of the results, which `{results}` in a path stands for.

    Returns
    -------
    dict of str to Row
        By name of the sample.

    Raises
    ------
    ConfigError
        If the file, a column or a cell is wrong, or a sample occurs twice.
    """
    headings = {field.alias or name: field for name, field in kind.model_fields.items()}
    required = [name for name, field in headings.items() if field.is_required()]
    table = read_written_table(path, required, ConfigError, optional=[*headings], separator="\t")
    found: dict[str, _Row] = {}
    lines: dict[str, int] = {}
    for row, line in enumerate(table.lines):
        where = table.where(row)
        cells = {
            name: values[row].replace(RESULTS_FOLDER, results)
            for name, values in table.columns.items()
        }
        sample = validated(kind, cells, where)
        if sample.name in found:
            raise ConfigError(
                f"sample {sample.name!r} occurs twice",
                where=where,
                hint=f"Row {lines[sample.name]} has the same name; every recording needs its own "
                "name.",
            )
        found[sample.name] = sample
        lines[sample.name] = line
    return found


def embedded_path(results: str, sample: str) -> str:
    """Path of the calibration that is read from the recording of a sample."""
    return f"{results}/recordings/{sample}/calibration.xml"


def with_embedded(
    samples: MutableMapping[str, _Row],
    results: str,
    where: str,
    first: MutableMapping[str, str] | None = None,
) -> dict[str, _Row]:
    """Put the path of the calibration in a recording where the table says `embedded`.

    Parameters
    ----------
    samples : mapping of str to Row
    results, where : str
        Folder of the results; how to call the sample table in errors.
    first : mapping of str to str, optional
        First sample of every scanner so far; it is filled. Samples of a scanner share what the
        recording of its first sample holds. Without it every recording is its own source.

    Returns
    -------
    dict of str to Row

    Raises
    ------
    ConfigError
        If the scanner sends no calibration.
    """
    found = dict(samples)
    for name, sample in samples.items():
        if sample.calibration != EMBEDDED:
            continue
        if not SCANNERS[sample.scanner].embeds_calibration:
            senders = [scanner.name for scanner in SCANNERS.values() if scanner.embeds_calibration]
            raise ConfigError(
                f"sample {name!r}: {sample.scanner} sends no calibration in its packets",
                where=where,
                allowed=f"'{EMBEDDED}' for {' and '.join(senders)}",
                hint="Name a calibration file, or `nominal`. An HDL-64E S2 sends its calibration "
                "from firmware 4.07 on.",
            )
        source = name if first is None else first.setdefault(sample.scanner, name)
        path = embedded_path(results, source)
        found[name] = sample.model_copy(update={"calibration": path})
    return found


@dataclass(frozen=True)
class Described:
    """A scanner that is not among `SCANNERS`.

    Attributes
    ----------
    path : str
        File that describes it.
    scanner : Scanner
    """

    path: str
    scanner: Scanner


def with_described(
    samples: Mapping[str, UnsurveyedSample], where: str
) -> tuple[dict[str, UnsurveyedSample], dict[str, Described]]:
    """Read the scanners that files describe, and put their names into the samples.

    Parameters
    ----------
    samples : mapping of str to UnsurveyedSample
    where : str
        How to call the sample table in errors.

    Returns
    -------
    samples : dict of str to UnsurveyedSample
        With the name of the scanner in the place of the file.
    described : dict of str to Described
        By the name of the scanner.

    Raises
    ------
    ConfigError
        If a file is missing or wrong, or two of them describe scanners of one name.
    """
    found, described = dict(samples), dict[str, Described]()
    for name, sample in samples.items():
        path = sample.scanner
        if not is_scanner_file(path):
            continue
        if not Path(path).is_file():
            raise ConfigError(
                f"scanner of sample {name!r}: no file {path!r}",
                where=where,
                allowed=f"a YAML file, {', '.join(SCANNERS)}",
                hint="Paths are relative to the folder in which snakemake runs.",
            )
        scanner = read_scanner(path)
        first = described.setdefault(scanner.name, Described(path, scanner))
        if first.path != path:
            raise ConfigError(
                f"scanner of sample {name!r}: {path!r} and {first.path!r} both describe "
                f"{scanner.name!r}",
                where=where,
                hint="Name one of the two files in all rows, or give the scanners two names.",
            )
        found[name] = sample.model_copy(update={"scanner": scanner.name})
    return found, described


def scanners_of(samples: Sequence[Row]) -> list[str]:
    """Scanners of samples, in order of appearance."""
    return list(dict.fromkeys(sample.scanner for sample in samples))
