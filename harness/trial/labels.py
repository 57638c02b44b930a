"""Where the names of places stand on a map: beside their markers, off the paths, off each other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from harness.log.channel import Array

Place = tuple[str, float, float]  # name, x and y of its marker
STEP = 1.0  # points between the samples of a path
MOST_SAMPLES = 500_000
MARGIN = 2.5  # points that stay free around a name
DISTANCES = (7.0, 13.0, 20.0, 30.0, 42.0)  # points from the marker's centre to the name's border
FAR = 20.0  # points from which a line leads to the marker
DIRECTIONS = np.radians([45, -45, 135, -135, 0, 180, 90, -90, 22, -22, 158, -158, 67, -67, 113, -113])
MARKER = 6.0  # points, half the width of a marker


def place_labels(
    axes: Axes, places: Sequence[Place], lines: Sequence[Array], markers: Array, color: str
) -> list[Annotation]:
    """Write the names of places where they cover least of what is drawn.

    Args:
        axes: with its limits and place in the figure as they stay.
        lines: (n, 2) each, polylines to keep clear of, in the axes' coordinates.
        markers: (m, 2), centres of further markers to keep clear of.
    """
    canvas = axes.figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    point = renderer.points_to_pixels(1.0)
    centres = axes.transData.transform(np.array([place[1:] for place in places], dtype=float).reshape(-1, 2))
    corners = MARKER * point * np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)])
    others = axes.transData.transform(markers.reshape(-1, 2))
    obstacles = np.concatenate(
        [
            *(_samples(axes.transData.transform(line), STEP * point) for line in lines),
            (np.concatenate([centres, others])[:, np.newaxis] + corners).reshape(-1, 2),
        ]
    )
    obstacles = np.unique(np.round(obstacles), axis=0)
    view = axes.get_window_extent(renderer)
    labels: list[Annotation] = []
    taken: list[Bbox] = []
    for (name, x, y), centre in zip(places, centres, strict=True):
        label = axes.annotate(
            name, (x, y), (0, 0), textcoords="offset points", ha="center", va="center", color=color,
            fontweight="bold", zorder=9, path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )  # fmt: skip
        label.set_in_layout(False)
        extent = label.get_window_extent(renderer)
        half = np.array([extent.width, extent.height]) / 2
        least, offset, distance = np.inf, np.zeros(2), 0.0
        for near, angle in product(DISTANCES, DIRECTIONS):
            place = np.array([np.cos(angle), np.sin(angle)]) * (near * point + half)
            box = Bbox([centre + place - half, centre + place + half]).padded(MARGIN * point)
            covered = _covered(box, obstacles, taken, view)
            if covered < least:
                least, offset, distance, best = covered, place, near, box
            if covered == 0:
                break
        label.set_position(tuple(offset / point))
        taken.append(best)
        labels.append(label)
        if distance >= FAR:
            leader = {"arrowstyle": "-", "color": color, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 4}
            arrow = axes.annotate(
                "", (x, y), tuple(offset / point), textcoords="offset points", arrowprops=leader
            )
            arrow.set_in_layout(False)
    return labels


def _samples(line: Array, step: float) -> Array:
    """Points of a polyline, (n, 2), at most about a step apart; what is not finite is left out."""
    line = line[np.isfinite(line).all(axis=1)]
    if len(line) < 2:
        return line
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.linspace(0.0, along[-1], min(int(along[-1] / step) + 2, MOST_SAMPLES))
    samples: Array = np.column_stack([np.interp(at, along, line[:, axis]) for axis in (0, 1)])
    return samples


def _covered(box: Bbox, obstacles: Array, taken: Sequence[Bbox], view: Bbox) -> int:
    """How much of what is drawn a name in this box covers; another name and the border weigh most."""
    inside = ((obstacles >= box.min) & (obstacles <= box.max)).all(axis=1)
    worst = len(obstacles)
    outside = not (view.contains(*box.min) and view.contains(*box.max))
    return int(inside.sum()) + worst * (outside + sum(box.overlaps(other) for other in taken))
