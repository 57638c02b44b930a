"""The page on streets and poles: what maps, dogs and widths of streets make of success."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from harness.files import write_whole
from harness.sweep.sweep import plan_sweep
from harness.sweep.table import Z_95, Point
from harness.sweep.trials import TRIAL_TYPES
from harness.terminal import percent
from harness.trial.scenario import Scenario, Street, about, load
from harness.verification.page import FULL, RESULTS, TEMPLATES
from harness.verification.runs import DRAWN, Size, run
from harness.verification.tables import markdown
from models.kit.units import DEG
from models.streets import CanineInStreets

PAGE = "streets.md"
THRESHOLD = "49:49"  # deg, of the field's structured trials
HALF_WIDTHS = (1.0, 1.5, 2.5)  # m
DOGS = {"default": (), "`table_5_1`": DRAWN}
SYSTEMS: tuple[Literal["cts", "full"], ...] = ("cts", "full")
SHIPPED = ("downtown_two", "downtown_three", "crossing", "star")


@dataclass(frozen=True)
class Layout:
    """Where streets cross the first one, which leads to the first waypoint and as far again.

    Attributes:
        directions: of the others, rad from the first one's; none for one street in the turn's direction.
        before: where they cross, m before the waypoint.
    """

    directions: Sequence[float] = ()
    before: float = 0.0

    def streets(self, scenario: Scenario, half_width: float) -> tuple[Street, ...]:
        """The streets for a trial with two waypoints, the first one straight to the north."""
        (north, _), (to_north, to_east) = scenario.waypoints
        directions = self.directions or [math.atan2(to_east, to_north - north)]
        ways = [(north * math.cos(angle), north * math.sin(angle)) for angle in directions]
        at = north - self.before
        others = [Street((at - n, -e), (at + n, e), half_width) for n, e in ways]
        return (Street((0.0, 0.0), (2 * north, 0.0), half_width), *others)


CROSSING, STAR, EARLY = Layout(), Layout([90 * DEG, 45 * DEG, 135 * DEG]), Layout(before=2.5)


def rates(dog: str, half_width: float, layout: Layout, trials: int) -> list[float]:
    """The success rates of the four types of trials on a map."""
    points = []
    for name in TRIAL_TYPES["three"]:
        scenario = load(name)
        scenario = replace(scenario, streets=layout.streets(scenario, half_width))
        points.append(point_of(scenario, trials, "field", DOGS[dog]))
    return [point.success_rate for point in points]


def point_of(
    target: Scenario,
    trials: int,
    reading: str | None = None,
    settings: Sequence[str] = (),
    system: Literal["cts", "full"] = "cts",
) -> Point:
    """The trials of a scenario at 49 deg."""
    sweep = plan_sweep(
        target, thresholds=THRESHOLD, trials=trials, reading=reading, settings=settings, system=system
    )
    return run(sweep).table[0]


def write(folder: Path = RESULTS, size: Size = FULL) -> None:
    """Write the page.

    Raises:
        FileError: it cannot be written.
    """
    write_whole(folder / PAGE, TEMPLATES.get_template(f"{PAGE}.jinja").render(_context(size)).encode())


def _context(size: Size) -> dict[str, object]:
    by_map = {
        (dog, half_width): [rates(dog, half_width, layout, size.street) for layout in (CROSSING, STAR, EARLY)]
        for dog in DOGS
        for half_width in HALF_WIDTHS
    }
    narrow = [_mean(by_type) for dog in DOGS for k, by_type in enumerate(by_map[dog, 1.0]) if k != 1]
    half = 100 * Z_95 * 0.5 / math.sqrt(size.street)  # of the interval of a rate of 50 %, in points
    return {
        "size": size,
        "cone": _degrees("street_cone"),
        "lag": _degrees("street_lag"),
        "of_type": math.ceil(10 * half) / 10,
        "of_mean": math.ceil(10 * half / 2) / 10,
        "by_map": map_table(by_map),
        "shipped": shipped_table(size),
        "least": percent(min(narrow)),
        "most": percent(max(narrow)),
    }


def map_table(by_map: dict[tuple[str, float], list[list[float]]]) -> str:
    """Success by dog, half-width and layout."""
    rows = []
    for (dog, half_width), (crossing, star, early) in by_map.items():
        by_type = ", ".join(f"{100 * rate:.1f}" for rate in crossing)
        means = (percent(_mean(each)) for each in (crossing, star, early))
        rows.append([dog, f"{half_width:g} m", f"{by_type} %", *means])
    types = ", ".join(name.replace("_", " ") for name in TRIAL_TYPES["three"])
    columns = [f"one crossing: {types}", "mean", "star: mean", "one crossing 2.5 m before the waypoint: mean"]
    return markdown(["dog", "half-width", *columns], rows)


def _degrees(parameter: str) -> str:
    """A parameter of the dog by default."""
    return f"{CanineInStreets.variables()[parameter].start[0] / DEG:g} deg"


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def shipped_table(size: Size) -> str:
    """Success of the scenarios that come with the project."""
    rows = []
    for name in SHIPPED:
        row = [f"`{name}`: {about(name).partition(' (')[0]}"]
        for system in SYSTEMS:
            point = point_of(load(name), size.shipped, system=system)
            low, high = point.interval
            row.append(f"{percent(point.success_rate)} ({100 * low:.1f} to {100 * high:.1f})")
        rows.append(row)
    return markdown(["scenario", *(f"success in {system} (95 % interval)" for system in SYSTEMS)], rows)
