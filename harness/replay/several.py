"""Replays of all recordings below a folder: a folder of results for each, and a table of all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from harness.recording.find import name_below
from harness.replay.comparison import Comparison
from harness.replay.outage import COLUMNS
from harness.replay.replay import not_used, replay, report
from harness.replay.source import open_source
from harness.terminal import new_table, print_table
from models.errors import CanineError

PARTS = ("configurations", "verdicts")  # of outages.json, by the configurations' names


def default_folder(path: Path) -> Path:
    """The folder of the results by default, with one in it for each recording."""
    return Path("out") / f"replay-{path.resolve().name}"


def replay_one(
    path: Path,
    recording: Path,
    comparison: Comparison,
    outage: tuple[float, float],
    folder: Path,
    *,
    attitude: str = "",
) -> dict[str, Any]:
    """Replay one recording below `path`: the content of outages.json, and a `problem`, "" if none.

    Args:
        outage: its length, and the time from one's start to the next's [s].
        folder: gets a folder with the results.
        attitude: own or recorded; by default as recorded, if the recording has one.
    """
    name = name_below(path, recording)
    try:
        source = open_source(recording, attitude)
        chosen = source.outages(*outage)
        replayed = replay(source, comparison, chosen)
        result = report(source, comparison, chosen, replayed, folder / name)
    except CanineError as reason:
        return {"recording": name, "problem": str(reason)}
    return result | {"recording": name, "problem": ""}


def require_one(path: Path, results: Sequence[dict[str, Any]]) -> None:
    """Raise if no recording could be replayed.

    Raises:
        CanineError: none could.
    """
    if all(result["problem"] for result in results):
        raise CanineError(f"{path}: none of {len(results)} recordings can be replayed; see what keeps each")


def require_sound(results: Sequence[dict[str, Any]]) -> None:
    """Raise if an FMU went wrong in a recording.

    Raises:
        CanineError: one did; the text has each verdict.
    """
    verdicts = [
        f"{result['recording']}: {verdict}"
        for result in results
        if not result["problem"]
        for verdict in result["verdicts"].values()
    ]
    if verdicts:
        raise CanineError("\n".join(verdicts))


def show(results: Sequence[dict[str, Any]], console: Console) -> None:
    """Print the median error of each configuration at the ends of the outages, a line for each recording."""
    # a recording without a magnetometer lacks the estimators that need one
    replayed = [result for result in results if not result["problem"]]
    names = list(dict.fromkeys(name for result in replayed for part in PARTS for name in result[part]))
    table = new_table()
    table.add_column("median position error [m]\nat the end of the outage")
    for heading in ("outages", "left out", "dropped", *names):
        table.add_column(f"\n{heading}", justify="right")
    for result in results:
        if result["problem"]:
            table.add_row(result["recording"], "0", *"-" * (2 + len(names)))
            continue
        own, failed = result["configurations"], result["verdicts"]
        medians = [
            f"{own[name][COLUMNS[0]]['median']:.2f}" if name in own else "failed" if name in failed else "-"
            for name in names
        ]
        table.add_row(
            result["recording"],
            str(len(result["outages"])),
            str(sum(result["left_out"].values())),
            str(sum(result["dropped"].values())),
            *medians,
        )
    print_table(table, console)
    for result in results:
        notes = [] if result["problem"] else [f"note: {note}" for note in result["notes"]]
        for line in [*(result["problem"] or not_used(result)).splitlines(), *notes]:
            console.print(f"{result['recording']}: {line}", soft_wrap=True, markup=False, highlight=False)
