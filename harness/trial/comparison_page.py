"""Two logs in one page: both tracks, both series in each panel, and what differs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.cosim.loop import Array
from harness.files import in_words, write_whole
from harness.log.compare import TURN, LogComparison
from harness.log.comparison_table import sentence
from harness.log.log import Log
from harness.report.page import column, render
from harness.report.thin import rows_to_show
from harness.trial.events import events
from harness.trial.page import (
    ANGLES,
    COMMANDS,
    MOST_EVENTS,
    Line,
    bands,
    changes,
    marks,
    panel,
    route_data,
    signals_of,
    units_of,
)
from harness.trial.summary import in_a_sentence, summarize

SIDES = {"a": ("A", "truth", ""), "b": ("B", "threshold", "second")}  # name, colour, class on the map
QUANTITIES = (  # a panel each: of several signals the first that both logs have
    ("distance to the target", "m", ("controller.distance",)),
    ("deviation from the target", "rad", ("controller.deviation",)),
    ("speed", "m/s", ("plant.speed", "estimator.speed")),
    ("heading", "rad", ("plant.heading", "estimator.heading")),
    ("error of the estimated position", "m", ("error.position",)),
)
OF_INTEREST = tuple(
    f"{component}.{name}"
    for component in ("plant", "estimator")
    for name in ("north", "east", "speed", "heading")
)
MOST_SIGNALS = 200  # in the page's table


@dataclass(frozen=True)
class Side:
    """One of two logs, with its values at the times of both.

    Attributes:
        rows: (times,), the log's row at or before each time; -1 before its first and after its last.
    """

    log: Log
    signals: dict[str, Array]
    rows: np.ndarray[Any, np.dtype[np.intp]]

    @classmethod
    def of(cls, log: Log, times: Array) -> Side:
        """A log at these times."""
        rows = np.searchsorted(log.time, times, side="right") - 1
        rows[times > log.time[-1]] = -1
        return cls(log, signals_of(log), rows)

    def __getitem__(self, signal: str) -> Array:
        values: Array = np.where(self.rows >= 0, self.signals[signal][self.rows], np.nan)
        return values


def write_comparison(a: Log, b: Log, comparison: LogComparison, path: Path) -> None:
    """Write the page, which needs no other file.

    Raises:
        FileError: it cannot be written.
    """
    of_sides = {name: events(log) for log, (name, *_) in zip((a, b), SIDES.values(), strict=True)}
    happened = sorted(
        (replace(event, text=f"{name}: {event.text}") for name, own in of_sides.items() for event in own),
        key=lambda event: event.time,
    )
    shown = happened[:MOST_EVENTS]
    data = comparison_data(a, b, comparison) | {
        "marks": [
            mark | {"text": f"{name}: {mark['text']}"}
            for name, own in of_sides.items()
            for mark in marks(own)
        ],
        "events": [event.time for event in shown],
    }
    content = render(
        "comparison.html.jinja",
        f"{a.path} and {b.path}",
        data,
        ("answer.js",),
        agree=comparison.agree,
        sentence=sentence(comparison),
        sides=[
            {"name": name, "path": str(log.path), "how": in_a_sentence(summarize(log)), "broken": log.broken}
            for log, (name, *_) in zip((a, b), SIDES.values(), strict=True)
        ],
        thinned=data["thinned"],
        differences=comparison.signals[:MOST_SIGNALS],
        more_differences=max(len(comparison.signals) - MOST_SIGNALS, 0),
        alone={name: comparison.signals_of_one[key] for key, (name, *_) in SIDES.items()},
        statements=[(s.name, in_words(s.a), in_words(s.b)) for s in comparison.statements],
        events=shown,
        more_events=len(happened) - len(shown),
    )
    write_whole(path, content)


def comparison_data(a: Log, b: Log, comparison: LogComparison) -> dict[str, Any]:
    """What the page draws: signals as `a.plant.north` and `b.plant.north`, and B - A at the times of both."""
    times = np.union1d(a.time, b.time)
    sides = {"a": Side.of(a, times), "b": Side.of(b, times)}
    units = units_of(b) | units_of(a)
    columns: dict[str, Array] = {}
    panels = []
    for title, unit, names in QUANTITIES:
        both = [name for name in names if all(name in side.signals for side in sides.values())]
        if both:
            lines = [Line(f"{key}.{both[0]}", name, colour) for key, (name, colour, _) in SIDES.items()]
            columns |= {f"{key}.{both[0]}": side[both[0]] for key, side in sides.items()}
            panels.append(panel(title, unit, lines, **(ANGLES if unit == "rad" else {"include": [0]})))
    differing = {difference.signal for difference in comparison.signals}
    shown = {name: units[name] for name in OF_INTEREST if name in differing}
    for name, difference in _differences(sides["a"], sides["b"], times, shown).items():
        columns[f"difference.{name}"] = difference
        line = Line(f"difference.{name}", "B - A", "estimate")
        panels.append(panel(f"{name}, B - A", units[name], [line], height=90))
    tracks = _tracks(sides, columns)
    strips = _strips(sides, columns)
    states = [columns[strip["signal"]] for strip in strips]
    lines_drawn = [values for name, values in columns.items() if not name.endswith(".command")]
    rows = rows_to_show(lines_drawn, changes(states, len(times)))
    return {
        "time": column(times[rows], "s"),
        "signals": {
            name: column(values[rows], units.get(name.partition(".")[2], ""))
            for name, values in columns.items()
        },
        "thinned": None if len(rows) == len(times) else {"shown": len(rows), "ticks": len(times)},
        "panels": panels,
        "tracks": tracks,
        "strips": strips,
        "felt": None,
        "route": route_data(a) or route_data(b),
        "bands": [
            band | {"text": f"{name}: {band['text']}"}
            for log, (name, *_) in zip((a, b), SIDES.values(), strict=True)
            for band in bands(log)
        ],
    }


def _differences(a: Side, b: Side, times: Array, units: Mapping[str, str]) -> dict[str, Array]:
    """B - A of signals at each time, the shorter way round for angles; the last where not both have a row.

    Args:
        units: of the signals, by name.
    """
    at, of_a, of_b = np.intersect1d(a.log.time, b.log.time, assume_unique=True, return_indices=True)
    if not len(at):
        return {name: np.full(len(times), np.nan) for name in units}
    last = np.searchsorted(at, times, side="right") - 1
    known = (last >= 0) & (times <= at[-1])
    differences = {}
    for name, unit in units.items():
        difference = b.signals[name][of_b] - a.signals[name][of_a]
        if turn := TURN.get(unit):
            difference = difference - turn * np.round(difference / turn)
        differences[name] = np.where(known, difference[last], np.nan)
    return differences


def _tracks(sides: Mapping[str, Side], columns: dict[str, Array]) -> list[dict[str, Any]]:
    """The path of each log's animal, or of its estimate; what they need is added to the columns."""
    tracks = []
    for key, side in sides.items():
        label, colour, css = SIDES[key]
        component = next((c for c in ("plant", "estimator") if f"{c}.north" in side.signals), None)
        if component is None or f"{component}.east" not in side.signals:
            continue
        names = {name: f"{component}.{name}" for name in ("north", "east", "heading")}
        known = {name: signal for name, signal in names.items() if signal in side.signals}
        columns |= {f"{key}.{signal}": side[signal] for signal in known.values()}
        tracks.append(
            {
                "label": label,
                "class": css,
                "colour": colour,
                "place": [f"{key}.{component}.north", f"{key}.{component}.east"],
                "heading": f"{key}.{known['heading']}" if "heading" in known else None,
                "sd": None,
                "command": None,
            }
        )
    return tracks


def _strips(sides: Mapping[str, Side], columns: dict[str, Array]) -> list[dict[str, str]]:
    strips = []
    for key, side in sides.items():
        command = next((name for name in COMMANDS if name in side.signals), None)
        if command:
            columns[f"{key}.controller.command"] = side[command]
            signal = f"{key}.controller.command"
            strips.append({"name": SIDES[key][0], "signal": signal, "kind": "command", "text": ""})
    return strips
