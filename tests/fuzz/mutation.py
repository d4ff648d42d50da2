"""Changes of bytes that a fuzzer makes without knowing a format, always the same for a seed."""

import random
from collections.abc import Iterator, Sequence

#: Bytes that formats take for lengths, signs and ends.
_EXTREMES = (
    b"\0", b"\xff", b"\x7f", b"\x80", b"\xff\xff", b"\0\0", b"\xff\xff\xff\x7f", b"\0\0\0\0",
    b"\xff\xff\xff\xff", b"\x00\x00\x00\x80", b"\xff" * 8, b"\0" * 16,
)  # fmt: skip
#: What texts hold that are read as numbers, names or markup.
_TEXTS = (
    b"nan", b"-inf", b"1e308", b"1e-400", b"-1", b"0", b"999999999999999999999", b"null", b"NA",
    b"", b'"', b"'", b",", b";", b"\t", b"\n", b"\r\n", b"\xef\xbb\xbf", b"\xff\xfe", b"&lt;",
    b"<!DOCTYPE x>", b"!!int ''", b"&a *a", b"{", b"}", b"[", b"]", b":", b"- ", b"#", b"%s",
    b"{x}", "ö\u2028".encode(), b"\x1b[31m", b"\0",
)  # fmt: skip
#: No case is longer.
MOST_BYTES = 1 << 16


def mutated(seeds: Sequence[bytes], rng: random.Random) -> bytes:
    """One of the seeds with one to six changes."""
    content = bytearray(rng.choice(seeds))
    for _ in range(1 + int(rng.random() ** 2 * 6)):
        at = rng.randrange(len(content) + 1)
        n = int(2 ** (rng.random() * 11))
        kind = rng.randrange(9)
        if kind == 0 and content:
            content[at % len(content)] ^= 1 << rng.randrange(8)
        elif kind == 1:
            del content[at : at + n]
        elif kind == 2:
            del content[at:]
        elif kind == 3:
            content[at:at] = content[rng.randrange(len(content) + 1) :][:n]
        elif kind == 4:
            other = rng.choice(seeds)
            content[at : at + n] = other[rng.randrange(len(other) + 1) :][:n]
        elif kind == 5:
            found = rng.choice(_EXTREMES)
            content[at : at + len(found)] = found
        elif kind == 6:
            content[at : at + rng.choice((0, 1, 4))] = rng.choice(_TEXTS)
        elif kind == 7:
            content[at : at + min(n, 64)] = rng.randbytes(min(n, 64))
        else:
            content[at:at] = bytes(rng.choice((1, 3, 16, 700)))
    return bytes(content[:MOST_BYTES])


def cases(seeds: Sequence[bytes], number: int, seed: int) -> Iterator[bytes]:
    """So many cases, always the same for a seed; the first ones are the seeds themselves."""
    rng = random.Random(seed)
    for k in range(number):
        yield seeds[k] if k < len(seeds) else mutated(seeds, rng)
