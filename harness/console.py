"""What every command prints beside its tables: notes, JSON, and where the results lie."""

from __future__ import annotations

import json
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import typer

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
