"""The commands of `canine`. Each imports what it needs when it runs: help and usage errors come at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack, closing
from copy import copy
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from codegen.toolchains.compiler import PLATFORMS
from harness import (
    fault_commands,
    firmware_commands,
    log_commands,
    route_commands,
    station_commands,
    sweep_commands,
    vest_commands,
)
from harness.console import (
    build_status,
    end_interrupted,
    json_of,
    out,
    print_note,
    progress_bar,
    say_where,
    short,
)
from harness.cosim.stepping import GIB, Limits, Loop, Order
from harness.options import (
    Ahrs,
    CallLimit,
    Controller,
    Estimator,
    Fmi,
    Foxglove,
    MemoryLimit,
    Onboard,
    Plant,
    Seed,
    Settings,
    numbers,
)
from harness.recording import STREAMS
from harness.replay import EVERY_S, OUTAGE_S
from harness.studies import STUDIES
from harness.trial import DEFAULT, ReadingName
from models.errors import CanineError, UsageError

if TYPE_CHECKING:
    from harness.log.live import Pace
    from harness.replay.comparison import Comparison
    from harness.station.live import Live
    from harness.trial.request import Request

LONG_S = 60.0  # s of trial time, from which on a run shows its progress

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


Target = Annotated[str, typer.Argument(metavar="[SCENARIO.toml|SYSTEM.ssp|LOG.mcap]")]
Stepping = Annotated[Order | None, typer.Option(help="of stepping; sequential by default")]


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"canine {version('guided-canine')}")
        raise typer.Exit


@app.callback()
def canine(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="print the version and exit"),
    ] = False,
) -> None:
    """Guided canine: models, FMUs, and trials of a dog that is led along waypoints.

    \b
    canine run                                    the three-waypoint trial
    canine run two_waypoint --seed 7 --set cmec.moving_deviation=37
    canine run my.toml --plant dog.fmu            the same with a dog made elsewhere
    canine check dog.fmu --role plant             does it fit, and what is wrong if not
    canine wiring --order jacobi                  what is stepped when, and what delays
    canine replay out/demo/trial.mcap             the estimator over a recording, with GPS outages
    canine fit out                                the dog's statistics from logged trials
    canine tune ../walk                           an estimator's noise, from a recording's innovations
    canine study outage                           estimators through outages, beside the text's numbers
    canine sweep two                              many trials at each value of a parameter
    canine matrix --controllers cmec,quarter_turn --plants canine,dog.fmu    many trials with each pair
    canine day three_waypoint                     missions in a row: the dog tires and habituates
    canine plan campus.geojson --from gate --to pond                routes round buildings, tried by trials
    canine keygen --out vest.key                  a vest's radio key
    canine firmware --target stm32f405 --key vest.key --out fw      the onboard program's sources
    canine pil --target cortex-m4f                runs them on the simulated processor, bit by bit
    canine vest --speed 20                        firmware and dog in real time, commanded by radio
    canine export out/demo/trial.mcap --to csv    a log as files that other tools read
    canine export left_90 --ssp left_90.ssp       a trial as a package that other tools run
    canine compare out/demo out/again             do two logs agree, and where do they differ first
    canine report out/demo                        a log as an interactive page: map, plots, events, playback
    canine recover out/demo/trial.mcap            a log that was cut is made whole
    canine scenarios                              the trials that come with the project
    canine parameters cmec                        what a scenario can set: unit, range, default, meaning
    canine c cmec --precision float               the C of a block

    --debug anywhere shows where an error comes from.
    Exit status: 0 done (also when the dog failed its trial), 1 a fault in what was run, or logs that differ,
    2 wrong usage, 130 ended by Ctrl-C.
    """


@app.command()
def build(
    platform: Annotated[
        list[str] | None, typer.Option(help=f"one of {', '.join(PLATFORMS)}; beside this machine's")
    ] = None,
    more: Annotated[
        list[str] | None, typer.Argument(metavar="[PLATFORM]...", help="further platforms")
    ] = None,
) -> None:
    """Build the FMUs and the .ssp packages.

    \b
    canine build
    canine build --platform win64
    """
    from fmus.build import build_all
    from fmus.folder import build_folder

    with build_status("building") as done:
        paths = build_all(platforms=[*(platform or []), *(more or [])], done=done)
    typer.echo(f"{len(paths)} files in {short(build_folder())}")


@app.command()
def run(
    target: Target = DEFAULT,
    *,
    seed: Seed = None,
    settings: Settings = None,
    seeds: Annotated[
        str | None, typer.Option(metavar="a:b", help="a trial with each seed from a to b: a table")
    ] = None,
    plant: Plant = None,
    estimator: Estimator = None,
    controller: Controller = None,
    ahrs: Ahrs = False,
    order: Stepping = None,
    fmi: Fmi = None,
    onboard: Onboard = None,
    loop: Annotated[
        Loop | None,
        typer.Option(help="in C or in Python, with the same log; native by default, python with --onboard"),
    ] = None,
    call_limit: CallLimit = Limits.call,
    memory_limit: MemoryLimit = Limits.memory / GIB,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out",
            file_okay=False,
            help="by default out/<scenario>-<seed>, <folder of the log>-again, or out/<scenario>-seeds",
        ),
    ] = None,
    foxglove: Foxglove = None,
    is_live: Annotated[
        bool, typer.Option("--live", help="its page in the browser while it runs, at the clock's pace")
    ] = False,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="with --live: print the address alone")
    ] = False,
    speed: Annotated[
        float | None,
        typer.Option(min=0.01, max=1000, help="with --live or --foxglove: trial time over the clock's"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the summary as JSON")] = False,
) -> None:
    """Run a trial, and write its log and report.

    \b
    canine run                                    three_waypoint, seed 1
    canine run two_waypoint --seed 7 --set cmec.moving_deviation=37
    canine run my.toml --plant dog.fmu --order jacobi --fmi 3 --out out/dog
    canine run out/three_waypoint-1/trial.mcap    that trial again: the same log
    canine run --estimator canine_tracker         another estimator of ours
    canine run --controller quarter_turn --plant differential_drive   and another controller, another plant
    canine run --onboard pil:cortex-m4f           the firmware in the loop, fed with its instruments' bytes
    canine run two_waypoint --seeds 1:20          twenty trials: a folder each, a table, seeds.csv
    canine run --live --speed 2                   twice as fast as the clock, shown in the browser
    canine run --foxglove 8765                    at the clock's pace, once a viewer is there

    It leaves trial.mcap, summary.json, trial.html and trial.png.
    """
    from harness.log.live import Pace, viewers_at
    from harness.trial import trial
    from harness.trial.prepare import prepared
    from harness.trial.request import Changes, build_missing, requested
    from harness.trial.summary import show

    swaps = {"plant": plant, "controller": controller}
    limits = Limits(call=call_limit, memory=int(memory_limit * GIB))
    changes = Changes(order, fmi, swaps, settings or [], seed, onboard, estimator, ahrs, loop, limits)
    if seeds is not None and seed is not None:
        raise UsageError(f"--seed {seed} and --seeds {seeds}: expected one of both")
    if seeds is not None and foxglove is not None:
        raise UsageError(f"--foxglove {foxglove} and --seeds {seeds}: viewers are shown one trial")
    if seeds is not None and is_live:
        raise UsageError(f"--live and --seeds {seeds}: the browser is shown one trial")
    if speed is not None and not is_live and foxglove is None:
        raise UsageError(
            f"--speed {speed:g}: expected with --live or --foxglove; else nothing waits for the clock"
        )
    if no_browser and not is_live:
        raise UsageError("--no-browser: expected with --live")
    if is_live:
        station_commands.require_extra("--live")
    with requested(target, changes) as request:
        with build_status("building the FMUs") as done:
            build_missing(request, done)
        if seeds is not None:
            _run_seeds(request, seeds, folder, as_json)
            return
        pace = Pace(speed or 1.0)
        with ExitStack() as stack:
            ready = stack.enter_context(prepared(request))
            viewers = stack.enter_context(viewers_at(foxglove, print_note, pace=pace))
            live = stack.enter_context(_shown_live(request, pace, not no_browser)) if is_live else None
            notes = (*request.notes, *ready.notes)
            for note in notes:
                print_note(note)
            place = folder or request.default_folder
            if folder is None and (others := trial.replaced(request, ready, place)):
                print_note(others)
            duration, fault = request.scenario.duration, None
            with progress_bar("trial [s]", duration, quiet=as_json or duration < LONG_S) as progress:
                try:
                    summary = trial.run(request, ready, place, progress, viewers=viewers, audience=live)
                except trial.EndedByFaultError as error:
                    summary, fault = error.summary, error
                except KeyboardInterrupt as interrupt:
                    end_interrupted(interrupt, trial.what_is_left(place))
            for note in summary["notes"][len(notes) :]:
                print_note(note)
            if live:
                live.finish((place / trial.PAGE).read_bytes())
    if as_json:
        typer.echo(json_of(summary))
    else:
        show(summary, out())
        say_where(place)
    if fault is not None:
        raise fault


def _shown_live(request: Request, pace: Pace, opens: bool) -> AbstractContextManager[Live]:
    """A trial in the browser while it runs; `opens` the default one by itself."""
    from harness.station.live import live

    def ready(address: str) -> None:
        print_note(f"the trial begins when a browser opens {address}")
        if opens:
            station_commands.open_browser(address)

    return live(f"{request.scenario.name}, seed {request.scenario.seed}", pace, ready)


def _run_seeds(request: Request, seeds: str, folder: Path | None, as_json: bool) -> None:
    """`canine run --seeds`."""
    from harness.trial.seeds import SEEDS, default_folder, parse_seeds, run_seeds, show

    chosen = parse_seeds(seeds)
    place = folder or default_folder(request)
    summaries = []
    with (
        progress_bar("trials", len(chosen), quiet=as_json) as progress,
        closing(run_seeds(request, chosen, place, print_note)) as trials,
    ):
        try:
            for summary in trials:
                summaries.append(summary)
                if progress:
                    progress(len(summaries))
        except KeyboardInterrupt as interrupt:
            done = f"{len(summaries)} of {len(chosen)} trials are done"
            end_interrupted(interrupt, f"{done}: {place / SEEDS}" if summaries else done)
    if as_json:
        typer.echo(json_of(summaries))
    else:
        show(summaries, out())
        typer.echo(f"{short(place)}/: {SEEDS}, and a folder for each seed")


app.command("firmware")(firmware_commands.write_firmware)
app.command("keygen")(firmware_commands.keygen)
app.command("pil")(firmware_commands.processor_in_the_loop)
app.command("station")(station_commands.operate)
app.command("prove")(firmware_commands.prove_rules)
app.command("vest")(vest_commands.run_vest)


@app.command()
def wiring(
    target: Target = DEFAULT,
    *,
    order: Stepping = None,
    fmi: Fmi = None,
    plant: Plant = None,
    estimator: Estimator = None,
    controller: Controller = None,
    ahrs: Ahrs = False,
    as_json: Annotated[bool, typer.Option("--json", help="print it as JSON")] = False,
) -> None:
    """Print who is stepped when, and what delays: links by the names that scenarios use.

    \b
    canine wiring
    canine wiring my.ssp --order jacobi
    """
    from harness.cosim.wiring import Rate, wire
    from harness.trial.plan import address_of
    from harness.trial.prepare import prepared
    from harness.trial.request import Changes, build_missing, requested

    swaps = {"plant": plant, "controller": controller}
    with requested(target, Changes(order, fmi, swaps, estimator=estimator, ahrs=ahrs)) as request:
        with build_status("building the FMUs") as done:
            build_missing(request, done)
        with prepared(request) as ready:
            wired = wire(ready.system, ready.fmus, request.order, ready.plants)
    names = {link: address_of(link, ready.interfaces) for link, _ in wired.delays}
    if as_json:
        links = [
            {
                "link": names[link],
                "variables": (link.source_variable, link.target_variable),
                "factor": link.factor,
                "offset": link.offset,
                "table": link.table,
                "ticks": delay.least,
                "most_ticks": delay.most,
            }
            for link, delay in wired.delays
        ]
        written = {"order": wired.order, "step_s": wired.step, "links": links}
        typer.echo(json_of(written | {"rates": {n: asdict(wired.rates[n]) for n in wired.order}}))
        return
    rows = [("link", "delay")]
    for link, delay in wired.delays:
        own_names = f"({link})" if str(link) != names[link] else ""
        rows.append(("  ".join(filter(None, [names[link], link.conversion, own_names])), str(delay)))
    width = max(len(link) for link, _ in rows) + 2
    rates = {name: f" ({rate})" if rate != Rate() else "" for name, rate in wired.rates.items()}
    order_of_steps = ", then ".join(name + rates[name] for name in wired.order)
    typer.echo(f"{request.order}, every {wired.step:g} s: {order_of_steps}")
    for row, (what, delay_text) in enumerate(rows):  # importing rich's tables takes longer
        typer.secho(f"{what:{width}}{delay_text}", bold=row == 0 or None)


@app.command()
def check(
    fmu: Annotated[Path, typer.Argument(exists=True, metavar="X.fmu|RECORDING")],
    role: Annotated[str | None, typer.Option(help="does it fit this role of the system?")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print what is in a recording as JSON")] = False,
) -> None:
    """Does an FMU fit, or what is in a recording; and what is wrong with it.

    \b
    canine check dog.fmu --role plant             (dog.toml beside it may map names and units)
    canine check ../walk                          rates, holes, fixes, drops, mounting, clocks
    canine check field                            every recording below a folder
    """
    if fmu.is_dir() or fmu.suffix.lower() in STREAMS:
        if role is not None:
            raise UsageError(f"--role {role}: {fmu} is a recording; a role is for an FMU")
        from harness.recording import check as recordings

        results = recordings.check_all(fmu)
        if as_json:
            typer.echo(json_of(results))
        else:
            recordings.show_all(results, out())
        recordings.raise_problems(fmu, results)
        return
    if as_json:
        raise UsageError(f"--json: {fmu} is an FMU; --json is for a recording")
    if fmu.suffix.lower() == ".toml":
        raise UsageError(f"{fmu}: `canine run` takes scenarios; expected an FMU or a recording")
    if fmu.suffix.lower() == ".mcap":
        raise UsageError(f"{fmu}: `canine replay` takes logs; expected an FMU or a recording")
    from harness.cosim.check import check_fmu

    typer.echo(check_fmu(fmu, role, print_note))


@app.command("replay")
def replay_recording(
    recording: Annotated[Path, typer.Argument(exists=True, metavar="FOLDER|LOG.mcap")],
    *,
    estimator: Annotated[
        str, typer.Option(metavar="NAME,...|all", help="of ours; also paths of FMUs")
    ] = "four_state",
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="estimator.name=value", help="a parameter; angles in deg"),
    ] = None,
    parameters: Annotated[
        list[Path] | None,
        typer.Option(exists=True, dir_okay=False, metavar="X.toml", help="one more configuration, as tuned"),
    ] = None,
    outage: Annotated[float, typer.Option(min=OUTAGE_S[0], max=OUTAGE_S[1], help="s without GPS")] = 10,
    every: Annotated[
        float, typer.Option(min=EVERY_S[0], max=EVERY_S[1], help="s from one outage's start to the next")
    ] = 5,
    attitude: Annotated[
        str, typer.Option(metavar="own|recorded", help="of the Canine AHRS, or as recorded where it is")
    ] = "",
    folder: Annotated[
        Path | None, typer.Option("--out", file_okay=False, help="by default out/replay-<recording>")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the result as JSON")] = False,
) -> None:
    """Run estimators over a recording with simulated outages: a table, outages.json, replay.html, replay.png.

    \b
    canine replay ../walk                         a folder with .ubx, imu*.csv and their time tags
    canine replay ../walk --estimator all         every estimator of ours, in each of its configurations
    canine replay ../walk --estimator six_state,two_bias --set estimator.position_sd_floor=0.5
    canine replay ../walk --parameters out/tune-walk/tune.toml   with what canine tune found
    canine replay out/demo --outage 5             the log of a trial, or the folder that has it
    canine replay field                           every recording below a folder: a table of all

    Other formats: harness/recording/README.md.
    """
    from harness.files import replaced
    from harness.recording.find import recordings_below
    from harness.recording.signals import require_attitude
    from harness.replay import replay
    from harness.replay.comparison import compare
    from harness.replay.source import open_source, recorded_at

    comparison = compare(estimator, settings or [], parameters or [])
    require_attitude(attitude)
    recording = recorded_at(recording)
    paths = recordings_below(recording)
    if paths != [recording]:
        _replay_all(recording, paths, comparison, (outage, every), folder, attitude=attitude, as_json=as_json)
        return
    source = open_source(recording, attitude)
    if source.broken:
        print_note(f"{recording}: the log is not whole, {source.broken}")
    for note in (*source.notes, *comparison.notes(source)):
        print_note(f"{recording}: {note}")
    chosen = source.outages(outage, every)
    with progress_bar("outages", len(chosen.windows), quiet=as_json) as progress:
        replayed = replay.replay(source, comparison, chosen, progress)
    for note in replayed.notes:
        print_note(f"{recording}: {note}")
    place = folder or source.folder
    if others := replaced(place / "outages.json", replay.identity(source, comparison, chosen)):
        print_note(f"{place}: has another replay, which this replaces ({others})")
    result = replay.report(source, comparison, chosen, replayed, place)
    if as_json:
        typer.echo(json_of(result))
    else:
        replay.show(result, out())
        say_where(place)
    if verdicts := replayed.verdicts.values():
        raise CanineError("\n".join(verdicts))


def _replay_all(
    path: Path,
    paths: list[Path],
    comparison: Comparison,
    outage: tuple[float, float],
    folder: Path | None,
    *,
    attitude: str,
    as_json: bool,
) -> None:
    """`canine replay` of a folder of recordings."""
    from harness.replay import several

    place, results = folder or several.default_folder(path), []
    with progress_bar("recordings", len(paths), quiet=as_json) as progress:
        for recording in paths:
            results.append(several.replay_one(path, recording, comparison, outage, place, attitude=attitude))
            if progress:
                progress(len(results))
    if as_json:
        typer.echo(json_of(results))
    else:
        several.show(results, out())
    several.require_one(path, results)
    if failed := [result["recording"] for result in results if result["problem"]]:
        some = f"{len(failed)} of {len(results)} recordings"
        print_note(f"{path}: {some} cannot be replayed: {', '.join(failed)}")
    if not as_json:
        typer.echo(f"{short(place)}/: a folder for each recording")
    several.require_sound(results)


app.command("sweep")(sweep_commands.sweep_parameters)
app.command("matrix")(sweep_commands.compare_controllers)
app.command("day")(sweep_commands.run_days)
app.command("plan")(route_commands.plan_route)


@app.command("fit")
def fit_animal(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap|FOLDER...")],
    *,
    source: Annotated[
        Literal["plant", "estimator"] | None,
        typer.Option(help="whose motion; by default the plant's where it is logged, else the estimator's"),
    ] = None,
    turned: Annotated[
        float | None,
        typer.Option(min=1e-3, max=90, help="deg/s from which on a LEFT or RIGHT was obeyed; see the README"),
    ] = None,
    rest: Annotated[
        str | None,
        typer.Option(
            metavar="s,...",
            help="each folder's logs are one day's missions; rest between two missions, s",
        ),
    ] = None,
    settings: Settings = None,
    folder: Annotated[Path | None, typer.Option("--out", file_okay=False, help="by default out/fit")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the result as JSON")] = False,
) -> None:
    """Estimate the animal's statistics (Table 5.1): a table, fit.json, fit.html, fit.png, fit.toml to run.

    \b
    canine fit out                                every trial.mcap below out
    canine fit field/*.mcap --source estimator    as without the truth
    canine fit monday tuesday --rest 600          and how it tires and habituates over a day
    canine fit 1.mcap 2.mcap 3.mcap --rest 600,900 --set canine.fatigue_time=1800

    --rest takes as given, unless --set says otherwise, what canine_all_day assumes of ways and times.
    """
    from harness.fit import day, report
    from harness.fit import estimate as statistics

    days = None
    if rest is not None:
        laws = day.laws_given(settings or [])
        days = day.Days(statistics.days_of(logs), numbers("--rest", rest, "s"), laws)
    elif settings:
        raise UsageError(f"--set {settings[0]}: acts with --rest alone, which says that the logs are of days")
    paths = statistics.find_logs(logs)
    with progress_bar("logs", len(paths), quiet=as_json) as progress:
        reading = statistics.read_tracks(paths, source, progress)
    result = statistics.estimate(reading, None if turned is None else math.radians(turned), days)
    place = folder or report.FOLDER
    report.report(result, place, print_note)
    if as_json:
        typer.echo(json_of(result))
    else:
        report.show(result, out())
        say_where(place)


@app.command()
def study(
    name: Annotated[str, typer.Argument(metavar="[NAME]", help="without it, the studies are listed")] = "",
    recording: Annotated[
        Path | None,
        typer.Argument(
            exists=True,
            metavar="[FOLDER|LOG.mcap|PATH.csv]",
            help="for studies of one: recording (a folder or a log), motion (the folder of a dog's unit), "
            "outage (a csv of positions or a log)",
        ),
    ] = None,
    *,
    seeds: Annotated[
        int | None, typer.Option(help="trials of each kind, 2 to 5000; by default the study's own")
    ] = None,
    sensor_sets: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME", help="of sensors and pack: dissertation, measured..."),
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--out", file_okay=False, help="by default out/study-<name>")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the result as JSON")] = False,
) -> None:
    """Carry out a study of Chapter 3 or Appendices B to D: tables, pictures, study.html, <name>.json.

    \b
    canine study                                  the studies, a line each
    canine study pitch
    canine study outage --seeds 1000 --set measured
    canine study recording ../walk                all estimators on a recording, as canine replay reads them
    """
    from harness.studies.study import Options, find_study, report, run_study

    if not name:
        for title, summary in STUDIES.items():
            out().print(f"{title:<14}{summary}", soft_wrap=True, markup=False, highlight=False)
        return
    if sensor_sets and len(sensor_sets) > 1:
        raise UsageError(f"--set {' --set '.join(sensor_sets)}: a study takes one set, or all without --set")
    sensor_set = sensor_sets[0] if sensor_sets else None
    with progress_bar("percent", 100, quiet=as_json) as progress:
        result = run_study(name, Options(seeds, sensor_set, recording), progress)
    place = folder or Path("out", f"study-{name}")
    report(name, result, place, print_note)
    if as_json:
        typer.echo(json_of(result))
    else:
        find_study(name).show(result, out())
        say_where(place)


@app.command("tune")
def tune_estimator(
    recording: Annotated[Path, typer.Argument(exists=True, metavar="FOLDER|LOG.mcap")],
    *,
    estimator: Annotated[str, typer.Option(help="the block to tune")] = "four_state",
    hold: Annotated[
        list[str] | None, typer.Option(metavar="NOISE", help="stays as declared, such as sigma_bias")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--out", file_okay=False, help="by default out/tune-<recording>")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the result as JSON")] = False,
) -> None:
    """Fit an estimator's noise to a recording: tables, tune.json, tune.html, tune.png, and tune.toml to run.

    The noise is the one that makes the innovations of the first half most likely, with its confidence
    intervals. The second half judges: NIS, log-likelihood, and the errors in outages of 10 s.

    \b
    canine tune ../walk
    canine tune ../walk --hold sigma_bias         the bias walks as declared
    canine tune out/distance_100-1/trial.mcap --estimator canine_tracker
    """
    from harness.replay.source import open_source
    from harness.tune import report
    from harness.tune.tune import tune
    from models.system import find_estimator

    block = find_estimator(estimator)
    source = open_source(recording)
    for note in source.notes:
        print_note(f"{recording}: {note}")
    with progress_bar("percent", 100, quiet=as_json) as progress:
        result = tune(source, block, hold or [], progress)
    place = folder or report.default_folder(source.name)
    report.report(result, place, print_note)
    if as_json:
        typer.echo(json_of(result))
    else:
        report.show(result, out())
        say_where(place)


app.command("compare")(log_commands.compare_logs)
app.command("report")(log_commands.report_log)
app.command("recover")(log_commands.recover_log)
app.command("export")(log_commands.export)
app.command("faults")(fault_commands.try_faults)


@app.command("scenarios")
def list_scenarios(
    as_json: Annotated[bool, typer.Option("--json", help="print them as JSON")] = False,
) -> None:
    """List the scenarios that come with the project; each runs by its name."""
    from rich.markup import escape

    from harness.terminal import new_table, print_table
    from harness.trial.scenario import about, load, shipped

    scenarios = {name: load(name) for name in shipped()}
    if as_json:
        entries = [
            {"name": name, "system": s.system, "waypoints": s.waypoints, "duration_s": s.duration}
            | {"about": about(name)}
            for name, s in scenarios.items()
        ]
        typer.echo(json_of(entries))
        return
    table = new_table()
    for heading in ("\nscenario", "waypoints\nafter the start", "\nsystem", "\nwhat it is"):
        table.add_column(heading, justify="right" if "waypoints" in heading else "left")
    for name, scenario in scenarios.items():
        table.add_row(name, str(len(scenario.waypoints)), scenario.system, escape(about(name)))
    print_table(table, out())


@app.command("parameters")
def list_parameters(
    block: Annotated[str | None, typer.Argument(metavar="[BLOCK]", help="by default all")] = None,
    *,
    reading: Annotated[ReadingName, typer.Option(help="whose defaults are listed")] = "calibrated",
    as_json: Annotated[bool, typer.Option("--json", help="print them as JSON")] = False,
) -> None:
    """List the parameters that a scenario or --set can set: unit, range, default, meaning; angles in deg.

    \b
    canine parameters
    canine parameters cmec
    canine parameters cmec --reading guarded      the defaults of firmware, with limits

    A set of parameters is chosen by its name: --set canine=table_5_1, or canine = "table_5_1" in a scenario.
    """
    from harness.trial import parameters
    from models.readings import ON_BOARD
    from models.system import BLOCKS, find_block

    blocks = BLOCKS if block is None else [find_block(block)]
    rows, on_board = (parameters.parameters_of(blocks, name) for name in (reading, ON_BOARD))
    if as_json:
        typer.echo(json_of(parameters.as_json(rows)))
    else:
        parameters.show(rows, out())
        if block and (sets := parameters.sets_for(blocks[0])):
            print_note(f"sets: {', '.join(sets)}; --set {blocks[0].title()}={sets[0]}")
        if others := sum(row != other for row, other in zip(rows, on_board, strict=True)):
            print_note(
                f"defaults of the reading {reading}; {others} are others in {ON_BOARD}, the reading of "
                f"firmware: --reading {ON_BOARD}"
            )


@app.command("c")
def c_of_block(
    block: str,
    *,
    precision: Annotated[Literal["float", "double"], typer.Option(help="of the arithmetic")] = "double",
    folder: Annotated[
        Path | None, typer.Option("--out", file_okay=False, metavar="DIR", help="by default out/c")
    ] = None,
) -> None:
    """Write the C of a block: a header and a source, which need no library but sqrt, floor and fabs.

    \b
    canine c cmec
    canine c four_state --precision float --out firmware/src
    """
    from codegen.blocks.block_c import generate, write_files
    from harness.files import make_folder
    from models.system import find_block

    declared = find_block(block)
    if precision not in declared.precisions:
        raise UsageError(
            f"--precision {precision}: {block} comes in {' and '.join(declared.precisions)} only"
        )
    files = generate(declared, precision)
    place = folder or Path("out/c")
    make_folder(place)
    for path in write_files(files, place):
        typer.echo(short(path))


def program_of(arguments: Sequence[str]) -> Any:
    """The program that a command line is for: of the command that it names alone, else of all.

    typer reads the signatures of all commands that it has, for tens of milliseconds.
    """
    name = next((argument for argument in arguments if not argument.startswith("-")), "")
    commands = app.registered_commands
    named = [one for one in commands if (one.name or getattr(one.callback, "__name__", "")) == name]
    program = copy(app)
    program.registered_commands = named or commands
    return typer.main.get_command(program)
