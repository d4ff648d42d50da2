"""The report: complete, self-contained, the same bytes for the same study."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from support.page import certificate, picture, sample_map
from support.results import TABLES, statistics
from write_report import main

from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.io import storage
from velocal.paper import agreement as comparison
from velocal.paper import printed as published
from velocal.paper import tables
from velocal.reporting import report
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
from velocal.study.figures import LaserFigure
from velocal.survey.checks.findings import Finding, columns

LASERS, SUMMARY = statistics()
FACTORY = nominal(SCANNERS["HDL-32E"])
PNG = picture()

METHODS = pd.DataFrame(
    {
        "method": ["paper", "unit"], "name": ["the paper <printed>", "ours"], "reference": "x",
        "planes": "all", "parameters": "dl", "other_seen": [0, 0], "unconverged": [3, 0],
        "calibration_walls_rms_cm": [1.0, 1.01], "other_walls_rms_cm": [2.0, 1.5],
    }
)  # fmt: skip

LEDGER = {
    "file": "sa5.bin", "scanner": "HDL-32E", "duration_s": 33.1, "rotations": 332,
    "rotations_complete": 330, "rotation_rate_hz": 10.006, "gaps": 2, "packets_missing": 17,
    "remarks": ["azimuth step <odd>"],
    "ledger": {
        "file_bytes": 1234567, "framing": "records of 1248 bytes",
        "data": {"packets": 989, "bytes": 1}, "framing_bytes": 2,
        "position": {"packets": 3, "bytes": 4},
        "rejected": {"cut short": {"packets": 1, "bytes": 77}}, "unaccounted_bytes": 0,
    },
}  # fmt: skip

SURVEY = {
    "position": "P5", "scanner": "HDL-32E",
    "pose": {
        "rotation": np.eye(3).tolist(), "translation_m": [10.0, 0.0, 0.0],
        "covariance_rad_m": np.diag([1e-6, 4e-6, 9e-6, 1e-8, 4e-8, 9e-8]).tolist(),
        "targets": ["B1", "B2", "B3"], "variance_factor": 1.234, "redundancy": 3,
    },
    "planes": [
        {
            "name": "short_wall", "targets": 110, "flatness_mean_m": 0.00076,
            "flatness_max_m": 0.00244, "variance_factor": None,
        }
    ],
}  # fmt: skip


def columns_of_set():
    dl = FACTORY.dl + 0.0123
    zero = np.zeros(32)
    return {
        "laser_id": np.arange(32), "dl_m": dl, "alpha_rad": FACTORY.alpha, "v_rad": FACTORY.v,
        "voff_m": zero, "hoff_m": zero, "dl_std_m": zero + 0.0004, "v_std_rad": zero + np.nan,
    }  # fmt: skip


def agreement():
    rebuilt = pd.concat(
        [
            tables.formatted(tables.build(n, entry, SUMMARY, simulated=True).frame)
            for n, entry in TABLES.items()
        ]
    )
    return comparison.of_cells(comparison.statistics_shown(SUMMARY, rebuilt))


EXPORTS = pd.DataFrame(
    {
        "file": ["set1.yaml", "set1.xml"], "program": ["ros", "veloview"],
        "rotation_rate_hz": [9.87, np.nan], "count": [5, 5], "factory_cm": [2.21, 2.21],
        "before_cm": [2.31, 2.33],
        "model_cm": [0.41, 0.41], "after_cm": [0.42, 0.43],
    }
)  # fmt: skip
FULL = report.Study(
    title="Study of <two> scanners & more",
    simulated=True,
    ledgers={"sa5": LEDGER},
    tables=TABLES,
    summary=SUMMARY,
    agreement=agreement(),
    claims=pd.DataFrame(
        {
            "claim": ["It holds.", "It does not."],
            "where": ["here", "there"],
            "computed": ["1 < 2", "2 > 1"],
            "test": ["t", "F"],
            "verdict": ["holds", "cannot be judged"],
            "explanation": ["so it is", "too few"],
        }
    ),
    figures=[
        report.Figure(
            "16",
            LaserFigure(kind="std", scanner="HDL-32E", samples=["sa5"], data="calibration"),
            pd.DataFrame(
                {
                    "calibration": ["before", "after"],
                    "role": ["factory", "window"],
                    "parameter_set": ["", ""],
                }
            ),
            PNG,
        )
    ],
    surveys=[SURVEY],
    sets={"HDL-32E": {"set1": columns_of_set()}},
    exports={("HDL-32E", "set1"): EXPORTS},
    factories={"HDL-32E": FACTORY},
    field_table=pd.DataFrame({"sample": ["street"], "rms_cm": [0.61234567]}),
    field_pictures={"street": PNG},
    methods=METHODS,
    methods_png=PNG,
    certificates=[certificate()],
    range_sigma_m={certificate().scanner: 0.02},
    maps=[sample_map()],
)
PAGE = report.render(FULL)


class Elements(HTMLParser):
    """Collects elements, and checks that they are closed in order."""

    VOID = ("meta", "link", "img", "br", "input")

    def __init__(self, page):
        super().__init__()
        self.stack, self.found = [], []
        self.feed(page)
        assert not self.stack

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag


def text_of(page):
    page = re.sub(
        r"(?s)<style>.*?</style>|<script.*?</script>|src=\"data:[^\"]*\"|<[^>]+>", " ", page
    )
    return re.sub(r"\s+", " ", page)


def test_identical_bytes():
    assert report.render(FULL) == PAGE


def test_needs_no_network():
    """Scripts are in the page; what they draw is said again in tables and pictures."""
    for tag, attributes in Elements(PAGE).found:
        assert tag not in ("iframe", "object", "base")
        for name in ("src", "href"):
            assert attributes.get(name, "#").startswith(("#", "data:", "certificate.html"))
    svg = "http://www.w3.org/2000/svg"  # a name, not an address that is asked for
    assert not re.search(r"https?://|url\(|@import|fetch\(|XMLHttp", PAGE.replace(svg, ""))


def test_links_lead_somewhere():
    found = Elements(PAGE).found
    ids = {attributes["id"] for _, attributes in found if "id" in attributes}
    links = {a["href"] for tag, a in found if tag == "a"} - {"certificate.html"}
    assert {f"#{name}" for name in ids} >= links
    assert len(links) == 12


def test_simulated_studies_say_so_first():
    text = text_of(PAGE)
    assert text.index("The recordings of this study are simulated.") < text.index("Overview")
    assert "no evidence" in text


def test_other_studies_do_not():
    page = report.render(replace(FULL, simulated=False))
    assert "imulat" not in text_of(page)
    Elements(page)


def test_every_printed_cell_occurs_with_its_verdict():
    text = text_of(PAGE)
    for row in FULL.agreement.to_dict(orient="records"):
        dagger = " †" if row["item"] in published.CONTRADICTIONS else ""
        assert f"{row['item']}{dagger} " in text
    count = (FULL.agreement["within"] == "true").sum()
    assert PAGE.count(">yes</td>") == count
    assert f"All {len(FULL.agreement)} entries" in text
    for reason in published.CONTRADICTIONS.values():
        assert reason in text
    items = FULL.agreement["item"]
    std = FULL.agreement[items.str.endswith("std_cm")]
    assert f"{(std['within'] == 'true').sum()} of {len(std)}" in text


def test_what_the_check_will_refuse_stands_at_the_top():
    page = report.render(replace(FULL, unexpected=["V <item>: printed 1, reproduced 2"]))
    text = text_of(page)
    assert text.index("1 numbers are not as they were.") < text.index("Overview")
    assert "V &lt;item&gt;: printed 1, reproduced 2" in page
    Elements(page)
    assert "not as they were" not in PAGE


def test_contradictory_cells_are_marked_beside_our_numbers():
    assert re.search(r"67\.4<sup>†</sup>", PAGE)
    assert re.search(r"3\.4<sup>†</sup>", PAGE)


def test_printed_labels_are_shown_where_they_differ():
    assert "sa5 (printed: sc3)" in text_of(PAGE)
    assert "sa5 (printed: sa6)" in text_of(PAGE)


def test_text_is_escaped():
    assert "Study of &lt;two&gt; scanners &amp; more" in PAGE
    assert "azimuth step &lt;odd&gt;" in PAGE


def test_ledger_survey_sets_and_field():
    text = text_of(PAGE)
    assert "cut short: 1 packets, 77 bytes" in text
    assert "1\u202f234\u202f567" in PAGE
    assert "0.057, 0.115, 0.172" in text
    # Of the scanner's origin: 10 m from the site frame's, whose own are 0.10, 0.20 and 0.30 mm.
    assert "0.10, 30.00, 20.00" in text
    assert "short wall 110 0.76 2.44 –" in text
    assert "1 1.230 0.040 0.0000 –" in text
    assert "street 0.61235" in text


def test_verdicts_read_from_a_file_are_understood():
    read = FULL.agreement.assign(within=FULL.agreement["within"] == "true")
    assert report.render(replace(FULL, agreement=read)) == PAGE


def test_without_comparison_there_is_nothing_of_the_paper():
    page = report.render(replace(FULL, agreement=None, methods=None, simulated=False))
    assert "paper" not in text_of(page).replace("as in the paper", "")
    assert 'id="agreement"' not in page
    Elements(page)


@pytest.mark.parametrize("simulated", [True, False])
def test_a_study_of_ledgers_alone(simulated):
    page = report.render(report.Study("Two recordings", simulated, ledgers={"x": LEDGER}))
    ids = [attributes.get("id") for tag, attributes in Elements(page).found if tag == "section"]
    assert ids == ["ledger", "versions"]


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.005, "1.00"), (-0.001, "0.00"), (-2.5, "−2.50"), (None, "–"), (float("nan"), "–")],
)
def test_fixed(value, text):
    assert report.fixed(value, 2) == text


def test_claims_show_their_verdict_and_open_their_numbers():
    text = PAGE[PAGE.index("Claims of the paper") :]
    assert "<td>holds</td><td><details><summary>so it is</summary>" in text
    assert '<td class="off">cannot be judged</td>' in text
    assert "1 &lt; 2" in text
    assert "Claims of the paper" not in report.render(replace(FULL, claims=None))


def test_script_reads_what_is_there(tmp_path):
    for folder in ("recordings/sa5", "HDL-32E"):
        (tmp_path / folder).mkdir(parents=True)
    storage.write_json(tmp_path / "recordings/sa5/ledger.json", LEDGER)
    storage.write_csv(tmp_path / "summary.csv", SUMMARY)
    storage.write_csv(tmp_path / "agreement.csv", FULL.agreement)
    item = FULL.agreement["item"][FULL.agreement["within"] == "true"].iloc[0]
    (tmp_path / "known.csv").write_text(f"item,rotations,reason\n{item},,it was missed once\n")
    storage.write_json(tmp_path / "P5.json", SURVEY)
    storage.write_csv(tmp_path / "checks.csv", columns([]))
    drawn = tmp_path / "figure_16.png"
    drawn.write_bytes(PNG)
    storage.write_csv(drawn.with_suffix(".csv"), FULL.figures[0].numbers)
    of_set = tmp_path / "HDL-32E/set1.csv"
    formats.write(of_set, CalibrationFile(FACTORY, std={"dl": np.full(32, 0.001)}))
    storage.write_csv(of_set.with_suffix(".exports.csv"), EXPORTS)
    files = {
        "ledgers": [tmp_path / "recordings/sa5/ledger.json"],
        "summary": tmp_path / "summary.csv",
        "agreement": tmp_path / "agreement.csv",
        "listed_misses": tmp_path / "known.csv",
        "surveys": [tmp_path / "P5.json"],
        "checks": tmp_path / "checks.csv",
        "maps": [],
        "map_pictures": [],
        "pictures": [drawn],
        "numbers": [drawn.with_suffix(".csv")],
        "sets": [of_set],
        "exports": [of_set.with_suffix(".exports.csv")],
        "factories": [],
        "field_pictures": [],
        "unit_pictures": [],
        "unit_tables": [],
        "drift_pictures": [],
        "outdoor_pictures": [],
        "outdoor_numbers": [],
    }
    files |= dict.fromkeys(
        (
            "certificate",
            "methods_csv",
            "methods_png",
            "field_table",
            "outdoor",
            "claims",
            "interior",
        )
    )
    common = {"title": "t", "simulated": True, "rotations": 330, "tables": TABLES}
    common |= {"figures": {"16": FULL.figures[0].selection.plain()}, "scanners": ["HDL-32E"]}
    common |= {"samples": ["sa5"], "set_scanners": ["HDL-32E"], "set_names": ["set1"]}
    common |= {"factory_scanners": [], "field_samples": [], "unsurveyed_units": []}
    common |= {"timed_units": [], "range_sigma_m": {}}
    common |= {"outdoor_figures": {}}
    main(**files, report_html=tmp_path / "report.html", **common)
    page = (tmp_path / "report.html").read_text()
    ids = [attributes.get("id") for tag, attributes in Elements(page).found if tag == "section"]
    assert ids == [
        "overview", "tables", "agreement", "figures", "survey", "sets", "ledger", "versions",
    ]  # fmt: skip
    assert str(tmp_path) not in page
    assert f"{item}: is listed as a known miss, but it is not missed" in text_of(page)


def test_warnings_of_the_survey_stand_on_top():
    warning = Finding("warning", "pose", "base.csv, position <P1>", "is poor", "2 cm", "Do this.")
    page = report.render(replace(FULL, warnings=[warning]))
    Elements(page)
    top = text_of(page[: page.index("<nav")])
    assert "base.csv, position &lt;P1&gt;: is poor (allowed: 2 cm). Do this." in top
    assert "The checks of the survey warn" not in PAGE


def test_methods_are_compared():
    section = re.search(r'(?s)<section id="methods"[^>]*>.*?</section>', PAGE)[0]
    assert "the paper &lt;printed&gt;" in section
    assert "-25.0 % on the position" in section
    assert section.count("<tr>") == 3
    assert 'id="methods"' not in report.render(replace(FULL, methods=None))


def test_outdoor_figures_say_what_they_show():
    """Also to those who do not see the picture."""
    numbers = pd.DataFrame(
        {
            "distance_m": [10.0, 35.0], "before_cm": [2.0, 3.0], "after_cm": [1.0, 1.5],
            "parameter_set": "set3",
        }
    )  # fmt: skip
    means = pd.DataFrame(
        {
            "kind": "real", "scanner": "HDL-64E", "samples": 2, "role": ["factory", "set"],
            "parameter_set": ["", "set3"], "rms_cm": [2.5, 1.25], "shown": ["before", "after"],
        }
    )  # fmt: skip
    drawn = report.OutdoorFigure("26", "real", "HDL-64E", numbers, PNG)
    found = Elements(report.render(replace(FULL, outdoor=means, outdoor_figures=[drawn]))).found
    texts = [attributes["alt"] for tag, attributes in found if tag == "img"]
    (text,) = [each for each in texts if "distance of the panels" in each]
    for part in ("real conditions", "HDL-64E", "10 to 35 m", "2.50 cm", "1.25 cm", "set3"):
        assert part in text
    assert ("figure", {"id": "figure-26"}) in found


def test_every_figure_of_the_paper_is_accounted_for():
    section = re.search(r'(?s)<section id="figures">.*?</section>', PAGE)[0]
    assert section.count('<tr><th scope="row"') >= 28
    own = report.render(replace(FULL, agreement=None))
    assert "every figure of the paper" not in own
    assert "Table II" not in own
    assert ">Calibration data, HDL-64E: " in own


# -- wide tables, on screen and on paper -----------------------------------------------------------


def test_wide_tables_scroll_by_keyboard():
    """A region that scrolls can have the focus, and has a name of its own."""
    found = Elements(PAGE).found
    regions = [a for _, a in found if a.get("class", "").split(" ")[0] == "scroll"]
    assert len(regions) == sum(tag == "table" for tag, _ in found) > 10
    assert all(each["tabindex"] == "0" and each["role"] == "region" for each in regions)
    labels = [each["aria-label"] for each in regions]
    assert len(set(labels)) == len(labels)
    assert {"Table II", "Parameter set set1, HDL-32E", "Ledger"} <= set(labels)


def test_style_for_paper():
    style = re.search(r"(?s)<style>(.*?)</style>", PAGE)[1]
    assert "@page { size: A4;" in style
    assert "@page across { size: A4 landscape; }" in style
    paper = style[style.index("@media print") :]
    assert ".scroll { overflow: visible; }" in paper
    assert "details::details-content { content-visibility: visible;" in paper
    assert "@media screen and (prefers-color-scheme: dark)" in style


MEASURE = """
<style>html { width: 186mm; } .across { width: 273mm; }</style>
<script>
const found = [...document.querySelectorAll("table")].map(table => {
  const page = table.closest(".across") || document.documentElement;
  const over = table.getBoundingClientRect().right - page.getBoundingClientRect().right;
  const name = table.parentElement.getAttribute("aria-label");
  return {name: name, over: over, height: table.getBoundingClientRect().height};
});
document.title = JSON.stringify(found);
</script>
"""


def on_paper(page, folder, chromium):
    """Name, pixels beyond the text, and height of every table, as a browser lays them out.

    The text is as wide as an A4 page, upright or across, without its margins of 12 mm.
    """
    style, n = re.subn("@media print", "@media all", page)
    assert n == 1
    file = folder / "page.html"
    file.write_text(style.replace("</body>", f"{MEASURE}</body>"))
    done = subprocess.run(
        [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom",
         f"--user-data-dir={folder / 'profile'}", file.as_uri()],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    (title,) = re.findall(r"(?s)<title>(\[.*?\])</title>", done.stdout)
    return json.loads(title)


def test_all_columns_are_on_the_page_of_a4(tmp_path):
    """Also with long names of files, and the tables in collapsed parts are there."""
    names = ("chromium", "chromium-browser", "google-chrome")
    chromium = next(filter(None, map(shutil.which, names)), None)
    if chromium is None:
        pytest.skip("no Chromium that could lay out the page. Hint: install the package chromium")
    ledger = LEDGER | {"file": "recording_of_the_first_position_with_the_lamp_on_2026-11-26.pcap"}
    numbers = {name: [1.234, 170.0] for name in (
        "calibration_rms_cm", "other_rms_cm", "calibration_within_1sigma_pct",
        "other_within_1sigma_pct", "dl_error_cm", "alpha_error_deg", "v_error_deg", "v_far_off")
    }  # fmt: skip
    names = ["planes unknown, range scale", "with prior, positions jointly"]
    methods = METHODS.assign(
        **numbers, name=names, reference="Muhammad and Lacroix 2010", parameters="dl alpha v scale"
    )
    planes = pd.DataFrame({f"column_{i}_cm": [1.23456] for i in range(16)})
    page = report.render(
        replace(FULL, methods=methods, ledgers={"real64_01": ledger}, field_table=planes)
    )
    found = on_paper(page, tmp_path, chromium)
    assert len(found) == page.count("<table")
    assert [table for table in found if table["over"] > 0.5] == []
    assert [table["name"] for table in found if table["height"] < 20] == []
    # What the browser says without the style for paper:
    bare = re.sub(r"(?s)(@media print \{).*?\n\}\n", r"\1 }\n", page)
    wide = {table["name"] for table in on_paper(bare, tmp_path, chromium) if table["over"] > 0.5}
    assert wide >= {"Methods", "Ledger"}


def test_files_for_programs_state_their_rate_and_what_they_are_worth():
    rows = re.findall(r"<tr><td>set1.*?</tr>", PAGE)
    cells = [re.findall(r"<td[^>]*>([^<]*)</td>", row) for row in rows]
    assert cells == [
        ["set1.yaml", "ros", "9.87", "2.21", "2.31", "0.41", "0.42"],
        ["set1.xml", "veloview", "any", "2.21", "2.33", "0.41", "0.43"],
    ]
