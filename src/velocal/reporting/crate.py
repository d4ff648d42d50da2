"""A run as a Research Object Crate: what it was made from, with what, and what came out.

RO-Crate describes a folder in one file of JSON-LD that repositories such as Zenodo and WorkflowHub
read. The profile is that of a process run (`Process Run Crate
<https://w3id.org/ro/wfrun/process>`_): one action with its inputs, results and software.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rocrate.model import ContextEntity, File
from rocrate.rocrate import ROCrate

PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
#: Media types of the files of a run, by suffix.
MEDIA = {
    "csv": "text/csv",
    "html": "text/html",
    "json": "application/json",
    "md": "text/markdown",
    "parquet": "application/vnd.apache.parquet",
    "png": "image/png",
    "svg": "image/svg+xml",
    "tex": "application/x-tex",
    "tsv": "text/tab-separated-values",
    "xml": "application/xml",
    "yaml": "application/yaml",
}


@dataclass(frozen=True)
class Described:
    """A file of a run.

    Attributes
    ----------
    path : str
        From the folder of the results, with ``/``; an input may lie elsewhere.
    sha256 : str
        Digest of its content.
    size : int
        Bytes.
    """

    path: str
    sha256: str
    size: int


def crate(
    title: str,
    *,
    simulated: bool,
    inputs: Sequence[Described],
    results: Sequence[Described],
    versions: Mapping[str, str],
    date: str,
) -> dict[str, Any]:
    """Describe a run.

    Parameters
    ----------
    title : str
        Of the study.
    simulated : bool
        Whether the recordings are simulated.
    inputs : sequence of Described
        Files that people handed over. They are named with their digests, but are no part of the
        folder that is described.
    results : sequence of Described
        Files in the folder.
    versions : mapping of str to str
        Of the software, with the program that ran under the name velocal.
    date : str
        Day of the run, YYYY-MM-DD.

    Returns
    -------
    dict of str to object
        Content of ``ro-crate-metadata.json``.
    """
    made = ROCrate(gen_preview=False)
    made.name = title
    made.description = "Calibration of laser scanners by velocal." + (
        " The recordings are simulated." if simulated else ""
    )
    made.datePublished = date
    made.root_dataset["conformsTo"] = [made.add(ContextEntity(made, PROFILE, {
        "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5",
    }))]  # fmt: skip
    outputs = [
        made.add(File(made, dest_path=one.path, properties=_properties(one))) for one in results
    ]
    given = [
        made.add(ContextEntity(made, f"#{one.path}", {"@type": "File", **_properties(one)}))
        for one in inputs
    ]
    software = {
        name: made.add(ContextEntity(made, f"#{name}", {
            "@type": "SoftwareApplication", "name": name, "softwareVersion": version,
        }))
        for name, version in versions.items()
    }  # fmt: skip
    program = software.pop("velocal")
    program["softwareRequirements"] = list(software.values())
    action = made.add(ContextEntity(made, "#run", {
        "@type": "CreateAction", "name": f"Run of velocal: {title}", "endTime": date,
    }))  # fmt: skip
    action["instrument"] = program
    action["object"] = given
    action["result"] = outputs
    made.root_dataset["mentions"] = [action]
    return dict(made.metadata.generate())


def _properties(one: Described) -> dict[str, Any]:
    known = {"name": one.path.rsplit("/", 1)[-1], "contentSize": one.size, "sha256": one.sha256}
    media = MEDIA.get(one.path.rsplit(".", 1)[-1])
    return known | ({"encodingFormat": media} if media else {})
