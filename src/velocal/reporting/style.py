"""The look of all figures: colours, settings of matplotlib, title, legend and note, files.

Colours are those of Okabe and Ito; the two states differ in shape and fill as well, for print
without colour. The bytes of a figure depend on nothing but its numbers.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import MultipleLocator
from PIL import Image

from velocal.arrays import Array
from velocal.errors import StorageError, hidden, visible
from velocal.io.storage import write_blocks
from velocal.study.figures import HistogramFigure, LaserFigure

BEFORE, AFTER, GREY, DARK, CONNECTION = "#D55E00", "#0072B2", "#6B6B6B", "#303030", "#BDBDBD"
#: Okabe and Ito, without black and yellow.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
#: Width of pictures in the report.
_PAGE_PIXELS = 1500
#: Level for PNG files: the usual 6 takes half again as long, and saves a seventh of the size.
_COMPRESSION = 3
#: Dashes of a reference line.
DASHED = (0, (5, 3))

#: Settings of matplotlib on top of its own defaults.
STYLE: Mapping[Any, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "font.size": 8.5,
    "axes.titlesize": 9.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.6,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "xtick.minor.width": 0.4,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 300,
    "svg.hashsalt": "velocal",
    "svg.fonttype": "path",
}


@contextmanager
def style() -> Iterator[None]:
    """The one style of all figures, whatever the user's matplotlibrc says."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def save(figure: Figure, svg: Path, png: Path) -> None:
    """Write a figure as SVG and PNG without anything that changes from run to run.

    Parameters
    ----------
    figure : Figure
    svg, png : Path
    """
    with style():
        _plain_texts(figure)
        canvas: Any = FigureCanvasAgg(figure)
        drawing, picture = io.BytesIO(), io.BytesIO()
        with _arranged(figure):
            canvas.draw()
            dpi = figure.get_dpi()
            opaque = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
            opaque.save(picture, "PNG", dpi=(dpi, dpi), compress_level=_COMPRESSION)
            canvas = FigureCanvasSVG(figure)
            canvas.print_svg(drawing, metadata={"Date": None, "Creator": None})
        write_blocks(svg, [drawing.getvalue()])
        write_blocks(png, [picture.getvalue()])


@contextmanager
def _arranged(figure: Figure) -> Iterator[None]:
    """Arrange the parts of a figure for its canvas, and do not arrange them while it is drawn.

    `Figure.savefig` would arrange them again for the second format, and draw the figure to do so.
    """
    dpi, engine = figure.get_dpi(), figure.get_layout_engine()
    figure.set_dpi(mpl.rcParams["savefig.dpi"])
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")
    yield
    figure.set_dpi(dpi)
    if engine is not None:
        figure.set_layout_engine(engine)


def for_page(png: Path) -> bytes:
    """Make a picture small enough for a page: at most 1500 pixels wide, 256 colours.

    Parameters
    ----------
    png : Path

    Returns
    -------
    bytes
        Content of a smaller PNG file, the same for the same picture.

    Raises
    ------
    StorageError
        If the file is no picture.
    """
    try:
        with Image.open(png) as opened:
            picture = opened.convert("RGB")
    except OSError as error:
        hint = "Delete the file; the next run makes it again."
        raise StorageError(f"is no picture: {error}", where=str(png), hint=hint) from None
    if picture.width > _PAGE_PIXELS:
        height = round(picture.height * _PAGE_PIXELS / picture.width)
        picture = picture.resize((_PAGE_PIXELS, height), Image.Resampling.BILINEAR)
    small = io.BytesIO()
    reduced = picture.quantize(256, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    reduced.save(small, "PNG")
    return small.getvalue()


def _plain_texts(figure: Figure) -> None:
    """Show names of files, planes and targets as they are: a `$` in them begins no formula.

    Matplotlib writes the numbers of logarithmic axes as formulas; these remain.
    """
    texts: list[Any] = figure.findobj(Text)
    for text in texts:
        shown = text.get_text()
        if "\\mathdefault" in shown:
            continue
        if "$" in shown:
            text.set_parse_math(False)
        if hidden(shown.replace("\n", "")):
            text.set_text(visible(shown, newlines=True))


def finish(
    figure: Figure, axes: Sequence[Axes], title: str, *, simulated: bool = False, **legend: Any
) -> None:
    """Put the title above, one legend of some axes below, and the note on simulated recordings.

    Parameters
    ----------
    figure : Figure
    axes : sequence of Axes
        Whose legend it is; no legend without any.
    title : str
    simulated : bool
        Whether a note says that the recordings are simulated.
    **legend
        Options of `Figure.legend`.
    """
    figure.suptitle(title, x=0.01, ha="left", fontsize=9.0, fontweight="bold")
    if axes:
        handles = [handle for ax in axes for handle in ax.get_legend_handles_labels()[0]]
        options = {"ncols": len(handles), "borderpad": 0.1, **legend}
        figure.legend(handles=handles, loc="outside lower left", **options)
    if simulated:
        figure.text(
            0.995, 0.012, "simulated recordings", ha="right", va="bottom", fontsize=7.0,
            color=GREY, fontstyle="italic",
        )  # fmt: skip


def metres(ax: Axes, *, tick_m: float | None = None) -> None:
    """Make a plan of axes: equal scales in metres, a grid, labels.

    Parameters
    ----------
    ax : Axes
    tick_m : float, optional
        Distance of ticks; chosen by matplotlib if left out.
    """
    ax.set_aspect("equal")
    ax.grid(visible=True, axis="both")
    ax.set_xlabel("X [m]")
    ax.set_ylabel("Y [m]")
    if tick_m is not None:
        ax.xaxis.set_major_locator(MultipleLocator(tick_m))
        ax.yaxis.set_major_locator(MultipleLocator(tick_m))


def centred(ax: Axes, low: Array, high: Array) -> None:
    """Limit axes to a square about the middle of a plan, and mark the scanner at its origin."""
    middle, half = 0.5 * (low + high), 0.56 * float(np.max(high - low))
    ax.set_xlim(middle[0] - half, middle[0] + half)
    ax.set_ylim(middle[1] - half, middle[1] + half)
    ax.plot(0.0, 0.0, "+", color="black", markersize=9, markeredgewidth=1.2)


def reference(ax: Axes, value: float, label: str) -> None:
    """Draw a dashed horizontal line that the values are compared with.

    Parameters
    ----------
    ax : Axes
    value : float
    label : str
        For the legend.
    """
    ax.axhline(value, color=GREY, linewidth=0.9, linestyle=DASHED, label=label)


def laser_axis(ax: Axes, n_lasers: int) -> None:
    """Scale the horizontal axis for lasers, counted from 1."""
    ax.set_xlim(0.2, n_lasers + 0.8)
    step = 4 if n_lasers > 16 else 2 if n_lasers > 8 else 1
    ax.set_xticks([1, *range(step, n_lasers + 1, step)])
    ax.xaxis.set_minor_locator(MultipleLocator(1))


def samples_title(selection: LaserFigure | HistogramFigure, what: str) -> str:
    """Title of a figure of some samples: scanner, data, samples, and what is shown."""
    samples = ", ".join(selection.samples)
    return f"{selection.scanner}, {selection.data} data ({samples}): {what}"
