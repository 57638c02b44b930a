"""The studies of Chapter 3 and Appendices B to D."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import Any

from harness.front_door.arguments import StrPath, check_type, named_from_python


@dataclass(frozen=True)
class StudyResult:
    """A study that was carried out.

    Attributes:
        folder: with the pictures and the result as JSON.
        result: all that tables and pictures show.
        notes: what the user should know.
    """

    folder: Path
    result: dict[str, Any]
    notes: tuple[str, ...] = ()


@named_from_python
def run_study(
    name: str,
    *,
    seeds: int | None = None,
    set_name: str | None = None,
    recording: StrPath | None = None,
    out: StrPath | None = None,
    progress: Callable[[float], None] | None = None,
) -> StudyResult:
    """Carry out a study of Chapter 3 or Appendices B to D.

    >>> from harness import run_study
    >>> study = run_study("pitch", seeds=3, out="out/pitch")
    >>> round(study.result["asymptote_m_s2"], 2)
    1.8

    Args:
        name: as `canine study` lists them.
        seeds: trials of each kind, 2 to 5,000; by default the study's own number.
        set_name: of sensors and pack, one of `models.sets.SETS`.
        recording: a folder or a log, for a study of one.
        out: the folder for the results; by default out/study-<name>.
        progress: called with the percentage that is done.

    Raises:
        UsageError: there is no such study, or it has no use for an option.
    """
    from harness.studies import study  # noqa: PLC0415 - imports scipy and the models

    check_type("seeds", seeds, Integral, "a whole number")
    options = study.Options(seeds, set_name, None if recording is None else Path(recording))
    result = study.run_study(name, options, progress)
    folder = Path("out", f"study-{name}") if out is None else Path(out)
    notes: list[str] = []
    study.report(name, result, folder, notes.append)
    return StudyResult(folder, result, tuple(notes))
