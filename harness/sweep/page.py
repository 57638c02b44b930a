"""Pages of sweeps and matrices: every point with its numbers, and the trials behind it by seed."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from harness.report.page import render
from harness.sweep.chunks import TICK_S, Outcomes
from harness.sweep.table import Point, plain
from harness.terminal import percent
from harness.trial.scenario import Scenario

if TYPE_CHECKING:
    from harness.sweep.matrix import Result
    from harness.sweep.sweep import Sweep

MOST_TRIALS = 200_000  # listed on a page, evenly over its points
MOST_SCENARIOS = 400  # on a page: with more points none can be run again from there
SEED = re.compile(r"(?m)^(seed = )(-?\d+)$")


@dataclass(frozen=True)
class Place:
    """A point on a page.

    Attributes:
        label: what it is, in words.
        point: its numbers; None if it could not run, and why stands in `refused`.
        ticks: of each trial, by number: 0 of those without success.
        scenarios: of its trials in turns, as they ran; `options` of `canine run` beside them.
    """

    label: str
    point: Point | None
    ticks: npt.NDArray[np.unsignedinteger[Any]] = field(default_factory=lambda: np.empty(0, np.uint32))
    scenarios: Sequence[Scenario] = ()
    options: str = ""
    refused: str = ""


@dataclass(frozen=True)
class Grid:
    """A table of places: their numbers in `places`, by row and column."""

    title: str
    row: str
    column: str
    rows: Sequence[str]
    columns: Sequence[str]
    cells: Sequence[Sequence[int]] = field(default_factory=list)


def sweep_page(sweep: Sweep, table: Sequence[Point], outcomes: Outcomes, texts: Sequence[str]) -> bytes:
    """The page of a sweep; `texts` are its recommendations in words."""
    options = "".join(f" --{role} {name}" for role, name in sweep.named.items())
    few = len(table) * len(sweep.scenarios) <= MOST_SCENARIOS
    places = []
    for index, (values, settings, point) in enumerate(zip(sweep.points, sweep.settings, table, strict=True)):
        label = ", ".join(f"{axis.label} {plain(v)}" for axis, v in zip(sweep.axes, values, strict=True))
        scenarios = [s.override(settings, swaps=sweep.blocks) for s in sweep.scenarios] if few else []
        ticks = outcomes.ticks[index][: outcomes.ran[index]]
        places.append(Place(label, point, ticks, scenarios, options))
    first, *second = sweep.axes
    axis, grids = None, []
    if second:
        width = len(second[0].written)
        rows, columns = ([plain(v) for v in varied.written] for varied in sweep.axes)
        cells = [[row * width + column for column in range(width)] for row in range(len(rows))]
        grids.append(Grid("success rate", first.label, second[0].label, rows, columns, cells))
    else:
        axis = {"label": first.label, "values": [float(v) for v in first.written]}
    return _page("sweep", sweep.about, places, seed=sweep.seed, axis=axis, grids=grids, texts=texts)


def matrix_page(result: Result, outcomes: Outcomes, texts: Sequence[str]) -> bytes:
    """The page of a matrix; `texts` are its comparisons in words."""
    matrix = result.matrix
    ran = {name: index for index, name in enumerate(matrix.jobs)}
    scenarios = {scenario.name: scenario for scenario in matrix.scenarios}
    places = []
    for name in matrix.cells:
        controller, plant, scenario = name
        place = Place(", ".join(name), None, refused=result.verdict(name))
        if name in ran:
            ticks = outcomes.ticks[ran[name]][: outcomes.ran[ran[name]]]
            options = f" --controller {controller} --plant {plant}"
            again = () if matrix.settings else (scenarios[scenario],)  # a setting acts in some cells only
            place = Place(place.label, result.table[name], ticks, again, options)
        places.append(place)
    numbers = {name: index for index, name in enumerate(matrix.cells)}
    grids = [
        Grid(
            scenario,
            "controller",
            "plant",
            matrix.controllers,
            matrix.plants,
            [[numbers[c, p, scenario] for p in matrix.plants] for c in matrix.controllers],
        )
        for scenario in scenarios
    ]
    return _page("matrix", matrix.about, places, seed=matrix.seed, axis=None, grids=grids, texts=texts)


def _page(
    kind: str,
    about: str,
    places: Sequence[Place],
    *,
    seed: int,
    axis: Mapping[str, Any] | None,
    grids: Sequence[Grid],
    texts: Sequence[str],
) -> bytes:
    listed = max(MOST_TRIALS // max(len(places), 1), 1)
    data = {
        "tick": TICK_S,
        "axis": axis,
        "grids": [vars(grid) for grid in grids],
        "points": [_data(place, seed, listed) for place in places],
    }
    return render(
        "points.html.jinja",
        kind.capitalize(),
        data,
        ("points.js",),
        styles=("points.css",),
        maps=False,
        sentence=about,
        texts=texts,
        table=f"{kind}.csv",
    )


def _data(place: Place, seed: int, listed: int) -> dict[str, Any]:
    """A point as points.js takes it."""
    point = place.point
    if point is None or not point.trials:
        why = place.refused or (point.verdict if point else "")
        numbers = [("trials", "0"), ("why", why)]
        rate = low = high = time = None
    else:
        numbers, rate, time = _numbers(point), point.success_rate, point.mean_time
        low, high = point.interval
    left = len(place.ticks) - listed
    if left > 0:
        numbers.append(("not listed", f"{left} trials"))
    return {
        "label": place.label,
        "numbers": numbers,
        "rate": rate,
        "low": low,
        "high": high,
        "time": time,
        "seed": seed,
        "ticks": place.ticks[:listed].tolist(),
        "options": place.options,
        "scenarios": [_halves(scenario) for scenario in place.scenarios],
    }


def _numbers(point: Point) -> list[tuple[str, str]]:
    """A point's numbers in words."""
    low, high = point.interval
    numbers = [
        ("trials", str(point.trials)),
        ("successes", f"{point.successes}, {percent(point.success_rate)}"),
        ("95 % interval", f"{100 * low:.1f} to {100 * high:.1f} %"),
        ("mean time", _with_unit(point.mean_time, "s")),
        ("its standard deviation", _with_unit(point.sd_time, "s")),
        ("directional commands", _with_unit(point.mean_commands, "in a success")),
        ("timeouts", str(point.timeouts)),
    ]
    for name in point.trial_types:
        share = point.rate_of(name)
        numbers.append((name, "no trials" if share is None else f"{percent(share)} succeed"))
    numbers += [
        (f"{name.lower().replace('_', ' ')} (ticks)", str(count))
        for name, count in point.anomalies.items()
        if count
    ]
    return [*numbers, ("FMUs", point.verdict)] if point.verdict else numbers


def _with_unit(value: float | None, unit: str) -> str:
    return "\u2013" if value is None else f"{value:.2f} {unit}"


def _halves(scenario: Scenario) -> tuple[str, str]:
    """A scenario's text before and after its seed."""
    before, after = SEED.sub(lambda line: line[1] + "\0", scenario.text(), count=1).split("\0")
    return before, after
