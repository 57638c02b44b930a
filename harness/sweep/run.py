"""Trials run on cores or on a cluster, from where a journal left off."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, TypeVar

from harness.files import replaced
from harness.sweep.axis import SweepError
from harness.sweep.chunks import Outcomes, Progress, Trials, pool_at, run_all
from harness.sweep.journal import open_journal
from harness.sweep.tls import Certificates

Results = TypeVar("Results")


class Asked(Protocol):
    """What asks for trials: a sweep or a matrix."""

    @property
    def work(self) -> Trials: ...

    @property
    def about(self) -> str: ...

    @property
    def identity(self) -> dict[str, Any]: ...

    @property
    def fingerprint(self) -> str: ...


def run_trials(
    asked: Asked,
    folder: Path,
    report: Callable[[Outcomes], Results],
    address: str | None,
    *,
    what: str,
    files: tuple[str, ...],
    certificates: Certificates,
    progress: Progress | None,
    note: Callable[[str], None],
) -> Results:
    """Run the trials that the folder's journal lacks, and report on them; the rest is as of `run`.

    Args:
        what: is run, a sweep or a matrix.
        files: the names of the results; the last one holds the identity.
        report: writes the results.
    """
    for name in files:
        if os.path.isdir(folder / name):  # unlike Path.is_dir, it raises nothing
            raise SweepError(f"{folder / name}: is a folder; remove it, or choose another one with --out")
    job, identity = asked.work, asked.identity
    with open_journal(folder, job, asked.fingerprint, asked.about, identity, what=what) as journal:
        others = replaced(folder / files[-1], identity)
        if others:
            note(f"{folder}: has the results of another {what}, which these replace ({others})")
        outcomes = Outcomes(job if address is None else job.packed())
        for chunk in journal.chunks:
            outcomes.add(chunk)
        if journal.dropped:
            lines = f"{journal.dropped} damaged line{'s' * (journal.dropped > 1)}"
            note(f"{journal.path}: {lines} left out; those trials run again")
        if outcomes.done:
            note(f"{outcomes.done} of {job.total} trials are there from before; going on")
            if progress:
                progress(outcomes.done)
        try:
            if outcomes.done < job.total:
                with pool_at(address, job, note, certificates) as pool:
                    run_all(outcomes, pool, journal.append, progress)
        except BaseException:
            if journal.empty:
                journal.remove()
            raise
        for text in dict.fromkeys(text for notes in outcomes.notes.values() for text in notes):
            note(f"in the first of many trials, {text}")
        if outcomes.repeated:
            points = "1 point" if outcomes.repeated == 1 else f"{outcomes.repeated} points"
            note(
                f"at {points} all trials of a type succeed on the same tick: nothing in them depends on the "
                "seed; they are one trial, and its interval means nothing"
            )
        results = report(outcomes)
        journal.remove()
    return results
