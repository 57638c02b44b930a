"""The commands of `canine` that take logs of trials; `command_line` adds them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from harness.console import print_note, say_where
from models.errors import UsageError


def export_log(
    log: Annotated[str, typer.Argument(metavar="LOG.mcap")],
    *,
    to: Annotated[Literal["csv", "parquet"], typer.Option(help="the format")],
    folder: Annotated[
        Path | None,
        typer.Option("--out", file_okay=False, help="by default a folder csv or parquet beside it"),
    ] = None,
) -> None:
    """Write a log's signals for other tools: a file for each component, and units.json.

    \b
    canine export out/demo/trial.mcap --to csv
    canine export out/demo/trial.mcap --to parquet --out data

    The first column is `time` in s. NaN, Infinity and -Infinity stand in a CSV by these names. Parquet needs
    the extra guided-canine[parquet].
    """
    from harness.log.export import export
    from harness.log.log import read_log
    from harness.trial.scenario import shipped

    if log.endswith(".toml") or (log in shipped() and not Path(log).exists()):
        raise UsageError(f"export {log}: expected a log; `canine run {log}` writes one, trial.mcap")
    content = read_log(Path(log))
    if content.broken:
        print_note(f"{log}: the log is not whole, {content.broken}")
    place = folder or Path(log).parent / to
    export(content, to, place)
    say_where(place)
