"""The page of a trial, from its log alone: trial.html, and the comparison of two logs in one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from harness.cosim.loop import Array
from harness.files import write_whole
from harness.log.arrived import arrived
from harness.log.log import Log
from harness.report.page import column, render
from harness.report.thin import rows_to_show
from harness.trial.disturbances import GPS_OUTAGE, LOST_RADIO, ORDER, disturbances
from harness.trial.events import Event, events
from harness.trial.parameters import changed
from harness.trial.summary import in_a_sentence, position_error, words

MOST_EVENTS = 1000  # in the page's table
MOST_PANELS = 24  # of a log with none of a trial's signals
TURN = 2 * np.pi
BANDS = {GPS_OUTAGE: "outage", ORDER: "order", LOST_RADIO: "lost"}  # others are faults
STATES = ("command", "status", "waypoint", "anomaly", "override", "link_ok", "mode")
COMMANDS = ("controller.command", "plant.command")  # the first that there is
ANGLES = {"turn": TURN, "range": [-190, 190], "splits": [-180, -90, 0, 90, 180]}  # a panel of them
FELT = ("tone_hz", "vibrate_left", "vibrate_right")


@dataclass(frozen=True)
class Line:
    """A signal in a panel, as `plots.js` takes it; `around` is the signal of its standard deviation."""

    signal: str
    label: str
    colour: str
    around: str | None = None
    points: bool = False
    width: float = 1.6


def write_page(log: Log, summary: Mapping[str, Any], path: Path) -> None:
    """Write trial.html, one page that needs no other file.

    Raises:
        FileError: it cannot be written.
    """
    happened = events(log)
    if summary["outcome"] == "timeout":
        happened.append(Event(float(log.time[-1]), "caution", "the time was over"))
    data = trial_data(log) | {
        "marks": marks(happened),
        "events": [event.time for event in happened[:MOST_EVENTS]],
    }
    page = render(
        "trial.html.jinja",
        ", seed ".join(filter(None, (summary["scenario"] or log.path.name, str(summary["seed"])))),
        data,
        ("answer.js",),
        sentence=in_a_sentence(summary).removeprefix(summary["outcome"].capitalize()),
        summary=words(summary),
        outcome=summary["outcome"],
        broken=log.broken,
        disturbances=disturbances(log),
        notes=summary["notes"],
        events=happened[:MOST_EVENTS],
        more_events=max(len(happened) - MOST_EVENTS, 0),
        thinned=data["thinned"],
        changed=changed(log),
        records=log.metadata,
        runs_again=bool(log.attachments),
        channels=log.channels,
    )
    write_whole(path, page)


def trial_data(log: Log, known: tuple[int, int] = (0, 0)) -> dict[str, Any]:
    """What the page draws: signals by name in SI units, and how they are drawn (harness/report/README.md).

    Args:
        known: so many ticks of so many signals a page has already; where that still fits, `time` and
            `signals` are those `from` there on.
    """
    signals = signals_of(log)
    units = units_of(log)
    panels = _panels(log, signals)
    drawn = {line["signal"] for panel in panels for line in panel["series"]}
    drawn |= {line["around"] for panel in panels for line in panel["series"] if line["around"]}
    tracks = _tracks(signals)
    for track in tracks:
        drawn |= {*track["place"], *(track["sd"] or ()), *filter(None, [track["heading"], track["command"]])}
    strips = _strips(signals)
    drawn |= {strip["signal"] for strip in strips}
    states = [signals[name] for name in drawn if name.partition(".")[2] in (*STATES, *FELT)]
    fixes = [signals[name] for name in drawn if name.startswith("fix.")]
    lines = [
        signals[name]
        for name in drawn
        if not name.startswith("fix.") and name.partition(".")[2] not in (*STATES, *FELT)
    ]
    rows = rows_to_show(lines, changes(states, len(log.time)), fixes)
    whole = len(rows) == len(log.time)
    first = known[0] if whole and known[1] == len(drawn) else 0
    thinned = None if whole else {"shown": len(rows), "ticks": len(log.time)}
    rows = rows[first:]
    return {
        "from": first,
        "time": column(log.time[rows], "s"),
        "signals": {name: column(signals[name][rows], units.get(name, "")) for name in sorted(drawn)},
        "thinned": thinned,
        "panels": panels,
        "tracks": tracks,
        "strips": strips,
        "felt": [f"command_module.{name}" if f"command_module.{name}" in drawn else None for name in FELT],
        "route": route_data(log),
        "bands": bands(log),
    }


def changes(states: Sequence[Array], rows: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """The rows, (rows,), in which any state is another than before."""
    marked = np.zeros(rows, dtype=np.bool_)
    for state in states:
        marked[1:] |= state[1:] != state[:-1]
    return marked


def signals_of(log: Log) -> dict[str, Array]:
    """The log's signals by name, with the fixes as they arrived, and the estimate's errors."""
    signals = {
        f"{channel.component}.{name}": log.values[channel.component][:, i]
        for channel in log.channels
        for i, name in enumerate(channel.names)
    }
    came = arrived(log.channels, log.metadata)
    if "gps_fix" in came:
        fixes = log[came["gps_fix"]] > 0
        for name in ("north", "east", "speed"):
            if f"gps_{name}" in came:
                signals[f"fix.{name}"] = np.where(fixes, log[came[f"gps_{name}"]], np.nan)
    for name in ("north", "east", "speed", "heading"):
        if f"estimator.{name}" in log and f"plant.{name}" in log:
            error = log[f"estimator.{name}"] - log[f"plant.{name}"]
            signals[f"error.{name}"] = error - TURN * np.round(error / TURN) if name == "heading" else error
    position = position_error(log)
    return signals if position is None else signals | {"error.position": position}


def units_of(log: Log) -> dict[str, str]:
    derived = {"position": "m", "north": "m", "east": "m", "speed": "m/s", "heading": "rad"}
    return log.units | {
        f"{group}.{name}": unit for group in ("fix", "error") for name, unit in derived.items()
    }


def _panels(log: Log, signals: Mapping[str, Array]) -> list[dict[str, Any]]:
    """The panels over time of what the log has."""

    def level(name: str, label: str, signs: tuple[int, ...] = (1,)) -> list[dict[str, Any]]:
        value = log.parameter(f"controller.{name}")
        if value is None:
            return []
        shown = f"{label} {math.degrees(value) if name.endswith('deviation') else value:.4g}"
        return [{"value": sign * value, "label": shown if sign > 0 else ""} for sign in signs]

    both = (1, -1)
    truth, estimate = ("truth", "truth"), ("estimate", "estimate")
    panels = [
        panel("distance to the target", "m", [Line("controller.distance", "distance", "truth")],
              levels=level("capture_radius", "reached"), include=[0]),
        panel("deviation from the target", "rad", [Line("controller.deviation", "h", "truth")],
              levels=level("moving_deviation", "h'", both) + level("stop_deviation", "h''", both),
              **ANGLES),
        panel("speed", "m/s", [Line("fix.speed", "GPS fix", "gps", points=True),
                               Line("estimator.speed", *estimate, width=1.2), Line("plant.speed", *truth)],
              levels=level("stopped_speed", "V'"), include=[0]),
        panel("heading", "rad", [Line("estimator.heading", *estimate, width=1.2),
                                 Line("plant.heading", *truth)], **ANGLES),
    ]  # fmt: skip
    panels += [
        panel(
            f"error of the estimate: {name}",
            unit,
            [Line(f"error.{name}", "error", "estimate", around=f"estimator.{name}_sd")],
            height=90,
            aroundZero=True,
            range=_error_range(signals, name, unit),
        )
        for name, unit in (("north", "m"), ("east", "m"), ("speed", "m/s"), ("heading", "rad"))
    ]
    kept = [present(one, signals) for one in panels]
    return [one for one in kept if one["series"]] or _panels_of_all(log)


def _panels_of_all(log: Log) -> list[dict[str, Any]]:
    """A panel for each signal, up to a number, of a log that has none of a trial's."""
    shown = islice(log.units.items(), MOST_PANELS)
    return [panel(name, unit, [Line(name, "", "truth")]) for name, unit in shown]


def _error_range(signals: Mapping[str, Array], name: str, unit: str) -> list[float] | None:
    """Room for the errors and for what is usual of 2 sigma: single sigmas of a running dog are far larger."""
    errors, sd = (np.abs(signals.get(key, np.empty(0))) for key in (f"error.{name}", f"estimator.{name}_sd"))
    errors, sd = errors[np.isfinite(errors)], sd[np.isfinite(sd)]
    widest = max(float(errors.max(initial=0.0)), float(np.median(2 * sd)) if len(sd) else 0.0)
    room = 1.1 * (math.degrees(widest) if unit == "rad" else widest)
    return [-room, room] if room else None


def panel(title: str, unit: str, lines: Sequence[Line], **more: Any) -> dict[str, Any]:
    """A panel as `plots.js` takes it."""
    return {"title": title, "unit": unit, "series": [asdict(line) for line in lines], **more}


def present(one: dict[str, Any], signals: Mapping[str, Array]) -> dict[str, Any]:
    """A panel with those of its lines that there are."""
    lines = [line for line in one["series"] if line["signal"] in signals]
    return one | {
        "series": [line | {"around": line["around"] if line["around"] in signals else None} for line in lines]
    }


def _tracks(signals: Mapping[str, Array]) -> list[dict[str, Any]]:
    """The lines on the map; the last one is the animal's, or what is known of it."""
    command = next((c for c in COMMANDS if c in signals), None)
    known = [
        (component, name)
        for component, name in (("fix", "GPS fix"), ("estimator", "estimate"), ("plant", "truth"))
        if f"{component}.north" in signals and f"{component}.east" in signals
    ]
    return [
        {
            "label": name,
            "class": "" if component == known[-1][0] else {"estimator": "estimate", "fix": "fix"}[component],
            "colour": {"estimator": "estimate", "fix": "gps"}.get(component, "truth"),
            "place": [f"{component}.north", f"{component}.east"],
            "heading": f"{component}.heading" if f"{component}.heading" in signals else None,
            "sd": _sd(component, signals),
            "command": command if component == known[-1][0] else None,
        }
        for component, name in known
    ]


def _sd(component: str, signals: Mapping[str, Array]) -> list[str] | None:
    names = [f"{component}.north_sd", f"{component}.east_sd"]
    return names if all(name in signals for name in names) else None


def _strips(signals: Mapping[str, Array]) -> list[dict[str, str]]:
    """The rows of blocks over time: the command, the operator's order, what the dog feels."""
    command = next((c for c in COMMANDS if c in signals), None)
    order = "controller.override" if signals.get("controller.override", np.zeros(1)).any() else None
    rows = [("command", command, "command", ""), ("order", order, "order", "")]
    rows += [("tone", f"command_module.{FELT[0]}", "tone", "")]
    rows += [
        ("vibration", f"command_module.{name}", "vibration", name.partition("_")[2]) for name in FELT[1:]
    ]
    return [
        {"name": name, "signal": signal, "kind": kind, "text": text}
        for name, signal, kind, text in rows
        if signal is not None and signal in signals
    ]


def route_data(log: Log) -> dict[str, Any] | None:
    """Waypoints, home, capture radius and fence for the map; streets' outlines and poles, if any."""
    route, ground = log.route, log.ground
    if route is None:
        return None
    *waypoints, home = [[north, east] for _, north, east in route.places]
    data = {"waypoints": waypoints, "home": home, "radius": route.radius, "fence": route.fence}
    return data if ground is None else data | {"streets": ground.outlines(), "poles": ground.poles}


def bands(log: Log) -> list[dict[str, Any]]:
    """What disturbed the trial, as bands over time."""
    return [
        {"from": start, "until": end, "kind": BANDS.get(kind, "fault"), "text": kind}
        for kind, spans in disturbances(log).items()
        for start, end in spans
    ]


def marks(happened: Sequence[Event]) -> list[dict[str, Any]]:
    """Waypoints that were reached, and the first tick of each anomaly."""
    return [{"time": event.time, "kind": event.mark, "text": event.text} for event in happened if event.mark]
