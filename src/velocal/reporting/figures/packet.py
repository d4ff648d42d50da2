"""Layout of a data packet, byte by byte, and its numbers.

Everything is read from the types that the decoder uses, so that the figure cannot tell another
story than the code.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from velocal.capture.udp import HEADER_BYTES
from velocal.packets.data import BLOCK, BLOCKS, CHANNELS, PACKET, PAYLOAD_BYTES
from velocal.reporting.style import COLOURS, DARK, GREY, finish, style
from velocal.scanner.models import AZIMUTH_TICK_DEG, Scanner

#: What is drawn, from the whole to its parts.
RECORD, PAYLOAD, OF_BLOCK, OF_CHANNEL = "record", "payload", "block", "channel"
#: Left edge, width, upper edge and height of the four bars, in hundredths of the drawing.
_LEFT, _WIDTH, _HEIGHT = 15.5, 83.5, 9.0
_TOP = {RECORD: 92.0, PAYLOAD: 69.0, OF_BLOCK: 40.0, OF_CHANNEL: 13.0}
_PLAIN = "#E8E8E8"

#: Left and right edge of a piece of a bar; width and colour of pieces.
Span = tuple[float, float]
Pieces = list[tuple[float, str]]


@dataclass(frozen=True)
class Field:
    """A field of a packet.

    Attributes
    ----------
    part : str
        What it is a part of: `RECORD`, `PAYLOAD`, `OF_BLOCK` or `OF_CHANNEL`.
    name : str
    offset : int
        From the beginning of that part, bytes.
    size : int
        Of one element, bytes.
    repeats : int
        Number of elements.
    content : str
        In words.
    """

    part: str
    name: str
    offset: int
    size: int
    repeats: int
    content: str


def packet_fields(scanner: Scanner) -> tuple[Field, ...]:
    """All fields of the record of a data packet, in order."""
    flags = ", ".join(
        f"{_as_sent(flag)} lasers {CHANNELS * k + 1}-{min(CHANNELS * (k + 1), scanner.n_lasers)}"
        for k, flag in enumerate(scanner.flags)
    )
    channels = BLOCK["channels"]
    channel = channels.subdtype[0] if channels.subdtype else channels
    end = (
        "status type and its value"
        if scanner.sends_status
        else f"return mode and product byte ({scanner.factory_byte:#04x})"
    )
    firing = (
        f"one firing of {scanner.lasers_per_firing} lasers"
        if scanner.firings_per_block == 1
        else f"{scanner.firings_per_block} firings of {scanner.lasers_per_firing} lasers"
    )
    tick = f"in units of {1e3 * scanner.distance_tick_m:g} mm; 0: no return"
    return (
        Field(RECORD, "header", 0, HEADER_BYTES, 1, "Ethernet, IPv4 and UDP"),
        Field(RECORD, "payload", HEADER_BYTES, PAYLOAD_BYTES, 1, "what the scanner sends"),
        Field(PAYLOAD, "blocks", *_place(PACKET, "blocks"), BLOCKS, firing),
        Field(
            PAYLOAD, "timestamp", *_place(PACKET, "timestamp"), 1, "microseconds within the hour"
        ),
        Field(PAYLOAD, "status", *_place(PACKET, "status"), 1, end),
        Field(OF_BLOCK, "flag", *_place(BLOCK, "flag"), 1, flags),
        Field(
            OF_BLOCK, "azimuth", *_place(BLOCK, "azimuth"), 1, f"units of {AZIMUTH_TICK_DEG:g} deg"
        ),
        Field(OF_BLOCK, "channels", *_place(BLOCK, "channels"), CHANNELS, "one laser each"),
        Field(OF_CHANNEL, "distance", *_place(channel, "distance"), 1, tick),
        Field(OF_CHANNEL, "intensity", *_place(channel, "intensity"), 1, "0 to 255"),
    )


def packet_table(fields: Sequence[Field]) -> pd.DataFrame:
    """Numbers of the figure: a row per field.

    Returns
    -------
    DataFrame
        Columns ``part``, ``field``, ``offset_bytes``, ``bytes``, ``repeats`` and ``content``, see
        `Field`.
    """
    names = ["part", "field", "offset_bytes", "bytes", "repeats", "content"]
    return pd.DataFrame([astuple(each) for each in fields], columns=names)


def _as_sent(flag: int) -> str:
    """Bytes of a little-endian flag in the order of the wire."""
    return flag.to_bytes(2, "little").hex(" ").upper()


def _place(of: np.dtype[np.void], name: str) -> tuple[int, int]:
    """Offset and size of a field, bytes; the size is that of one of its elements."""
    fields: Mapping[str, Any] = of.fields or {}
    kind, offset = fields[name][:2]
    one = kind.subdtype[0] if kind.subdtype and name != "status" else kind
    return int(offset), one.itemsize


def draw_packet(fields: Sequence[Field], scanner: Scanner) -> Figure:
    """Draw the fields as four bars, each a part of the one above.

    Parameters
    ----------
    fields : sequence of Field
    scanner : Scanner

    Returns
    -------
    Figure
    """
    of = {(each.part, each.name): each for each in fields}
    with style():
        figure = Figure(figsize=(7.0, 4.3))
        ax = figure.subplots()
        ax.set_axis_off()
        ax.set_xlim(0.0, 100.0)
        ax.set_ylim(0.0, 100.0)
        inner = _record(ax, of[RECORD, "header"], of[RECORD, "payload"])
        _wedge(ax, RECORD, inner, PAYLOAD)
        tail = [of[PAYLOAD, name] for name in ("timestamp", "status")]
        inner = _payload(ax, of[PAYLOAD, "blocks"], tail, scanner)
        _wedge(ax, PAYLOAD, inner, OF_BLOCK)
        inner = _block(ax, *(of[OF_BLOCK, name] for name in ("flag", "azimuth", "channels")))
        _wedge(ax, OF_BLOCK, inner, OF_CHANNEL)
        _channel(ax, [of[OF_CHANNEL, name] for name in ("distance", "intensity")])
        title = f"{scanner.name}: record of a data packet (all numbers little-endian)"
        finish(figure, [], title)
    return figure


def _record(ax: Axes, header: Field, payload: Field) -> Span:
    _name(ax, RECORD, "record", header.size + payload.size)
    spans = _bar(ax, RECORD, [(header.size, _PLAIN), (payload.size, "white")])
    _inside(ax, RECORD, spans[0], f"{header.size}")
    ax.text(_LEFT, _TOP[RECORD] + 1.2, f"header: {header.content}", va="bottom", fontsize=7.5)
    _inside(ax, RECORD, spans[1], f"payload, {payload.size} bytes")
    return spans[1]


def _payload(ax: Axes, block: Field, tail: Sequence[Field], scanner: Scanner) -> Span:
    _name(ax, PAYLOAD, "payload", PAYLOAD_BYTES)
    count = len(scanner.flags)
    pieces: Pieces = [(block.size, COLOURS[k % count]) for k in range(block.repeats)]
    # The six bytes at the end would be too narrow to be seen.
    pieces += [(0.38 * block.size, _PLAIN) for _ in tail]
    spans = _bar(ax, PAYLOAD, pieces)
    for k, span in enumerate(spans[: block.repeats]):
        _inside(ax, PAYLOAD, span, f"{k}\n{_as_sent(scanner.flags[k % count])}", fontsize=6.8)
    for each, span in zip(tail, spans[block.repeats :], strict=True):
        _inside(ax, PAYLOAD, span, f"{each.size}", fontsize=6.8)
    above = f"{block.repeats} blocks of {block.size} bytes, each {block.content}"
    _over(ax, PAYLOAD, spans[0][0], spans[block.repeats - 1][1], above)
    _under(ax, PAYLOAD, "; ".join(f"{each.size}: {each.name}, {each.content}" for each in tail))
    return spans[0]


def _block(ax: Axes, flag: Field, azimuth: Field, channel: Field) -> Span:
    _name(ax, OF_BLOCK, "block", BLOCK.itemsize)
    # Two bytes would be too narrow for a word.
    head = 2.3 * channel.size
    pieces: Pieces = [(head, COLOURS[0]), (head, _PLAIN)]
    spans = _bar(ax, OF_BLOCK, pieces + [(channel.size, "white")] * channel.repeats)
    _inside(ax, OF_BLOCK, spans[0], f"flag\n{flag.size}", fontsize=6.8)
    _inside(ax, OF_BLOCK, spans[1], f"azim.\n{azimuth.size}", fontsize=6.8)
    for k, span in enumerate(spans[2:]):
        if k % 4 == 0 or k == channel.repeats - 1:
            _inside(ax, OF_BLOCK, span, f"{k}", fontsize=6.8)
    above = f"{channel.repeats} channels of {channel.size} bytes, {channel.content}"
    _over(ax, OF_BLOCK, spans[2][0], spans[-1][1], above)
    _under(ax, OF_BLOCK, f"flag: {flag.content}; azimuth in {azimuth.content}")
    return spans[2]


def _channel(ax: Axes, parts: Sequence[Field]) -> None:
    _name(ax, OF_CHANNEL, "channel", sum(each.size for each in parts))
    for each, span in zip(parts, _bar(ax, OF_CHANNEL, [(p.size, "white") for p in parts]),
                          strict=True):  # fmt: skip
        size = f"{each.size} byte{'s' if each.size > 1 else ''}"
        _inside(ax, OF_CHANNEL, span, f"{each.name}, {size}: {each.content}")


def _name(ax: Axes, part: str, name: str, size: int) -> None:
    """Name of a bar and its size, on its left."""
    y = _TOP[part] - 0.5 * _HEIGHT
    ax.text(0.0, y, name, ha="left", va="bottom", fontsize=8.5, fontweight="bold")
    ax.text(0.0, y - 0.6, f"{size} bytes", ha="left", va="top", fontsize=7.5, color=GREY)


def _over(ax: Axes, part: str, left: float, right: float, text: str) -> None:
    ax.text(0.5 * (left + right), _TOP[part] + 1.0, text, ha="center", va="bottom", fontsize=7.5)


def _under(ax: Axes, part: str, text: str) -> None:
    ax.text(_LEFT + _WIDTH, _TOP[part] - _HEIGHT - 1.2, text, ha="right", va="top", fontsize=7.0,
            color=DARK, bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "alpha": 0.85,
                              "linewidth": 0.0})  # fmt: skip


def _inside(ax: Axes, part: str, span: Span, text: str, *, fontsize: float = 8.0) -> None:
    ax.text(0.5 * sum(span), _TOP[part] - 0.5 * _HEIGHT, text, ha="center", va="center",
            fontsize=fontsize, linespacing=1.25)  # fmt: skip


def _bar(ax: Axes, part: str, pieces: Pieces) -> list[Span]:
    """Draw one bar of pieces of some widths and colours; left and right edge of each."""
    total = sum(size for size, _ in pieces)
    edges = _LEFT + _WIDTH * np.cumsum([0.0, *(size / total for size, _ in pieces)])
    spans = list(itertools.pairwise(edges.tolist()))
    for (left, right), (_, colour) in zip(spans, pieces, strict=True):
        ax.add_patch(
            Rectangle(
                (left, _TOP[part] - _HEIGHT), right - left, _HEIGHT, linewidth=0.7,
                edgecolor=DARK, facecolor=colour, alpha=0.35 if colour in COLOURS else 1.0,
            )
        )  # fmt: skip
    return spans


def _wedge(ax: Axes, part: str, span: Span, inner: str) -> None:
    """Grey wedge from a piece of a bar to the bar that shows it."""
    top, bottom = _TOP[part] - _HEIGHT, _TOP[inner]
    corners = [(span[0], top), (span[1], top), (_LEFT + _WIDTH, bottom), (_LEFT, bottom)]
    ax.add_patch(
        Polygon(corners, facecolor="#F4F4F4", edgecolor=GREY, linewidth=0.5, linestyle=(0, (3, 3)),
                zorder=0.0)
    )  # fmt: skip
