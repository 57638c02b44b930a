"""What every command prints beside its tables: notes, JSON, progress, where the results lie, an early end."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer

from harness.interrupts import name_of

if TYPE_CHECKING:
    from rich.console import Console


@cache
def out() -> Console:
    """Standard output, with tables and colours on a terminal."""
    from harness.terminal import console_of  # noqa: PLC0415 - help and usage errors need no rich

    return console_of()


@cache
def err() -> Console:
    """Standard error, for notes and progress."""
    from harness.terminal import console_of  # noqa: PLC0415 - as above

    return console_of(stderr=True)


def json_of(value: object) -> str:
    """A result as JSON; letters are escaped only where standard output cannot show them all."""
    is_unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    return json.dumps(value, indent=2, ensure_ascii=not is_unicode)


def print_note(text: str) -> None:
    """Print what a user should know, as it is: nothing in it is markup."""
    err().print(f"note: {text}", style="dim", soft_wrap=True, markup=False)


def say_where(folder: Path) -> None:
    """Where the results lie: what there is, by name."""
    typer.echo(f"{short(folder)}/: {', '.join(sorted(p.name for p in folder.iterdir() if p.is_file()))}")


def short(path: Path) -> str:
    """A path as a user would type it."""
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path)


def end_interrupted(interrupt: KeyboardInterrupt, what: str) -> NoReturn:
    """Say what is left of a command that the user ended, and leave."""
    number = interrupt.args[0] if interrupt.args else signal.SIGINT
    err().print(f"canine: ended by {name_of(number)}; {what}", soft_wrap=True, markup=False)
    sys.exit(128 + number)


@contextmanager
def build_status(what: str) -> Iterator[Callable[[Path], None]]:
    """Say on a terminal which file is ready; the compiler takes some seconds for each."""
    if not sys.stderr.isatty():
        yield lambda path: None
        return
    with err().status(f"{what}...") as status:
        yield lambda path: status.update(f"{what}... {path.parent.name}/{path.name}")


@contextmanager
def progress_bar(what: str, total: float, quiet: bool) -> Iterator[Callable[[float], None] | None]:
    """A progress bar, on a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415 - as above

    with Progress(
        TextColumn(what), BarColumn(), TextColumn("{task.completed:.0f} of {task.total:.0f}"),
        TimeElapsedColumn(), console=err(), transient=True,
    ) as bar:  # fmt: skip
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, completed=done)
