"""The page on habituation: what the field's counts allow, and how far apart waypoints are best with it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.stats import chi2

from harness.files import write_whole
from harness.log.channel import Array
from harness.sweep.sweep import plan_sweep
from harness.sweep.table import Z_95, Point
from harness.terminal import percent
from harness.trial.scenario import Scenario
from harness.verification.page import FULL, RESULTS, TEMPLATES
from harness.verification.published import FIELD, Field, log_likelihood
from harness.verification.runs import DRAWN, Size, run
from harness.verification.tables import markdown
from models.day import BOUNDS, CanineAllDay

PAGE = "habituation.md"
PLANT = CanineAllDay.title()
GAIN = "canine.habituation_gain"
DOGS: Mapping[str, tuple[str, ...]] = {"default": (), "`table_5_1`": DRAWN}
# habituation is taken for the only cause
ALONE = tuple(f"canine.fatigue_{effect}=0" for effect in ("slows", "delays", "disobeys"))
OPEN = tuple(field for field in FIELD if field.environment == "non-structured")
GAINS = "0:0.6:0.05"
FINE = 1e-3  # between two gains at which the likelihood is looked up
LEVEL = 0.95

LENGTH = 200.0  # m, of a straight way
PARTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16)  # of equal length
ON_THE_WAY = "0:0.3:0.1"  # gains


@dataclass(frozen=True, eq=False)
class Allowed:
    """What the counts of the trials in the open say of the gain, for one dog.

    Attributes:
        gains: (n,) that were tried.
        rates: (n, counts) of success, at each of OPEN.
    """

    gains: Array
    rates: Array

    @cached_property
    def log_likelihoods(self) -> Array:
        """(n,) of the counts, below what any rates could give."""
        return np.array([log_likelihood(OPEN, row) for row in self.rates])

    @cached_property
    def _between(self) -> tuple[Array, Array]:
        """Gains, FINE apart, and twice the log-likelihoods below the likeliest one's."""
        fine = np.arange(self.gains[0], self.gains[-1] + FINE / 2, FINE)
        curve = CubicSpline(self.gains, self.log_likelihoods)(fine)
        return fine, 2 * (curve.max() - curve)

    @property
    def likeliest(self) -> float:
        """The gain that makes the counts the likeliest."""
        gains, below = self._between
        return float(gains[below.argmin()])

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the likelihood ratio."""
        gains, below = self._between
        inside = gains[below <= chi2.ppf(LEVEL, 1)]
        return float(inside[0]), float(inside[-1])

    @property
    def bound(self) -> float:
        """The upper end of the 95 % interval to one side."""
        gains, below = self._between
        return float(gains[below <= chi2.ppf(2 * LEVEL - 1, 1)][-1])


def allowed(settings: Sequence[str], trials: int) -> Allowed:
    """What the counts say of the gain of a dog.

    Args:
        settings: of the dog, `block.name=value`.
        trials: for each gain and each count.
    """
    tables = [_points(field, settings, trials) for field in OPEN]
    gains = np.array([float(point.written[0]) for point in tables[0]])
    successes = np.array([[point.successes for point in table] for table in tables]).T
    return Allowed(gains, (successes + 0.5) / (trials + 1))  # never 0 or 1


def _points(field: Field, settings: Sequence[str], trials: int) -> list[Point]:
    """A point for each of GAINS, at the field's waypoints and threshold."""
    threshold = f"cmec.moving_deviation={field.threshold}"
    return _over(GAINS, field.waypoints, (threshold, *settings), trials)


def _over(gains: str, target: str | Scenario, settings: Sequence[str], trials: int) -> list[Point]:
    """A point for each gain, in the reading of the field."""
    sweep = plan_sweep(
        target, vary=(f"{GAIN}={gains}",), trials=trials, reading="field", plant=PLANT,
        settings=(*ALONE, *settings),
    )  # fmt: skip
    return run(sweep).table


def straight(parts: int) -> Scenario:
    """A straight way of LENGTH in equal parts."""
    waypoints = [(LENGTH * k / parts, 0.0) for k in range(1, parts + 1)]
    return Scenario(name="straight", system="cts", waypoints=waypoints, duration=600.0)


def straight_points(parts: int, settings: Sequence[str], trials: int, gains: str = ON_THE_WAY) -> list[Point]:
    """How often a dog is led along it: a point for each gain."""
    return _over(gains, straight(parts), settings, trials)


def write(folder: Path = RESULTS, size: Size = FULL) -> str:
    """Write the page; what it says of the gain, in lines.

    Raises:
        FileError: it cannot be written.
    """
    allowed_by_dog = {dog: allowed(settings, size.gain) for dog, settings in DOGS.items()}
    page = TEMPLATES.get_template(f"{PAGE}.jinja").render(
        size=size,
        likelihoods=likelihood_table(allowed_by_dog),
        verdicts=verdict_table(allowed_by_dog),
        straight={dog: straight_table(settings, size) for dog, settings in DOGS.items()},
        half=math.ceil(1000 * Z_95 * 0.5 / math.sqrt(size.straight)) / 10,  # of a rate of 50 %
        bound=BOUNDS["habituation_gain"].most,
    )
    write_whole(folder / PAGE, page.encode())
    return verdict_table(allowed_by_dog)


def likelihood_table(allowed_by_dog: Mapping[str, Allowed]) -> str:
    """How likely each gain makes the field's counts, for each dog."""
    conditions = [f"{field.waypoints}, {field.threshold} deg" for field in OPEN]
    counts = [f"{f.successes}/{f.trials} = {percent(f.successes / f.trials)}" for f in OPEN]
    rows = [["the field", "", *counts, "0"]]
    for dog, each in allowed_by_dog.items():
        for gain, rates, likelihood in zip(each.gains, each.rates, each.log_likelihoods, strict=True):
            rows.append([dog, f"{gain:g}", *map(percent, rates), f"{likelihood:.2f}"])
    return markdown(["dog", "gain", *conditions, "ln L"], rows)


def verdict_table(allowed_by_dog: Mapping[str, Allowed]) -> str:
    """The likeliest gain of each dog, its interval and its bound."""
    return markdown(
        ["dog", "likeliest gain", "95 % interval", "at most (95 %, to one side)"],
        [
            [dog, f"{each.likeliest:.2f}", "{:.2f} to {:.2f}".format(*each.interval), f"{each.bound:.2f}"]
            for dog, each in allowed_by_dog.items()
        ],
    )


def straight_table(settings: Sequence[str], size: Size) -> str:
    """Success along the straight way, by the distance of waypoints and by the gain."""
    tables = {parts: straight_points(parts, settings, size.straight) for parts in PARTS}
    gains = [f"{float(point.written[0]):g}" for point in tables[PARTS[0]]]
    return markdown(
        ["waypoints every", *gains],
        [
            [f"{LENGTH / parts:.3g} m", *(percent(point.success_rate) for point in table)]
            for parts, table in tables.items()
        ],
    )
