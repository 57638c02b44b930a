"""Which values of the varied parameters are best, with statistical confidence.

Results at each point are partly chance, and many points are compared. The rule: a point is named among the
best unless the trials show that it is worse than the point that did best. Chance also decides which point
does best, so each of the K (K - 1) ordered pairs of points gets an equal share of 5 % (Bonferroni's bound).
In at least 95 % of all sweeps every point left out is truly worse, the truly best point is named, and a flat
curve is called flat. More trials make the choice sharper.

Trial i has the same seed at every point, so points are compared trial by trial, which removes most of the
chance:

- **success**: McNemar's exact test, one-sided, of the trials that succeeded at only one of the two points.
- **time** of the successful trials: the difference of the two means over its standard error. Each trial's
  share in the error of a mean is its deviation from the mean over the number of successes, 0 if it failed;
  the paired shares give the error of the difference. A point with fewer than 30 successes is not judged.
- **both**: the fastest among the best for success. Where few trials succeed they are the easy ones, so a
  short time with a low success rate is not an advantage.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

import numpy as np
import numpy.typing as npt

from harness.sweep.chance import heads, student
from harness.sweep.table import Point, name_of, plain
from harness.terminal import percent

ALPHA = 0.05  # share of sweeps in which the best point may be missing among those named
LEAST = 30  # successes from which on a point's mean time is judged
RULE = (
    "A point is named unless it is shown to be worse than the one that did best: one-sided tests of the "
    "trials paired by their seeds, at 5 % over all pairs of points (Bonferroni). Success: McNemar's exact "
    "test. Time, of the successful trials: t-test of the paired difference of the means; points with fewer "
    f"than {LEAST} successes are not judged. Both: the fastest among the best for success. The range is the "
    "connected stretch of named points around the best one. Pareto: by the means as measured, of the points "
    "judged; no other one has a success rate at least as high and a time at least as short, and is better in "
    "one of the two. A trial that an FMU's failure ended counts as none; a point given up for such failures "
    "is not judged."
)
ENDS = {(False, False): "inside", (True, False): "start", (False, True): "end", (True, True): "both"}
WORDS = {
    "inside": "",
    "start": "; it begins where the range{} begins: no optimum inside is shown, smaller values may do better",
    "end": "; it goes on to where the range{} ends: no optimum inside is shown, larger values may do better",
    "both": "; it spans the whole range{}: no optimum inside is shown",
}
UNJUDGED = {
    "start": "; below the stretch{} nothing could be judged: no optimum inside is shown",
    "end": "; above the stretch{} nothing could be judged: no optimum inside is shown",
    "both": "; below and above the stretch{} nothing could be judged: no optimum inside is shown",
}
MENTIONED = 6  # points that a text names one by one at most
Mask = npt.NDArray[np.bool_]
Ticks = npt.NDArray[np.unsignedinteger[Any]]


@dataclass(frozen=True)
class Finding:
    """The best of K points by one criterion.

    Attributes:
        best: index of the point that did best.
        named: (K,) the points not shown to be worse.
        unjudged: (K,) the points that could not be compared.
    """

    best: int
    named: Mask
    unjudged: Mask


def best_for_success(ticks: Ticks, ran: Mask | None = None, among: Mask | None = None) -> Finding:
    """Which of K points are not shown to succeed less often than the best.

    Of several points with the highest rate, the fastest counts as the best.

    Args:
        ticks: (K, trials), 0 is a failure.
        ran: (K, trials) the trials that no FMU ended; all by default. Pairs of them are compared.
        among: (K,) the points to compare, one at least; all by default.
    """
    ran = np.ones(ticks.shape, dtype=bool) if ran is None else ran
    judged = np.ones(len(ticks), dtype=bool) if among is None else among
    successes = [int(np.count_nonzero(row)) for row in ticks]
    rates = [n / max(int(np.count_nonzero(row)), 1) for row, n in zip(ran, successes, strict=True)]
    mean = [row.sum(dtype=np.int64) / max(n, 1) for row, n in zip(ticks, successes, strict=True)]
    best = min(map(int, np.flatnonzero(judged)), key=lambda i: (-rates[i], mean[i], i))
    pairs = ran & ran[best]
    only_best = np.count_nonzero(pairs & (ticks[best] > 0) & (ticks == 0), axis=1)
    only_this = np.count_nonzero(pairs & (ticks[best] == 0) & (ticks > 0), axis=1)
    # if equal, a trial won at one point only is either's
    by_chance = np.array(
        [heads(int(gains), int(gains + losses)) for gains, losses in zip(only_best, only_this, strict=True)]
    )
    named = judged & (by_chance > ALPHA / _pairs(int(judged.sum())))
    return Finding(best, named, ~judged)


def best_for_time(ticks: Ticks, among: Mask | None = None) -> Finding | None:
    """Which of K points are not shown to be slower than the fastest.

    Args:
        ticks: (K, trials), 0 is a failure.
        among: (K,) the points to compare; all by default.

    Returns:
        None if every point has fewer than LEAST successes.
    """
    successes = np.array([np.count_nonzero(row) for row in ticks])
    candidates = np.ones(len(ticks), dtype=bool) if among is None else among
    judged = candidates & (successes >= LEAST)
    if not judged.any():
        return None
    means = np.array([row.sum(dtype=np.int64) for row in ticks]) / np.maximum(successes, 1)
    best = int(np.argmin(np.where(judged, means, np.inf)))
    share = error_shares(ticks[best], means[best])
    level = 1 - ALPHA / _pairs(int(judged.sum()))
    named = np.zeros(len(ticks), dtype=bool)
    for i in np.flatnonzero(judged):
        error = math.sqrt(float(np.sum((error_shares(ticks[i], means[i]) - share) ** 2)))
        least = min(successes[i], successes[best])
        spread = error * math.sqrt(least / (least - 1))
        named[i] = means[i] - means[best] <= student(level, int(least) - 1) * spread
    return Finding(best, named, candidates & ~judged)


def _pairs(points: int) -> int:
    """Number of ordered pairs (the best point, another), any of which chance may pick; at least 1."""
    return max(1, points * (points - 1))


def error_shares(row: Ticks, mean: float) -> npt.NDArray[np.float64]:
    """Each trial's share in the error of the mean [ticks] over the successful ones: (trials,), as `row`.

    The root of the sum of the squared shares is the mean's standard error. The same of two rows' paired
    differences is the standard error of the difference of the means.
    """
    shares: npt.NDArray[np.float64] = np.where(row > 0, row - mean, 0.0) / np.count_nonzero(row)
    return shares


def pareto(table: Sequence[Point]) -> list[int]:
    """The points for which no other is at least as good in success rate and mean time, and better in one.

    Points with fewer than LEAST successes are not compared: their mean times are chance.
    """
    measured = [
        (i, p.success_rate, p.mean_time)
        for i, p in enumerate(table)
        if p.mean_time is not None and p.successes >= LEAST
    ]
    front: list[int] = []
    least = math.inf
    last: tuple[float, float] | None = None
    for i, rate, time in sorted(measured, key=lambda p: (-p[1], p[2], p[0])):
        if time < least or (rate, time) == last:
            front.append(i)
            least, last = time, (rate, time)
    return sorted(front)


def recommend(
    axes: Sequence[tuple[str, str, Sequence[Decimal]]], table: Sequence[Point], ticks: Ticks
) -> dict[str, Any]:
    """What the sweep recommends, with the keys of recommendation.json.

    Its `advice` has each text once, and one of all flat criteria; none where there is nothing to compare.

    A trial that an FMU's failure ended counts as none. A point that was given up is not judged.

    Args:
        axes: column, unit and values of each varied parameter; the last varies first from point to point.
        table: a row for each point.
        ticks: (points, trials), the tick on which a trial succeeded, 0 if it failed.
    """
    ran = np.ones(ticks.shape, dtype=bool)
    for row, point in zip(ran, table, strict=True):
        row[point.trials :] = False
        row[[failure.number for failure in point.fmu_failures]] = False
    judged = np.array([not point.gave_up for point in table]) & ran.any(axis=1)
    describe = _Describer(axes, table, judged)
    front = pareto(describe.table)
    success = best_for_success(ticks, ran, judged) if ticks[judged].any() else None
    time = best_for_time(ticks, judged)
    both = best_for_time(ticks, success.named) if success else None
    criteria = {
        "success": ("best success rate", success, _rate),
        "time": ("shortest time", time, _time),
        "both": ("fastest of those with the best success rate", both, _time),
    }
    no_time = f"too few successes to compare times; expected {LEAST} at a point: run more trials"
    without = {
        "success": f"best success rate: no trial succeeded{describe.spoiled or ' at any point'}",
        "time": no_time,
        "both": no_time,
    }
    described = {
        key: describe(what, finding, measure) if finding else {"text": without[key]}
        for key, (what, finding, measure) in criteria.items()
    }
    described["pareto"] = {
        "text": describe.front(front),
        "points": [describe.point(i) for i in front],
        "unjudged": describe.named(describe.few | ~judged),
    }
    flat = {key: criteria[key] for key, row in described.items() if row.get("flat")}
    together = describe.flat(flat.values())
    texts = dict.fromkeys(together if key in flat else row["text"] for key, row in described.items())
    advice = list(texts) if len(table) > 1 else []
    return {"rule": RULE, "confidence": 1 - ALPHA, **described, "advice": advice}


def _rate(point: Point) -> str:
    return percent(point.success_rate)


def _time(point: Point) -> str:
    return f"{point.mean_time:.2f} s"


def _reaches(places: Sequence[int], size: int) -> tuple[bool, bool]:
    """Whether places along an axis reach its start and its end."""
    return places[0] == 0, places[-1] == size - 1


class _Describer:
    """Turns findings into words and plain data."""

    def __init__(
        self, axes: Sequence[tuple[str, str, Sequence[Decimal]]], table: Sequence[Point], judged: Mask
    ) -> None:
        self.axes = axes
        self.table = [
            point.without_failures if is_judged else point
            for point, is_judged in zip(table, judged, strict=True)
        ]
        self.grid = tuple(len(values) for _, _, values in axes)
        self.judged = judged
        self.few = judged & np.array([0 < point.successes < LEAST for point in table])
        shortened = judged & np.array([bool(point.fmu_failures) for point in table])
        self.spoiled = self.rest("; without the trials that FMUs ended at ", shortened)
        self.spoiled += self.rest("; not judged, since FMUs failed: ", ~judged)

    def __call__(self, what: str, finding: Finding, measure: Callable[[Point], str]) -> dict[str, Any]:
        """A finding's range, whether the optimum lies inside the varied range, and both in words.

        Args:
            what: the criterion in words.
            measure: a point's value of the criterion in words.
        """
        region = self.around(finding.best, finding.named)
        unjudged = finding.unjudged | ~self.judged
        open_region = self.around(finding.best, finding.named | unjudged)
        ranges, ends, words = {}, {}, ""
        for axis, (column, _, values) in enumerate(self.axes):
            places = self.places(region, axis)
            ranges[column] = [number(values[places[0]]), number(values[places[-1]])]
            ends[column], shown, unknown = "one value", "inside", "inside"
            if len(values) > 1:
                start, end = _reaches(places, len(values))
                open_start, open_end = _reaches(self.places(open_region, axis), len(values))
                ends[column] = ENDS[open_start, open_end]
                shown = ENDS[start, end]
                unknown = ENDS[open_start and not start, open_end and not end]
            of = f" of {name_of(column)}" if len(self.axes) > 1 else ""
            words += WORDS[shown].format(of) + UNJUDGED.get(unknown, "").format(of)
        flat = bool(finding.named.all())
        interior = all(end in ("inside", "one value") for end in ends.values()) and not flat
        if len(self.table) == 1:
            text = f"{what}: one point, nothing to compare ({self.ranges(region)}: {measure(self.table[0])})"
            text += self.spoiled
        elif flat:
            text = self.flat([(what, finding, measure)])
        else:
            text = f"{what}: {self.ranges(region)} (best at {self.value(finding.best)}: "
            text += f"{measure(self.table[finding.best])})"
            text += words
            text += self.rest("; besides ", finding.named & ~region)
            text += self.rest("; too few successes to judge ", finding.unjudged & self.judged) + self.spoiled
        return {
            "text": text,
            "best": self.point(finding.best),
            "range": ranges,
            "points": self.named(finding.named),
            "unjudged": self.named(unjudged),
            "interior_optimum": interior,
            "flat": flat,
            "range_ends": ends,
        }

    def flat(self, criteria: Collection[tuple[str, Finding | None, Callable[[Point], str]]]) -> str:
        """Criteria, each with its finding and measure, by which no point is shown to be better, in words."""
        whats = ", ".join(what for what, _, _ in criteria)
        everywhere = self.ranges(np.ones(len(self.table), dtype=bool))
        bests = dict.fromkeys(
            f"best measured at {self.value(finding.best)}: {measure(self.table[finding.best])}"
            for _, finding, measure in criteria
            if finding
        )
        return (
            f"{whats}: no value of {everywhere} is shown to be better than another: flat, no optimum "
            f"({'; '.join(bests)}){self.spoiled}"
        )

    def front(self, indices: Sequence[int]) -> str:
        """The Pareto front in words: its two ends and some points between them."""
        few = self.rest("; too few successes to judge ", self.few) + self.spoiled
        if not indices:
            why = f"no point has {LEAST} successes" if self.few.any() else "no trial succeeded"
            return f"Pareto front of success rate and time: empty, {why}"
        steps = min(len(indices), MENTIONED)
        chosen = [indices[round(k * (len(indices) - 1) / max(1, steps - 1))] for k in range(steps)]
        points = (self.table[i] for i in chosen)
        texts = [f"{self.value(i)} ({_rate(p)}, {_time(p)})" for i, p in zip(chosen, points, strict=True)]
        left_out = f" and {len(indices) - steps} between" if len(indices) > steps else ""
        return f"Pareto front of success rate and time, as measured: {', '.join(texts)}{left_out}{few}"

    def around(self, best: int, mask: Mask) -> Mask:
        """The points of a mask that are connected to the best one, neighbour by neighbour."""
        inside = mask.reshape(self.grid)
        region = np.zeros_like(inside)
        left = [tuple(int(place) for place in np.unravel_index(best, self.grid))]
        while left:
            place = left.pop()
            if inside[place] and not region[place]:
                region[place] = True
                for axis, size in enumerate(self.grid):
                    for near in (place[axis] - 1, place[axis] + 1):
                        if 0 <= near < size:
                            left.append((*place[:axis], near, *place[axis + 1 :]))
        return region.ravel()

    def places(self, region: Mask, axis: int) -> list[int]:
        """The places along an axis where a region has points."""
        return sorted({int(place) for place in np.nonzero(region.reshape(self.grid))[axis]})

    def ranges(self, region: Mask) -> str:
        """How far a region reaches: `20 to 32 deg`."""
        texts = []
        for axis, (column, unit, values) in enumerate(self.axes):
            places = self.places(region, axis)
            first, last = plain(values[places[0]]), plain(values[places[-1]])
            span = first if first == last else f"{first} to {last}"
            texts.append(f"{name_of(column)} {span} {unit}".rstrip())
        return " and ".join(texts)

    def rest(self, what: str, mask: Mask) -> str:
        """A few points of a mask by their values, and how many more there are."""
        indices = np.flatnonzero(mask)
        if not indices.size:
            return ""
        more = f" and {indices.size - MENTIONED} more" if indices.size > MENTIONED else ""
        return what + ", ".join(self.value(int(i)) for i in indices[:MENTIONED]) + more

    def value(self, index: int) -> str:
        """A point's values as written."""
        written = self.table[index].written
        return plain(written[0]) if len(written) == 1 else f"({', '.join(map(plain, written))})"

    def named(self, mask: Mask) -> list[Any]:
        """The points of a mask, each by its value or the list of its values."""
        return [self.place(int(i)) for i in np.flatnonzero(mask)]

    def place(self, index: int) -> Any:
        """A point's value, or the list of its values."""
        values = [number(value) for value in self.table[index].written]
        return values[0] if len(values) == 1 else values

    def point(self, index: int) -> dict[str, Any]:
        """A point with its rate and time."""
        point = self.table[index]
        low, high = point.interval
        return {
            **{column: number(value) for (column, _, _), value in zip(self.axes, point.written, strict=True)},
            "success_rate": point.success_rate,
            "ci_low": low,
            "ci_high": high,
            "mean_time_s": point.mean_time,
        }


def number(value: Decimal) -> int | float:
    """A value as a JSON number, whole if it can be."""
    return int(value) if value == int(value) else float(value)
