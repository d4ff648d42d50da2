"""The scripts of the report, in a browser; and what they draw from."""

import base64
import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support.page import LASERS, certificate, picture, sample_map

from velocal.errors import StorageError
from velocal.evaluation.residual_map import root_mean_square
from velocal.reporting import interactive, report
from velocal.reporting.style import for_page
from velocal.reporting.verdict import laser_note, verdict
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal

STUDY = report.Study(
    "Own study",
    simulated=False,
    factories={"HDL-32E": nominal(SCANNERS["HDL-32E"])},
    certificates=[certificate()],
    range_sigma_m={certificate().scanner: 0.02},
    maps=[sample_map()],
    interior=interactive.Interior(
        np.arange(40_000) % 2,
        ["M1", "M2"],
        [[1.0, 2.0, 0.5], [3.0, 2.0, 0.5]],
        {
            state: np.random.default_rng(0).uniform(0.0, size, (40_000, 3))
            for state, size in (("factory", 5.0), ("refined", 4.0))
        },
    ),
)
#: Notes what goes wrong, works on the page as a person would, and puts what it found in its title.
PROBE = """
<script>
const errors = [];
window.onerror = (message) => errors.push(message);
console.error = (...parts) => errors.push(parts.join(" "));
</script>
"""
VISIT = """
<script>
const lasers = document.querySelector("section.lasers"), body = lasers.querySelector("tbody");
const firsts = () => [...body.rows].slice(0, 2).map(row => row.dataset.laser);
const headings = lasers.querySelectorAll("thead button");
headings[1].click();
const rising = firsts(), how = lasers.querySelector("[aria-sort]").getAttribute("aria-sort");
headings[1].click();
const falling = firsts();
const button = body.querySelector("tr[data-laser='3'] button");
button.focus();
button.click();
const detail = lasers.querySelector(".detail");
const count = (each) => each.querySelectorAll(".after").length;
const plots = [...detail.querySelectorAll("svg")].map(count);
const heading = document.activeElement.textContent;
body.querySelector("tr[data-laser='32']").click();
const unseen = detail.textContent;
const colours = (canvas) => {
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  return new Set(Array.from(data, (_, i) => i % 4 ? 0 : data.slice(i, i + 4).join())).size;
};
const maps = [...document.querySelectorAll(".map canvas")].map(colours);
const scenes = [...document.querySelectorAll(".scene canvas")];
const changed = (canvas, work) => {
  const before = canvas.toDataURL();
  work();
  return canvas.toDataURL() !== before;
};
const key = new KeyboardEvent("keydown", {key: "ArrowLeft"});
const turned = scenes.map((each) => changed(each, () => each.dispatchEvent(key)));
const state = document.querySelector(".interior select");
const compared = changed(scenes[1], () => {
  state.value = "after";
  state.dispatchEvent(new Event("change"));
});
const asked = performance.getEntriesByType("resource");
document.title = JSON.stringify({
  errors, rising, falling, how, plots, heading, unseen, maps, scenes: scenes.map(colours), turned,
  compared,
  requests: asked.filter(one => !one.name.startsWith("data:")).length,
  wider: document.documentElement.scrollWidth - document.documentElement.clientWidth,
});
</script>
"""


@pytest.fixture(scope="module")
def chromium():
    names = ("chromium", "chromium-browser", "google-chrome")
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        pytest.skip("no Chromium to run the page in. Hint: install the package chromium")
    return found


def visited(page, folder, chromium, width=1200):
    file = folder / "page.html"
    page = page.replace("<head>", "<head>" + PROBE, 1).replace("</body>", VISIT + "</body>")
    file.write_text(page)
    done = subprocess.run(
        [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom",
         f"--window-size={width},900", f"--user-data-dir={folder / 'profile'}", file.as_uri()],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    (title,) = re.findall(r"(?s)<title>(\{.*?\})</title>", done.stdout)
    return json.loads(title)


@pytest.mark.parametrize("width", [1200, 500])
def test_page_works_in_a_browser(tmp_path, chromium, width):
    found = visited(report.render(STUDY), tmp_path, chromium, width)
    assert found["errors"] == []
    assert found["requests"] == 0
    # dl falls from laser to laser: 10 mm for the first, -21 mm for the last.
    assert found["rising"] == ["32", "31"]
    assert found["how"] == "ascending"
    assert found["falling"] == ["1", "2"]
    # 100 bins along the azimuth, bars of a histogram, one line of correlations.
    along, bars, line = found["plots"]
    assert along == 100
    assert 3 < bars <= 40
    assert line == 1
    assert found["heading"] == "Laser 3"
    assert "No surveyed plane was seen by this laser." in found["unseen"]
    before, after = found["maps"]
    assert before > after > 3
    assert min(found["scenes"]) > 20
    assert found["compared"]
    assert found["turned"] == [True, True]
    assert found["wider"] <= 0


def test_without_maps_nothing_is_drawn(tmp_path):
    page = report.render(replace(STUDY, maps=[], interior=None))
    assert 'class="map"' not in page
    assert 'class="scene"' not in page
    assert 'id="maps"' not in page
    assert 'data-laser="1"' in page


def test_payload_is_what_was_measured():
    one = sample_map()
    text = interactive.payload([replace(one, planes=["</script><b>", "floor"])])
    assert "<" not in text
    content = json.loads(text)
    (sample,) = content["samples"]
    assert sample["planes"] == ["</script><b>", "floor"]
    for name, key, type_, unit in (
        ("laser_id", "laser", "<u1", 1.0),
        ("azimuth_bin", "azimuth_bin", "<u2", 1.0),
        ("before_m", "before", "<i2", content["residual_mm"] * 1e-3),
        ("after_m", "after_s", "<i2", content["residual_mm"] * 1e-3),
        ("y_m", "y", "<i2", content["coordinate_m"]),
    ):
        read = np.frombuffer(base64.b64decode(sample[key]), type_) * unit
        assert np.abs(read - getattr(one.residuals, name)).max() <= 0.5 * unit + 1e-12


def test_values_beyond_the_integers_are_cut():
    values = np.frombuffer(
        base64.b64decode(interactive.packed(np.array([9e9, -9e9]), 1, "<i2")), "<i2"
    )
    assert values.tolist() == [32767, -32768]


def test_root_mean_square_of_unseen_lasers_is_nan():
    found = root_mean_square(np.array([3.0, 4.0]), np.array([1, 1]), 3)
    assert np.isnan(found[[0, 2]]).all()
    assert found[1] == pytest.approx(np.sqrt(12.5))


SUMMARY = pd.DataFrame(
    {
        "scanner": "HDL-32E", "data": ["validation"] * 3 + ["calibration"],
        "role": ["factory", "unit", "set", "unit"], "parameter_set": ["", "all", "set1", "all"],
        "complies_correlated": [14, 32, 20, 1],
    }
)  # fmt: skip


def test_verdict_in_words():
    found = verdict(certificate(), SUMMARY)
    text = " ".join(found.found)
    assert found.good
    assert "from 1.33 to 0.34 cm (gain 0.99 cm, 95 % interval 0.70 to 1.28 cm)" in found.found[0]
    assert "14 of 32 lasers were within the datasheet" in text
    assert "now there are 32." in text
    # |10 - k| > 5.5: k of 0 to 4 and 16 to 31.
    assert "distance is known to 5.5 mm (k = 2); it is not significant for 11 of 32 lasers" in text
    assert "vertical angle is known to 0.060 deg (k = 2); it is not significant for 32 of" in text
    advice = " ".join(found.next)
    assert "parameter_sets/HDL-32E/all.yaml with the ROS driver" in advice
    assert "second position" in advice
    assert "decide little of the vertical angle" in advice


def test_verdict_that_says_no():
    refused = certificate(recommended=False, verdict="no difference shown")
    found = verdict(refused, None)
    assert not found.good
    assert found.found[0].startswith("The calibration is not recommended (no difference shown)")
    assert "Keep the factory's file" in found.next[0]
    assert "with the ROS driver" not in " ".join(found.next)
    page = report.render(replace(STUDY, certificates=[refused]))
    assert 'class="verdict bad"' in page
    unjudged = verdict(certificate(held_out_centred=None, verdict="not judged"), None)
    assert "could not be judged" in unjudged.found[0]


def test_note_of_a_laser():
    note = laser_note(certificate(), 1)
    assert note.startswith("Distance 9.0 mm (± 5.5) at 3.4 m; rotational angle 0.010 deg")
    assert "Weakly determined: vertical angle." in note


def test_the_first_screen_is_the_verdict():
    page = report.render(STUDY)
    assert page.index('class="verdict"') < page.index("<nav")
    assert "HDL-32E (S &lt;7&gt;), all" in page
    assert page.count("<tr data-laser=") == LASERS


def test_pictures_of_a_page_are_small(tmp_path):
    file = tmp_path / "x.png"
    file.write_bytes(picture())
    assert for_page(file) == for_page(file)
    file.write_bytes(b"\x89PNG\r\n\x1a\nnot really")
    with pytest.raises(StorageError, match=r"x\.png: is no picture"):
        for_page(file)
