"""The command of `canine` that tries faults; `command_line` adds it."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from harness.console import (
    build_status,
    end_interrupted,
    json_of,
    out,
    print_note,
    progress_bar,
    short,
)
from harness.cosim.stepping import GIB, Limits
from harness.options import (
    Ahrs,
    CallLimit,
    Controller,
    Estimator,
    MemoryLimit,
    Onboard,
    Plant,
    Seed,
    Settings,
)


def try_faults(
    target: Annotated[str, typer.Argument(metavar="SCENARIO")],
    *,
    seed: Seed = None,
    settings: Settings = None,
    plant: Plant = None,
    estimator: Estimator = None,
    controller: Controller = None,
    ahrs: Ahrs = False,
    onboard: Onboard = None,
    call_limit: CallLimit = Limits.call,
    memory_limit: MemoryLimit = Limits.memory / GIB,
    at: Annotated[float, typer.Option(min=0, help="s at which those of the catalogue begin")] = 3.0,
    lasting: Annotated[float, typer.Option(min=0.04, help="s that those of the catalogue last")] = 4.0,
    folder: Annotated[
        Path | None,
        typer.Option("--out", file_okay=False, help="by default out/<scenario>-faults"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the results as JSON")] = False,
) -> None:
    """Try each fault of a scenario alone: what did the controller do?

    \b
    canine faults two_waypoint
    canine faults my.toml --out out/mine --json
    canine faults two_waypoint --controller quarter_turn

    A scenario without faults is tried with a catalogue: sensors, estimate, command and radio, each with kinds
    of faults that fit. A trial without faults comes first. The controller `stopped` within so many ticks for
    what it noticed, `went on` to a success, or `failed`. The folder gets a trial for each fault by number,
    faults.json and faults.csv.
    """
    from harness.trial import lone_faults
    from harness.trial.request import Changes, requested

    swaps = {"plant": plant, "controller": controller}
    limits = Limits(call=call_limit, memory=int(memory_limit * GIB))
    changes = Changes(
        swaps=swaps, settings=settings or [], seed=seed, onboard=onboard, estimator=estimator, ahrs=ahrs,
        limits=limits,
    )  # fmt: skip
    with requested(target, changes) as request:
        with build_status("building the FMUs") as done:
            cases = lone_faults.build_cases(request, at, at + lasting, built=done, note=print_note)
        place = folder or lone_faults.default_folder(request)
        results = []
        with (
            progress_bar("trials", len(cases) + 1, quiet=as_json) as progress,
            closing(lone_faults.run_cases(request, cases, place)) as trials,
        ):
            try:
                for result in trials:
                    results.append(result)
                    if progress:
                        progress(len(results))
            except KeyboardInterrupt as interrupt:
                done_so_far = f"{len(results)} of {len(cases) + 1} trials are done"
                end_interrupted(interrupt, f"{done_so_far}: {place}" if results else done_so_far)
    if as_json:
        typer.echo(json_of(results))
    else:
        lone_faults.show(results, out())
        typer.echo(f"{short(place)}/: {lone_faults.JSON}, {lone_faults.CSV}, and a folder for each trial")
