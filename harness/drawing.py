"""The style of all pictures: colours that the colour-blind can tell apart, grids, legends, figures as PNG."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
from matplotlib import MatplotlibDeprecationWarning, rc_context, rcdefaults
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.patches import Patch
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar
from rich.cells import cell_len, set_cell_size

DPI = 150
MAGENTA, CIRCLE_EDGE, CIRCLE_FACE = "#C2338F", "#D9AE00", "#FFF6C9"
TRUTH, GPS, ESTIMATE = "#111111", "#7A7A7A", "#9B51E0"
ESTIMATES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#7B3FB5")
Style = dict[str, Any]
GRID: Style = {"color": "#E3E6EA", "linewidth": 0.8}
BESIDE: Style = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.03), "frameon": False, "borderaxespad": 0.0}
BELOW: Style = {"frameon": False, "columnspacing": 1.6, "handletextpad": 0.6}
ABOVE: Style = {"loc": "lower left", "bbox_to_anchor": (-0.01, 1.005), "borderaxespad": 0.0, **BELOW}
ABOVE |= {"columnspacing": 1.2, "handlelength": 1.6}
# bands over time, told apart by hatching too
OUTAGE: Style = {"facecolor": "#D3D7DD", "edgecolor": "#8A929C", "hatch": ""}
ORDER: Style = {"facecolor": "#D2E6F7", "edgecolor": "#4C8FC4", "hatch": "\\\\\\"}
LOST_RADIO: Style = {"facecolor": "#FCE0CB", "edgecolor": "#D9772B", "hatch": "///"}
FAULTS: tuple[Style, ...] = (  # in turns
    {"facecolor": "#D6BEEE", "edgecolor": "#7A4FA3", "hatch": "xx"},
    {"facecolor": "#A6F2A6", "edgecolor": "#2E8A2E", "hatch": "++"},
    {"facecolor": "#F5A3A3", "edgecolor": "#B04040", "hatch": ".."},
    {"facecolor": "#A3A3F5", "edgecolor": "#4A4AC0", "hatch": "oo"},
)
FAILURE = "#D7263D"  # what an FMU spoiled
COLUMNS = 8  # of a figure's legend, at most
LONGEST = 72  # columns of a name in a title
UNKNOWN = "\u25a1"  # stands for a character that the font lacks


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size [in] that needs no window; its layout makes room for what is drawn."""
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


@contextmanager
def house_style() -> Iterator[None]:
    """Matplotlib's own settings, whatever a user's matplotlibrc or program has set; as a decorator, too."""
    with warnings.catch_warnings(), rc_context():
        warnings.simplefilter("ignore", MatplotlibDeprecationWarning)  # settings that it gives up one day
        rcdefaults()
        yield


def freeze_layout(figure: Figure) -> None:
    """Lay out a figure for good: what is drawn in it later keeps its place, and moves nothing."""
    layout = figure.get_layout_engine()
    if layout is not None:
        with warnings.catch_warnings():  # labels as long as 1e300 leave no room for what they label
            warnings.filterwarnings("ignore", "constrained_layout not applied")
            layout.execute(figure)
    for axes in figure.axes:
        axes.apply_aspect()
    figure.set_layout_engine("none")


def png_of(figure: Figure, dpi: float = DPI) -> bytes:
    """A figure as a PNG; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def drawable(name: str, columns: int = LONGEST) -> str:
    """A user's name as a picture's text: one line, cut at some columns, the font's characters, no maths."""
    printable = " ".join("".join(c if c.isprintable() else " " for c in name).split())
    if cell_len(printable) > columns:
        printable = set_cell_size(printable, columns - 1).rstrip(" ,") + "\u2026"
    return "".join(c if ord(c) in _characters() else UNKNOWN for c in printable).replace("$", r"\$")


def set_title(figure: Figure, text: str, size: float = 12.0) -> None:
    """Write a title over the figure, at most as large [points] as the figure's width lets it be."""
    title = figure.suptitle(text, fontsize=size)
    share = title.get_window_extent().width / figure.bbox.width
    title.set_fontsize(size * min(1.0, 0.98 / share))


@cache
def _characters() -> frozenset[int]:
    """The characters of the font of all pictures."""
    return frozenset(get_font(findfont(FontProperties())).get_charmap())


def shade(axes: Axes, spans: Iterable[tuple[float, float]], style: Style) -> None:
    """Draw bands over time behind the curves; the border keeps the shortest one visible."""
    for start, end in spans:
        axes.axvspan(start, end, linewidth=0.8, zorder=0.4, **style)


def add_legend(figure: Figure, handles: Sequence[Artist]) -> None:
    """Draw a figure's legend below it, in as many columns as its width has room for."""
    for columns in range(min(len(handles), COLUMNS), 0, -1):
        legend = figure.legend(handles=handles, loc="outside lower center", ncols=columns, **BELOW)
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()


def band_handle(label: str, style: Style) -> Patch:
    """A band's entry in a legend."""
    return Patch(label=label, linewidth=0.8, **style)


def add_scale_bar(axes: Axes, share: float = 0.25) -> AnchoredSizeBar:
    """Draw a scale bar of a round length in m above the right corner of a map, where it covers nothing.

    Args:
        axes: a map in m with its limits as they stay.
        share: the most of the map's width that the bar takes.
    """
    length = round_below(share * abs(float(np.diff(axes.get_xlim())[0])))
    text = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
    bar = AnchoredSizeBar(
        axes.transData, length, text, "lower right", frameon=False, pad=0.0, borderpad=0.3, sep=3,
        label_top=True, bbox_to_anchor=(1.0, 1.0), bbox_transform=axes.transAxes,
    )  # fmt: skip
    bar.size_bar.get_children()[0].set(linewidth=2.0)
    axes.add_artist(bar)
    return bar


def round_below(value: float) -> float:
    """The greatest 1, 2 or 5 times a power of ten that is at most a value above 0."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(digit for digit in (1, 2, 5) if digit * power <= value * (1 + 1e-9)))
