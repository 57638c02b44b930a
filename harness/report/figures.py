"""Figures of matplotlib as data for `charts.js`: what they draw, in the units of their axes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.category import StrCategoryFormatter
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure, FigureBase
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, FuncFormatter, Locator, MaxNLocator

from harness.drawing import ESTIMATE, ESTIMATES, GPS, ORDER, OUTAGE, TRUTH
from harness.report.thin import rows_to_show

MOST_POINTS = 4000  # of a line; longer ones are thinned
DIGITS = 6  # of a number, more than a screen shows
NAMES = {  # colours of pictures, by what style.css calls them
    TRUTH: "truth",
    GPS: "gps",
    ESTIMATE: "estimate",
    OUTAGE["facecolor"]: "outage",
    ORDER["facecolor"]: "order",
} | {colour: f"series-{number}" for number, colour in enumerate(ESTIMATES, 1)}
PLAIN = {"truth", "#000000"}  # of entries of a legend that explain a style, not a colour
NAMING = (FixedFormatter, FuncFormatter, StrCategoryFormatter)  # may give names; others give numbers
DASHES = {"-": [], "--": [6, 4], ":": [2, 3], "-.": [6, 3, 2, 3]}
Chart = dict[str, Any]


def charts_of(figure: Figure) -> list[list[Chart]]:
    """The charts of a figure, as README.md describes them: a list for each grid of axes, in their order.

    Raises:
        TypeError: the figure draws what no chart has.
    """
    legends = list(_legends(figure))
    grids: list[FigureBase] = list(figure.subfigs) or [figure]
    return [[_chart(axes, legends) for axes in _axes_of(grid)] for grid in grids]


def _axes_of(figure: FigureBase) -> list[Axes]:
    axes: Any = figure.axes
    return list(axes)


def legend_of(figure: Figure) -> list[Chart]:
    """The entries of a figure's own legend: what colours and signs mean."""
    return [_entry(handle) for legend in _legends(figure) for handle in _handles(legend)]


def title_of(figure: Figure) -> str:
    """The words above a figure; "" for none."""
    return figure.get_suptitle().replace(r"\$", "$")


def _chart(axes: Axes, legends: Sequence[Legend]) -> Chart:
    own = axes.get_legend()
    handles = [h for legend in (*([own] if own else []), *legends) for h in _handles(legend)]
    entries = [_entry(handle) for handle in handles]
    chart: Chart = {
        "title": axes.get_title() or axes.get_title(loc="left"),
        "place": _place(axes),
        "height": _inches(axes),
        "equal": bool(axes.get_aspect() == 1),
        "x": _scale(axes.xaxis, axes.get_xlim(), axes.get_xlabel(), axes.get_xscale()),
        "y": _scale(axes.yaxis, axes.get_ylim(), axes.get_ylabel(), axes.get_yscale()),
        "legend": [_entry(handle) for handle in _handles(own)] if own else [],
    }
    drawn = sorted((a for a in _drawn(axes) if a.get_visible()), key=lambda artist: artist.get_zorder())
    marks = [mark for artist in drawn for mark in _marks(axes, artist)]
    for mark in marks:
        mark["name"] = mark["name"] or _explained(mark, entries)
    return chart | {"marks": marks}


def _drawn(axes: Axes) -> list[Artist]:
    return [*axes.patches, *axes.collections, *axes.lines, *axes.texts, *axes.images]


def _place(axes: Axes) -> list[int] | None:
    """First row, last row, first column, last column in the grid; None outside of one."""
    spec = axes.get_subplotspec()
    if spec is None:
        return None
    return [spec.rowspan.start, spec.rowspan.stop - 1, spec.colspan.start, spec.colspan.stop - 1]


def _inches(axes: Axes) -> float:
    """How high they are in the picture, in."""
    root = axes.get_figure(root=True)
    assert root is not None  # a panel is of a figure
    return float(axes.figure.bbox.height / root.dpi * axes.get_position(original=True).height)


def _scale(axis: Axis, limits: tuple[float, float], label: str, kind: str) -> Chart:
    formatter, names = axis.get_major_formatter(), None
    if isinstance(formatter, NAMING):
        places = [float(place) for place in axis.get_majorticklocs()]
        texts = [" ".join(text.split()) for text in formatter.format_ticks(places)]
        if any(text and not _states(text, place) for place, text in zip(places, texts, strict=True)):
            names = [[place, text] for place, text in zip(places, texts, strict=True) if text]
    return {
        "label": label,
        "range": _numbers(sorted(limits)),
        "turned": bool(limits[0] > limits[1]),
        "log": kind == "log",
        "whole": _is_whole(axis.get_major_locator()),
        "names": names,
    }


def _is_whole(locator: Locator) -> bool:
    """Does an axis show whole numbers alone? No public field says so."""
    return isinstance(locator, MaxNLocator) and bool(locator._integer)  # type: ignore[attr-defined]


def _states(text: str, number: float) -> bool:
    """Is a text no more than the number that it stands at?"""
    try:
        return math.isclose(float(text), number, rel_tol=1e-3)
    except ValueError:
        return False


def _marks(axes: Axes, artist: Artist) -> list[Chart]:
    """What an artist draws; nothing where it has no place to draw at."""
    name = _name(artist)
    if isinstance(artist, Line2D):
        return _marks_of_line(axes, artist, name)
    if isinstance(artist, Rectangle):
        return [_mark_of_rectangle(axes, artist, name)]
    if isinstance(artist, PathCollection):
        return _marks_of_points(artist, name)
    if isinstance(artist, LineCollection):
        colour = _colour(artist.get_edgecolor()[0])
        return [
            {"kind": "line", "name": name, "colour": colour, "width": 1.5, "dash": [], "sign": "",
             "x": _numbers(segment[:, 0]), "y": _numbers(segment[:, 1])}
            for segment in artist.get_segments()
        ]  # fmt: skip
    if isinstance(artist, Text):
        x, y = artist.get_position()
        if artist.get_transform() == axes.transAxes:
            return [{"kind": "words", "name": "", "text": artist.get_text()}]
        return [{"kind": "text", "name": "", "text": artist.get_text(), "x": float(x), "y": float(y)}]
    raise TypeError(f"a chart draws no {type(artist).__name__}; expected lines, points, bars, spans or texts")


def _marks_of_line(axes: Axes, line: Line2D, name: str) -> list[Chart]:
    x, y = (np.atleast_1d(np.asarray(values, np.float64)) for values in line.get_data(orig=False))
    along_x, along_y = line.get_transform().contains_branch_seperately(axes.transData)
    style = _style(line)
    if not (along_x and along_y):  # axhline and axvline
        return [style | {"kind": "level", "name": name, "x": None if along_y else float(x[0]),
                         "y": float(y[0]) if along_y else None}]  # fmt: skip
    if len(x) == 0:
        return []
    rows = rows_to_show([x, y], np.zeros(len(x), np.bool_), most=MOST_POINTS, buckets=MOST_POINTS // 4)
    return [style | {"kind": "line", "name": name, "x": _numbers(x[rows]), "y": _numbers(y[rows]),
                     "thinned": len(rows) < len(x)}]  # fmt: skip


def _mark_of_rectangle(axes: Axes, patch: Rectangle, name: str) -> Chart:
    along_x, along_y = patch.get_data_transform().contains_branch_seperately(axes.transData)
    low, left = patch.get_y(), patch.get_x()
    x, y = sorted((left, left + patch.get_width())), sorted((low, low + patch.get_height()))
    return {
        "kind": "box",
        "name": name,
        "colour": _colour(patch.get_facecolor()),
        "x": _numbers(x) if along_x else None,
        "y": _numbers(y) if along_y else None,
    }


def _marks_of_points(points: PathCollection, name: str) -> list[Chart]:
    places = np.ma.filled(np.ma.asarray(points.get_offsets(), np.float64), np.nan)
    if len(places) == 0:
        return []
    faces = points.get_facecolor()
    return [
        {"kind": "line", "name": name, "colour": _colour(points.get_edgecolor()[0]), "width": 0, "dash": [],
         "sign": "o", "hollow": len(faces) == 0, "x": _numbers(places[:, 0]), "y": _numbers(places[:, 1])}
    ]  # fmt: skip


def _style(line: Line2D) -> Chart:
    """Colour, width, dashes and sign of a line."""
    sign, style = str(line.get_marker()), str(line.get_linestyle())
    sign = "" if sign in ("None", "", " ") else sign
    drawn = style not in ("None", "", " ")
    colour = _colour(line.get_color())
    face = line.get_markerfacecolor()
    edge = line.get_markeredgecolor()
    hollow = bool(sign) and isinstance(face, str) and face == "none"
    return {
        "colour": colour if drawn or not sign else _colour(edge if hollow or sign in "|_+x" else face),
        "width": float(line.get_linewidth()) if drawn else 0,
        "dash": DASHES.get(style, DASHES["--"]) if drawn else [],
        "sign": sign,
        "hollow": hollow,
    }


def _entry(handle: Artist) -> Chart:
    """A legend's entry."""
    label = str(handle.get_label())
    if isinstance(handle, Line2D):
        return {"label": label, **_style(handle)}
    if isinstance(handle, PathCollection):
        hollow = len(handle.get_facecolor()) == 0
        return {"label": label, "colour": _colour(handle.get_edgecolor()[0]), "width": 0, "dash": [],
                "sign": "o", "hollow": hollow}  # fmt: skip
    if isinstance(handle, LineCollection):  # error bars
        return {"label": label, "colour": _colour(handle.get_edgecolor()[0]), "width": 1.5, "dash": [],
                "sign": "", "hollow": False}  # fmt: skip
    if isinstance(handle, Rectangle):
        return {"label": label, "colour": _colour(handle.get_facecolor()), "width": 0, "dash": [],
                "sign": "box", "hollow": False}  # fmt: skip
    raise TypeError(f"a legend explains no {type(handle).__name__}; expected lines, points or boxes")


def _legends(figure: FigureBase) -> Iterator[Legend]:
    yield from figure.legends
    for part in figure.subfigs:
        yield from _legends(part)


def _handles(legend: Legend) -> list[Artist]:
    """A legend's entries with their texts as labels."""
    handles = [handle for handle in legend.legend_handles if handle is not None]
    for handle, text in zip(handles, legend.get_texts(), strict=True):
        handle.set_label(text.get_text())
    return handles


def _name(artist: Artist) -> str:
    """An artist's own name; "" for none."""
    label = str(artist.get_label())
    return "" if label.startswith("_") else label


def _explained(mark: Chart, entries: Iterable[Chart]) -> str:
    """What the legends say of a mark: of its colour, and of its style where an entry is black."""
    sign = "box" if mark["kind"] == "box" else mark.get("sign", "")
    style = (sign, bool(mark.get("width")), mark.get("dash", []), mark.get("hollow", False))
    same_colour, same_style = [], []
    for entry in entries:
        own_style = (entry["sign"], bool(entry["width"]), entry["dash"], entry["hollow"])
        if entry["colour"] == mark.get("colour"):
            same_colour.append((own_style == style, entry["label"]))
        elif entry["colour"] in PLAIN and own_style == style:
            same_style.append(entry["label"])
    exact = [label for is_exact, label in same_colour if is_exact]
    return ", ".join(dict.fromkeys([*(exact or [label for _, label in same_colour])[:1], *same_style[:1]]))


def _colour(colour: Any) -> str:
    """A colour by its name in style.css, or as #rrggbb."""
    if isinstance(colour, np.ndarray) and len(colour) == 0:
        return "none"
    code = to_hex(to_rgba(colour)).upper()
    return NAMES.get(code, code.lower())


def _numbers(values: npt.ArrayLike) -> list[float | None]:
    """Numbers with the digits that a screen can show; None for those that are not finite."""
    return [float(f"{v:.{DIGITS}g}") if math.isfinite(v) else None for v in np.asarray(values, np.float64)]
