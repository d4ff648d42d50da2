"""The description of a run for repositories of data, read by an independent library."""

import hashlib
import json

import yaml
from describe_run import main
from rocrate.rocrate import ROCrate
from support.running import ROOT


def test_crate_of_a_run(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    given = tmp_path / "survey/planes.csv"
    report = tmp_path / "results/report.html"
    table = tmp_path / "results/tables/table_2.csv"
    for number, path in enumerate((given, report, table)):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"content {number}")
    metadata = tmp_path / "results/ro-crate-metadata.json"
    main(
        handed_over=[given],
        made=[table, report],
        metadata=metadata,
        title="A <study>",
        simulated=True,
    )
    first = metadata.read_bytes()
    main(
        handed_over=[given],
        made=[report, table],
        metadata=metadata,
        title="A <study>",
        simulated=True,
    )
    assert metadata.read_bytes() == first
    read = ROCrate(tmp_path / "results")
    assert read.name == "A <study>"
    assert "simulated" in read.description
    assert read.root_dataset["datePublished"] == "1970-01-02"
    action = read.dereference("#run")
    assert sorted(each.id for each in action["result"]) == ["report.html", "tables/table_2.csv"]
    (used,) = action["object"]
    assert used["sha256"] == hashlib.sha256(b"content 0").hexdigest()
    assert used["contentSize"] == 9
    assert action["instrument"]["name"] == "velocal"
    assert "numpy" in [each["name"] for each in action["instrument"]["softwareRequirements"]]
    assert read.dereference("report.html")["encodingFormat"] == "text/html"
    ids = [entity["@id"] for entity in json.loads(first)["@graph"]]
    assert len(set(ids)) == len(ids)


def test_files_of_the_codecheck_are_made():
    """Every file that codecheck.yml names is one that README.md or results/README.md tells of."""
    manifest = yaml.safe_load((ROOT / "codecheck.yml").read_text(encoding="utf-8"))["manifest"]
    told = (ROOT / "README.md").read_text(encoding="utf-8")
    names = [each["file"].removeprefix("results/") for each in manifest]
    assert len(names) > 4
    for name in names:
        assert name in told or name.startswith("tables/table_")


def test_container_copies_what_is_there():
    text = (ROOT / "Containerfile").read_text(encoding="utf-8")
    commands = [line.split() for line in text.splitlines() if line.startswith("COPY")]
    copied = [name for _, name, *_ in commands if not name.startswith("--from=")]
    assert copied
    assert all((ROOT / name).exists() for name in copied)
