"""What is asked for, resolved: the map, the scenario, the candidates; before any trial."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import get_args

import numpy as np

from harness.fit.stated import FITTED, stated_and_assumed
from harness.routes import CLEARANCES, LONGEST, SPACINGS, TRIALS, WAYS, Along
from harness.routes.candidates import Candidate, candidates_of, told_apart
from harness.routes.map_file import load
from harness.routes.open_ground import open_ways
from harness.routes.score import Scorer, route_scenario
from harness.routes.site import Place, RouteError, Site
from harness.routes.streets import street_ways
from harness.routes.way import OPEN, STREETS, Way, best
from harness.sweep.components import Components, find_components
from harness.sweep.trials import Options, adapted
from harness.trial import scenario as scenarios
from harness.trial.plan import Interface, interfaces_of_system
from harness.trial.scenario import MAX_COORDINATE, Scenario
from models.cmec import MAX_WAYPOINTS
from models.errors import nearest
from models.kit.random import MAX_SEED
from models.readings import ON_BOARD, READINGS
from models.system import ESTIMATOR

OF_ROUTE = (  # parameters of dogs and controllers that a route states
    "start_north", "start_east", "start_heading", "home_north", "home_east",
    "waypoint_count", "waypoint_north", "waypoint_east",
)  # fmt: skip
SPARE = 3  # times as many ways are looked at where turns are preferred
SPEEDS = {  # of plants, and how many of each are the most that a trial of theirs has
    "cruise_speed": 1,
    "cruise_speed_deviation": 4,
    "walking_speed": 1,
    "driving_speed": 1,
}
COUNTING = "field"  # the reading by default: it counts turns anew at each waypoint
DURATION = 600.0  # s of a trial, without a scenario that says so
MEAN_DOG = (
    "the dog is that of Table 5.1, not yours{}: the best spacing depends on its drift and turns; fit "
    "it from logs (`canine fit`), and give --scenario or --set"
)
HABITUATION = (
    "the dog heeds the last vibration as it heeds the first: if yours does not, fewer waypoints are better, "
    "along a straight way every 40 to 50 m at a gain of 0.1, every 50 to 67 m at 0.2 and 0.3"
)
HABITUATING = "the dog gets used to vibrations with a gain of {:g}; nobody measured that gain, nor the law"


@dataclass(frozen=True)
class Asked:
    """What `canine plan` is asked; the attributes are its options. A scenario may also be made in Python."""

    target: str
    begin: str
    end: str
    metres: bool = False
    origin: tuple[float, float] | None = None
    along: Along = "both"
    clearances: Sequence[float] = CLEARANCES
    ways: int = WAYS
    longest: float = LONGEST
    preference: float = 0.0
    spacings: Sequence[float | None] = SPACINGS
    scenario: str | Scenario | None = None
    system: str = "cts"
    reading: str | None = None
    settings: Sequence[str] = ()
    plant: str | None = None
    controller: str | None = None
    seed: int | None = None
    trials: int = TRIALS


@dataclass(frozen=True)
class Problem:
    """A plan's parts, checked, before any trial.

    Attributes:
        base: the scenario that the result is written as, in its own system: candidates may be tried in
            another.
        candidates: the shortest unsplit one first.
        assumes: what of the dog and the controller is not known to be so.
    """

    asked: Asked
    site: Site
    begin: Place
    end: Place
    base: Scenario
    scorer: Scorer
    candidates: list[Candidate]
    notes: list[str]
    assumes: list[str]


def prepare(asked: Asked, note: Callable[[str], None] = lambda text: None) -> Problem:
    """Read the map, resolve the scenario, and make the candidates.

    Args:
        note: called with a line for the user.

    Raises:
        RouteError: the map or an option cannot be used, a place is in an area, or the end cannot be reached.
        UsageError: the scenario cannot be used.
    """
    _check(asked)
    map_file = load(asked.target, metres=asked.metres)
    points = map_file.point_of("begin", asked.begin), map_file.point_of("end", asked.end)
    map_file.check_distance(f"end {asked.end}: is", np.array(points[1:]), points[0])
    site = map_file.site(points[0], asked.origin)
    begin, end = (map_file.place_at(point, points[0]) for point in points)
    for name, text, place in (("begin", asked.begin, begin), ("end", asked.end, end)):
        if max(map(abs, place)) > MAX_COORDINATE:
            raise RouteError(
                f"{site.name}: {name} {text} is more than {MAX_COORDINATE / 1000:g} km from [0, 0] of the "
                "map; expected coordinates about a near origin: take the same off all of them"
            )
        area = site.area_at(place)
        if area is not None:
            raise RouteError(
                f"{site.name}: {name} {text} is in {area.where}; expected a place outside all areas"
            )
    base, in_trials, components = _scenarios(asked, site, begin, end)
    system = components.system(in_trials)
    scorer = Scorer(in_trials, system, site.areas, begin)
    ways, of_ways = _ways(asked, site, begin, end)
    interfaces = interfaces_of_system(system)
    controller = interfaces["controller"]
    values = scorer.trial_type(Candidate(ways[0], None, (end,))).values
    _check_count(controller, values["controller"], in_trials)
    least = controller.start("capture_radius", values["controller"])
    if math.dist(begin, end) <= least:
        raise RouteError(
            f"end {asked.end}: is {math.dist(begin, end):.1f} m from begin {asked.begin}; expected more "
            f"than d', {least:g} m"
        )
    by_length = sorted(ways, key=lambda way: way.length)
    _check_time(asked, by_length[0], interfaces["plant"], values["plant"], in_trials)
    (reference, *_), _ = candidates_of(by_length, [None], site, least)
    others, notes = candidates_of(ways, asked.spacings, site, least)
    candidates = told_apart([reference, *(c for c in others if c.waypoints != reference.waypoints)])
    widest = max((spacing for spacing in asked.spacings if spacing is not None), default=None)
    if widest is not None and by_length[0].length > MAX_WAYPOINTS * widest:
        notes.append(_unsplit(by_length[0], widest))
    if in_trials.streets or in_trials.poles:
        notes.append(
            f"the streets and poles that hold and draw the dog are the scenario's ({len(in_trials.streets)} "
            f"and {len(in_trials.poles)}), not lines of the map"
        )
    notes = [*site.notes, *of_ways, *notes]
    for text in notes:
        note(text)
    assumes = _assumptions(in_trials, interfaces["plant"], values["plant"])
    return Problem(asked, site, begin, end, base, scorer, candidates, notes, assumes)


def _check(asked: Asked) -> None:
    """Refuse numbers that make no sense."""
    for name, values in (("clearance", asked.clearances), ("spacing", asked.spacings)):
        if not values:
            raise RouteError(f"{name} is empty; expected one number at least")
    for clearance in asked.clearances:
        if not 0 < clearance <= 100:
            raise RouteError(f"clearance {clearance:g}: expected more than 0, up to 100 m")
    if asked.along not in get_args(Along):
        raise RouteError(f"along {asked.along}: expected one of {', '.join(get_args(Along))}")
    for name, value, low, high in (
        ("ways", asked.ways, 1, 50),
        ("longest", asked.longest, 1, 10),
        ("prefer_turns", asked.preference, 0, 1000),
        ("trials", asked.trials, 1, 1_000_000),
    ):
        if not low <= value <= high:
            raise RouteError(f"{name} is {value:g}; expected {low} to {high}")
    if asked.reading is not None and asked.reading not in READINGS:
        raise RouteError(
            f"reading {asked.reading}: there is no such reading{nearest(asked.reading, READINGS)}"
        )


def _ways(asked: Asked, site: Site, begin: Place, end: Place) -> tuple[list[Way], list[str]]:
    """The ways to try, and notes on where there are none.

    Raises:
        RouteError: there is none.
    """
    finders: dict[str, Callable[..., list[Way]]] = {}  # by what is said if one finds none
    of_streets: list[str] = []
    if asked.along != STREETS and (site.areas or asked.along == OPEN):
        for clearance in sorted(asked.clearances):
            finders[f"no way keeps {clearance:g} m clear of the areas"] = partial(
                open_ways, site, begin, end, clearance
            )
    if asked.along == STREETS and not site.streets:
        raise RouteError(
            f"{site.name}: has no line; expected streets, or take the ways round the areas (open)"
        )
    if asked.along != OPEN and site.streets:
        finders["no way leads there along streets"] = partial(
            street_ways, site, begin, end, note=of_streets.append
        )
    count = asked.ways * (SPARE if asked.preference else 1)
    chosen: list[Way] = []
    notes: list[str] = []
    faults: list[RouteError] = []
    for without, find in finders.items():
        try:
            ways = find(count=count, longest=asked.longest)
        except RouteError as fault:
            faults.append(fault)
            notes.append(f"{without}: {fault}")
            continue
        chosen += best(ways, asked.ways, asked.preference)
        if not ways:
            notes.append(without)
    if faults and not chosen:
        raise faults[0]
    if not chosen:
        raise RouteError(
            f"{site.name}: no way leads from {asked.begin} to {asked.end}: "
            f"{_why_none(asked, site, begin, end, of_streets)}"
        )
    return chosen, [*of_streets, *notes]


def _why_none(asked: Asked, site: Site, begin: Place, end: Place, of_streets: Sequence[str]) -> str:
    """Why no way was found, and what to do."""
    reasons, advice = [], "mend the map"
    if asked.along != STREETS and site.areas:
        if surrounded := site.surrounded(begin, end):
            reasons.append(f"areas surround the {'begin' if surrounded == begin else 'end'}")
        else:
            reasons.append(f"none round the areas with {min(asked.clearances):g} m clear of them")
            advice = "take a smaller clearance, or mend the map"
    if asked.along != OPEN and site.streets:
        reasons.append(f"none along streets{''.join(f' ({text})' for text in of_streets)}")
    return f"{', '.join(reasons)}; {advice}"


def _scenarios(asked: Asked, site: Site, begin: Place, end: Place) -> tuple[Scenario, Scenario, Components]:
    """The scenario of the result, the same in the system of the trials, and what is in it."""
    own = Scenario(name=site.name, duration=DURATION) if asked.scenario is None else asked.scenario
    if isinstance(own, str):
        own = scenarios.load(own, mission=False)
    if own.package is not None:
        raise RouteError(
            f"scenario {asked.scenario if isinstance(asked.scenario, str) else own.name}: runs a package; "
            "expected one of a system of ours"
        )
    components = find_components(plant=asked.plant, controller=asked.controller)
    if components.foreign:
        raise RouteError(
            f"{', '.join(components.fmus.values())}: an FMU takes hundreds of times as long as a block of "
            "ours; expected a plant and a controller by name"
        )
    ground = [name for name in ("streets", "poles", "fence") if getattr(own, name)]
    if ground and site.origin is not None and not np.allclose(site.origin, own.origin, rtol=0, atol=1e-7):
        raise RouteError(
            f"{own.name}: its {' and '.join(ground)} are about its origin, "
            f"{own.origin[0]:.10g},{own.origin[1]:.10g}, and the route is about "
            f"{site.origin[0]:.10g},{site.origin[1]:.10g}; expected the same, or a scenario without them"
        )
    own = replace(
        route_scenario(own, begin, (end,)),
        origin=site.origin or own.origin,
        reading=asked.reading or own.reading or COUNTING,
    )
    in_trials = adapted(own, Options(asked.system, seed=asked.seed), asked.settings, components)
    for address in in_trials.parameters:
        if address.partition(".")[2].partition("[")[0] in OF_ROUTE:
            raise RouteError(
                f"{in_trials.name}: {address} is set; start, home and waypoints are the route's: leave it out"
            )
    if in_trials.seed + asked.trials - 1 > MAX_SEED:
        raise RouteError(f"seed is {in_trials.seed}; expected {MAX_SEED - asked.trials + 1} at most")
    base = replace(
        in_trials, system=own.system, estimator=own.estimator if own.system != "cts" else ESTIMATOR
    )
    return base, in_trials, components


def _check_time(
    asked: Asked, shortest: Way, plant: Interface, values: Mapping[str, float], scenario: Scenario
) -> None:
    """Refuse an end that no trial is long enough for."""
    speeds = {name: plant.start(name, values) for name in SPEEDS if name in plant.parameters}
    reach = scenario.duration * sum(SPEEDS[name] * speed for name, speed in speeds.items())
    if speeds and shortest.length > reach:
        raise RouteError(
            f"end {asked.end}: the shortest way is {shortest.length:.0f} m, and the {plant.block} runs "
            f"{reach:.0f} m at most in a trial's {scenario.duration:g} s (duration); expected a nearer end, "
            "or a scenario with a longer duration"
        )


def _unsplit(shortest: Way, widest: float) -> str:
    """A note on waypoints that are few for the way."""
    return (
        f"no way takes a waypoint every {widest:g} m: the shortest is {shortest.length:.0f} m, "
        f"{MAX_WAYPOINTS} waypoints lead {MAX_WAYPOINTS * widest:g} m; tried with waypoints at corners "
        "alone: take a wider spacing, or plan the way in parts"
    )


def _check_count(controller: Interface, values: Mapping[str, float], scenario: Scenario) -> None:
    """Refuse a controller that does not count turns anew at each waypoint."""
    if "reset_turns" not in controller.parameters:
        return  # controllers beside the CMEC always count per waypoint
    if not controller.start("reset_turns", values):
        most = controller.start("max_turns", values)
        raise RouteError(
            f"{scenario.name}: the reading {scenario.reading} counts turns over the whole trial "
            f"(cmec.reset_turns is false), and one more than MAXTURN, {most:g}, ends it: hardly any route "
            f"would be led to its end; expected a count per waypoint: --reading {COUNTING}, or {ON_BOARD}"
        )


def _assumptions(scenario: Scenario, plant: Interface, values: Mapping[str, float]) -> list[str]:
    """What of the dog is not known to be so: a route is recommended on it."""
    if not plant.parameters.keys() >= set(FITTED):
        return [f"the {plant.block} is yours: nobody fitted its parameters to logs of one"]
    stated, assumed = stated_and_assumed(scenario.parameters, {plant.block})
    in_part = f", in {', '.join(assumed)} (stated: {', '.join(stated)})" if stated else ""
    gain = "habituation_gain"
    habituates = plant.start(gain, values) if gain in plant.parameters else 0.0
    return [
        *([MEAN_DOG.format(in_part)] if assumed else []),
        HABITUATING.format(habituates) if habituates else HABITUATION,
    ]
