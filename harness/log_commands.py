"""The commands of `canine` that take logs, and trials as other tools take them; `command_line` adds them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from harness.console import build_status, json_of, out, print_note, say_where, short
from harness.options import Ahrs, Controller, Estimator, Fmi, Plant, Seed, Settings
from models.errors import UsageError

if TYPE_CHECKING:
    from harness.trial.request import Changes


def export(
    target: Annotated[str, typer.Argument(metavar="LOG.mcap|SCENARIO")],
    *,
    to: Annotated[
        Literal["csv", "parquet"] | None, typer.Option(help="a log's signals: the format of their files")
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out", file_okay=False, help="of --to; by default a folder csv or parquet beside the log"
        ),
    ] = None,
    ssp: Annotated[
        Path | None, typer.Option(dir_okay=False, metavar="FILE.ssp", help="a trial as a package")
    ] = None,
    seed: Seed = None,
    settings: Settings = None,
    plant: Plant = None,
    estimator: Estimator = None,
    controller: Controller = None,
    ahrs: Ahrs = False,
    fmi: Fmi = None,
) -> None:
    """Write for other tools: a log's signals as tables (--to), or a trial as an SSP package (--ssp).

    \b
    canine export out/demo/trial.mcap --to csv
    canine export out/demo/trial.mcap --to parquet --out data
    canine export left_90 --ssp left_90.ssp
    canine export my.toml --seed 7 --set cmec.moving_deviation=37 --fmi 3 --ssp my.ssp

    Of a log: a file for each component, and units.json. The first column is `time` in s. NaN, Infinity and
    -Infinity stand in a CSV by these names. Parquet needs the extra guided-canine[parquet].

    The package holds the trial's FMUs, their wiring, and all that the scenario sets: seed, start, waypoints,
    reading, parameters, the controller's start. It cannot hold changes by time ([[set]],
    a lost radio).
    """
    from harness.trial.request import Changes

    if (to is None) == (ssp is None):
        raise UsageError(f"export {target}: expected --to csv, --to parquet, or --ssp FILE.ssp")
    swaps = {role: fmu for role, fmu in (("plant", plant), ("controller", controller)) if fmu is not None}
    changes = Changes(
        fmi=fmi, swaps=swaps, settings=settings or [], seed=seed, estimator=estimator, ahrs=ahrs
    )
    if ssp is not None:
        if folder is not None:
            raise UsageError(f"--out {folder} is for --to; --ssp {ssp} names the file itself")
        _export_trial(target, changes, ssp)
    elif changes != Changes(settings=[]):
        raise UsageError(f"--to {to}: a log is exported as it is; what changes a trial is for --ssp")
    else:
        _export_signals(target, str(to), folder)


def _export_signals(log: str, to: str, folder: Path | None) -> None:
    from harness.log import export as tables
    from harness.log.log import read_log
    from harness.trial.scenario import shipped

    if log.endswith(".toml") or (log in shipped() and not Path(log).exists()):
        raise UsageError(f"export {log}: expected a log; `canine run {log}` writes one, trial.mcap")
    content = read_log(Path(log))
    if content.broken:
        print_note(f"{log}: the log is not whole, {content.broken}")
    place = folder or Path(log).parent / to
    tables.export(content, to, place)
    say_where(place)


def _export_trial(target: str, changes: Changes, file: Path) -> None:
    from harness.trial.package import write_package
    from harness.trial.prepare import prepared
    from harness.trial.request import build_missing, requested

    with requested(target, changes) as request:
        with build_status("building the FMUs") as done:
            build_missing(request, done)
        with prepared(request) as ready:
            for note in (*request.notes, *ready.notes):
                print_note(note)
            write_package(request, ready, file)
    typer.echo(short(file))


def compare_logs(
    a: Annotated[Path, typer.Argument(metavar="A")],
    b: Annotated[Path, typer.Argument(metavar="B")],
    *,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ABS|signal=ABS",
            help="largest difference that still agrees, in the signal's unit as in the log (angles in rad): "
            "for all signals, a component's, or one",
        ),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option("--html", dir_okay=False, metavar="FILE", help="a page with both: map and plots"),
    ] = None,
    values_only: Annotated[
        bool, typer.Option("--values-only", help="metadata, units and attachments may differ")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print the result as JSON")] = False,
) -> None:
    """Compare two logs, or the logs in two folders of runs: do they agree, and where do they differ first?

    \b
    canine compare out/demo/trial.mcap out/again/trial.mcap
    canine compare out/demo out/again --tolerance 1e-9
    canine compare out/demo out/again --tolerance 1e-9 --tolerance estimator.north=0.01 --tolerance plant=0
    canine compare out/demo out/again --values-only
    canine compare out/demo out/left_90-1 --html both.html

    Rows are compared at the times that both have. Without a tolerance values must have the same bits: 0.0 is
    not -0.0, NaN is NaN. With one, an angle (in rad or deg, unless its name ends in _sd) differs by the
    shorter way round, and NaN differs from every number. What comes after the end of a log that was cut does
    not count. Exit status: 0 they agree, 1 they differ.
    """
    from harness.log import comparison_table
    from harness.log.compare import Tolerances, compare
    from harness.log.log import log_of, read_log

    tolerances = Tolerances.parse(tolerance or [])
    logs = read_log(log_of(a)), read_log(log_of(b))
    result = compare(*logs, tolerances, values_only=values_only)
    if as_json:
        typer.echo(json_of(result.facts()))
    else:
        comparison_table.show(result, out())
    if html is not None:
        from harness.trial.comparison_page import write_comparison

        write_comparison(*logs, result, html)
        if not as_json:
            typer.echo(short(html))
    for log in logs:
        if log.broken:
            print_note(f"{log.path}: the log is not whole, {log.broken}; what is after that does not count")
    if not result.agree:
        raise typer.Exit(1)


def report_log(
    log: Annotated[Path, typer.Argument(metavar="LOG")],
    *,
    file: Annotated[
        Path | None,
        typer.Option("--out", dir_okay=False, metavar="FILE.html", help="by default <log>.html beside it"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the summary as JSON")] = False,
) -> None:
    """Write the page of a trial from its log, or the log in a run's folder: map, plots, events, playback.

    \b
    canine report out/demo
    canine report field.mcap --out field.html

    The page needs no network and no other file. It is what `canine run` leaves as trial.html. A log that was
    cut short, or whose trial a fault ended, has a page up to there.
    """
    from harness.log.log import log_of, read_log
    from harness.trial.page import write_page
    from harness.trial.summary import show, summarize
    from harness.trial.vest_notes import radio_notes, refusal_notes

    content = read_log(log_of(log))
    page = file or content.path.with_suffix(".html")
    summary = summarize(content, notes=refusal_notes(content) + radio_notes(content))
    write_page(content, summary, page)
    if as_json:
        typer.echo(json_of(summary))
        return
    show(summary, out())
    if content.broken:
        print_note(f"{content.path}: the log is not whole, {content.broken}")
    typer.echo(short(page))


def recover_log(
    log: Annotated[Path, typer.Argument(metavar="LOG.mcap")],
    *,
    file: Annotated[
        Path | None,
        typer.Option("--out", dir_okay=False, metavar="FILE", help="by default <log>-recovered.mcap"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print what was recovered as JSON")] = False,
) -> None:
    """Make a log whole that was cut: its process was killed, or its disk was full. The log itself stays.

    \b
    canine recover out/demo/trial.mcap
    canine recover out/demo --out out/demo.mcap

    The new file has all ticks that were written whole, and its metadata say that it was recovered. Of a log
    that is damaged elsewhere it has what stands before the damage. A log that is whole is not written anew.
    """
    from harness.log.log import log_of, read_log
    from harness.log.recover import recover
    from harness.trial.summary import show, summarize

    recovery = recover(log_of(log), file)
    summary = summarize(recovery.log if recovery.out is None else read_log(recovery.out))
    if as_json:
        typer.echo(json_of(recovery.facts() | {"summary": summary}))
        return
    for line in recovery.words():
        typer.echo(line)
    if recovery.out is not None:
        show(summary, out())
        typer.echo(short(recovery.out))
