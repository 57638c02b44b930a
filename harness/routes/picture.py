"""The picture of a plan: the map with its areas and routes, and what there is to choose between."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from harness.drawing import (
    BELOW,
    CIRCLE_EDGE,
    ESTIMATES,
    GRID,
    Style,
    add_scale_bar,
    drawable,
    house_style,
    new_figure,
    png_of,
    set_title,
)
from harness.routes.candidates import Candidate
from harness.routes.halving import Result
from harness.routes.site import Area, Place
from harness.terminal import percent

AREA: Style = {"facecolor": "#D9CFC4", "edgecolor": "#8A7A68", "linewidth": 1.0, "zorder": 1}
STREET: Style = {"color": "#C9D3DD", "linewidth": 5.0, "zorder": 0.5, "solid_capstyle": "round"}
TRIED: Style = {"color": "#9AA3AD", "linewidth": 0.7, "alpha": 0.7, "zorder": 2}
REFERENCE: Style = {"color": "#111111", "linewidth": 1.2, "linestyle": (0, (4, 2)), "zorder": 5.5}
PLATE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
MOST = len(ESTIMATES)  # routes with a colour of their own
RIM = 2.4  # points by which a route is wider than those drawn over it, and by which its waypoints are larger
NEAR = 1.0  # m within which one route would hide another
HIDDEN = 0.3  # share of a route's length


@house_style()
def routes_png(result: Result) -> bytes:
    """The picture as a PNG."""
    return png_of(routes_figure(result))


def routes_figure(result: Result) -> Figure:
    """The map to the left; success over time of the candidates to the right."""
    figure = new_figure(13, 7)
    plane, choice = figure.subplots(1, 2, width_ratios=(1.2, 1))
    coloured = _coloured(result)
    _draw_map(plane, result, coloured)
    _draw_choice(choice, result, coloured)
    problem = result.problem
    set_title(
        figure,
        drawable(
            f"{problem.site.name}: {len(problem.candidates)} candidates; "
            f"{problem.scorer.system.components['controller'].title()} and "
            f"{problem.scorer.system.components['plant'].title()}, reading "
            f"{problem.scorer.scenario.reading}, system {problem.scorer.scenario.system}",
            100,
        ),
    )
    return figure


def _coloured(result: Result) -> dict[Candidate, str]:
    """The routes with a colour: the recommended one first, then the front by success."""
    first = [result.recommended] if result.recommended else []
    chosen = dict.fromkeys([*first, *result.front])
    return dict(zip((c for c in chosen if c != result.reference), ESTIMATES, strict=False))


def _draw_map(axes: Axes, result: Result, coloured: dict[Candidate, str]) -> None:
    """North up, east to the right."""
    site, begin = result.problem.site, result.problem.begin
    for street in site.streets:
        north, east = np.array(street.coords).T
        axes.plot(east, north, **STREET)
    for area in site.areas:
        axes.add_patch(PathPatch(_outline(area.shape), **AREA))
    for candidate in result.problem.candidates:
        if candidate not in coloured and candidate != result.reference:
            _draw_line(axes, [begin, *candidate.waypoints], **TRIED)
    levels = _levels([shapely.LineString([begin, *candidate.waypoints]) for candidate in coloured])
    for (candidate, colour), level in zip(coloured.items(), levels, strict=True):
        width = 2.2 if candidate == result.recommended else 1.4
        _draw_line(
            axes, [begin, *candidate.waypoints], color=colour, zorder=5 - level / 10,
            linewidth=width + RIM * level, marker="o", markersize=4 + RIM * level,
        )  # fmt: skip
    _draw_line(axes, [begin, *result.reference.waypoints], **REFERENCE)
    for (north, east), word in ((begin, "from"), (result.problem.end, "to")):
        axes.plot(east, north, marker="o", markersize=9, color="white", markeredgecolor="black", zorder=6)
        axes.annotate(word, (east, north), xytext=(8, -4), textcoords="offset points", zorder=6, bbox=PLATE)
    for area in site.areas:
        _name(axes, area)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.05)
    axes.set_xlabel("east [m]")
    axes.set_ylabel("north [m]")
    axes.grid(**GRID)
    axes.set_axisbelow(True)
    add_scale_bar(axes)


def _levels(lines: Sequence[shapely.LineString]) -> list[int]:
    """How many routes each is wider for: of those before it, the ones that are drawn over much of it."""
    levels: list[int] = []
    for line in lines:
        over = [
            level + 1
            for level, other in zip(levels, lines, strict=False)
            if line.intersection(other.buffer(NEAR)).length > HIDDEN * line.length
        ]
        levels.append(max(over, default=0))
    return levels


def _role(candidate: Candidate, result: Result) -> str:
    """What a route is beside one on the front, for the legend."""
    if candidate == result.recommended:
        return ", recommended"
    return ", the shortest unsplit way (dashed)" if candidate == result.reference else ""


def _draw_line(axes: Axes, places: Sequence[Place], **style: object) -> None:
    north, east = np.array(places).T
    axes.plot(east, north, **style)  # type: ignore[arg-type]


def _name(axes: Axes, area: Area) -> None:
    point = area.shape.representative_point()
    text = drawable(area.name, 18)
    axes.text(point.y, point.x, text, fontsize=8, ha="center", va="center", color="#4A4036", zorder=2.5)


def _outline(polygon: shapely.Polygon) -> Path:
    """A polygon with its holes as a path, east before north."""
    rings = [np.array(ring.coords)[:, ::-1] for ring in (polygon.exterior, *polygon.interiors)]
    codes = [[Path.MOVETO, *[Path.LINETO] * (len(ring) - 2), Path.CLOSEPOLY] for ring in rings]
    return Path(np.concatenate(rings), np.concatenate(codes))


def _draw_choice(axes: Axes, result: Result, coloured: dict[Candidate, str]) -> None:
    """Success with its interval over mean time; the chance of entering an area in words."""
    others = "others, as far as they were tried"
    for candidate in reversed(result.ranked):
        score = result.tried[candidate]
        if score.mean_time is None:
            continue
        low, high = (100 * bound for bound in score.interval)
        rate = 100 * score.success_rate
        colour = coloured.get(candidate, "#111111" if candidate == result.reference else "#9AA3AD")
        is_named = candidate in coloured or candidate == result.reference
        axes.errorbar(
            score.mean_time, rate, yerr=[[rate - low], [high - rate]], color=colour, capsize=3,
            marker="*" if candidate == result.recommended else "o",
            markersize=13 if candidate == result.recommended else 6,
            markeredgecolor=CIRCLE_EDGE if candidate == result.recommended else colour,
            label=f"{candidate.label}: {percent(score.success_rate)}, {score.mean_commands:.1f} stimuli, "
            f"enters {percent(score.entry_rate)}{_role(candidate, result)}" if is_named else others,
        )  # fmt: skip
        if not is_named:
            others = ""  # once in the legend
    axes.set_xlabel("mean time to the end [s]")
    axes.set_ylabel("reaches the end and enters no area [%]")
    axes.grid(**GRID)
    axes.set_axisbelow(True)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), fontsize=8, reverse=True, **BELOW)
