"""What a scenario asks for and cannot act, as notes: a line each."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

from harness.cosim.stepping import first_tick
from harness.trial.pairs import windows
from harness.trial.scenario import Disturbance, Scenario
from models.aiming_off import TURNED
from models.canine import Canine
from models.canine_ahrs import CanineAhrs
from models.cmec import Cmec
from models.fence import encloses
from models.kit.declaration import flatten
from models.kit.timing import TICK
from models.streets import CanineInStreets
from models.system import ESTIMATORS, SYSTEMS, names_of

if TYPE_CHECKING:
    from harness.cosim.fmu import Fault  # fmpy: sweeps do without
    from harness.trial.plan import Interface

CONTROLLER = {name for name, _ in flatten(Cmec.group("parameter"))}
WAYPOINTS = ("capture_radius", "waypoint_", "home_", "start_")  # with what such names begin
COUNTS = ("street_count", "pole_count")
Values = Mapping[str, Mapping[str, float]]
Interfaces = Mapping[str, "Interface"]


def idle_notes(
    scenario: Scenario, interfaces: Interfaces, values: Values, varied: Collection[str] = ()
) -> Iterator[str]:
    """What cannot act, whatever the animal does.

    Args:
        values: of the plan (SI), by component and flat name.
        varied: component and flat name of what a sweep varies; nothing is said of waypoints if it moves them,
            nor of streets and poles if it places them.
    """
    placing = any(name.partition(".")[2] in COUNTS for name in varied)
    moving = any(name.partition(".")[2].startswith(WAYPOINTS) for name in varied)
    if scenario.system in SYSTEMS:
        yield from _below_a_tick(scenario, interfaces)
    if scenario.system == "full_ahrs" and not _takes_attitude(scenario.estimator):
        yield f"{scenario.estimator} takes no attitude: canine_ahrs changes nothing"
    for interface, block, own in _components(interfaces, values):
        for name, number, begin, until in windows(block, own):
            if begin == until:
                yield f"{block}.{name}[{number}]: the window is empty, it starts and ends at {begin:g} s"
            elif scenario.system in SYSTEMS and first_tick(begin, TICK) == first_tick(until, TICK):
                yield (
                    f"{block}.{name}[{number}]: no tick (every {TICK:g} s) is in the window "
                    f"from {begin:g} to {until:g} s"
                )
        if Canine.title() in names_of(block):
            yield from _search(own)
        if block == Cmec.title() and not moving and interface.parameters.keys() >= CONTROLLER:
            yield from _waypoints(scenario, interface, own)
            yield from _fence(scenario, interface, own)
            yield from _response(interface, own)
        if block == CanineInStreets.title() and not placing and not any(map(own.get, COUNTS)):
            yield f"there is no street and no pole: {block} does what {Canine.title()} does"
        if "capture_radius" in interface.parameters and scenario.streets and not moving:
            yield from _off_streets(scenario, interface, own)
    yield from (
        f"{what} never acts: the trial lasts {scenario.duration:g} s"
        for what, time in timed(scenario, interfaces, values)
        if time > scenario.duration
    )


def late_notes(scenario: Scenario, interfaces: Interfaces, values: Values, end: float) -> list[str]:
    """What did not act in a trial that ended at `end` [s], before its duration."""
    return [
        f"{what} never acted: the trial ended at {end:.2f} s"
        for what, time in timed(scenario, interfaces, values)
        if end < time <= scenario.duration
    ]


def nan_notes(scenario: Scenario, fault: Fault) -> list[str]:
    """Which of a scenario's faults may be behind a value that was not finite."""
    return [
        f"[[fault]] {number}, nan of {f.signal}, acts from {f.at:g} s on: who is given nan may answer with it"
        for number, f in enumerate(scenario.faults, start=1)
        if f.kind == "nan" and fault.kind == "not finite" and f.at <= fault.time
    ]


def timed(scenario: Scenario, interfaces: Interfaces, values: Values) -> Iterator[tuple[str, float]]:
    """What a scenario has happen, and from when on [s]: changes of inputs, and windows."""
    for number, setting in enumerate(scenario.sets, start=1):
        yield f"[[set]] {number}, {setting.variable} at {setting.at:g} s,", setting.at
    for number, fault in enumerate(scenario.faults, start=1):
        yield f"[[fault]] {number}, {_words(fault, interfaces)} at {fault.at:g} s,", fault.at
    for _, block, own in _components(interfaces, values):
        for name, number, begin, until in windows(block, own):
            if begin < until:
                yield f"{block}.{name}[{number}] = {begin:g} s", begin


def _words(fault: Disturbance, interfaces: Interfaces) -> str:
    """A fault in words, with the unit of its signal."""
    units = {
        f"{component}.{name}": output.unit
        for component, interface in interfaces.items()
        for name, output in interface.outputs.items()
    }
    return fault.words(units)


def _components(
    interfaces: Interfaces, values: Values
) -> Iterator[tuple[Interface, str, Mapping[str, float]]]:
    for component, interface in interfaces.items():
        yield interface, interface.block, values.get(component, {})


def _takes_attitude(estimator: str) -> bool:
    """Whether one of our estimators has an input that the AHRS feeds."""
    inputs = ESTIMATORS[estimator].flat_names("input")
    return any(name in inputs for name in CanineAhrs.flat_names("output"))


def _below_a_tick(scenario: Scenario, interfaces: Interfaces) -> Iterator[str]:
    if scenario.duration < TICK:
        yield f"duration is {scenario.duration:g} s, below a tick ({TICK:g} s): nothing moves"
    spans = [(f"[[set]] {i}, {s.variable}", s.at, s.until) for i, s in enumerate(scenario.sets, start=1)]
    spans += [
        (f"[[fault]] {i}, {_words(f, interfaces)}", f.at, f.until)
        for i, f in enumerate(scenario.faults, start=1)
    ]
    for what, at, until in spans:
        if until is not None and first_tick(at, TICK) == first_tick(until, TICK):
            yield f"{what} from {at:g} to {until:g} s, never acts: no tick (every {TICK:g} s) is in it"


def _search(values: Mapping[str, float]) -> Iterator[str]:
    """The longest search for the bumper below the shortest, which then holds."""
    shortest, longest = values.get("bumper_search_min", 0.0), values.get("bumper_search_max", 0.0)
    if 0 < longest < shortest:
        yield (
            f"canine.bumper_search_max is {longest:g} s, below bumper_search_min: each search lasts "
            f"{shortest:g} s"
        )


def _response(interface: Interface, values: Mapping[str, float]) -> Iterator[str]:
    """A response time that is to be learnt from larger turns than there are."""
    least = 2 * TURNED * interface.start("heading_sd", values)
    if interface.start("response_sd", values) and least >= math.pi:
        yield (
            f"cmec.response_sd has no effect: a response is learnt from a turn of {2 * TURNED} heading_sd, "
            f"which is {math.degrees(least):g} deg; expected below 180 deg"
        )


def _fence(scenario: Scenario, interface: Interface, values: Mapping[str, float]) -> Iterator[str]:
    """A fence that does not act, and what of the mission is outside of it."""
    if scenario.fence and not interface.start("guarded", values):
        yield 'the fence does not act without the safety rules: set reading = "guarded"'
    elif scenario.fence:
        places = [("the start", scenario.start[:2])]
        places += [(f"waypoint {i}", place) for i, place in enumerate(scenario.waypoints, start=1)]
        yield from (
            f"{name} is outside the fence: the animal may be stopped; on board a START is refused"
            for name, place in places
            if not encloses(scenario.fence, place)
        )


def _off_streets(scenario: Scenario, interface: Interface, values: Mapping[str, float]) -> Iterator[str]:
    """A start that no street holds, and waypoints that the animal cannot reach from any."""

    def outside(place: tuple[float, float]) -> float:
        return min(street.outside(place) for street in scenario.streets)

    radius = interface.start("capture_radius", values)
    if (far := outside(scenario.start[:2])) > 0:
        yield f"the start is {far:.3g} m outside of all streets, which hold the animal once it enters one"
    for number, place in enumerate(scenario.waypoints, start=1):
        if (far := outside(place)) > radius:
            yield (
                f"waypoint {number} is {far:.3g} m outside of all streets, beyond "
                f"{interface.block}.capture_radius = {radius:g} m: it cannot be reached from them"
            )


def _waypoints(scenario: Scenario, interface: Interface, values: Mapping[str, float]) -> Iterator[str]:
    """Waypoints that are reached before the animal moves, and those beyond the last in use."""

    def value(name: str) -> float:
        return interface.start(name, values)

    radius, count = value("capture_radius"), int(value("waypoint_count"))
    stated = {int(name[len("waypoint_north[") : -1]) for name in values if name.startswith("waypoint_north[")}
    if not stated:
        return
    yield from (f"waypoint {i} is not in use: waypoint_count is {count}" for i in sorted(stated) if i > count)
    used = range(1, count + 1)
    yield from (f"waypoint {i} is not given: it is 0 m north, 0 m east" for i in used if i not in stated)
    points = [
        ("the start", scenario.start[:2]),
        *((f"waypoint {i}", (value(f"waypoint_north[{i}]"), value(f"waypoint_east[{i}]"))) for i in used),
        ("home", (value("home_north"), value("home_east"))),
    ]
    for (before, place), (name, point) in pairwise(points):
        apart = math.dist(place, point)
        when = "it is reached at once" if before == "the start" else f"it may be reached where {before} is"
        if apart == 0:
            yield f"{name} is where {before} is: {when}"
        elif apart <= radius:
            yield f"{name} is {apart:.3g} m from {before}, within cmec.capture_radius = {radius:g} m: {when}"
