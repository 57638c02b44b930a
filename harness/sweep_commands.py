"""The commands of `canine` that run many trials; `command_line` adds them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from harness.console import build_status, end_interrupted, json_of, out, print_note, progress_bar, say_where
from harness.cosim.stepping import GIB, Limits
from harness.options import (
    Ahrs,
    CallLimit,
    Controller,
    Estimator,
    MemoryLimit,
    Plant,
    Settings,
    listed,
    numbers,
)
from harness.trial import DEFAULT, ReadingName
from models.errors import CanineError
from models.kit.random import MAX_SEED

if TYPE_CHECKING:
    from harness.sweep.run import Asked

Reading = Annotated[
    ReadingName | None,
    typer.Option(help="by default the scenario's, calibrated"),
]
FirstSeed = Annotated[
    int | None, typer.Option(min=0, max=MAX_SEED, help="of the first trial at each point; 1 by default")
]
Dask = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="of the scheduler of a Dask cluster; tls:// asks for certificates"),
]
DaskCa = Annotated[
    Path | None, typer.Option(metavar="FILE", help="certificate (PEM) of the cluster's authority")
]
DaskCert = Annotated[Path | None, typer.Option(metavar="FILE", help="this machine's certificate (PEM)")]
DaskKey = Annotated[
    Path | None, typer.Option(metavar="FILE", help="its private key (PEM), if it is not in --dask-cert")
]


def sweep_parameters(
    target: Annotated[str, typer.Argument(metavar="two|three|SCENARIO.toml")],
    *,
    thresholds: Annotated[
        str | None,
        typer.Option(
            metavar="a[:b[:step]]",
            help="deviation threshold h' [deg]; 15:90, or 15:65 with three waypoints and more",
        ),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="block.name=a:b:step", help="any parameter, instead or beside; angles in deg"),
    ] = None,
    trials: Annotated[int, typer.Option(help="at each point")] = 1000,
    system: Annotated[
        Literal["cts", "full"],
        typer.Option(help="cts: the true state into the controller; full: the estimate"),
    ] = "cts",
    plant: Plant = None,
    estimator: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|X.fmu", help="with --system full: one of ours, four_state by default, or an FMU"
        ),
    ] = None,
    controller: Controller = None,
    ahrs: Ahrs = False,
    reading: Reading = None,
    seed: FirstSeed = None,
    dask: Dask = None,
    dask_ca: DaskCa = None,
    dask_cert: DaskCert = None,
    dask_key: DaskKey = None,
    call_limit: CallLimit = Limits.call,
    memory_limit: MemoryLimit = Limits.memory / GIB,
    settings: Settings = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out",
            file_okay=False,
            help="by default out/sweep-<name>, with reading, system, seed and parameters if special",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the recommendation as JSON")] = False,
) -> None:
    """Run many trials at each value of a parameter: sweep.csv, .png, .html, recommendation.json.

    \b
    canine sweep two                              5.3.5: h' from 15 to 90 deg, 1000 trials each
    canine sweep three --thresholds 15:65         5.3.6: four types of trials in turns
    canine sweep my.toml --vary cmec.capture_radius=3:10:0.5 --trials 10000
    canine sweep two --vary canine.drift=-3:3:0.5 --vary cmec.moving_deviation=15:60:5
    canine sweep three --system full --estimator canine_tracker --thresholds 49
    canine sweep two --plant dog.fmu --thresholds 30:60:10 --trials 200      with a dog made elsewhere
    canine sweep three --dask tls://host:8786 --dask-ca ca.pem --dask-cert me.pem --dask-key me.key
                                                  on a cluster; tcp:// where nobody else reaches it

    The same command goes on where an earlier one was interrupted. With FMUs made elsewhere sweep.csv also has
    the columns fmu_failures and verdict; exit status 1 if one of them ended a trial.
    """
    from harness.sweep import sweep, tls

    certificates = tls.Certificates(dask_ca, dask_cert, dask_key)
    tls.check_use(dask, certificates)
    limits = Limits(call=call_limit, memory=int(memory_limit * GIB))
    with build_status("building the FMUs") as done:
        planned = sweep.plan_sweep(
            target, thresholds=thresholds, vary=vary or [], trials=trials, system=system, reading=reading,
            seed=seed, settings=settings or [], estimator=estimator, ahrs=ahrs, plant=plant,
            controller=controller, limits=limits, note=print_note, built=done,
        )  # fmt: skip
    place = folder or sweep.default_folder(planned)
    with _running(planned, place, as_json) as progress:
        table, result = sweep.run(
            planned, place, dask, certificates=certificates, progress=progress, note=print_note
        )
    if as_json:
        typer.echo(json_of(result))
    else:
        sweep.show(planned, table, result, out())
        say_where(place)
    _fail_by(sweep.fmu_failures_of(planned, table))


def compare_controllers(
    controllers: Annotated[
        str | None,
        typer.Option(metavar="NAME|X.fmu,...", help="of ours by name, or FMUs; all of ours by default"),
    ] = None,
    plants: Annotated[
        str | None,
        typer.Option(metavar="NAME|X.fmu,...", help="the same; by default all of ours that obey commands"),
    ] = None,
    scenarios: Annotated[
        str, typer.Option(metavar="SCENARIO.toml,...", help="files or names; also two, three, as in a sweep")
    ] = DEFAULT,
    *,
    trials: Annotated[int, typer.Option(help="of each cell")] = 1000,
    system: Annotated[
        Literal["cts", "full"] | None,
        typer.Option(help="cts: the true state into the controller; full: the estimate; by default each's"),
    ] = None,
    estimator: Estimator = None,
    ahrs: Ahrs = False,
    reading: Reading = None,
    seed: FirstSeed = None,
    dask: Dask = None,
    dask_ca: DaskCa = None,
    dask_cert: DaskCert = None,
    dask_key: DaskKey = None,
    call_limit: CallLimit = Limits.call,
    memory_limit: MemoryLimit = Limits.memory / GIB,
    settings: Settings = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out", file_okay=False, help="by default out/matrix, with reading, system and so on if special"
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print matrix.json")] = False,
) -> None:
    """Run many trials of each controller with each plant in each scenario: matrix.csv, .json and .png.

    \b
    canine matrix                                 all of ours, three_waypoint, 1000 trials a cell
    canine matrix --controllers cmec,quarter_turn --plants canine,pedestrian --trials 200
    canine matrix --controllers cmec,mine.fmu --plants canine,dog.fmu --scenarios three_waypoint,left_90
    canine matrix --scenarios three --system cts --set cmec.moving_deviation=37

    Trial i of each cell has the same seed, so controllers are also compared trial by trial. An FMU that
    crashes, hangs or fails spoils its own cells only: they say so, and the exit status is 1. The same
    command goes on where an earlier one was interrupted.
    """
    from harness.sweep import matrix, tls

    certificates = tls.Certificates(dask_ca, dask_cert, dask_key)
    tls.check_use(dask, certificates)
    limits = Limits(call=call_limit, memory=int(memory_limit * GIB))
    with build_status("building the FMUs") as done:
        planned = matrix.plan_matrix(
            None if controllers is None else listed(controllers),
            None if plants is None else listed(plants), listed(scenarios), trials=trials, system=system,
            reading=reading, seed=seed, settings=settings or [], estimator=estimator, ahrs=ahrs,
            limits=limits, note=print_note, built=done,
        )  # fmt: skip
    place = folder or matrix.default_folder(planned)
    with _running(planned, place, as_json) as progress:
        result = matrix.run(
            planned, place, dask, certificates=certificates, progress=progress, note=print_note
        )
    if as_json:
        typer.echo(json_of(result.facts()))
    else:
        matrix.show(result, out())
        say_where(place)
    _fail_by(result.fmu_failures(refused="left out, as noted above"))


def run_days(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO.toml", help="a file or a name: each mission")
    ] = DEFAULT,
    *,
    missions: Annotated[int, typer.Option(help="in a row")] = 8,
    rest: Annotated[
        str, typer.Option(metavar="s,...", help="between two missions; each of several is a curve")
    ] = "600",
    controllers: Annotated[str, typer.Option(metavar="NAME,...", help="of ours; each is a curve")] = "cmec",
    days: Annotated[int, typer.Option(help="how often the day is simulated")] = 1000,
    system: Annotated[
        Literal["cts", "full"],
        typer.Option(help="cts: the true state into the controller; full: the estimate"),
    ] = "cts",
    estimator: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="with --system full: one of ours, four_state by default"),
    ] = None,
    reading: Reading = None,
    seed: FirstSeed = None,
    settings: Settings = None,
    logs: Annotated[
        int, typer.Option(min=0, help="of so many days each mission is also run alone, with a log and a page")
    ] = 0,
    folder: Annotated[
        Path | None, typer.Option("--out", file_okay=False, help="by default out/day-<scenario>")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print day.json")] = False,
) -> None:
    """Run days of missions with rests: the dog tires and habituates. day.csv, .json, .png and .html.

    \b
    canine day three_waypoint                     8 missions, 600 s of rest between them, 1000 days
    canine day three_waypoint --rest 60,600,3600 --controllers cmec,quarter_turn
    canine day three_waypoint --reading field --set canine.fatigue_slows=0.3 --set cmec=aim_off
    canine day my.toml --missions 12 --set canine.start_fatigue=0.4

    All controllers and rests meet the same seeds. How the dog tires and habituates is assumed: the parameters
    of the plant canine_all_day say so, and the results too. `canine parameters canine_all_day` lists them.
    """
    from harness.day import missions as day_of_missions
    from harness.day import report
    from harness.front_door.series import write_days

    asked = day_of_missions.Asked(
        scenario, listed(controllers), numbers("--rest", rest, "s"), missions, days, system, estimator,
        reading, seed, settings or (),
    )  # fmt: skip
    planned = day_of_missions.plan_days(asked, print_note)
    with progress_bar("trials", planned.total, quiet=as_json) as progress:
        result = day_of_missions.run(planned, progress)
    place = folder or report.default_folder(result)
    logged = min(logs, days) * len(result.curves) * missions
    with progress_bar("logs", logged, quiet=as_json or not logged) as progress:
        write_days(result, logs, place, print_note, progress)
    if as_json:
        typer.echo(json_of(report.facts(result)))
    else:
        report.show(result, out())
        say_where(place)


@contextmanager
def _running(planned: Asked, place: Path, as_json: bool) -> Iterator[Callable[[float], None] | None]:
    """The progress of trials; Ctrl-C says what is kept of them."""
    with progress_bar("trials", planned.work.total, quiet=as_json) as progress:
        try:
            yield progress
        except KeyboardInterrupt as interrupt:
            end_interrupted(
                interrupt,
                f"what is done is kept in {place}: the same command goes on there"
                if any(place.glob("*.journal"))
                else "nothing is done",
            )


def _fail_by(failures: Sequence[str]) -> None:
    """Name the FMUs that ended trials, once all else is done."""
    if failures:
        raise CanineError("\n".join(failures))
