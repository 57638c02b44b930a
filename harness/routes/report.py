"""The results of a plan: table, routes.json, routes.png; scenario and mission of the recommended route."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from harness.files import replaced, write_set
from harness.routes.candidates import Candidate
from harness.routes.halving import Result
from harness.routes.picture import routes_png
from harness.routes.score import Score
from harness.routes.site import rings_of
from harness.station.formats import geojson
from harness.station.formats.scenario import of_scenario
from harness.terminal import new_table, percent, print_table
from models.system import CONTROLLER

if TYPE_CHECKING:
    from rich.console import Console

ROUTES, PICTURE, SCENARIO, MISSION = "routes.json", "routes.png", "route.toml", "mission.geojson"
IDENTITY = ("map", "from", "to", "system", "controller", "plant", "reading", "parameters", "seed")


def default_folder(result: Result) -> Path:
    """The folder of the results by default."""
    return Path("out") / f"plan-{result.problem.site.name}"


def write(result: Result, folder: Path, note: Callable[[str], None] = lambda text: None) -> None:
    """Write the files; those of an earlier plan go before the first of them comes.

    Args:
        note: called with a line for the user.

    Raises:
        UsageError: the folder cannot be made or written into.
        FileError: a file cannot be written, or one of an earlier plan not removed.
    """
    content = facts(result)
    if others := replaced(folder / ROUTES, {key: content[key] for key in IDENTITY}):
        note(f"{folder}: has another plan, which this replaces ({others})")
    earlier = (SCENARIO, MISSION) if (folder / ROUTES).exists() else ()  # else they may be the user's own
    files = {PICTURE: routes_png(result)}
    name = f"route-{result.problem.site.name}"
    if result.caution:
        note(result.caution)
    if result.recommended is None:
        note("no candidate ever succeeded: there is no scenario and no mission to write")
    else:
        scenario = result.scenario_of(result.recommended, name)
        files[SCENARIO] = (_comment(result, result.recommended) + scenario.text()).encode()
        if result.problem.site.origin is None:
            note("the map does not say where on the earth it is: no mission is written; give --origin")
        else:
            files[MISSION] = geojson.write(of_scenario(scenario), name)
    write_set(folder, {**files, ROUTES: _json(content)}, earlier)


def facts(result: Result) -> dict[str, Any]:
    """The content of routes.json."""
    problem, scorer = result.problem, result.problem.scorer
    recommended = result.recommended
    return {
        "map": problem.site.name,
        "from": list(problem.begin),
        "to": list(problem.end),
        "origin": problem.site.origin,
        "system": scorer.scenario.system,
        "controller": scorer.system.components["controller"].title(),
        "plant": scorer.system.components["plant"].title(),
        "reading": scorer.scenario.reading,
        "parameters": dict(scorer.scenario.parameters),
        "seed": scorer.scenario.seed,
        "candidates": len(problem.candidates),
        "rounds": [{"candidates": each.candidates, "trials": each.trials} for each in result.rounds],
        "assumes": problem.assumes,
        "notes": [*problem.notes, *([result.caution] if result.caution else [])],
        "recommended": None if recommended is None else result.ranked.index(recommended) + 1,
        "reference": result.ranked.index(result.reference) + 1,
        "areas": [
            {"name": area.name, "rings": [ring.tolist() for ring in rings_of(area.shape)]}
            for area in problem.site.areas
        ],
        "routes": [
            {
                "number": number,
                "on_front": candidate in result.front,
                "not_shown_worse": candidate in result.as_good,
                **_facts_of(candidate, result.tried[candidate], result),
            }
            for number, candidate in enumerate(result.ranked, start=1)
        ],
    }


def _facts_of(candidate: Candidate, score: Score, result: Result) -> dict[str, Any]:
    low, high = score.interval
    entry_low, entry_high = score.entry_interval
    return {
        "label": candidate.label,
        "length_m": round(candidate.way.length, 2),
        "along": candidate.way.kind,
        "clearance_m": candidate.way.clearance,
        "spacing_m": candidate.spacing,
        "waypoints": [[round(north, 3), round(east, 3)] for north, east in candidate.waypoints],
        "trials": score.trials,
        "successes": score.successes,
        "success_rate": score.success_rate,
        "ci_low": low,
        "ci_high": high,
        "reached": int(score.reached.sum()),
        "entries": score.entries,
        "entry_rate": score.entry_rate,
        "entry_ci_low": entry_low,
        "entry_ci_high": entry_high,
        "entered": score.by_area(result.problem.site.areas),
        "mean_time_s": score.mean_time,
        "mean_commands": score.mean_commands,
    }


def _json(content: object) -> bytes:
    return (json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _comment(result: Result, candidate: Candidate) -> str:
    """The comment of a candidate's scenario: how to run it, what was found of it, and on what that rests."""
    problem, score = result.problem, result.tried[candidate]
    low, high = score.interval
    tried_in = problem.scorer.scenario.system
    other = "" if problem.base.system == tried_in else f"; this file is of the system {problem.base.system}"
    command = run_command(result, SCENARIO)
    needed = ", since a scenario holds neither plant nor controller" if _components(result) else ""
    lines = [
        f"A route by `canine plan` on the map {problem.site.name}: {candidate.label}",
        f"{percent(score.success_rate)} of {score.trials} trials reached the end and entered no area "
        f"(95 % interval {100 * low:.1f} to {100 * high:.1f})",
        f"They were trials of the system {tried_in}{other}",
        *([f"Caution: {result.caution}"] if result.caution else []),
        *(f"It is assumed that {text}" for text in problem.assumes),
        f"Run it by `{command}`{needed}",
        "A scenario holds no areas: the run neither watches whether the dog enters one nor draws them",
    ]
    return "".join(f"# {line}.\n" for line in lines)


def _components(result: Result) -> list[str]:
    """The options that put the plan's plant and controller where a scenario's own would be."""
    blocks = {role: block.title() for role, block in result.problem.scorer.system.components.items()}
    own = {"plant": result.problem.base.plant, "controller": CONTROLLER}
    return [
        part for role, name in own.items() if blocks[role] != name for part in (f"--{role}", blocks[role])
    ]


def run_command(result: Result, scenario: str) -> str:
    """The command that runs the recommended route's scenario, the one in this file, as it was tried."""
    return shlex.join(["canine", "run", scenario, *_components(result)])


def _system_of_run(result: Result) -> str:
    """What a run of the recommended route has that its trials had not."""
    system = result.problem.base.system
    if system == result.problem.scorer.scenario.system:
        return ""
    return f" in the system {system}, where it may succeed less often (--system {system} tries it there)"


def show(result: Result, folder: Path, console: Console) -> None:
    """Print the Pareto front, the reference, what is recommended and on what that rests.

    Args:
        folder: of the results.
    """
    table = new_table()
    table.add_column("route")
    for heading in ("waypoints", "success", "95 % interval", "enters an area", "time [s]", "stimuli"):
        table.add_column(escape(heading), justify="right")
    shown = dict.fromkeys([*result.front, result.reference])
    for candidate in shown:
        score = result.tried[candidate]
        low, high = score.interval
        mark = "* " if candidate == result.recommended else "  "
        table.add_row(
            f"{mark}{candidate.label}",
            str(len(candidate.waypoints)),
            percent(score.success_rate),
            f"{100 * low:.1f}-{100 * high:.1f}",
            percent(score.entry_rate),
            *("-" if mean is None else f"{mean:.1f}" for mean in (score.mean_time, score.mean_commands)),
        )
    print_table(table, console)
    for line in words(result, folder):
        console.print(line, soft_wrap=True, markup=False)


def ties_of(result: Result) -> str:
    """What decided between the recommended route and others that are as good; "" if there are none."""
    if len(result.able) <= 1:
        return ""
    ties = f"; {len(result.able)} are not shown to succeed less often than the best"
    if len(result.clearest) == len(result.able):
        return f"{ties}; it is the fastest of these"
    if len(result.clearest) == 1:
        return f"{ties}; of these it enters areas least"
    return f"{ties}, {len(result.clearest)} of them not to enter areas more often; it is the fastest of these"


def words(result: Result, folder: Path) -> list[str]:
    """What the table does not say."""
    trials, problem = result.rounds[-1].trials, result.problem
    tried = (
        f"{len(problem.candidates)} candidates, {len(result.tried)} of them tried {trials} times in the "
        f"system {problem.scorer.scenario.system}"
    )
    is_led = problem.site.origin is not None and not _components(result)  # the station has the usual dog
    station = ["canine", "station", "--simulate", str(folder / SCENARIO), "--mission", str(folder / MISSION)]
    if result.recommended is None:
        return [f"{tried}; none ever succeeded: take a wider --clearance, other --spacing, or more --ways"]
    return [
        f"{tried}; the last row is the shortest unsplit way, to compare with",
        f"* recommended: {result.recommended.label}{ties_of(result)}",
        *(f"it is assumed that {text}" for text in problem.assumes),
        f"to run it{_system_of_run(result)}: {run_command(result, str(folder / SCENARIO))}",
        *([f"to lead a simulated vest along it: {shlex.join(station)}"] if is_led else []),
    ]
