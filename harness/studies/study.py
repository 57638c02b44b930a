"""A study by its name: found, carried out, written."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, TypeVar, cast

from matplotlib.figure import Figure
from rich.console import Console

from harness.drawing import png_of
from harness.files import replaced, write_set
from harness.report.charts import charts_page
from harness.studies import STUDIES
from models.errors import UsageError, nearest

Result = dict[str, Any]  # JSON
Item = TypeVar("Item")
Answer = TypeVar("Answer")
PAGE = "study.html"
MOST_SEEDS = 5000  # more would take gigabytes, and the intervals are narrow by then
Progress = Callable[[float], None]  # called with the percentage that is done


@dataclass(frozen=True)
class Options:
    """What a user may choose; a study refuses what it has no use for.

    Attributes:
        seeds: how many trials of each kind; None: the study's own number.
        set: of sensors and pack, one of `models.sets.SETS`; None: the study's own choice.
        recording: a folder or a log.
    """

    seeds: int | None = None
    set: str | None = None
    recording: Path | None = None


def in_threads(function: Callable[[Item], Answer], items: Iterable[Item]) -> Iterator[Answer]:
    """The function's results in the order of the items, several at once; when nobody waits, no more begin."""
    with ThreadPoolExecutor() as pool:
        try:
            yield from pool.map(function, items)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


class Study(Protocol):
    """What a study's module has.

    Attributes:
        TAKES: the options that it has a use for.
        PICTURES: the names of all that it may draw, if these depend on the options.
    """

    TAKES: frozenset[str]

    def run(self, options: Options, progress: Progress) -> Result:
        """Carry it out."""

    def show(self, result: Mapping[str, Any], console: Console) -> None:
        """Print the result as tables."""

    def draw(self, result: Mapping[str, Any]) -> Mapping[str, Figure]:
        """The result as pictures, by the names of their files without `.png`."""


def find_study(name: str) -> Study:
    """The study of this name.

    Raises:
        UsageError: there is none.
    """
    if name not in STUDIES:
        raise UsageError(f'there is no study "{name}"{nearest(name, STUDIES)}')
    return cast(Study, import_module(f"harness.studies.{name}"))


def run_study(name: str, options: Options = Options(), progress: Progress | None = None) -> Result:
    """Carry a study out; the result is plain data.

    Raises:
        UsageError: there is no such study, or it has no use for an option.
    """
    study = find_study(name)
    for option, value in vars(options).items():
        if value is not None and option not in study.TAKES:
            takes = ", ".join(f"--{o}" if o != "recording" else "a recording" for o in sorted(study.TAKES))
            what = "a recording" if option == "recording" else f"--{option}"
            raise UsageError(f"study {name} has no use for {what}; it takes {takes or 'no options'}")
    if options.seeds is not None and options.seeds < 2:
        raise UsageError(f"--seeds {options.seeds}: expected 2 or more, since a spread is stated")
    if options.seeds is not None and options.seeds > MOST_SEEDS:
        raise UsageError(f"--seeds {options.seeds}: expected at most {MOST_SEEDS}")
    result = study.run(options, progress or (lambda percent: None))
    recording = None if options.recording is None else str(options.recording)
    asked = {"seeds": options.seeds, "set": options.set, "recording": recording}
    return {"study": name, "options": asked, **result}


def report(name: str, result: Result, folder: Path, note: Callable[[str], None] = lambda text: None) -> None:
    """Write `<name>.json`, the pictures, and study.html, a page that needs no other file, into a folder.

    Args:
        note: called with a line for the user if they replace those of other options.

    Raises:
        UsageError: the folder cannot be made.
        FileError: they cannot be written.
    """
    if others := replaced(folder / f"{name}.json", {"options": result["options"]}):
        note(f"{folder}: has the results of other options, which these replace ({others})")
    text = json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False)
    study = find_study(name)
    figures = study.draw(result)
    drawn = {f"{title}.png": png_of(figure) for title, figure in figures.items()}
    page = charts_page(f"Study: {name}", STUDIES[name], figures, lambda console: study.show(result, console))
    earlier = [f"{title}.png" for title in getattr(study, "PICTURES", ())]
    write_set(folder, {f"{name}.json": (text + "\n").encode(), PAGE: page} | drawn, earlier)
