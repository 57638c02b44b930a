"""The command `canine plan`; `command_line` adds it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

import typer

from harness.console import json_of, out, print_note, progress_bar, say_where
from harness.options import Controller, Plant, Settings, listed, number
from harness.routes import CLEARANCES, LONGEST, SPACINGS, TRIALS, WAYS, Along, require_packages
from models.errors import UsageError
from models.kit.random import MAX_SEED


def _texts(lengths: Iterable[float | None]) -> str:
    return ",".join("none" if length is None else f"{length:g}" for length in lengths)


def plan_route(
    target: Annotated[str, typer.Argument(metavar="MAP")],
    *,
    begin: Annotated[
        str,
        typer.Option(
            "--from", metavar="P", help="a point's name, latitude,longitude, or in metres north,east"
        ),
    ],
    end: Annotated[str, typer.Option("--to", metavar="P", help="the same")],
    metres: Annotated[
        bool, typer.Option("--metres", help="a GeoJSON in metres, east before north, that does not say so")
    ] = False,
    origin: Annotated[
        str, typer.Option(metavar="LAT,LON", help="where [0, 0] of a map in metres is, for the mission")
    ] = "",
    along: Annotated[Along, typer.Option(help="round the areas, along the streets, or both")] = "both",
    clearance: Annotated[str, typer.Option(metavar="m,...", help="from the areas")] = _texts(CLEARANCES),
    ways: Annotated[int, typer.Option(help="different ways with each clearance, at most")] = WAYS,
    longest: Annotated[float, typer.Option(help="times the shortest way that another may be long")] = LONGEST,
    prefer_turns: Annotated[
        float, typer.Option(metavar="m", help="what a turn nearer to 45 or 90 deg by 45 deg is worth")
    ] = 0.0,
    spacing: Annotated[
        str, typer.Option(metavar="m|none,...", help="between waypoints; none: at corners alone")
    ] = _texts(SPACINGS),
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="SCENARIO.toml", help="its dog and its controller; start and waypoints are replaced"
        ),
    ] = None,
    system: Annotated[
        Literal["cts", "full"],
        typer.Option(help="of the trials; cts: the true state into the controller; full: the estimate"),
    ] = "cts",
    reading: Annotated[
        str | None, typer.Option(help="one that counts turns per waypoint; the scenario's, or field")
    ] = None,
    plant: Plant = None,
    controller: Controller = None,
    seed: Annotated[
        int | None, typer.Option(min=0, max=MAX_SEED, help="of the first trial of each candidate")
    ] = None,
    trials: Annotated[int, typer.Option(help="of each candidate that is left at the end")] = TRIALS,
    settings: Settings = None,
    folder: Annotated[
        Path | None, typer.Option("--out", file_okay=False, metavar="DIR", help="by default out/plan-<map>")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print routes.json")] = False,
) -> None:
    """Find routes round buildings, each scored by simulated trials: routes.json and .png, scenario, mission.

    \b
    canine plan five_buildings --from home --to goal          a map that comes with the project
    canine plan campus.geojson --from 32.6062,-85.4877 --to 32.6079,-85.4876
    canine plan campus.kml --from gate --to pond --clearance 5,10 --spacing none,20,25
    canine plan yard.geojson --metres --from 0,0 --to 180,40 --along streets
    canine plan five_buildings --from home --to goal --scenario my.toml --system full

    A map is GeoJSON or KML: polygons are areas that the dog may not enter, lines are streets, points with a
    name are places for --from and --to. Candidates are different ways, by which side of each area they pass,
    times clearances, times spacings of waypoints. They are tried by the same seeds, in rounds: the better
    half goes on with twice as many trials. Of those left, routes are shown that no other one beats in
    success, time, stimuli and chance of entering an area at once. route.toml is for `canine run`,
    mission.geojson for the station.
    """
    require_packages()
    from harness.routes import halving, report
    from harness.routes.problem import Asked, prepare

    problem = prepare(
        Asked(
            target,
            begin,
            end,
            metres=metres,
            origin=_origin(origin),
            along=along,
            clearances=[number("--clearance", part, "m") for part in listed(clearance)],
            ways=ways,
            longest=longest,
            preference=prefer_turns,
            spacings=[None if part == "none" else number("--spacing", part, "m") for part in listed(spacing)],
            scenario=scenario,
            system=system,
            reading=reading,
            settings=settings or (),
            plant=plant,
            controller=controller,
            seed=seed,
            trials=trials,
        ),
        print_note,
    )
    with progress_bar("% of the trials", 100, quiet=as_json) as progress:
        result = halving.run(problem, progress and (lambda share: progress(100 * share)))
    place = folder or report.default_folder(result)
    report.write(result, place, print_note)
    if as_json:
        typer.echo(json_of(report.facts(result)))
    else:
        report.show(result, place, out())
        say_where(place)


def _origin(text: str) -> tuple[float, float] | None:
    if not text:
        return None
    try:
        latitude, longitude = map(float, text.split(","))
    except ValueError:
        raise UsageError(f'--origin "{text}": expected latitude,longitude in deg') from None
    return latitude, longitude
