"""Faulty tables: survey files and sample tables, as people and spreadsheets write them."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from support.chain import study_world

from catalogue.case import PLAN, Case, Outcome
from catalogue.study import BASE, CONFIG, PLANES, SAMPLES, SITE, replaced, rewritten
from velocal.simulation import survey
from velocal.survey.network.field_book import FILES, FieldBook, write_field_book

_ROW = "wall1_1,wall1,5,0,0,1,1,1"


def _row(new: str) -> object:
    return replaced((PLANES, _ROW, new))


def _semicolons(text: str) -> str:
    return text.replace(",", ";")


def _german(text: str) -> str:
    return re.sub(r"(\d)\.(\d)", r"\1,\2", _semicolons(text))


_REFUSED = {
    "survey: empty file": rewritten(PLANES, lambda _: ""),
    "survey: comments only": rewritten(PLANES, lambda _: "# nothing\n"),
    "survey: headings only": rewritten(PLANES, lambda text: text.split("wall1_0")[0]),
    "survey: a spreadsheet (.xlsx)": rewritten(PLANES, lambda _: b"PK\x03\x04rest"),
    "survey: UTF-16 text": rewritten(PLANES, lambda text: text.encode("utf-16")),
    "survey: Latin-1 text": rewritten(
        PLANES, lambda text: text.replace("wall1_1", "w\xe4").encode("latin-1")
    ),
    "survey: a control character": _row("wall1\x07_1,wall1,5,0,0,1,1,1"),
    "survey: a character that turns the direction of text": _row("\u202ewall1_1,wall1,5,0,0,1,1,1"),
    "survey: zeros in place of text": rewritten(PLANES, lambda _: b"\0" * 100),
    "survey: headings separated by spaces": rewritten(PLANES, lambda text: text.replace(",", " ")),
    "survey: a column is missing": rewritten(
        PLANES, lambda text: re.sub(r",[^,]*$", "", text, flags=re.M)
    ),
    "survey: an unknown column": replaced((PLANES, "std_z_mm", "std_z_cm")),
    "survey: a column twice": replaced((PLANES, "std_z_mm", "std_y_mm")),
    "survey: no headings": replaced(
        (PLANES, "target,plane,x_m,y_m,z_m,std_x_mm,std_y_mm,std_z_mm\n", "")
    ),
    "survey: one value too many in a row": _row("wall1_1,wall1,5,0,0,1,1,1,7"),
    "survey: one value too few in a row": _row("wall1_1,wall1,5,0,0,1,1"),
    "survey: decimal commas between commas": _row("wall1_1,wall1,5,000,0,0,1,1,1"),
    "survey: decimal commas and points together": rewritten(
        PLANES,
        lambda text: _semicolons(text).replace("wall1_1;wall1;5;0;", "wall1_1;wall1;5,0;0.1;"),
    ),
    "survey: an empty name": _row(",wall1,5,0,0,1,1,1"),
    "survey: an empty plane": _row("wall1_1,,5,0,0,1,1,1"),
    "survey: an empty coordinate": _row("wall1_1,wall1,,0,0,1,1,1"),
    "survey: an empty standard deviation": _row("wall1_1,wall1,5,0,0,1,,1"),
    "survey: text in place of a number": _row("wall1_1,wall1,5 m,0,0,1,1,1"),
    "survey: nan": _row("wall1_1,wall1,nan,0,0,1,1,1"),
    "survey: inf": _row("wall1_1,wall1,inf,0,0,1,1,1"),
    "survey: 1e308 m": _row("wall1_1,wall1,1e308,0,0,1,1,1"),
    "survey: 1e999 m": _row("wall1_1,wall1,1e999,0,0,1,1,1"),
    "survey: a hexadecimal number": _row("wall1_1,wall1,0x10,0,0,1,1,1"),
    "survey: underscores in a number": _row("wall1_1,wall1,1_000,0,0,1,1,1"),
    "survey: a standard deviation of 0": _row("wall1_1,wall1,5,0,0,0,1,1"),
    "survey: a negative standard deviation": _row("wall1_1,wall1,5,0,0,-1,1,1"),
    "survey: a standard deviation of 1e-320 mm": _row("wall1_1,wall1,5,0,0,1e-320,1,1"),
    "survey: a standard deviation of 1e300 mm": _row("wall1_1,wall1,5,0,0,1e300,1,1"),
    "survey: a target twice": replaced((PLANES, "wall1_2", "wall1_1")),
    "survey: a quote that is not closed": _row('"wall1_1,wall1,5,0,0,1,1,1'),
    "survey: `#` in a name without quotes": _row("wall#1,wall1,5,0,0,1,1,1"),
    "survey: no target of a plane that is used": rewritten(
        PLANES, lambda text: text.replace(",floor,", ",ground,")
    ),
    "survey: the name of a plane in another case": rewritten(
        PLANES, lambda text: text.replace(",floor,", ",Floor,")
    ),
    "survey: no target of a position": rewritten(SITE, lambda text: text.replace(",P2,", ",P3,")),
    "survey: no target of the scanner": rewritten(
        BASE, lambda text: text.replace("HDL-32E", "HDL-32")
    ),
    "survey: two targets on a plane": rewritten(
        PLANES, lambda text: re.sub("floor_[23].*\n", "", text)
    ),
    "survey: targets of a plane on one line": rewritten(
        PLANES,
        lambda text: re.sub(
            r"(floor_\d,floor),(\d),\d", r"\1,\2,\2", text.replace("floor,5,0,0", "floor,3,0,0")
        ),
    ),
    "survey: targets of a plane at one point": rewritten(
        PLANES, lambda text: re.sub(r"(floor_\d,floor),\d,\d", r"\1,1,1", text)
    ),
    "survey: two targets of the base": rewritten(BASE, lambda text: re.sub("B[23].*\n", "", text)),
    "survey: other names on the base than in the site": rewritten(
        BASE, lambda text: re.sub(r"^B", "C", text, flags=re.M)
    ),
    "survey: targets of the base on one line": rewritten(
        BASE, lambda text: re.sub(r"E,[^,]*,[^,]*,[^,]*", "E,0,0,0", text)
    ),
    "survey: a folder in place of a file": lambda folder: (
        rewritten(PLANES, lambda text: text)(folder),
        (folder / PLANES).unlink(),
        (folder / PLANES).mkdir(),
    ),
    "samples: empty file": rewritten(SAMPLES, lambda _: ""),
    "samples: no rows": rewritten(SAMPLES, lambda text: text.split("sample1")[0]),
    "samples: a column is missing": replaced((SAMPLES, "\tposition\t", "\tplace\t")),
    "samples: an unknown column": replaced(
        (SAMPLES, "calibration\nsample1", "calibration\tcolour\nsample1")
    ),
    "samples: separated by spaces": rewritten(SAMPLES, lambda text: text.replace("\t", "  ")),
    "samples: unknown scanner": replaced((SAMPLES, "sample1\tHDL-32E", "sample1\tHDL32")),
    "samples: a file that describes the scanner, in a survey": replaced(
        (SAMPLES, "sample1\tHDL-32E", "sample1\tscanner.yaml")
    ),
    "samples: a name with a space": replaced((SAMPLES, "sample1\t", "sample 1\t")),
    "samples: a name with a slash": replaced((SAMPLES, "sample1\t", "../1\t")),
    "samples: a name with braces": replaced((SAMPLES, "sample1\t", "{x}\t")),
    "samples: a recording with braces": replaced((SAMPLES, "captures/sample1", "captures/{x}")),
    "samples: no recording": replaced((SAMPLES, "captures/sample1.pcap", "")),
    "samples: a recording that does not exist": replaced(
        (SAMPLES, "captures/sample1", "captures/gone")
    ),
    "samples: a path of 2000 characters": replaced(
        (SAMPLES, "captures/sample1", "captures/" + "x" * 2000)
    ),
    "samples: a name of a file of 300 characters": replaced(
        (SAMPLES, "captures/sample1", "captures/" + "x" * 300)
    ),
    "samples: a sample twice": replaced((SAMPLES, "\nsample2", "\nsample1")),
    "samples: `embedded` for a scanner that sends no calibration": rewritten(
        SAMPLES, lambda text: text.replace("\tnominal", "\tembedded")
    ),
    "samples: two calibrations of one scanner": replaced(
        (SAMPLES, "sample1.pcap\tnominal", "sample1.pcap\tcaptures/sample1.pcap")
    ),
    "samples: a port that is no number": rewritten(
        SAMPLES,
        lambda text: text.replace("calibration\n", "calibration\tport\n").replace(
            "\tnominal", "\tnominal\thttp"
        ),
    ),
    "samples: port 70000": rewritten(
        SAMPLES,
        lambda text: text.replace("calibration\n", "calibration\tport\n").replace(
            "\tnominal", "\tnominal\t70000"
        ),
    ),
    "samples: an address that is none": rewritten(
        SAMPLES,
        lambda text: text.replace("calibration\n", "calibration\taddress\n").replace(
            "\tnominal", "\tnominal\tscanner.local"
        ),
    ),
}


def _all_named(name: str) -> object:
    """A plane, its targets and nothing else with an awkward name."""
    return replaced(
        (CONFIG, "[wall1, wall2, floor]", f'[wall1, wall2, "{name}"]'),
        *((PLANES, f"floor_{n},floor,", f"{name}{n},{name},") for n in range(4)),
    )


_USED = {
    "survey: semicolons between the columns": rewritten(PLANES, _semicolons),
    "survey: tabs between the columns": rewritten(PLANES, lambda text: text.replace(",", "\t")),
    "survey: semicolons and decimal commas": rewritten(SITE, _german),
    "survey: byte order mark and Windows ends of lines": rewritten(
        PLANES, lambda text: b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode()
    ),
    "survey: quotes around every value": rewritten(
        PLANES, lambda text: re.sub(r"([^,\n]+)", r'"\1"', text.split("\n", 1)[1])
    ),
    "survey: columns in another order": rewritten(
        PLANES,
        lambda text: "\n".join(",".join(line.split(",")[::-1]) for line in text.splitlines()[1:]),
    ),
    "survey: empty lines and empty columns of a spreadsheet": rewritten(
        PLANES, lambda text: text.replace("\n", ",,\n") + ",,,,,,,,,\n\n"
    ),
    "survey: a comment behind a row": _row(_ROW + " # behind the door"),
    "survey: a plane called NA": _all_named("NA"),
    "survey: a plane called null": _all_named("null"),
    "survey: a plane called 1": _all_named("1"),
    "survey: a plane called true": _all_named("true"),
    "survey: a plane called `$x^2$`": _all_named("$x^2$"),
    "survey: a plane called `<b>`": _all_named("<b>"),
    "samples: commas between the columns": rewritten(SAMPLES, lambda text: text.replace("\t", ",")),
    "samples: byte order mark and Windows ends of lines": rewritten(
        SAMPLES, lambda text: b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode()
    ),
}


@cache
def _book() -> FieldBook:
    return survey.field_book(study_world())


def _observed(file: str, pattern: str, new: str, count: int = 1) -> object:
    """Write the observations of the simulated surveyor, and change one file."""

    def make(folder: Path) -> None:
        write_field_book(_book(), {name: folder / f"{name}.csv" for name in FILES}, 24.0)
        path = folder / f"{file}.csv"
        text, found = re.subn(pattern, new, path.read_text(), count=count, flags=re.M)
        assert found, pattern
        path.write_text(text)

    return make


_OBSERVED_REFUSED = {
    "observations: angles in gon": _observed("network", "zenith_deg", "zenith_gon"),
    "observations: text in place of an angle": _observed(
        "network", r"^(S1,\w+),[^,]*", r"\1,north"
    ),
    "observations: an angle of 1e300": _observed("network", r"^(S1,\w+),[^,]*", r"\1,1e300"),
    "observations: a standard deviation of 0": _observed("network", r"[^,]*$(?<!mm)", "0"),
    "observations: an image without principal distance": _observed(
        "images", r"^(\w+,\w+,[-\d][^,]*,[^,]*,[^,]*),.*", r"\1,"
    ),
    "observations: a point twice": _observed("points", "floor_t001,", "floor_t002,"),
    "observations: no approximate coordinates": _observed(
        "points", r"^(\w+),(\w*),[-\d].*", r"\1,\2,,,", 0
    ),
    "observations: a target of a plane that was not observed": _observed(
        "images", r"^\w+,floor_t001,.*\n", "", 0
    ),
    "observations: a station that is connected with nothing": _observed(
        "network", r"^S1,(\w+)", r"S1,far_\1", 0
    ),
}
_OBSERVED_USED = {
    "observations: a distance that was not measured": _observed(
        "network", r"^(S1,\w+,[^,]*,[^,]*),[^,]*", r"\1,"
    ),
}
_OBSERVED = ("read", "observations", ".")

CASES = (
    *(Case(wrong, Outcome.REFUSED, make, PLAN) for wrong, make in _REFUSED.items()),
    *(Case(wrong, Outcome.USED, make, PLAN) for wrong, make in _USED.items()),
    *(Case(wrong, Outcome.REFUSED, make, _OBSERVED) for wrong, make in _OBSERVED_REFUSED.items()),
    *(Case(wrong, Outcome.USED, make, _OBSERVED) for wrong, make in _OBSERVED_USED.items()),
)
