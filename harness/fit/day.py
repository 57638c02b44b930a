"""What a day does to an animal, from the logs of its missions: the effects of fatigue and habituation.

The laws are those of models/day.py, and what of them is no effect is taken as given: the way that tires, the
times in which both states fade, the free vibrations, what a reward takes. From the way run, the vibrations
felt, the successes and the rests both states follow at any time of the day, habituation for each value of its
gain. The effects are then estimated.

- Speed: the line of the missions' cruising speeds over fatigue; its slope as a share of the rested speed,
  with Fieller's interval.
- Response time: the line of the delays of FORWARD from rest over fatigue, with Student's interval.
- Obedience: the likelihood of all responses to LEFT and RIGHT, over a success rate for each side, the share
  that fatigue takes and the gain of habituation. The intervals are those of the likelihood ratio.

An effect that is not shown to differ from 0 is said to be so, and what the logs cannot tell, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from harness.fit.tracks import TURNS, Track, Trial, stretches
from harness.log.channel import Array
from harness.trial.plan import si_value
from harness.trial.scenario import ScenarioError
from models.day import CanineAllDay, check_rest, faded, rested, tired_after, tired_by
from models.errors import UsageError, nearest

CONFIDENCE = 0.95
GIVEN = (
    "start_fatigue", "start_habituation", "fatigue_way", "fatigue_time", "free_vibrations",
    "habituation_time", "reward_relief",
)  # fmt: skip
FEWEST = 5  # values from which a line is drawn
FEWEST_RESPONSES = 10  # from which a share is estimated; of habituation, beyond the free ones
SPREAD = 0.02  # of fatigue, below which all values are of a dog that is equally tired
GRID = np.arange(101) / 100  # of the shares
UNTOLD = 0.95  # of the range, which an interval covers that tells nothing
HALVINGS = 40


@dataclass(frozen=True)
class Mission:
    """One mission of a day, as it was read.

    Attributes:
        rest: s, from its end to the next one's begin.
    """

    track: Track
    trial: Trial
    rest: float


@dataclass(frozen=True)
class Effect:
    """An effect of a day.

    Attributes:
        name: of the animal's parameter.
        n: values that it is estimated from.
        estimate, interval: None where the logs cannot tell.
        rested: the value of a rested animal, where there is one.
        why: why they cannot tell; "" if they can.
    """

    name: str
    n: int
    estimate: float | None = None
    interval: tuple[float, float] | None = None
    rested: float | None = None
    why: str = ""

    @property
    def verdict(self) -> str:
        """What may be concluded."""
        variable = CanineAllDay.variables()[self.name]
        if self.interval is None or self.estimate is None:
            return f"cannot be estimated: {self.why}"
        low, high = self.interval
        most = 1.0 if variable.unit == "1" else math.inf
        if low <= 0 and high >= UNTOLD * most:
            return "the logs tell nothing of it"
        if high < 0:
            return "below 0: the animal does not tire by this law"
        if low > 0:
            return "shown"
        return "not shown: the interval includes 0"

    def facts(self) -> dict[str, Any]:
        """As fit.json has it."""
        return {
            "unit": CanineAllDay.variables()[self.name].unit,
            "n": self.n,
            "estimate": self.estimate,
            "interval": self.interval,
            "rested": self.rested,
            "verdict": self.verdict,
        }


@dataclass(frozen=True)
class Days:
    """How logs are missions of days.

    Attributes:
        paths: of the logs of each day, in their order.
        rests: s, between two missions: one for all, or one for each.
        laws: what of the laws is taken as given.
    """

    paths: Sequence[Sequence[Path]]
    rests: Sequence[float]
    laws: Mapping[str, float]

    def __post_init__(self) -> None:
        """Refuse rests that are not between the missions.

        Raises:
            UsageError: there are.
        """
        for rest in self.rests:
            check_rest(rest)
        for day in self.paths:
            if len(self.rests) not in (1, len(day) - 1):
                raise UsageError(
                    f"rest: {len(self.rests)} rests, and the day of {day[0]} has {len(day)} missions; "
                    f"expected one for all, or {len(day) - 1}"
                )

    def missions(self, trials: Mapping[Path, tuple[Track, Trial]]) -> list[list[Mission]]:
        """The missions of each day.

        Raises:
            UsageError: a log was left out, or its motion is never known.
        """
        for path in (path for day in self.paths for path in day):
            if path not in trials:
                raise UsageError(f"{path}: was left out, and a day needs all its missions; leave out its day")
            track, _ = trials[path]
            if not (track.usable & track.fresh).any():
                raise UsageError(
                    f"{path}: its motion is never known, and a day needs the way run in each mission; leave "
                    "out its day"
                )
        return [
            [
                Mission(*trials[path], 0.0 if path is day[-1] else self.rests[number % len(self.rests)])
                for number, path in enumerate(day)
            ]
            for day in self.paths
        ]


def laws_given(settings: Sequence[str]) -> dict[str, float]:
    """What of the laws is taken as given: the declared values, or those of `canine.name=value`.

    Raises:
        UsageError: a setting is none of these, or out of its range.
    """
    declared = CanineAllDay.variables()
    laws = {name: declared[name].start[0] for name in GIVEN}
    for setting in settings:
        address, _, text = setting.partition("=")
        name = address.strip().removeprefix("canine.")
        if name not in laws:
            known = [f"canine.{one}" for one in GIVEN]
            raise UsageError(
                f"{setting}: a fit takes only what it does not estimate{nearest(address, known)}"
            )
        try:
            laws[name] = float(text)
        except ValueError:
            raise UsageError(f"{setting}: expected {declared[name].expected()}") from None
        declared[name].check(laws[name], f"canine.{name}")
    return laws


def estimate_day(days: Sequence[Sequence[Mission]], laws: Mapping[str, float]) -> dict[str, Any]:
    """The effects over some days: what fit.json has under `day`.

    Args:
        days: each its missions in their order.
        laws: as `laws_given` returns it.
    """
    speeds: list[tuple[float, float]] = []
    delays: list[tuple[float, float]] = []
    heard = []
    for day in days:
        followed = zip(day, _fatigues(day, laws), _habituations(day, laws), strict=True)
        for mission, fatigue, felt in followed:
            trial = mission.trial
            if "cruise_speed" in trial.values:
                before = np.array(trial.cruised) - 1  # a tick's speed is that of the fatigue before it
                speeds.append((float(fatigue[before].mean()), trial.values["cruise_speed"]))
            delays += [(float(fatigue[row]), delay) for row, delay in trial.delays]
            heard += [
                _Heard(TURNS[command][1], obeyed, float(fatigue[row]), *felt[row])
                for row, command, obeyed in trial.heard
            ]
    effects = [
        slowing(np.array(speeds).reshape(-1, 2)),
        delaying(np.array(delays).reshape(-1, 2)),
        *_disobeying(heard),
    ]
    tracks = [mission.track for day in days for mission in day]
    return {
        "confidence": CONFIDENCE,
        "days": len(days),
        "missions": sum(map(len, days)),
        "seconds": sum(float(np.ptp(track.time)) for track in tracks),
        "seconds_unknown": sum(float(np.diff(track.time)[~track.usable[:-1]].sum()) for track in tracks),
        "given": dict(laws),
        "effects": {effect.name: effect.facts() for effect in effects},
        "parameters": {
            f"canine.{effect.name}": float(f"{effect.estimate:.4g}")
            for effect in effects
            if effect.verdict == "shown" and effect.estimate is not None
        },
        "speeds": speeds,
        "delays": delays,
    }


def within_range(parameters: Mapping[str, float]) -> tuple[dict[str, float], list[str]]:
    """The parameters that the animal's model takes, and a note on each other one.

    Args:
        parameters: by `canine.name`, angles in degrees.
    """
    kept, notes = {}, []
    for address, value in parameters.items():
        variable = CanineAllDay.variables()[address.removeprefix("canine.")]
        try:
            si_value(value, variable, address)
        except ScenarioError as reason:
            notes.append(f"{reason}; the animal is beyond its model, and this is left out of the parameters")
        else:
            kept[address] = value
    return kept, notes


def _fatigues(day: Sequence[Mission], laws: Mapping[str, float]) -> Iterator[Array]:
    """Fatigue on each row of each mission."""
    fatigue = laws["start_fatigue"]
    for mission in day:
        track = mission.track
        seconds = np.diff(track.time)
        held = track.held
        ways = (0.5 * (held[:-1] + held[1:]) * seconds).tolist()
        kept = faded(laws["fatigue_time"], seconds).tolist()
        rows = [fatigue]
        for way, keeps in zip(ways, kept, strict=True):
            fatigue = keeps * tired_by(fatigue, way, laws["fatigue_way"])
            rows.append(fatigue)
        yield np.array(rows)
        if not track.success:  # a failed trial ends where the recall begins
            fatigue = tired_after(fatigue, track.way_home, laws["fatigue_way"])
        fatigue, _ = rested(fatigue, 0.0, False, mission.rest, laws)


def _habituations(
    day: Sequence[Mission], laws: Mapping[str, float]
) -> Iterator[dict[int, tuple[Array, bool]]]:
    """By mission, of each vibration's row: habituation for each gain of GRID, and is it a further one?"""
    habituation = np.full(GRID.shape, laws["start_habituation"])
    for mission in day:
        time = mission.track.time
        now = time[0]
        rows: dict[int, tuple[Array, bool]] = {}
        for command, first, _ in stretches(mission.track.command):
            if command in TURNS:
                habituation = habituation * faded(laws["habituation_time"], time[first] - now)
                now = time[first]
                further = len(rows) >= laws["free_vibrations"]
                if further:
                    habituation = habituation + GRID * (1 - habituation)
                rows[first] = habituation, further
        yield rows
        habituation = habituation * faded(laws["habituation_time"], time[-1] - now)
        _, habituation = rested(0.0, habituation, mission.track.success, mission.rest, laws)


@dataclass(frozen=True)
class _Heard:
    """A response: of which side, obeyed or not, and the states in which it was given.

    Attributes:
        habituation: for each gain of GRID.
        further: a vibration beyond the free ones.
    """

    side: str
    obeyed: bool
    fatigue: float
    habituation: Array
    further: bool


def _line(points: Array) -> tuple[Array, Array, float] | str:
    """Intercept and slope, their covariance, Student's quantile; or why there is no line."""
    if len(points) < FEWEST:
        return f"{len(points)} values; at least {FEWEST} are needed"
    x, y = points.T
    if np.ptp(x) < SPREAD:
        return f"all values are of fatigues within {SPREAD:g}; give a longer day, or shorter rests"
    design = np.column_stack([np.ones_like(x), x])
    inverse = np.linalg.inv(design.T @ design)
    line = inverse @ design.T @ y
    freedom = len(x) - 2
    variance = float(np.sum((y - design @ line) ** 2)) / freedom
    return line, variance * inverse, float(stats.t.ppf(0.5 + CONFIDENCE / 2, freedom))


def slowing(points: Array) -> Effect:
    """The share of the speed that full fatigue takes, from (fatigue, speed) of missions: (n, 2)."""
    name, line = "fatigue_slows", _line(points)
    if isinstance(line, str):
        return Effect(name, len(points), why=f"cruising speed: {line}")
    (rested_speed, slope), cov, quantile = line
    ratio = slope / rested_speed
    doubt = quantile**2 * cov[0, 0] / rested_speed**2
    if doubt >= 1:
        return Effect(name, len(points), why="the speeds scatter too widely")
    middle = ratio - doubt * cov[0, 1] / cov[0, 0] if cov[0, 0] else ratio
    square = cov[1, 1] - 2 * ratio * cov[0, 1] + ratio**2 * cov[0, 0]
    if cov[0, 0]:
        square -= doubt * (cov[1, 1] - cov[0, 1] ** 2 / cov[0, 0])
    half = quantile / abs(rested_speed) * math.sqrt(max(square, 0.0))
    low, high = ((middle - half) / (1 - doubt), (middle + half) / (1 - doubt))
    return Effect(name, len(points), -float(ratio), (-float(high), -float(low)), float(rested_speed))


def delaying(points: Array) -> Effect:
    """By how much full fatigue delays a response, from (fatigue, delay) of FORWARDs from rest: (n, 2)."""
    name, line = "fatigue_delays", _line(points)
    if isinstance(line, str):
        return Effect(name, len(points), why=f"FORWARD from rest: {line}")
    (rested_delay, slope), cov, quantile = line
    half = quantile * math.sqrt(cov[1, 1])
    return Effect(
        name, len(points), float(slope), (float(slope - half), float(slope + half)), float(rested_delay)
    )


def _disobeying(heard: Sequence[_Heard]) -> Iterator[Effect]:
    """The share that fatigue takes, and the gain of habituation, from all responses."""
    further = sum(response.further for response in heard)
    surface = _likelihood(heard)
    best = float(surface.max())
    fatigues = [response.fatigue for response in heard]
    for name, axis, n, what in (
        ("fatigue_disobeys", 0, len(heard), "responses to LEFT and RIGHT"),
        ("habituation_gain", 1, further, "responses to vibrations beyond the free ones"),
    ):
        if n < FEWEST_RESPONSES:
            yield Effect(name, n, why=f"{n} {what}; at least {FEWEST_RESPONSES} are needed")
        elif name == "fatigue_disobeys" and np.ptp(fatigues) < SPREAD:
            yield Effect(name, n, why=f"all responses are of fatigues within {SPREAD:g}; give a longer day")
        else:
            profile = surface.max(axis=axis)
            yield Effect(name, n, float(GRID[int(profile.argmax())]), _ends(2 * (best - profile)))


def _ends(fallen: Array) -> tuple[float, float]:
    """Where on GRID twice the fallen log-likelihood reaches the quantile; between its points by a line."""
    most = float(stats.chi2.ppf(CONFIDENCE, 1))
    inside = np.flatnonzero(fallen <= most)
    ends = []
    for last, step in ((int(inside[0]), -1), (int(inside[-1]), 1)):
        beyond = min(max(last + step, 0), len(GRID) - 1)
        rise = fallen[beyond] - fallen[last]
        share = (most - fallen[last]) / rise if 0 < rise < math.inf else 0.0
        ends.append(float(GRID[last] + share * (GRID[beyond] - GRID[last])))
    return ends[0], ends[1]


def _likelihood(heard: Sequence[_Heard]) -> Array:
    """(gains, shares): the log-likelihood of the responses, each side's rate the likeliest."""
    surface = np.zeros((len(GRID), len(GRID)))
    for side in {response.side for response in heard}:
        responses = [response for response in heard if response.side == side]
        obeyed = np.array([response.obeyed for response in responses])
        tired = 1 - np.multiply.outer(GRID, [response.fatigue for response in responses])
        accustomed = np.array([response.habituation for response in responses])
        surface += [_likeliest(tired * (1 - of_a_gain), obeyed) for of_a_gain in accustomed.T]
    return surface


def _likeliest(left: Array, obeyed: Any) -> Array:
    """(shares,): the log-likelihood at the rate that makes it largest.

    Args:
        left: (shares, responses), what fatigue and habituation leave of the rate.
        obeyed: (responses,).
    """
    low, high = np.zeros(len(left)), np.ones(len(left))
    ignored = left[:, ~obeyed]
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(HALVINGS):  # the slope of the log-likelihood falls with the rate
            rate = 0.5 * (low + high)
            chance = rate[:, None] * ignored
            rises = obeyed.sum() > (chance / (1 - chance)).sum(axis=1)
            low, high = np.where(rises, rate, low), np.where(rises, high, rate)
        chance = (0.5 * (low + high))[:, None] * left
        terms = np.where(obeyed, np.log(chance), np.log1p(-chance))
    return np.asarray(terms.sum(axis=1))
