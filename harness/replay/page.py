"""The page of a replay: paths and errors of all configurations over time, the outages, the tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Console

from harness.log.channel import Array
from harness.recording.holes import holes_of_fixes
from harness.recording.signals import SensorSignals
from harness.replay.comparison import HELD
from harness.replay.outage import Outage, Replayed, disjoint
from harness.report.page import column, render
from harness.report.tables import printed
from harness.report.thin import rows_to_show

PAGE = "replay.html"
MOST_VALUES = 600_000  # on a page, some 4 MB
COLOURS = 8  # --series-1 to --series-8 of style.css; after them dashes differ
DASHES: tuple[list[int], ...] = ([], [8, 4], [2, 3])
SHOWN = 7  # configurations that are drawn at first; others are a click away
MOST_OUTAGES = 500  # in the table
REFERENCE = "reference"


def replay_page(
    signals: SensorSignals,
    replayed: Replayed,
    names: Mapping[str, str],
    show: Callable[[Console], None],
    *,
    title: str,
    sentence: str,
    notes: Sequence[str],
) -> bytes:
    """The page as UTF-8, one file that needs no other.

    Args:
        signals: without an outage.
        names: of the configurations that were judged, as tables show them, by their own.
        show: prints the tables.
    """
    data = replay_data(signals, replayed, names)
    outages = replayed.outages
    return render(
        "replay.html.jinja",
        title,
        data,
        ("answer.js",),
        styles=("series.css",),
        sentence=sentence,
        picture="replay.png",
        thinned=data["thinned"],
        apart=len(data["bands"]) < len(outages),
        configurations=list(names.values()),
        outages=[
            (o.time[-1], o.start, o.end, o.path_m, o.standing, [o.errors[name][0] for name in names])
            for o in outages[:MOST_OUTAGES]
        ],
        more_outages=max(len(outages) - MOST_OUTAGES, 0),
        printed=printed(show),
        notes=notes,
    )


def replay_data(signals: SensorSignals, replayed: Replayed, names: Mapping[str, str]) -> dict[str, Any]:
    """What the page draws (harness/report/README.md).

    An estimate is that with all fixes up to the last outage. In the outages that do not overlap it is that
    without their fixes.
    """
    outages = replayed.outages
    apart = disjoint(outages)
    reference = _reference(signals)
    columns: dict[str, Array] = {f"{REFERENCE}.{name}": values for name, values in reference.items()}
    for number, name in enumerate(names):
        estimate = _estimate(name, replayed, apart, signals.t)
        off = np.hypot(*(estimate[way] - reference[way] for way in ("north", "east")))
        ends = np.full(len(signals.t), np.nan)
        for outage in outages:
            ends[_tick(signals.t, outage.time[-1])] = outage.errors[name][0]
        columns |= {f"{number}.{way}": values for way, values in estimate.items()}
        columns |= {f"{number}.error": off, f"{number}.end": ends}
    rows = _rows(signals.t, columns, outages, len(names))
    median = {name: float(np.median([o.errors[name][0] for o in outages])) for name in names}
    first = sorted(names, key=lambda name: (name != HELD, median[name]))[:SHOWN]
    looks = [
        (f"series-{number % COLOURS + 1}", number // COLOURS % len(DASHES)) for number in range(len(names))
    ]
    units = {"north": "m", "east": "m", "error": "m", "end": "m", "speed": "m/s"}

    def lines(way: str, *, points: bool = False) -> list[dict[str, Any]]:
        return [
            {"signal": f"{number}.{way}", "label": shown, "colour": colour, "width": 1.4,
             "dash": DASHES[dash], "points": points, "around": None}
            for number, (shown, (colour, dash)) in enumerate(zip(names.values(), looks, strict=True))
        ]  # fmt: skip

    truth = {"signal": f"{REFERENCE}.speed", "label": "GPS", "colour": "truth", "around": None}
    tracks = [
        {"label": names[name], "class": f"{colour} dash-{dash}", "colour": colour, "optional": True,
         "shown": name in first, "heading": None, "sd": None, "command": None,
         "place": [f"{number}.north", f"{number}.east"]}
        for number, (name, (colour, dash)) in enumerate(zip(names, looks, strict=True))
    ]  # fmt: skip
    return {
        "time": column(signals.t[rows], "s"),
        "signals": {key: column(v[rows], units[key.partition(".")[2]]) for key, v in columns.items()},
        "thinned": None if len(rows) == len(signals.t) else {"shown": len(rows), "ticks": len(signals.t)},
        "panels": [
            {"title": "distance from GPS", "unit": "m", "height": 190, "levels": [], "include": [0],
             "series": lines("error")},
            {"title": "distance from GPS at the end of each outage", "unit": "m", "levels": [],
             "include": [0], "series": lines("end", points=True)},
            {"title": "speed", "unit": "m/s", "height": 160, "levels": [], "include": [0],
             "series": [truth, *lines("speed")]},
        ],
        "tracks": [*tracks, {"label": "GPS", "class": "", "colour": "truth", "heading": None, "sd": None,
                             "command": None, "place": [f"{REFERENCE}.north", f"{REFERENCE}.east"]}],
        "strips": [],
        "felt": None,
        "route": None,
        "bands": [{"from": o.start, "until": o.end, "kind": "outage", "text": "GPS outage"} for o in apart],
        "marks": [],
        "events": [float(o.time[-1]) for o in outages[:MOST_OUTAGES]],
    }  # fmt: skip


def _reference(signals: SensorSignals) -> dict[str, Array]:
    """The receiver at each tick, (ticks,): on straight lines between fixes, NaN in the holes of them."""
    fixes = signals.reference_fix
    times = signals.t[fixes]
    inside = (signals.t >= times[0]) & (signals.t <= times[-1])
    for start, end in holes_of_fixes(times):
        inside &= (signals.t <= start) | (signals.t >= end)
    whole = {
        "north": signals.reference_north, "east": signals.reference_east, "speed": signals.reference_speed
    }  # fmt: skip
    return {
        name: np.where(inside, np.interp(signals.t, times, values[fixes]), np.nan)
        for name, values in whole.items()
    }


def _estimate(name: str, replayed: Replayed, apart: Sequence[Outage], time: Array) -> dict[str, Array]:
    """A configuration's estimate at each tick, (ticks,); NaN where an outage begins, behind it, and
    after the last."""
    estimate = {way: np.full(len(time), np.nan) for way in ("north", "east", "speed")}
    for way, whole in estimate.items():
        values = getattr(replayed.with_fixes[name], way)
        whole[: len(values)] = values
    for outage in apart:
        first = _tick(time, outage.time[0])
        for way, whole in estimate.items():
            values = getattr(outage.estimates[name], way)
            whole[first : first + len(values)] = values
            whole[[first, min(first + len(values), len(whole) - 1)]] = np.nan  # no line leads in or back
    return estimate


def _rows(
    time: Array, columns: Mapping[str, Array], outages: Sequence[Outage], configurations: int
) -> np.ndarray[Any, np.dtype[np.intp]]:
    """The ticks to draw: all, or those with the extremes of the errors, and the ends of the outages."""
    marked = np.zeros(len(time), dtype=np.bool_)
    for outage in outages:
        marked[[_tick(time, outage.time[0]), _tick(time, outage.time[-1])]] = True
    most = MOST_VALUES // len(columns)
    errors = [values for key, values in columns.items() if key.endswith(".error")]
    return rows_to_show(errors, marked, most=most, buckets=max(most // (2 * configurations), 1))


def _tick(time: Array, moment: float) -> int:
    """The tick at a time [s]."""
    return int(np.searchsorted(time, moment - 1e-6))
