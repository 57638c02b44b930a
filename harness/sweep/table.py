"""The table of a sweep: rates, times and counts at each point, computed from integers alone."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Any

import numpy as np
import numpy.typing as npt

from harness.sweep.chunks import ANOMALIES, SUMS, TICK_S, FmuFailure, Outcomes
from harness.terminal import DEVIATION_THRESHOLD

THRESHOLD_COLUMN = "threshold_deg"
Z_95 = 1.959963984540054  # the normal distribution's 97.5 % point
BLOCK = 1 << 18  # squares summed at a time: their sum stays below 2^63 for the longest trials


@dataclass(frozen=True)
class Point:
    """The trials at one point of the sweep.

    Attributes:
        written: the varied parameters, as users write them.
        ticks, squares, commands: sums over the successful trials: ticks, their squares, and directional
            commands (5.3.1 records them for these).
        timeouts: trials cut at their last tick, before any status ended them.
        anomalies: ticks that reported each kind, over all trials.
        trial_types: successes and trials of each type; empty if there is one type only.
        fmu_failures: ended trials, which count as failed.
        asked: trials that were asked for; of fewer, the point was given up.
        refused: why there are no trials.
    """

    written: tuple[Decimal, ...]
    trials: int
    successes: int
    ticks: int
    squares: int
    commands: int
    timeouts: int
    anomalies: Mapping[str, int]
    trial_types: Mapping[str, tuple[int, int]]
    fmu_failures: Sequence[FmuFailure] = ()
    asked: int = 0
    refused: str = ""

    @property
    def gave_up(self) -> bool:
        """Was the point given up?"""
        return self.trials < self.asked

    @property
    def without_failures(self) -> Point:
        """The same of the trials that no FMU ended."""
        return replace(self, trials=self.trials - len(self.fmu_failures), fmu_failures=())

    @property
    def verdict(self) -> str:
        """What FMUs did to the trials, in words; "" if nothing."""
        failures = self.fmu_failures
        if not failures:
            return self.refused
        kinds = Counter(failure.fault.kind for failure in failures)
        first = min(failures, key=lambda failure: failure.number)
        words = ", ".join(f"{kind} {count}" for kind, count in kinds.most_common())
        given_up = f", then given up ({self.asked} asked for)" if self.gave_up else ""
        ended = f"{len(failures)} of {self.trials} trials ended by a fault ({words}){given_up}"
        return f"{ended}; the first: {first.text}"

    @property
    def success_rate(self) -> float:
        """Share of all trials that succeeded."""
        return self.successes / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of the success rate."""
        return wilson(self.successes, self.trials)

    @property
    def mean_time(self) -> float | None:
        """Mean time of the successful trials [s]; None if there are none."""
        return TICK_S * (self.ticks / self.successes) if self.successes else None

    @property
    def sd_time(self) -> float | None:
        """Standard deviation of the successful trials' times [s]; None if there are fewer than two."""
        n = self.successes
        return TICK_S * math.sqrt((n * self.squares - self.ticks**2) / (n * (n - 1))) if n > 1 else None

    @property
    def mean_commands(self) -> float | None:
        """Mean number of directional commands in a successful trial; None if there are none."""
        return self.commands / self.successes if self.successes else None

    def rate_of(self, trial_type: str) -> float | None:
        """The success rate of one type of trial; None if it had no trials."""
        successes, trials = self.trial_types[trial_type]
        return successes / trials if trials else None


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """The 95 % confidence interval of a success rate (Wilson 1927)."""
    rate, spread = successes / trials, Z_95**2 / trials
    middle = (rate + spread / 2) / (1 + spread)
    half = Z_95 * math.sqrt(rate * (1 - rate) / trials + spread / (4 * trials)) / (1 + spread)
    return (middle - half if successes else 0.0), (middle + half if successes < trials else 1.0)


def table_of(points: Sequence[tuple[Decimal, ...]], outcomes: Outcomes) -> list[Point]:
    """A row for each point, in the order of `points`."""
    names = outcomes.job.type_names
    table = []
    for index, written in enumerate(points):
        ticks = outcomes.ticks[index][: outcomes.ran[index]]
        ticks_by_type = {name: ticks[turn :: len(names)] for turn, name in enumerate(names)}
        trial_types = {name: (int(np.count_nonzero(own)), own.size) for name, own in ticks_by_type.items()}
        sums = dict(zip(SUMS, map(int, outcomes.sums[index]), strict=True))
        table.append(
            Point(
                written,
                ticks.size,
                int(np.count_nonzero(ticks)),
                int(ticks.sum(dtype=np.int64)),
                _squares(ticks),
                sums["commands"],
                sums["timeouts"],
                {name: sums[name] for name in ANOMALIES},
                trial_types if len(names) > 1 else {},
                outcomes.fmu_failures.get(index, ()),
                outcomes.job.trials,
            )
        )
    return table


def _squares(ticks: npt.NDArray[np.unsignedinteger[Any]]) -> int:
    blocks = (ticks[at : at + BLOCK].astype(np.int64) for at in range(0, ticks.size, BLOCK))
    return sum(int(np.dot(block, block)) for block in blocks)


def name_of(column: str) -> str:
    """What texts and pictures call a column of the table: h' by the text's name, others by their address."""
    return DEVIATION_THRESHOLD if column == THRESHOLD_COLUMN else column


def csv_of(
    columns: Sequence[str],
    labels: Sequence[Sequence[str]],
    table: Sequence[Point],
    *,
    has_fmus: bool = False,
) -> bytes:
    """The table as CSV; a cell is empty where a value is None.

    Args:
        columns: names of the first columns; `labels`: what stands in them, by row.
        has_fmus: with the columns `fmu_failures` and `verdict` at the end.
    """
    trial_types = list(table[0].trial_types)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        [
            *columns, "trials", "successes", "success_rate", "ci_low", "ci_high", "mean_time_s", "sd_time_s",
            "mean_commands", "timeouts", *ANOMALIES, *trial_types, 
            *(["fmu_failures", "verdict"] if has_fmus else []),
        ]
    )  # fmt: skip
    for label, point in zip(labels, table, strict=True):
        numbers: list[float | None] = [None] * 6
        if point.trials:
            means = point.mean_time, point.sd_time, point.mean_commands
            numbers = [point.success_rate, *point.interval, *means]
        rates = [point.rate_of(trial_type) for trial_type in trial_types]
        writer.writerow(
            [
                *label, point.trials, point.successes, *map(_cell, numbers),
                point.timeouts, *point.anomalies.values(), *map(_cell, rates),
                *([len(point.fmu_failures), point.verdict] if has_fmus else []),
            ]
        )  # fmt: skip
    return text.getvalue().encode()


def _cell(number: float | None) -> str:
    return "" if number is None else f"{number:.6f}"


def plain(value: Decimal) -> str:
    """A value as text, without exponent and without trailing zeros in its fraction."""
    text = f"{value:f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text == "-0" else text
