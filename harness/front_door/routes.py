"""Routes round buildings, each scored by simulated trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from harness.front_door.arguments import (
    Progress,
    StrPath,
    check_choice,
    check_count,
    check_list,
    named_from_python,
    number_of,
    numbers_of,
    settings_of,
    target_of,
    text_of,
)
from harness.routes import CLEARANCES, LONGEST, SPACINGS, TRIALS, WAYS, Along, require_packages
from harness.trial import ReadingName
from harness.trial.scenario import Scenario, Written
from models.errors import UsageError
from models.readings import READINGS

Point = str | tuple[float, float]


@dataclass(frozen=True)
class PlanResult:
    """Routes that were tried.

    Attributes:
        folder: with all of its files.
        report: the content of routes.json; its notes, and what it assumes, name arguments for options.
        notes: what the user should know.
    """

    folder: Path
    report: Mapping[str, Any]
    notes: tuple[str, ...] = ()

    @property
    def routes(self) -> list[dict[str, Any]]:
        """The routes that are left at the end, the most successful first, by the names of routes.json."""
        return list(self.report["routes"])

    @property
    def recommended(self) -> dict[str, Any] | None:
        """The one of them that is recommended; None if none ever succeeded, and then there is no scenario."""
        number: int | None = self.report["recommended"]
        return None if number is None else self.routes[number - 1]

    @property
    def shortest(self) -> dict[str, Any]:
        """The shortest way without a waypoint between its corners, to compare with."""
        number: int = self.report["reference"]
        return self.routes[number - 1]

    @property
    def assumes(self) -> list[str]:
        """What of the dog and the controller is not known to be so."""
        return list(self.report["assumes"])

    @property
    def report_path(self) -> Path:
        """routes.json."""
        return self.folder / "routes.json"

    @property
    def picture_path(self) -> Path:
        """routes.png."""
        return self.folder / "routes.png"

    @property
    def scenario_path(self) -> Path:
        """route.toml, for `run_trial` with the plan's plant and controller, which a scenario does not hold.

        It is not written if no route ever succeeded.
        """
        return self.folder / "route.toml"

    @property
    def mission_path(self) -> Path:
        """mission.geojson, for the station; not written without an origin of the map either."""
        return self.folder / "mission.geojson"


@named_from_python
def run_plan(
    target: StrPath,
    begin: Point,
    end: Point,
    *,
    metres: bool = False,
    origin: tuple[float, float] | None = None,
    along: Along = "both",
    clearances: Sequence[float] = CLEARANCES,
    ways: int = WAYS,
    longest: float = LONGEST,
    prefer_turns: float = 0.0,
    spacings: Sequence[float | None] = SPACINGS,
    scenario: StrPath | Scenario | None = None,
    system: Literal["cts", "full"] = "cts",
    reading: ReadingName | None = None,
    parameters: Mapping[str, Written] | None = None,
    plant: str | None = None,
    controller: str | None = None,
    seed: int | None = None,
    trials: int = TRIALS,
    out: StrPath | None = None,
    progress: Progress | None = None,
) -> PlanResult:
    """Find routes round the areas of a map, each scored by simulated trials of the dog and the controller.

    >>> from harness import run_plan, run_trial
    >>> plan = run_plan("five_buildings", "home", "goal", clearances=[6], spacings=[20], ways=2, trials=256,
    ...                 out="out/planned")
    >>> plan.recommended["success_rate"] > plan.shortest["success_rate"]
    True
    >>> run_trial(plan.scenario_path, out="out/led").summary["scenario"]
    'route-five_buildings'

    Args:
        target: a GeoJSON or KML file, or the name of a map that comes with the project.
        begin, end: a point's name; latitude and longitude in deg, or on a map in metres north and east.
        metres: the coordinates of a GeoJSON are metres, whatever it says.
        origin: latitude and longitude in deg of [0, 0] of a map in metres.
        along: `open`, round the areas; `streets`; or `both`.
        clearances: m to keep from the areas; each is tried.
        ways: different ways with each clearance, at most.
        longest: none is longer than so many times the shortest.
        prefer_turns: m of detour that a turn is worth which is 45 deg nearer to 45 or 90 deg.
        spacings: m between waypoints; None puts them at the corners alone.
        scenario: its dog and its controller; its start and its waypoints are replaced.
        system: `cts` gives the controller the true state, `full` the estimate.
        reading: one that counts turns per waypoint; by default the scenario's, or `field`.
        parameters: values over the scenario's, by `block.name`; angles in degrees.
        plant, controller: of ours by name.
        seed: of the first trial of each route; by default the scenario's.
        trials: of each route that is left at the end.
        out: the folder of the results; by default out/plan-<map>.
        progress: called with the share of the trials that is done, 0 to 1.

    Raises:
        UsageError: the map, a place or a value does not fit, the end cannot be reached, or a package is
            missing.
        CanineError: a fault in what was run.
    """
    require_packages()
    from harness.routes import halving, report  # noqa: PLC0415 - shapely: trials need not wait
    from harness.routes.problem import Asked, prepare  # noqa: PLC0415

    for name, count in (("ways", ways), ("trials", trials)):
        check_count(name, count)
    for name, number in (("longest", longest), ("prefer_turns", prefer_turns)):
        number_of(name, number)
    check_list("spacings", spacings, "in m, [None, 20.0]")
    check_choice("system", system, ("cts", "full"))
    check_choice("reading", reading, tuple(READINGS))
    notes: list[str] = []
    problem = prepare(
        Asked(
            str(target),
            _point("begin", begin),
            _point("end", end),
            metres=metres,
            origin=None if origin is None else _pair("origin", origin, "latitude and longitude in deg"),
            along=along,
            clearances=numbers_of("clearances", clearances, "m"),
            ways=ways,
            longest=longest,
            preference=prefer_turns,
            spacings=[
                None if each is None else number_of(f"spacings[{place}]", each, "m")
                for place, each in enumerate(spacings)
            ],
            scenario=None if scenario is None else target_of(scenario),
            system=system,
            reading=reading,
            settings=settings_of(parameters),
            plant=text_of(plant),
            controller=text_of(controller),
            seed=seed,
            trials=trials,
        ),
        notes.append,
    )
    result = halving.run(problem, progress)
    folder = report.default_folder(result) if out is None else Path(out)
    report.write(result, folder, notes.append)
    return PlanResult(folder, report.facts(result), tuple(notes))


def _point(name: str, point: Point) -> str:
    """A place as the command has it."""
    if isinstance(point, str):
        return point
    one, other = _pair(name, point, 'a name, "home", or a pair of numbers')
    return f"{one!r},{other!r}"


def _pair(name: str, value: Sequence[float], expected: str) -> tuple[float, float]:
    """Two numbers."""
    try:
        one, other = map(float, value)
    except (TypeError, ValueError):
        raise UsageError(f"{name} is {value!r}; expected {expected}") from None
    return one, other
