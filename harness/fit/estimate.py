"""Estimates an animal's statistics from logged trials: Table 5.1 for any dog (5.2).

Each trial gives one value of every quantity that the animal's model draws once a trial (tracks.py). Here the
trials are read from logs and their values pooled, with confidence intervals.
"""

import math
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from harness.fit.day import Days, estimate_day, within_range
from harness.fit.tracks import (
    CRUISE_S,
    ENDED_EARLY,
    MOTION_SOURCES,
    RATES,
    STATISTICS,
    TURNS,
    MotionSource,
    Track,
    Trial,
    measure,
)
from harness.log.channel import Array
from harness.log.log import Log, LogError, read_log
from harness.trial.parameters import MISSION
from models.commands import Status
from models.errors import CanineError, UsageError
from models.kit.units import DEG

CONFIDENCE = 0.95
REDRAWN = ("cruise_speed", "speeding_up", "slowing_down")  # the model draws these again if they are below
FLOOR = 0.2  # of their means
NARROWEST, WIDEST = 0.05, 10.0  # deviations, as shares of the mean, between which redrawing is undone
ROUND_OFF = 1e-9  # share of the mean (or SI value) below which a deviation is rounding, not the animal's
OF_A_TRIAL = (  # parameters that are not the animal's
    "seed", "start_north", "start_east", "start_heading", "start_fatigue", "start_habituation",
)  # fmt: skip
NAMED = 3  # logs that a note names one by one at most
DISTURBING = 0.01  # share of turns slower than the threshold from which on a note says so


class FitError(UsageError):
    """A log cannot be read, or the logs hold nothing to estimate from."""


def interval_of_mean(values: Array) -> tuple[float, float] | None:
    """Confidence interval of the mean of a normal variable (Student's t); None for fewer than two values."""
    if len(values) < 2:
        return None
    half = stats.t.ppf(0.5 + CONFIDENCE / 2, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values))
    return float(values.mean() - half), float(values.mean() + half)


def interval_of_deviation(values: Array) -> tuple[float, float] | None:
    """Confidence interval of a normal variable's deviation (chi-square); None for fewer than two values."""
    if len(values) < 2:
        return None
    low, high = stats.chi2.ppf((0.5 + CONFIDENCE / 2, 0.5 - CONFIDENCE / 2), len(values) - 1)
    squares = (len(values) - 1) * values.var(ddof=1)
    return math.sqrt(squares / low), math.sqrt(squares / high)


def before_redrawing(mean: float, deviation: float) -> tuple[float, float] | None:
    """The model's mean and deviation that give these after redrawing values below FLOOR of the mean.

    They are those of the normal distribution that has the given moments once it is truncated below FLOOR of
    its mean. None if there is no such distribution: truncated, the deviation stays below 3/4 of the mean.
    """

    def moments(spread: float) -> tuple[float, float]:  # after truncation, of a distribution with mean 1
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


def pool(trials: Sequence[Trial], turned: float) -> dict[str, Any]:
    """The statistics over all trials, angles in degrees, as in fit.json.

    Args:
        turned: rad/s, turn rate from which on a command counted as obeyed.

    Raises:
        FitError: the trials have neither a value nor a response.
    """
    rows: dict[str, Any] = {}
    for statistic in STATISTICS:
        values = np.array([t.values[statistic.key] for t in trials if statistic.key in t.values])
        values = values * statistic.scale
        rows[statistic.key] = {
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
    if not any(row["n"] for row in (*rows.values(), *rates.values())):
        why = (f"{s.label}: {reasons(rows[s.key]['left_out']) or f'no {s.needs}'}" for s in STATISTICS)
        raise FitError(f"no trial has a stretch to estimate from ({'; '.join(why)}); give longer trials")
    parameters, beyond = within_range(_parameters(rows, rates))
    return {
        "confidence": CONFIDENCE,
        "turned_deg_s": turned / DEG,
        "statistics": rows,
        "responses": rates,
        "notes": [*_cautions(trials, rows, turned), *beyond],
        "parameters": parameters,
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
    """Number of stretches that a statistic could not use, by reason."""
    count: Counter[str] = Counter()
    for trial in trials:
        count.update({reason: n for (name, reason), n in trial.left_out.items() if name == key})
    return dict(count)


def reasons(left_out: Mapping[str, int]) -> str:
    """The reasons in words, each with its number of stretches."""
    return ", ".join(f"{reason} ({n})" for reason, n in left_out.items())


def _cautions(trials: Sequence[Trial], rows: Mapping[str, Any], turned: float) -> Iterable[str]:
    """Notes on the biases that the values themselves reveal."""
    cut = sum("cruise_speed" not in t.values and t.left_out["cruise_speed", ENDED_EARLY] > 0 for t in trials)
    if cut:
        yield (
            f"velocity: {cut} of {len(trials)} trials never had {CRUISE_S:g} s of steady speed; their dogs "
            "are fast or start slowly, so the mean is too low; give longer legs"
        )
    for key, _ in TURNS.values():
        row = rows[key]
        if row["sd"]:
            below, upto = stats.norm.cdf((-turned / DEG, turned / DEG), row["mean"], row["sd"])
            hidden = upto - below
            if hidden > DISTURBING:
                yield (
                    f"{row['label']}: by its distribution {100 * hidden:.1f} % of the turns are slower than "
                    f"{turned / DEG:g} deg/s and count as not obeyed: the success rate is too low by about "
                    "that share of itself, and the turn rate lacks these turns"
                )
    for key in REDRAWN:
        row = rows[key]
        if row["sd"] and before_redrawing(row["mean"], row["sd"]) is None:
            yield (
                f"{row['label']}: spread too widely for the model, which draws values below {FLOOR:g} of the "
                "mean again; simulated, the mean is higher and the deviation lower"
            )


def _parameters(rows: Mapping[str, Any], rates: Mapping[str, Any]) -> dict[str, float]:
    """The canine's parameters, angles in degrees, as a scenario states them."""
    parameters = {}
    for key, row in rows.items():
        if row["mean"] is None or key == "start_heading":
            continue
        mean, deviation = row["mean"], row["sd"]
        if key in REDRAWN and deviation is not None:
            mean, deviation = before_redrawing(mean, deviation) or (mean, deviation)
        parameters[f"canine.{key}"] = settled(mean)
        if deviation is not None:
            parameters[f"canine.{key}_deviation"] = settled(deviation, mean)
    for name, row in rates.items():
        if row["rate"] is not None:
            parameters[f"canine.{name}"] = row["rate"]
    return {name: rounded(value) for name, value in parameters.items()}


def rounded(value: float) -> float:
    return float(f"{value:.6g}")


def settled(value: float, mean: float = 0.0) -> float:
    """The value, or zero if it is mere rounding beside the mean or beside 1 (m/s, m/s2, deg/s, deg)."""
    return 0.0 if abs(value) < ROUND_OFF * max(1.0, abs(mean)) else value


def read_track(log: Log, source: MotionSource) -> Track:
    """Read the commands of a log, and the motion of one of its components.

    Raises:
        FitError: the log lacks the command or the motion, or holds one tick only.
    """
    components = ("plant", "controller") if source.component == "plant" else ("controller", "plant")
    commands = [f"{name}.command" for name in components if f"{name}.command" in log]
    motion = [f"{source.component}.{name}" for name in ("speed", "heading")]
    missing = [signal for signal in motion if signal not in log]
    if not commands or missing:
        lacks = missing[0] if commands else "controller.command"
        raise FitError(
            f'{log.path}: the log has no signal "{lacks}"; expected the log of a guided trial, such as '
            f"`canine run` writes, with the motion of {' or '.join(MOTION_SOURCES)}"
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
    aim, way_home = None, 0.0
    status = log["controller.status"][-1] if "controller.status" in log else None
    if log.route:
        (_, first_north, first_east), (_, north, east) = log.route.places[0], log.route.places[-1]
        aim = math.atan2(first_east - east, first_north - north)  # from home, where a trial starts
        place = [f"{source.component}.{name}" for name in ("north", "east")]
        if all(signal in log for signal in place):
            places = np.column_stack([log[signal] for signal in place])
            known = places[np.isfinite(places).all(axis=1)]
            way_home = math.dist(known[-1], (north, east)) if len(known) else 0.0
            if status == Status.FAILED:  # it is recalled, which ends within the capture radius
                way_home = max(0.0, way_home - log.route.radius)
    name = f"{log.path.resolve().parent.name}/{log.path.name}"
    swapped = log.attachments.get("plant.fmu")
    return Track(
        name, log.time, log[commands[0]], speed, heading, usable, fresh, aim, log.parameter("plant.seed"),
        next((channel.block for channel in log.channels if channel.component == "plant"), ""),
        sha256(swapped).hexdigest() if swapped else "",
        {
            name.removeprefix("plant."): value
            for name, value in log.metadata.get("parameters", {}).items()
            if name.startswith("plant.") and not _is_of_a_trial(name.removeprefix("plant."))
        },
        bool(status == Status.SUCCESS), way_home,
        log.path,
    )  # fmt: skip


def _is_of_a_trial(name: str) -> bool:
    """Is a plant's parameter not the animal's, but of its mission or of where it runs?"""
    return name in OF_A_TRIAL or name.startswith(MISSION)


def find_logs(paths: Sequence[Path]) -> list[Path]:
    """The logs among the paths, and those anywhere in folders among them, each once.

    Raises:
        FitError: a path does not exist, or a folder holds no log.
    """
    return list({log.resolve(): log for path in paths for log in _logs_at(path)}.values())


def _logs_at(path: Path) -> list[Path]:
    """The log, or those anywhere in a folder.

    Raises:
        FitError: the path does not exist, or the folder holds no log.
    """
    if not path.exists():
        raise FitError(f'there is no log "{path}"; expected a trial.mcap, or a folder that holds some')
    logs = sorted(path.rglob("*.mcap"), key=_counting) if path.is_dir() else [path]
    if not logs:
        raise FitError(f"{path}: the folder holds no .mcap; expected logs of trials")
    return logs


def _counting(path: Path) -> list[list[str | int]]:
    """A key by which paths are in the order in which people count: mission-2 before mission-10.

    Each part of a path is text, number, text and so on: text meets text, and a number a number.
    """
    return [
        [int(piece) if place % 2 else piece for place, piece in enumerate(re.split(r"(\d+)", part))]
        for part in path.parts
    ]


def days_of(paths: Sequence[Path]) -> list[list[Path]]:
    """The logs of days: each folder's logs, by their names, are a day; so are those that stand in a row.

    Raises:
        FitError: a path does not exist, a folder holds no log or those of several days, or a log is named
            twice.
    """
    days: list[list[Path]] = []
    in_a_row = False
    for path in paths:
        logs = _logs_at(path)
        if path.is_dir():
            _check_one_day(path, logs)
        if in_a_row and not path.is_dir():
            days[-1] += logs
        else:
            days.append(logs)
        in_a_row = not path.is_dir()
    times = Counter(log.resolve() for day in days for log in day)
    for log in (log for day in days for log in day):
        if times[log.resolve()] > 1:
            raise FitError(f"{log}: is named twice, and would be two missions; name it once")
    return days


def _check_one_day(folder: Path, logs: Sequence[Path]) -> None:
    """Refuse a folder of days: a day's logs stand side by side, or each in a folder of its own.

    Raises:
        FitError: it is one.
    """
    together = Path(os.path.commonpath([log.parent for log in logs]))
    within = [log.relative_to(together).parts for log in logs]
    crowded = Counter(parts[0] for parts in within if len(parts) > 1)
    if any(len(parts) > 2 or crowded[parts[0]] > 1 for parts in within):
        raise FitError(
            f"{folder}: its folders {', '.join(crowded)} hold several logs, or folders with logs; expected "
            "the missions of one day, side by side or each in a folder of its own: name each folder"
        )


@dataclass(frozen=True)
class Reading:
    """The trials of some logs.

    Attributes:
        tracks: each with the source of its motion.
        notes: on logs not read whole or left out, and on what the trials should have in common and do not.
        left_out: number of logs that were not used.
    """

    tracks: Sequence[tuple[Track, MotionSource]]
    notes: Sequence[str]
    left_out: int = 0


def read_tracks(
    paths: Sequence[Path], component: str | None = None, progress: Callable[[int], None] | None = None
) -> Reading:
    """Read trials from logs.

    Args:
        component: whose motion is read; by default the plant, or the estimator if a log has no plant.
        progress: called with the number of logs read.

    Raises:
        LogError, FitError: no log can be read, or the logs are of two plants alike in number; if some can be
            read, or most are of one plant, the others are left out and noted.
    """
    tracks: list[tuple[Track, MotionSource]] = []
    notes: list[str] = []
    content: dict[bytes, Path] = {}
    failures: list[CanineError] = []
    for number, path in enumerate(paths, start=1):
        if progress:
            progress(number)
        try:
            digest = sha256(_content(path)).digest()
            if digest in content:
                notes.append(f"{path}: the same log as {content[digest]}; counted once")
                continue
            log = read_log(path)
            name = component or ("plant" if "plant.speed" in log else "estimator")
            tracks.append((read_track(log, MOTION_SOURCES[name]), MOTION_SOURCES[name]))
            content[digest] = path
            if log.broken:
                notes.append(f"{path}: the log is not whole, {log.broken}")
        except (LogError, FitError) as failure:
            failures.append(failure)
    if not tracks:
        raise failures[0]
    notes += [f"{failure}; left out" for failure in failures]
    kept, others = _of_one_plant(tracks)
    left_out = len(failures) + len(tracks) - len(kept)
    return Reading(kept, [*notes, *others, *_mixed(kept)], left_out)


def _of_one_plant(
    tracks: Sequence[tuple[Track, MotionSource]],
) -> tuple[list[tuple[Track, MotionSource]], list[str]]:
    """The trials of the plant that most have, and those without a plant; a note on each other plant's.

    Raises:
        FitError: as many trials have another plant.
    """
    by_plant: dict[str, list[Track]] = {}
    for track, _ in tracks:
        if track.plant:
            by_plant.setdefault(track.plant, []).append(track)
    first, *others = sorted(by_plant, key=lambda plant: -len(by_plant[plant])) or [""]
    if others and len(by_plant[others[0]]) == len(by_plant[first]):
        plants = "; ".join(f"{plant}: {_named(by_plant[plant])}" for plant in (first, *others))
        raise FitError(f"the logs are of different plants, {plants}; give the logs of one of them")
    total = sum(map(len, by_plant.values()))
    notes = [
        f"{len(by_plant[plant])} of {total} logs ({_named(by_plant[plant])}) are of the plant {plant}, most "
        f"of {first}; left out"
        for plant in others
    ]
    return [(track, source) for track, source in tracks if track.plant in ("", first)], notes


def _named(tracks: Sequence[Track]) -> str:
    """Some logs by their names, and how many more there are."""
    more = f" and {len(tracks) - NAMED} more" if len(tracks) > NAMED else ""
    return ", ".join(track.name for track in tracks[:NAMED]) + more


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise FitError(f"{path}: cannot be read ({error.strerror}); expected the log of a trial") from error


def _mixed(tracks: Sequence[tuple[Track, MotionSource]]) -> Iterable[str]:
    """Notes on what the trials should have in common and do not, or have and should not."""
    sources = Counter(source.component for _, source in tracks)
    if len(sources) > 1:
        counts = ", ".join(f"{name} of {n}" for name, n in sources.items())
        yield (
            f"the motion is read from {counts} logs: the estimate is less exact; --source takes one of them"
        )
    plants = [track for track, _ in tracks if track.plant]
    without = [track for track, _ in tracks if not track.plant]
    if plants and without:
        yield (
            f"no plant in {len(without)} of {len(tracks)} logs ({_named(without)}): their animal is not the "
            f"{plants[0].plant} of the others; all count"
        )
    yield from _different_animals(plants)
    steps = Counter(f"{track.step:.4g}" for track, _ in tracks)
    if len(steps) > 1:
        counts = ", ".join(f"{step} s in {n}" for step, n in steps.items())
        yield f"the logs have different sample times: {counts}; each is read with its own"
    seeds = Counter(track.seed for track, _ in tracks if track.seed is not None)
    again = sum(n - 1 for n in seeds.values())
    if again:
        yield (
            f"simulated logs with the seed of another, and so its draws: {again}; they are not "
            "independent, and the intervals are too narrow; give each its own seed"
        )


def _different_animals(tracks: Sequence[Track]) -> Iterable[str]:
    """Notes on trials whose plants are alike in name, and differ in their file or their parameters."""
    files = Counter(track.file for track in tracks)
    if len(files) > 1:
        (common, _), *_ = files.most_common()
        others = [track for track in tracks if track.file != common]
        yield (
            f"the plant is another FMU of the same name in {len(others)} of {len(tracks)} logs "
            f"({_named(others)}); all count"
        )
    names = dict.fromkeys(name for track in tracks for name in track.parameters)
    for name in names:
        values = Counter(track.parameters.get(name, "none") for track in tracks)
        if len(values) > 1:
            (common, n), *_ = values.most_common()
            others = [track for track in tracks if track.parameters.get(name, "none") != common]
            yield (
                f"plant.{name} is {common} (SI) in {n} of {len(tracks)} logs, and differs in the others "
                f"({_named(others)}): the animals are not the same; all count"
            )


def estimate(reading: Reading, turned: float | None = None, days: Days | None = None) -> dict[str, Any]:
    """The statistics over all trials of some logs: the content of fit.json.

    Args:
        turned: rad/s, turn rate from which on a command counts as obeyed; by default each source's own.
        days: how they are missions of days; None for trials in no order.

    Raises:
        FitError: the trials have neither a value nor a response.
        UsageError: a mission of a day was left out.
    """
    tracks = [
        (track, source if turned is None else replace(source, turned=turned))
        for track, source in reading.tracks
    ]
    trials = [measure(track, source) for track, source in tracks]
    result = pool(trials, max(source.turned for _, source in tracks))
    result["notes"] = [*reading.notes, *result["notes"]]
    result["sources"] = sorted({source.component for _, source in tracks})
    result["logs"] = [track.name for track, _ in tracks]
    result["plants"] = sorted({track.plant for track, _ in tracks} - {""})
    result["left_out_logs"] = reading.left_out
    if days is not None:
        by_path = {track.path: (track, trial) for (track, _), trial in zip(tracks, trials, strict=True)}
        result["day"] = estimate_day(days.missions(by_path), days.laws)
        result["day"]["parameters"], beyond = within_range(result["day"]["parameters"])
        result["notes"] += beyond
    return result
