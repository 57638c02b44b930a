"""The animal's statistics from logged trials: Table 5.1 for a dog of one's own (5.2).

Read is what the model of the animal (models/canine.py) draws, as that model means it:

- It draws speed, acceleration, deceleration, drift and both turn rates once a trial. So a trial gives one
  value of each: the least-squares line that all its stretches share, each with an intercept of its own.
- Speed under one command is constant, then a line, then constant: a trapezoid's edge, found by least squares.
  After FORWARD from rest the line is the acceleration, after STOP the deceleration; what follows the line
  of FORWARD or RECALL is cruising.
- Drift turns the animal while it is told to run or still moves. Its rate is read under FORWARD; on RECALL the
  body turns home. In a turn, what drift adds while the animal still moves is subtracted.
- It draws a response for each LEFT or RIGHT issued. Obeyed is a command under which the heading changes at
  the threshold or faster, to either side: drawn turn rates may be negative, and then the dog does turn, the
  wrong way. What turns slower is counted as not obeyed.
"""

from __future__ import annotations

import io
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from scipy import stats
from scipy.optimize import brentq

from harness.attitude import TICK_S
from harness.log import Array, Log, LogError, read_log
from harness.plots import BELOW, DPI, ESTIMATES, GRID, TRUTH
from harness.scenario import is_angular
from harness.summary import write_whole
from models.canine import Canine
from models.commands import Command
from models.errors import CanineError, UsageError
from models.kit.units import DEG

FOLDER = Path("out/fit")
CONFIDENCE = 0.95
MOVING_M_S = 1.0  # under way
AT_REST_M_S = 0.5  # slower, a start is from rest
CRUISE_S = 1.0  # least time at a steady speed, and of a run for its drift
EDGE_S = 30.0  # within which speeding up or slowing down is looked for
COUNTED = 3  # responses to a side by trial: a dog too slow to tell is asked on and on, and would outweigh all
REDRAWN = ("cruise_speed", "speeding_up", "slowing_down")  # which the model draws again below
FLOOR = 0.2  # of their means
DISTURBING = 0.01  # share of turns under the threshold, from which on a note is due


class FitError(UsageError):
    """Logs that hold nothing to estimate from."""


@dataclass(frozen=True)
class Source:
    """Whose motion is read, and how finely it can tell.

    Attributes:
        component: of the log.
        rest: m/s, speed up to which it stands still.
        moving: m/s, speed below which neither braking nor a run tells anything.
        shortest: s, least time of a turn; one tick where that is longer.
        turned: rad/s, turn rate from which on a command counts as obeyed.
    """

    component: str
    rest: float
    moving: float
    shortest: float
    turned: float


SOURCES = {
    # the truth is exact, and a dog that does not obey does not turn at all
    "plant": Source("plant", 1e-6, 1.0, 0.0, 0.1 * DEG),
    # V' of Table 4.2; braking from less passes between fixes; 5 deg/s for the 3 s of DELTHRESH2 are 15 deg,
    # the least turn asked for (from h'' = 20 deg to 5): a slower dog has not done it in time anyway
    "estimator": Source("estimator", 0.3, 2.0, 0.2, 5 * DEG),
}


@dataclass(frozen=True)
class Statistic:
    """One that a trial has a value of; `key` names the canine's parameter, beside `<key>_deviation`.

    Attributes:
        needs: what must be commanded for it.
        published: mean, standard deviation and n of Table 5.1.
    """

    key: str
    label: str
    needs: str
    published: tuple[float, float, int] | None = None

    @property
    def unit(self) -> str:
        """As it is shown: angles in degrees."""
        return Canine.variables()[self.key].unit.replace("rad", "deg")

    @property
    def scale(self) -> float:
        """What a value in SI is multiplied by to be shown."""
        return 1 / DEG if is_angular(Canine.variables()[self.key]) else 1.0


STATISTICS = (  # published: Table 5.1; the deceleration's sign is left out, as the model has it
    Statistic("cruise_speed", "velocity", "FORWARD or RECALL", (4.86, 1.49, 66)),
    Statistic("speeding_up", "acceleration", "FORWARD", (1.78, 0.67, 73)),
    Statistic("slowing_down", "deceleration", "STOP of a moving animal", (2.72, 1.31, 40)),
    Statistic("right_turn_rate", "right turn", "RIGHT", (57.92, 37.66, 26)),
    Statistic("left_turn_rate", "left turn", "LEFT", (-77.67, 41.13, 26)),
    Statistic("drift", "heading drift", "FORWARD", (2.62, 1.62, 35)),
    Statistic("start_heading", "start heading", "command"),
)
RATES = {"left_success": (0.64, 45), "right_success": (0.60, 35)}  # Table 5.1: rate, n
TURNS = {
    Command.LEFT: ("left_turn_rate", "left_success"),
    Command.RIGHT: ("right_turn_rate", "right_success"),
}


@dataclass(frozen=True, eq=False)
class Track:
    """One trial as it is read; arrays are (ticks,), SI.

    Attributes:
        command: in force from its tick to the next.
        heading: clockwise from north, wrapped or not.
        usable: the motion is known on the tick.
        fresh: the speed is taken from the tick.
        aim: bearing of the first waypoint from the start, None if it is not known.
        seed: of the plant, None if it has none.
    """

    name: str
    time: Array
    command: Array
    speed: Array
    heading: Array
    usable: npt.NDArray[np.bool_]
    fresh: npt.NDArray[np.bool_]
    aim: float | None = None
    seed: float | None = None

    @property
    def step(self) -> float:
        """Sample time [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def held(self) -> Array:
        """Speed as it was last taken, (ticks,); before that, zero."""
        latest = np.maximum.accumulate(np.where(self.fresh, np.arange(len(self.speed)), -1))
        return np.where(latest >= 0, self.speed[latest], 0.0)


@dataclass
class Trial:
    """What a trial tells.

    Attributes:
        values: by the statistic's key, SI.
        responses: by the success rate's name, whether each command issued was obeyed.
        left_out: how many stretches could not be used, by the statistic's key and why.
    """

    name: str
    values: dict[str, float] = field(default_factory=dict)
    responses: dict[str, list[bool]] = field(default_factory=lambda: {name: [] for name in RATES})
    left_out: Counter[tuple[str, str]] = field(default_factory=Counter)


def stretches(command: Array) -> list[tuple[int, int, int]]:
    """Command, first row and last row of each stretch of one command.

    The last row is the first of the next command: what an animal is told shows a tick later.
    """
    starts = [0, *(np.flatnonzero(np.diff(command)) + 1).tolist()]
    ends = [*starts[1:], len(command) - 1]
    return [(int(command[first]), first, last) for first, last in zip(starts, ends, strict=True)]


def slope(lines: Sequence[tuple[Array, Array]]) -> float:
    """Least-squares slope that lines (abscissae, ordinates) share, each with an intercept of its own."""
    products = [((t - t.mean()) @ (y - y.mean()), (t - t.mean()) @ (t - t.mean())) for t, y in lines]
    return float(sum(xy for xy, _ in products) / sum(xx for _, xx in products))


def edge(x: Array, y: Array, least: int, most: int) -> tuple[int, int]:
    """First and last row of the line in what is constant, then a line, then constant, by least squares.

    Args:
        x, y: (n,), n > least.
        least: intervals that the line has at the least.
        most: row by which it ends at the latest, if y is that long.
    """
    n, x, y = len(y), x - x.mean(), y - y.mean()  # or the sums of squares would lose digits
    one, sx, sy, sxx, sxy, syy = (
        np.concatenate([[0.0], np.cumsum(p)]) for p in (np.ones(n), x, y, x * x, x * y, y * y)
    )

    def flat(count: Any, total: Any, square: Any) -> Any:  # arrays, or numbers and arrays
        return square - total**2 / np.maximum(count, 1)

    end = min(n, max(most, least) + 1)
    first, stop = np.arange(end - least)[:, None], np.arange(least + 1, end + 1)[None, :]
    count, x1, y1, x2, xy, y2 = (s[stop] - s[first] for s in (one, sx, sy, sxx, sxy, syy))
    with np.errstate(divide="ignore", invalid="ignore"):  # of one row and less, which are masked below
        line = y2 - y1**2 / count - (xy - x1 * y1 / count) ** 2 / (x2 - x1**2 / count)
    before = flat(first, sy[first], syy[first])
    after = flat(n - stop, sy[n] - sy[stop], syy[n] - syy[stop])
    error = np.where(stop - first > least, before + line + after, np.inf)
    i, j = np.unravel_index(int(np.argmin(error)), error.shape)
    return int(first[i, 0]), int(stop[0, j]) - 1


def measure(track: Track, source: Source) -> Trial:
    """What a trial tells about its animal."""
    trial = Trial(track.name)
    known = []
    for command, first, last in stretches(track.command):
        if command in set(Command) and command != Command.NONE and last > first:
            if track.usable[first : last + 1].all():
                thin = min(last - first, max(1, round(TICK_S / track.step)))  # the edges' cost grows as n^2
                known.append((Command(command), slice(first, last + 1, thin)))
            else:
                for key in _told_by(Command(command)):
                    trial.left_out[key, "the motion is not known throughout"] += 1
    _speed(track, known, source, trial)
    _drift(track, known, trial)
    _turn(track, known, source, trial)
    begun = np.flatnonzero((track.command != Command.NONE) & track.usable)
    if track.aim is None:
        trial.left_out["start_heading", "the log has no waypoint"] += 1
    elif len(begun):
        trial.values["start_heading"] = math.remainder(
            float(track.heading[begun[0]]) - track.aim, 2 * math.pi
        )
    return trial


def _told_by(command: Command) -> tuple[str, ...]:
    """What a stretch of a command would have told."""
    return {
        Command.FORWARD: ("cruise_speed", "speeding_up", "drift"),
        Command.RECALL: ("cruise_speed",),
        Command.STOP: ("slowing_down",),
    }.get(command) or TURNS[command][:1]


def _speed(track: Track, known: Sequence[tuple[Command, slice]], source: Source, trial: Trial) -> None:
    """Cruise speed, acceleration and deceleration."""
    lines: dict[str, list[tuple[Array, Array]]] = {"speeding_up": [], "slowing_down": []}
    steady = []
    for command, rows in known:
        running = command in (Command.FORWARD, Command.RECALL)
        fresh = track.fresh[rows]
        time, speed = track.time[rows][fresh], track.speed[rows][fresh]
        if len(speed) < 2 or not (running or (command == Command.STOP and speed[0] > AT_REST_M_S)):
            continue  # nothing to see, or to brake
        if not running and speed[0] < source.moving:
            trial.left_out["slowing_down", f"from less than {source.moving:g} m/s"] += 1
            continue
        step = float(np.median(np.diff(time)))
        begin, end = edge(time, speed, 1, round(EDGE_S / step))
        line = time[begin : end + 1], speed[begin : end + 1]
        if not running:
            lines["slowing_down"].append(line)
            continue
        steadily = speed[end:].mean()
        if steadily < MOVING_M_S:
            trial.left_out["cruise_speed", f"came to less than {MOVING_M_S:g} m/s"] += 1
        elif time[-1] - time[end] > CRUISE_S - 1e-9:
            steady.append(speed[end + 1 :])
        else:
            trial.left_out["cruise_speed", ENDED_EARLY] += 1
        if command == Command.RECALL:
            continue
        if speed[0] < AT_REST_M_S and steadily >= source.moving:
            lines["speeding_up"].append(line)
        else:
            why = "not from rest" if speed[0] >= AT_REST_M_S else f"came to less than {source.moving:g} m/s"
            trial.left_out["speeding_up", why] += 1
    if steady:
        trial.values["cruise_speed"] = float(np.concatenate(steady).mean())
    for key, sign in (("speeding_up", 1), ("slowing_down", -1)):
        if lines[key]:
            trial.values[key] = sign * slope(lines[key])


ENDED_EARLY = f"ended before {CRUISE_S:g} s of steady speed"


def _drift(track: Track, known: Sequence[tuple[Command, slice]], trial: Trial) -> None:
    """Rate of the heading while told FORWARD and under way."""
    lines = []
    for command, rows in known:
        if command != Command.FORWARD:
            continue
        time, heading = track.time[rows], np.unwrap(track.heading[rows])
        moving = np.flatnonzero(track.held[rows] > MOVING_M_S)
        if len(moving) and time[-1] - time[moving[0]] > CRUISE_S - 1e-9:
            lines.append((time[moving[0] :], heading[moving[0] :]))
        else:
            trial.left_out["drift", f"under way for less than {CRUISE_S:g} s"] += 1
    if lines:
        trial.values["drift"] = slope(lines)


def _turn(track: Track, known: Sequence[tuple[Command, slice]], source: Source, trial: Trial) -> None:
    """Responses to LEFT and RIGHT, and the turn rates of those obeyed; drift is known already if it is."""
    lines: dict[str, list[tuple[Array, Array]]] = {key: [] for key, _ in TURNS.values()}
    drift = trial.values.get("drift", 0.0)
    for command, rows in known:
        if command not in TURNS:
            continue
        key, rate = TURNS[command]
        time = track.time[rows]
        step = time[1] - time[0]
        least = max(1, math.ceil(source.shortest / step - 1e-9))
        if len(time) <= least:
            trial.left_out[key, "too short"] += 1
            continue
        moving = track.held[rows][:-1] > source.rest
        drifted = drift * np.concatenate([[0.0], np.cumsum(np.diff(time) * moving)])
        heading = np.unwrap(track.heading[rows]) - drifted
        obeyed = abs(slope([(time, heading)])) >= source.turned
        if len(trial.responses[rate]) < COUNTED:
            trial.responses[rate].append(obeyed)
        else:
            trial.left_out[rate, f"after the first {COUNTED} of a trial"] += 1
        if obeyed:
            begin, end = edge(time, heading, least, round(EDGE_S / step))
            lines[key].append((time[begin : end + 1], heading[begin : end + 1]))
    for key, found in lines.items():
        if found:
            trial.values[key] = slope(found)


def interval_of_mean(values: Array) -> tuple[float, float] | None:
    """Confidence interval of the mean of a normal variable (Student's t), from two values on."""
    if len(values) < 2:
        return None
    half = stats.t.ppf(0.5 + CONFIDENCE / 2, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values))
    return float(values.mean() - half), float(values.mean() + half)


def interval_of_deviation(values: Array) -> tuple[float, float] | None:
    """Confidence interval of the standard deviation of a normal variable (chi-square), from two values on."""
    if len(values) < 2:
        return None
    low, high = stats.chi2.ppf((0.5 + CONFIDENCE / 2, 0.5 - CONFIDENCE / 2), len(values) - 1)
    squares = (len(values) - 1) * values.var(ddof=1)
    return math.sqrt(squares / low), math.sqrt(squares / high)


def before_redrawing(mean: float, deviation: float) -> tuple[float, float] | None:
    """The model's parameters that give a mean and a standard deviation after its redrawing below FLOOR.

    Found is the normal distribution that, cut off below FLOOR of its mean, has these moments; None where
    there is none: cut off so, the deviation stays under 3/4 of the mean.
    """

    def moments(spread: float) -> tuple[float, float]:  # of the mean 1
        cut = (FLOOR - 1) / spread
        hazard = stats.norm.pdf(cut) / stats.norm.sf(cut)
        return 1 + spread * hazard, spread * math.sqrt(1 + cut * hazard - hazard**2)

    def excess(spread: float) -> float:
        cut_mean, cut_deviation = moments(spread)
        return cut_deviation / cut_mean - deviation / mean

    if mean <= 0 or excess(WIDEST) < 0:
        return None
    if excess(NARROWEST) > 0:
        return mean, deviation
    spread = float(brentq(excess, NARROWEST, WIDEST))
    full = mean / moments(spread)[0]
    return full, spread * full


NARROWEST, WIDEST = 0.05, 10.0  # deviations, as shares of the mean, between which redrawing is undone


def pool(trials: Sequence[Trial], turned: float) -> dict[str, Any]:
    """The statistics of all trials, angles in degrees: what fit.json holds.

    Args:
        turned: rad/s, turn rate from which on a command counted as obeyed.

    Raises:
        FitError: there is not one value and no response.
    """
    found: dict[str, Any] = {}
    for statistic in STATISTICS:
        values = np.array([t.values[statistic.key] for t in trials if statistic.key in t.values])
        values = values * statistic.scale
        found[statistic.key] = {
            "label": statistic.label,
            "unit": statistic.unit,
            "n": len(values),
            "mean": float(values.mean()) if len(values) else None,
            "mean_interval": interval_of_mean(values),
            "sd": float(values.std(ddof=1)) if len(values) > 1 else None,
            "sd_interval": interval_of_deviation(values),
            "left_out": _left_out(trials, statistic.key),
            "published": statistic.published
            and dict(zip(("mean", "sd", "n"), statistic.published, strict=True)),
        }
    rates: dict[str, Any] = {}
    for name, (rate, issued) in RATES.items():
        responses = [obeyed for trial in trials for obeyed in trial.responses[name]]
        test = stats.binomtest(sum(responses), len(responses)) if responses else None
        rates[name] = {
            "label": f"{name.replace('_', ' ')} rate",
            "n": len(responses),
            "obeyed": sum(responses),
            "rate": sum(responses) / len(responses) if responses else None,
            "interval": test and [float(p) for p in test.proportion_ci(CONFIDENCE, method="wilson")],
            "left_out": _left_out(trials, name),
            "published": {"rate": rate, "n": issued},
        }
    if not any(row["n"] for row in (*found.values(), *rates.values())):
        why = (f"{s.label}: {_why(found[s.key]['left_out']) or f'no {s.needs}'}" for s in STATISTICS)
        raise FitError(f"no trial holds a stretch to estimate from ({'; '.join(why)}); give longer trials")
    return {
        "confidence": CONFIDENCE,
        "turned_deg_s": turned / DEG,
        "statistics": found,
        "responses": rates,
        "notes": list(_cautions(trials, found, turned)),
        "parameters": _parameters(found, rates),
        "trials": [
            {
                "log": trial.name,
                **{s.key: trial.values[s.key] * s.scale for s in STATISTICS if s.key in trial.values},
                **trial.responses,
            }
            for trial in trials
        ],
    }


def _left_out(trials: Sequence[Trial], key: str) -> dict[str, int]:
    """Why, and how many stretches."""
    count: Counter[str] = Counter()
    for trial in trials:
        count.update({why: n for (of, why), n in trial.left_out.items() if of == key})
    return dict(count)


def _why(left_out: Mapping[str, int]) -> str:
    return ", ".join(f"{why} ({n})" for why, n in left_out.items())


def _cautions(trials: Sequence[Trial], found: Mapping[str, Any], turned: float) -> Iterable[str]:
    """What the figures are biased by, as far as they tell themselves."""
    cut = sum("cruise_speed" not in t.values and t.left_out["cruise_speed", ENDED_EARLY] > 0 for t in trials)
    if cut:
        yield (
            f"velocity: {cut} of {len(trials)} trials never had {CRUISE_S:g} s of steady speed; those are of "
            "fast dogs and slow starters, so that the mean is low; give longer legs"
        )
    for key, _ in TURNS.values():
        row = found[key]
        if row["sd"]:
            below, upto = stats.norm.cdf((-turned / DEG, turned / DEG), row["mean"], row["sd"])
            hidden = upto - below
            if hidden > DISTURBING:
                yield (
                    f"{row['label']}: by its distribution {100 * hidden:.1f} % of the turns are slower than "
                    f"{turned / DEG:g} deg/s and count as not obeyed: the success rate is too low by about "
                    "that share of it, and the turn rate lacks them"
                )
    for key in REDRAWN:
        row = found[key]
        if row["sd"] and before_redrawing(row["mean"], row["sd"]) is None:
            yield (
                f"{row['label']}: spread too widely for the model, which draws again below {FLOOR:g} of the "
                "mean; simulated, the mean is higher and the deviation less"
            )


def _parameters(found: Mapping[str, Any], rates: Mapping[str, Any]) -> dict[str, float]:
    """The canine's parameters, angles in degrees, as a scenario states them."""
    parameters = {}
    for key, row in found.items():
        if row["mean"] is None or key == "start_heading":
            continue
        mean, deviation = row["mean"], row["sd"]
        if key in REDRAWN and deviation is not None:
            mean, deviation = before_redrawing(mean, deviation) or (mean, deviation)
        parameters[f"canine.{key}"] = mean
        if deviation is not None:
            parameters[f"canine.{key}_deviation"] = deviation
    for name, row in rates.items():
        if row["rate"] is not None:
            parameters[f"canine.{name}"] = row["rate"]
    return {name: _rounded(value) for name, value in parameters.items()}


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")


def read_track(log: Log, source: Source) -> Track:
    """A trial as a source of the log has it.

    Raises:
        FitError: the log lacks the command or the motion, or holds one tick.
    """
    told = ("plant", "controller") if source.component == "plant" else ("controller", "plant")
    commands = [f"{name}.command" for name in told if f"{name}.command" in log]
    motion = [f"{source.component}.{name}" for name in ("speed", "heading")]
    missing = [signal for signal in motion if signal not in log]
    if not commands or missing:
        lacks = missing[0] if commands else "controller.command"
        raise FitError(
            f'{log.path}: the log has no signal "{lacks}"; expected the log of a guided trial, such as '
            f"`canine run` writes, with the motion of {' or '.join(SOURCES)}"
        )
    if len(log.time) < 2:
        raise FitError(f"{log.path}: holds one tick; expected a trial")
    speed, heading = (log[signal] for signal in motion)
    usable = np.isfinite(speed) & np.isfinite(heading)
    if f"{source.component}.valid" in log:
        usable &= log[f"{source.component}.valid"] > 0
    fresh = np.ones(len(speed), dtype=bool)
    if f"{source.component}.gps_fix" in log:  # between fixes the speed swings with the pack (B.4)
        fresh = log[f"{source.component}.gps_fix"] > 0
    aim = None
    if log.route:
        (_, first_north, first_east), (_, north, east) = log.route.places[0], log.route.places[-1]
        aim = math.atan2(first_east - east, first_north - north)  # from home, where a trial starts
    name = f"{log.path.resolve().parent.name}/{log.path.name}"
    return Track(
        name, log.time, log[commands[0]], speed, heading, usable, fresh, aim, log.parameter("plant.seed")
    )


def find_logs(given: Sequence[Path]) -> list[Path]:
    """The logs themselves, and those in folders and folders of these, each once.

    Raises:
        FitError: one of them is not there, or a folder holds no log.
    """
    found: dict[Path, Path] = {}
    for path in given:
        if not path.exists():
            raise FitError(f'there is no log "{path}"; expected a trial.mcap, or a folder that holds some')
        logs = sorted(path.rglob("*.mcap")) if path.is_dir() else [path]
        if not logs:
            raise FitError(f"{path}: the folder holds no .mcap; expected logs of trials")
        found |= {log.resolve(): log for log in logs}
    return list(found.values())


@dataclass(frozen=True)
class Reading:
    """Trials that were read: each with what it was read from; what could not be read whole is noted."""

    tracks: Sequence[tuple[Track, Source]]
    notes: Sequence[str]


def read_tracks(
    paths: Sequence[Path], component: str | None = None, progress: Callable[[int], None] | None = None
) -> Reading:
    """Read logs: of the truth where they have it, else of the estimate, or of the component that is named.

    Raises:
        LogError, FitError: none of them can be read.
    """
    tracks: list[tuple[Track, Source]] = []
    notes: list[str] = []
    content: dict[bytes, Path] = {}
    failures: list[CanineError] = []
    for number, path in enumerate(paths, start=1):
        if progress:
            progress(number)
        try:
            digest = sha256(path.read_bytes()).digest()
            if digest in content:
                notes.append(f"{path}: the same log as {content[digest]}; counted once")
                continue
            log = read_log(path)
            name = component or ("plant" if "plant.speed" in log else "estimator")
            tracks.append((read_track(log, SOURCES[name]), SOURCES[name]))
            content[digest] = path
            if log.broken:
                notes.append(f"{path}: the log is not whole, {log.broken}")
        except (LogError, FitError) as failure:
            failures.append(failure)
    if not tracks:
        raise failures[0]
    notes += [f"{failure}; left out" for failure in failures]
    return Reading(tracks, [*notes, *_mixed(tracks)])


def _mixed(tracks: Sequence[tuple[Track, Source]]) -> Iterable[str]:
    """What the trials do not have in common, or should not."""
    sources = Counter(source.component for _, source in tracks)
    if len(sources) > 1:
        counts = ", ".join(f"{name} of {n}" for name, n in sources.items())
        yield f"the motion is read from {counts} logs: the estimate is less exact; --source takes one of them"
    steps = Counter(f"{track.step:.4g}" for track, _ in tracks)
    if len(steps) > 1:
        counts = ", ".join(f"{step} s in {n}" for step, n in steps.items())
        yield f"the logs have different sample times: {counts}; each is read with its own"
    seeds = Counter(track.seed for track, _ in tracks if track.seed is not None)
    again = sum(n - 1 for n in seeds.values())
    if again:
        yield (
            f"{again} of the simulated logs have the seed of another, and so the same draws: they are no "
            "trials of their own, and the intervals are too narrow; give each its own seed"
        )


def estimate(reading: Reading, turned: float | None = None) -> dict[str, Any]:
    """What fit.json holds.

    Args:
        turned: rad/s, turn rate from which on a command counts as obeyed; the sources' own by default.

    Raises:
        FitError: there is nothing to estimate from.
    """
    used = [
        (track, source if turned is None else replace(source, turned=turned))
        for track, source in reading.tracks
    ]
    result = pool([measure(*each) for each in used], max(source.turned for _, source in used))
    result["notes"] = [*reading.notes, *result["notes"]]
    result["sources"] = sorted({source.component for _, source in used})
    return result


def fragment(result: Mapping[str, Any]) -> str:
    """The parameters as the end of a scenario's file: fit.toml."""
    lines = [
        f"# The animal of {_trials(result)}, by `canine fit`: fit.json says how sure it is.",
        "# Append it to a scenario without [parameters], or copy its lines into these. Angles in degrees.",
        "",
        "[parameters]",
        *(f'"{name}" = {value!r}' for name, value in result["parameters"].items()),
    ]
    rows = {**result["statistics"], **result["responses"]}
    for key, row in rows.items():
        if row["n"] == 0:
            lines.append(f"# nothing to tell canine.{key} by: it stays as the model has it")
        elif row["n"] == 1 and key in result["statistics"]:
            lines.append(f"# one value does not tell canine.{key}_deviation: it stays as the model has it")
    start = result["statistics"]["start_heading"]
    if start["sd"] is not None:
        lines += [
            f"# The handler's: the start was {start['mean']:.3g} deg off the first waypoint on average.",
            f'# "canine.start_heading_deviation" = {_rounded(start["sd"])!r}',
        ]
    return "\n".join(lines) + "\n"


def report(result: Mapping[str, Any], out: Path) -> None:
    """Write fit.json, fit.toml and fit.png.

    Raises:
        LogError: they cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "fit.json", (json.dumps(result, indent=2) + "\n").encode())
    write_whole(out / "fit.toml", fragment(result).encode())
    buffer = io.BytesIO()
    figure(result).savefig(buffer, format="png")
    write_whole(out / "fit.png", buffer.getvalue())


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the statistics beside Table 5.1, and what was left out."""
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="bold")
    table.add_column(f"{_trials(result)} ({', '.join(result['sources'])})")
    for heading in ("n", "mean ± sd", "mean, 95 %", "sd, 95 %", "Table 5.1", "n"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in result["statistics"].values():
        known = row["published"]
        spread = "" if row["sd"] is None else f" ± {_number(row['sd'])}"
        table.add_row(
            escape(f"{row['label']} [{row['unit']}]"),
            str(row["n"]),
            _number(row["mean"]) + spread,
            _range(row["mean_interval"]),
            _range(row["sd_interval"]),
            *((f"{known['mean']:g} ± {known['sd']:g}", str(known["n"])) if known else ()),
        )
    for row in result["responses"].values():
        known = (f"{row['published']['rate']:g}", str(row["published"]["n"]))
        rate, interval = _number(row["rate"]), _range(row["interval"])
        table.add_row(row["label"], str(row["n"]), rate, interval, "", *known)
    console.print(table)
    for row in (*result["statistics"].values(), *result["responses"].values()):
        if row["left_out"]:
            why = _why(row["left_out"])
            console.print(f"left out, {row['label']}: {why}", style="dim", markup=False, soft_wrap=True)
    for note in result["notes"]:
        console.print(f"note: {note}", style="dim", markup=False, soft_wrap=True)


def _trials(result: Mapping[str, Any]) -> str:
    count = len(result["trials"])
    return "1 trial" if count == 1 else f"{count} trials"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.{1 if abs(value) >= 10 else 2}f}"


def _range(interval: Sequence[float] | None) -> str:
    return "-" if interval is None else f"{_number(interval[0])}..{_number(interval[1])}"


def figure(result: Mapping[str, Any]) -> Figure:
    """Each statistic's values over the trials, with the normal distribution fitted and that of Table 5.1."""
    drawn = Figure(figsize=(14, 6.6), dpi=DPI, layout="constrained")
    *panels, last = drawn.subplots(2, 4).flat
    for axes, (key, row) in zip(panels, result["statistics"].items(), strict=True):
        values = np.array([trial[key] for trial in result["trials"] if key in trial])
        _draw_statistic(axes, row, values)
    _draw_responses(last, result["responses"].values())
    for axes in (*panels, last):
        axes.set_axisbelow(True)
        axes.grid(**GRID)
    known: dict[str, Any] = {}
    for axes in (*panels, last):
        known |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    drawn.legend(known.values(), known.keys(), loc="outside lower center", ncols=len(known), **BELOW)
    drawn.suptitle(f"The animal of {_trials(result)}", fontsize=13)
    return drawn


def _draw_statistic(axes: Axes, row: Mapping[str, Any], values: Array) -> None:
    """Histogram as a density; without spread there is one bar and no curve."""
    axes.set_xlabel(f"{row['label']} [{row['unit']}]")
    axes.set_title(f"n = {row['n']}", fontsize=10)
    axes.set_yticks([])
    if not len(values):
        return
    spread = row["sd"] is not None and row["sd"] > 1e-6 * (1 + abs(row["mean"]))
    published = row["published"]
    if not spread:
        width = 0.1 * (1 + abs(row["mean"]))
        axes.bar(row["mean"], 1, width / 10, color=ESTIMATES[0], alpha=0.45, label="trials")
        axes.set_xlim(row["mean"] - width, row["mean"] + width)
        return
    axes.hist(values, bins="auto", density=True, color=ESTIMATES[0], alpha=0.45, label="trials")
    low, high = values.min(), values.max()
    x = np.linspace(low - 0.15 * (high - low), high + 0.15 * (high - low), 200)
    axes.plot(
        x, stats.norm.pdf(x, row["mean"], row["sd"]), color=TRUTH, linewidth=1.6, label="normal, fitted"
    )
    if published:
        y = stats.norm.pdf(x, published["mean"], published["sd"])
        axes.plot(x, y, color=ESTIMATES[1], linewidth=1.4, linestyle="--", label="Table 5.1")


def _draw_responses(axes: Axes, rates: Iterable[Mapping[str, Any]]) -> None:
    """Success rates with their intervals."""
    for place, row in enumerate(rates):
        axes.plot([place], [row["published"]["rate"]], "D", color=ESTIMATES[1], zorder=3)
        axes.annotate(f"n = {row['n']}", (place, 0.02), ha="center", fontsize=9)
        if row["rate"] is not None:
            low, high = row["interval"]
            axes.bar(place, row["rate"], 0.6, color=ESTIMATES[0], alpha=0.45, label="trials")
            error = [[row["rate"] - low], [high - row["rate"]]]
            axes.errorbar(place, row["rate"], yerr=error, color=TRUTH, capsize=5, label="95 %")
    axes.set_xticks([0, 1], ["left", "right"])
    axes.set_xlim(-0.6, 1.6)
    axes.set_ylim(0, 1)
    axes.set_xlabel("success rate")
