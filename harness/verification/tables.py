"""The page's tables, in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from harness.sweep.recommend import recommend
from harness.sweep.table import Point
from harness.sweep.trials import TRIAL_TYPES
from harness.terminal import percent
from harness.verification.published import (
    ALL_FROM,
    ALL_FROM_BY_TREND,
    AT_15_ABOVE,
    FIELD,
    R_SQUARED,
    TREND_AT_23,
    Field,
    joint_p_value,
    log_likelihood,
)
from harness.verification.runs import (
    AIMED_DOGS,
    AIMS,
    CAUSES,
    DIFFERENT,
    DISTANCES,
    DOGS,
    DRAWS,
    EXPLANATIONS,
    NO_LIMIT,
    OBEDIENT,
    ROUTES,
    Simulated,
    Size,
    mean_time_error,
    simulate,
    time_difference,
)
from models.readings import PUBLISHED

TYPES = [name.replace("_", " ") for name in TRIAL_TYPES["three"]]


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of the page; all columns except the first are aligned right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def seconds(point: Point) -> str:
    """Mean time of the successful trials."""
    return "-" if point.mean_time is None else f"{point.mean_time:.2f} s"


def _p(value: float) -> str:
    """A probability with two digits."""
    return f"{value:.2g}".replace("e-0", "e-")


def statements(size: Size) -> str:
    """The statements of 5.3.5 to 5.3.7.1 on the simulation beside our numbers."""
    two = {reading: simulate("two", "15:90", size.curve, reading) for reading in PUBLISHED}
    three = {reading: simulate("three", "15:65", size.curve, reading) for reading in PUBLISHED}

    def line(what: str, theirs: str, ours: Iterable[str]) -> list[str]:
        return [what, theirs, *ours]

    return markdown(
        ["what", "dissertation", *PUBLISHED],
        [
            line(
                "two waypoints, success at 15 deg",
                f"above {100 * AT_15_ABOVE:.0f} %",
                (percent(two[r].at(15).success_rate) for r in PUBLISHED),
            ),
            line(
                f"two waypoints, lowest success from {ALL_FROM} deg on",
                "100 %",
                (percent(two[r].rates[two[r].thresholds >= ALL_FROM].min()) for r in PUBLISHED),
            ),
            line(
                "two waypoints, h' from which the trend is at 100 %",
                f"{ALL_FROM_BY_TREND} deg",
                (_whole_from(two[r]) for r in PUBLISHED),
            ),
            line(
                "two waypoints, trend at 23 deg",
                f"{100 * TREND_AT_23:.0f} %",
                (percent(float(two[r].trend[0](np.array([23.0]))[0])) for r in PUBLISHED),
            ),
            line(
                "two waypoints, R² of the trend",
                percent(R_SQUARED["two"]),
                (percent(two[r].trend[1]) for r in PUBLISHED),
            ),
            line(
                "three waypoints, R² of the trend",
                percent(R_SQUARED["three"]),
                (
                    f"{percent(three[r].trend[1])} (straight line {percent(straight_line(three[r]))})"
                    for r in PUBLISHED
                ),
            ),
        ],
    )


def _whole_from(simulated: Simulated) -> str:
    """The first threshold at which the trend reaches 100 %."""
    whole = simulated.thresholds[simulated.trend[0](simulated.thresholds) >= 1.0]
    return f"{whole[0]:.0f} deg" if whole.size else "none"


def straight_line(simulated: Simulated) -> float:
    """R2 of a straight line through the success rates."""
    return float(np.corrcoef(simulated.thresholds, simulated.rates)[0, 1] ** 2)


def our_rate(field: Field, reading: str, size: Size, settings: tuple[str, ...] = ()) -> float:
    """The success rate of our trials under the conditions of field trials."""
    return _at(field, reading, size, settings).success_rate


def _at(field: Field, reading: str, size: Size, settings: tuple[str, ...] = ()) -> Point:
    thresholds = "37:49:12" if field.waypoints == "three" else "49:49" if field.threshold == 49 else "23:37:7"
    return simulate(field.waypoints, thresholds, size.rate, reading, settings).at(field.threshold)


def likelihood_table(size: Size) -> str:
    """How likely each reading and dog make the field's counts, all together."""
    open_ones = [i for i, field in enumerate(FIELD) if field.environment == "non-structured"]
    rows = []
    for name, (reading, settings) in EXPLANATIONS.items():
        points = [_at(field, reading, size, settings) for field in FIELD]
        rates = [(p.successes + 0.5) / (p.trials + 1) for p in points]  # never 0 or 1
        parts = [([FIELD[i] for i in chosen], [rates[i] for i in chosen])
                 for chosen in (open_ones, range(len(FIELD)))]  # fmt: skip
        cells = [f"{log_likelihood(*part):.1f}, {_p(joint_p_value(*part))}" for part in parts]
        rows.append([name, *(percent(p.success_rate) for p in points), *cells])
    conditions = [f"{f.waypoints}, {f.threshold} deg" for f in FIELD]
    counts = [f"{f.successes}/{f.trials} = {percent(f.successes / f.trials)}" for f in FIELD]
    return markdown(
        ["reading", *conditions, "not structured: ln L, p", "all six: ln L, p"],
        [["the field", *counts, "0", "0"], *rows],
    )


def field_table(size: Size) -> str:
    """Success rates in the field with their intervals, our rates, and the field's p-values under ours."""
    rows = []
    for waypoints in ("two", "three"):
        fields = [field for field in FIELD if field.waypoints == waypoints]
        trials = sum(field.trials for field in fields)
        for field in fields:
            what = f"{waypoints}, {field.threshold} deg, {field.environment}"
            rows += [
                [what, *_compared(field, reading, our_rate(field, reading, size))] for reading in PUBLISHED
            ]
        whole = Field(waypoints, 0, sum(field.successes for field in fields), trials, "")
        for reading in PUBLISHED:
            rate = sum(field.trials * our_rate(field, reading, size) for field in fields) / trials
            rows.append([f"{waypoints}, all {trials}", *_compared(whole, reading, rate)])
    return markdown(
        ["waypoints, h', environment", "field", "95 % interval", "reading", "ours", "inside?", "p", ""], rows
    )


def _compared(field: Field, reading: str, rate: float) -> list[str]:
    low, high = field.interval
    p = field.p_value(rate)
    return [
        f"{field.successes}/{field.trials} = {percent(field.successes / field.trials)}",
        f"{100 * low:.1f} to {100 * high:.1f} %",
        reading,
        percent(rate),
        "yes" if low <= rate <= high else "no",
        _p(p),
        "agrees" if p >= 0.05 else "**differs**",
    ]


def time_table(size: Size) -> str:
    """Mean times of two-waypoint trials, with 95 % intervals."""
    rows = []
    for threshold in (23, 30, 37):
        cells = [f"{threshold} deg"]
        for reading in DIFFERENT["two"]:
            point = simulate("two", "23:37:7", size.rate, reading).at(threshold)
            cells += [percent(point.success_rate), f"{point.mean_time:.2f} ± {mean_time_error(point):.2f} s"]
        rows.append(cells)
    return markdown(["h'", *(f"{r} {what}" for r in DIFFERENT["two"] for what in ("success", "time"))], rows)


def cause_table(size: Size) -> str:
    """The time that each cause adds, and the success rate with it."""
    plain = simulate("two", "23:37:7", size.rate)
    rows = [["none", *(f"{seconds(p)}, {percent(p.success_rate)}" for p in plain.table)]]
    for cause, settings in CAUSES.items():
        caused = simulate("two", "23:37:7", size.rate, settings=settings)
        cells = [cause]
        for ticks, other, point in zip(caused.ticks, plain.ticks, caused.table, strict=True):
            later, error = time_difference(ticks, other)
            cells.append(f"{later:+.2f} ± {error:.2f} s, {percent(point.success_rate)}")
        rows.append(cells)
    return markdown(["cause", *(f"{threshold:.0f} deg" for threshold in plain.thresholds)], rows)


def late_table(size: Size) -> str:
    """Three waypoints at 49 deg with a dog that responds late."""
    rows = []
    for delay in (0.0, 0.1, 0.2, 0.3):
        point = simulate("three", "49:49", size.rate, settings=(f"canine.response_delay={delay}",)).at(49)
        rows.append([f"{delay:.1f} s", percent(point.success_rate), *_by_type(point), seconds(point)])
    return markdown(["late by", "success", *TYPES, "time"], rows)


def _by_type(point: Point) -> list[str]:
    return [percent(point.rate_of(name) or 0.0) for name in TRIAL_TYPES["three"]]


def dog_table(size: Size, reading: str) -> str:
    """Dogs of several kinds, which show why trials fail: three waypoints at 49 deg."""
    rows = []
    for dog, settings in DOGS.items():
        point = simulate("three", "49:49", size.rate, reading, settings).at(49)
        rows.append([dog, percent(point.success_rate), *_by_type(point), seconds(point)])
    return markdown(["dog", "success", *TYPES, "time"], rows)


def drawn_table(size: Size) -> str:
    """What drawn speeds and accelerations change: three waypoints, `field`."""
    rows = []
    for what, settings in DRAWS.items():
        simulated = simulate("three", "37:49:12", size.rate, "field", settings)
        late = simulated.at(49)
        rates = [percent(point.success_rate) for point in simulated.table]
        rows.append([what, *rates, *_by_type(late), seconds(late)])
    return markdown(["drawn", "37 deg", "49 deg", *TYPES, "time"], rows)


def aim_table(size: Size) -> str:
    """What a controller gains that aims off: three waypoints at 49 deg, several dogs."""
    rows = []
    for dog, settings in AIMED_DOGS.items():
        points = [
            simulate("three", "49:49", size.rate, reading, (*settings, *aim)).at(49)
            for reading in ("calibrated", "field")
            for aim in AIMS.values()
        ]
        rows.append([dog, *(percent(point.success_rate) for point in points)])
    points = [
        simulate("distance_100", "49:49", size.long, reading, aim).at(49)
        for reading in ("calibrated", "field")
        for aim in AIMS.values()
    ]
    rows.append(["means, one leg of 100 m", *(percent(point.success_rate) for point in points)])
    return markdown(["dog", *(f"{r}: {aim}" for r in ("calibrated", "field") for aim in AIMS)], rows)


def distance_table(size: Size) -> str:
    """Two waypoints farther and farther apart."""
    rows = []
    for distance in DISTANCES:
        waypoint = (f"controller.waypoint_north[1]={distance}",)
        points = [simulate("distance_100", "49:49", size.long, r, waypoint).at(49) for r in DIFFERENT["two"]]
        free = simulate("distance_100", "29:89:20", size.long, settings=(*waypoint, *NO_LIMIT))
        rows.append(
            [f"{distance} m"]
            + [f"{percent(p.success_rate)}, {seconds(p)}" for p in points]
            + [percent(free.at(49).success_rate), *(seconds(p) for p in free.table)]
        )
    thresholds = [f"{h} deg" for h in (29, 49, 69, 89)]
    return markdown(["distance", *DIFFERENT["two"], "no limit: success", *thresholds], rows)


def route_table(size: Size) -> str:
    """Three, four and five waypoints around 122 m, by what MAXTURN counts."""
    budgets: dict[str, tuple[str, tuple[str, ...]]] = {
        "calibrated: 2 a trial": ("calibrated", ("cmec.reset_turns=false",)),
        "`field`: 2 a waypoint": ("field", ()),
        "literal: 2 a waypoint, re-issues count": ("literal", ("cmec.reset_turns=true",)),
        "literal, rates 1": ("literal", ("cmec.reset_turns=true", *OBEDIENT)),
    }
    rows = []
    for waypoints, scenario in ROUTES.items():
        points = (simulate(scenario, "49:49", size.rate, *budget).at(49) for budget in budgets.values())
        rows.append([str(waypoints), *(f"{percent(p.success_rate)}, {seconds(p)}" for p in points)])
    return markdown(["waypoints", *budgets], rows)


def guarded_table(size: Size) -> str:
    """What the safety rules cost: turns counted by waypoint, without the limits and with them."""
    rows = []
    for waypoints, target, threshold in (("two", "two", 23), ("two", "two", 37), ("three", "three", 49)):
        free = simulate(target, f"{threshold}:{threshold}", size.rate, "field")
        held = simulate(target, f"{threshold}:{threshold}", size.rate, "guarded")
        points = [one.at(threshold) for one in (free, held)]
        spent = held.at(threshold).anomalies["budget_spent"] / held.at(threshold).trials
        cells = [f"{percent(p.success_rate)}, {seconds(p)}" for p in points]
        rows.append([f"{waypoints}, {threshold} deg", *cells, percent(spent)])
    return markdown(["waypoints, h'", "without limits", "`guarded`", "ended by a spent budget"], rows)


def recommendation_table(size: Size) -> str:
    """The recommendations of `canine sweep`."""
    rows = []
    for target, thresholds in (("two", "15:90"), ("three", "15:65")):
        for reading in DIFFERENT[target]:
            ranked = simulate(target, thresholds, size.ranked, reading)
            axes = [(axis.column, axis.unit, axis.written) for axis in ranked.sweep.axes]
            advice = recommend(axes, ranked.table, ranked.ticks)
            cells = (_recommended(advice[criterion]) for criterion in ("success", "time", "both"))
            rows.append([f"{target}, {reading}", *cells])
    return markdown(["waypoints, reading", "best success", "shortest time", "fastest of the best"], rows)


def _recommended(advice: Mapping[str, Any]) -> str:
    """The range, the best point, and whether the range reaches the ends of the sweep."""
    if "range" not in advice:
        return str(advice["text"])
    ((low, high),) = advice["range"].values()
    best = advice["best"]
    (end,) = advice["range_ends"].values()
    beyond = {"start": ", to the sweep's start", "end": ", to the sweep's end", "both": ", everywhere"}
    span = f"{low} to {high}" if low != high else f"{low}"
    return (
        f"{span} deg{beyond.get(end, '')} (best at {best['threshold_deg']}: "
        f"{percent(best['success_rate'])}, {best['mean_time_s']:.2f} s)"
    )
