"""50,000 cases with fixed seeds through every reader, and what longer runs have found.

`make fuzz` tries as many as it is asked for, guided by coverage where atheris is installed.
"""

import gzip
import json

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from support.capture import as_bytes, pcap_head, pcap_packet, spin, udp_frame

from fuzz.mutation import cases
from fuzz.readers import READERS
from velocal.io.storage import FACTS

PARTS = 500


def test_as_many_cases_as_promised():
    assert sum(reader.share for reader in READERS.values()) == 50_000


@pytest.mark.parametrize(
    ("name", "part"),
    [(name, part) for name, reader in READERS.items() for part in range(-(-reader.share // PARTS))],
)
def test_no_case_does_anything_but_be_read_or_refused(name, part, tmp_path):
    reader = READERS[name]
    for case in cases(reader.seeds, min(PARTS, reader.share - part * PARTS), part):
        reader.read(case, tmp_path)


@pytest.mark.parametrize("name", READERS)
def test_the_seeds_are_read(name, tmp_path):
    """A harness whose seeds are refused would find nothing."""
    assert [READERS[name].read(seed, tmp_path) for seed in READERS[name].seeds] == ["read"] * len(
        READERS[name].seeds
    )


# -- findings --------------------------------------------------------------------------------------


def ends_within_headers() -> bytes:
    """Unpacked, fewer bytes are left after damage than the headers of a packet have."""
    frame = udp_frame(as_bytes(spin(1))[0])
    return gzip.compress(pcap_head() + pcap_packet(frame) + b"\xfe" * 33)


def ragged_station() -> bytes:
    content = json.loads(READERS["station"].seeds[0])
    content["residuals_m"] = [[1.0, 2.0], [3.0]]
    return json.dumps(content).encode()


def wordy_covariance() -> bytes:
    content = json.loads(READERS["station"].seeds[0])
    content["pose"]["covariance_rad_m"][0][0] = "NA"
    return json.dumps(content).encode()


def index_without_a_fact() -> bytes:
    table = pq.read_table(pa.BufferReader(READERS["rotations"].seeds[0]))
    told = dict(table.schema.metadata)
    facts = json.loads(told[FACTS])
    del facts["step_ticks"]
    written = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata(told | {FACTS: json.dumps(facts)}), written)
    return written.getvalue().to_pybytes()


FINDINGS = {
    "a fact of an index whose name is damaged": (
        "rotations",
        index_without_a_fact,
    ),
    "a covariance with a text in it": ("station", wordy_covariance),
    "bytes after the end of compressed content were rejected": ("compressed", ends_within_headers),
    "a message of SQLite that is no UTF-8": (
        "db3",
        lambda: (
            READERS["db3"].seeds[0].replace(b"CREATE TABLE messages", b"CREATE TABLE mess\xffges")
        ),
    ),
    "rows of different lengths in a station": ("station", ragged_station),
    "a LAS header with a thousand million records, which laspy counted to the end": (
        "own_las",
        lambda: (lambda las: las[:100] + b"\xff\xff\xff\x3f" + las[104:])(
            READERS["own_las"].seeds[0]
        ),
    ),
}


@pytest.mark.parametrize("what", FINDINGS)
def test_findings(what, tmp_path):
    name, make = FINDINGS[what]
    READERS[name].read(make(), tmp_path)
