"""A scenario run with several seeds: a folder for each trial, and a table of all."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Generator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from harness.files import write_whole
from harness.terminal import new_table, percent, print_table
from harness.trial import trial
from harness.trial.prepare import prepared
from harness.trial.request import Request, with_seeds
from models.errors import UsageError
from models.kit.random import MAX_SEED

SEEDS = "seeds.csv"
COLUMNS = ("seed", "outcome", "time_s", "waypoints_reached", "directional_commands")
ERRORS = ("mean", "max", "final")


def parse_seeds(text: str) -> range:
    """The seeds of `a:b`, with b.

    Raises:
        UsageError: it is not a:b, or a seed is out of range.
    """
    first, colon, last = text.partition(":")
    if colon and first.isdecimal() and last.isdecimal() and int(first) <= int(last) <= MAX_SEED:
        return range(int(first), int(last) + 1)
    raise UsageError(
        f"--seeds {text}: expected a:b, the first and the last seed, 0 <= a <= b <= {MAX_SEED}; as in 1:20"
    )


def default_folder(request: Request) -> Path:
    """Where the trials go by default: out/<scenario>-seeds."""
    return request.default_folder.with_name(f"{request.scenario.name}-seeds")


def run_seeds(
    request: Request,
    seeds: Sequence[int],
    out: Path,
    note: Callable[[str], None] = lambda text: None,
) -> Generator[dict[str, Any]]:
    """Run a trial with each seed into out/<seed>; yields the summaries.

    However it ends, seeds.csv has the trials that are done. A trial that the user ends leaves no files.

    Args:
        note: called with what the user should know: of all trials once, of one trial with its seed.

    Raises:
        UsageError: a folder cannot be made, or others write into it.
        CanineError: a fault in what was run; that trial's files, and its row, tell of it up to there.
        KeyboardInterrupt: the user ended it.
    """
    with trial.alone_in(out):
        (out / SEEDS).unlink(missing_ok=True)  # an earlier run's
        summaries: list[dict[str, Any]] = []
        notes_printed: set[str] = set()
        try:
            for seed, one in zip(seeds, with_seeds(request, seeds), strict=True):
                folder = out / str(seed)
                with prepared(one) as ready:
                    others = "" if summaries else trial.replaced(one, ready, folder)
                    for text in (*request.notes, *ready.notes, *([others] if others else [])):
                        if text not in notes_printed:
                            note(text)
                        notes_printed.add(text)
                    try:
                        summaries.append(trial.run(one, ready, folder))
                        late = summaries[-1]["notes"][len(request.notes) + len(ready.notes) :]
                        for text in late:
                            note(f"seed {seed}: {text}")
                    except trial.EndedByFaultError as error:
                        summaries.append(error.summary)
                        raise
                    except KeyboardInterrupt:
                        _remove(folder)
                        raise
                yield summaries[-1]
        finally:
            if summaries:
                write_whole(out / SEEDS, csv_of(summaries))


def _remove(folder: Path) -> None:
    """Remove the files of a trial that ended early, and its folder if nothing else is in it."""
    if trial.has_begun(folder):  # else they are an earlier run's
        for name in (trial.LOG, trial.PAGE, trial.PICTURE):
            (folder / name).unlink(missing_ok=True)
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def csv_of(summaries: Sequence[Mapping[str, Any]]) -> bytes:
    """The table as CSV: a row for each trial; errors of the position [m] are empty without an estimator."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*COLUMNS, *(f"position_error_{kind}_m" for kind in ERRORS)])
    for summary in summaries:
        errors = summary["position_error_m"] or dict.fromkeys(ERRORS, "")
        writer.writerow([*(summary[column] for column in COLUMNS), *(errors[kind] for kind in ERRORS)])
    return text.getvalue().encode()


def show(summaries: Sequence[Mapping[str, Any]], console: Console) -> None:
    """Print the table, and how many trials succeeded."""
    table = new_table()
    for heading in ("seed", "outcome", "time [s]", "waypoints", "commands", "position error [m]"):
        table.add_column(escape(heading), justify="left" if heading == "outcome" else "right")
    for summary in summaries:
        error = summary["position_error_m"]
        table.add_row(
            str(summary["seed"]),
            summary["outcome"],
            f"{summary['time_s']:.2f}",
            str(summary["waypoints_reached"]),
            str(summary["directional_commands"]),
            f"{error['mean']:.2f}" if error else "-",
        )
    print_table(table, console)
    successes = sum(summary["outcome"] == "success" for summary in summaries)
    share = f"{successes / len(summaries):.0%}"
    if share in ("0%", "100%") and 0 < successes < len(summaries):  # rounded
        share = percent(successes / len(summaries))
    console.print(f"{successes} of {len(summaries)} trials succeeded ({share})")
