"""The picture of a replay: for each configuration the paths and errors of its estimates in the outages."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.drawing import BELOW, ESTIMATES, GPS, GRID, TRUTH, drawable, house_style, new_figure, png_of
from harness.log.channel import Array
from harness.recording.holes import holes_of_fixes

SMALL, LARGE = 11, 14  # pt
SHOWN = "estimate, in outages that do not overlap"
WIDE = 4  # configurations abreast
WRAP = 130  # characters of LARGE on a line


class Track(NamedTuple):
    """A path over time, (n,) each: s, m, m."""

    time: Array
    north: Array
    east: Array


@house_style()
def replay_picture(
    gps: Track,
    estimates: Mapping[str, Sequence[Track]],
    errors: Mapping[str, Mapping[str, float | None]],
    *,
    on_map: Sequence[int],
    title: str = "",
    not_used: str = "",
) -> bytes:
    """The picture of a replay as a PNG.

    Args:
        gps: all fixes, the withheld ones too.
        estimates: each configuration's, by name, in each outage.
        errors: of each configuration, the `mean`, `median` and `p90` of the position's error [m].
        on_map: the outages to draw on the maps; those that overlap would hide each other there.
        title: above the picture.
        not_used: below the title, what was left out or dropped, in a line each.
    """
    return png_of(replay_figure(gps, estimates, errors, on_map=on_map, title=title, not_used=not_used))


def replay_figure(
    gps: Track,
    estimates: Mapping[str, Sequence[Track]],
    errors: Mapping[str, Mapping[str, float | None]],
    *,
    on_map: Sequence[int],
    title: str = "",
    not_used: str = "",
) -> Figure:
    """The figure of `replay_picture`: for each configuration a map above its errors, WIDE of them abreast.

    All maps have one scale, and so have all errors.
    """
    gps = _broken(gps)
    wide = min(len(estimates), WIDE)
    bands = -(-len(estimates) // wide)
    figure = new_figure(4.2 * wide, 9 * bands)
    grid = figure.subplots(2 * bands, wide, squeeze=False)
    top = 1.05 * max(np.nanmax(_error(gps, track)) for tracks in estimates.values() for track in tracks)
    shown = [gps, *(tracks[i] for tracks in estimates.values() for i in on_map)]
    middle, half = _square(shown)
    for number, (name, tracks) in enumerate(estimates.items()):
        color = ESTIMATES[number % len(ESTIMATES)]
        band, column = divmod(number, wide)
        above, below = grid[2 * band : 2 * band + 2, column]
        _map(above, gps, [tracks[i] for i in on_map], color)
        above.set_title(name, fontsize=LARGE, fontweight="bold", color=color)
        _errors(below, gps, tracks, color)
        above.set_xlim(middle[1] - half, middle[1] + half)
        above.set_ylim(middle[0] - half, middle[0] + half)
        below.set_ylim(0, top)
        below.set_title(_in_words(errors[name], len(tracks)), fontsize=SMALL)
    for band in range(bands):
        grid[2 * band, 0].set_ylabel("north [m]", fontsize=SMALL)
        grid[2 * band + 1, 0].set_ylabel("distance from GPS [m]", fontsize=SMALL)
    for empty in range(len(estimates), bands * wide):
        for axes in grid[2 * (empty // wide) : 2 * (empty // wide) + 2, empty % wide]:
            axes.remove()
    for axes in figure.axes:
        axes.grid(**GRID)
        axes.tick_params(labelsize=SMALL, labelbottom=True, labelleft=True)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=SMALL, **BELOW)
    below_title = (part for line in not_used.splitlines() for part in textwrap.wrap(line, WRAP))
    lines = [drawable(title, WRAP), *below_title]
    figure.suptitle("\n".join(lines), fontsize=LARGE)
    return figure


def _map(axes: Axes, gps: Track, tracks: Sequence[Track], color: str) -> None:
    """The receiver's path, and from each outage's estimate at its end a line to where the receiver was."""
    axes.plot(gps.east, gps.north, color=GPS, linewidth=1.2, label="GPS", zorder=2)
    for number, track in enumerate(tracks):
        first = number == 0
        axes.plot(track.east, track.north, color=color, linewidth=1.6, label=SHOWN if first else "", zorder=3)
        ends = _at(gps, track.time[-1:])
        axes.plot(
            [track.east[-1], ends.east[0]],
            [track.north[-1], ends.north[0]],
            color=TRUTH,
            linewidth=0.7,
            linestyle=":",
            marker="o",
            markersize=3,
            label="estimate and GPS at an outage's end" if first else "",
            zorder=4,
        )
    axes.set_aspect("equal")
    axes.locator_params(nbins=5)
    axes.set_xlabel("east [m]", fontsize=SMALL)


def _errors(axes: Axes, gps: Track, tracks: Sequence[Track], color: str) -> None:
    """Distance of the estimates from the receiver since the start of each outage."""
    for track in tracks:
        axes.plot(track.time - track.time[0], _error(gps, track), color=color, linewidth=1.2, alpha=0.7)
    axes.set_xlabel("time since the outage began [s]", fontsize=SMALL)
    axes.set_xlim(left=0)


def _error(gps: Track, track: Track) -> Array:
    """Distance of an estimate from the receiver's path, (n,) m."""
    there = _at(gps, track.time)
    return np.asarray(np.hypot(track.north - there.north, track.east - there.east))


def _square(tracks: Sequence[Track]) -> tuple[tuple[float, float], float]:
    """North and east of the middle of all tracks, and half the side of the square that holds them [m]."""
    spans = [(min(map(np.nanmin, parts)), max(map(np.nanmax, parts)))
             for parts in ([t.north for t in tracks], [t.east for t in tracks])]  # fmt: skip
    (south, north), (west, east) = spans
    half = 0.53 * max(north - south, east - west, 1.0)
    return (float(south + north) / 2, float(west + east) / 2), float(half)


def _broken(gps: Track) -> Track:
    """The receiver's path with a NaN in each hole, where nobody knows how it went."""
    holes = np.array(holes_of_fixes(gps.time)).reshape(-1, 2)
    behind = np.searchsorted(gps.time, holes[:, 1])
    nothing = np.full(len(holes), np.nan)
    gaps = (holes.mean(axis=1), nothing, nothing)
    return Track(*(np.insert(part, behind, gap) for part, gap in zip(gps, gaps, strict=True)))


def _at(gps: Track, time: Array) -> Track:
    """The receiver's path at some times, on straight lines between fixes; NaN in its holes."""
    return Track(time, np.interp(time, gps.time, gps.north), np.interp(time, gps.time, gps.east))


def _in_words(error: Mapping[str, float | None], number: int) -> str:
    return (
        f"at the end of {number} outage{'s' * (number != 1)}:\n"
        f"mean {error['mean']:.2f} m, median {error['median']:.2f} m, p90 {error['p90']:.2f} m"
    )
