"""`make mutants`: which small faults do the tests miss?

python -m tests.mutants [ONLY] [--list] [--jobs N]

ONLY is a part of a file's name (`link.c`), `file:line`, or a part of a changed line. Each mutant is a copy of
the project with one change, on which only the tests run that are meant to hold the file. Those that pass all
survive: a test is missing. Survivors that are accepted are listed with their reason in accepted.toml. Any
other makes this fail, and so does an entry there that no mutant survives by.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from codegen.scratch import Scratch
from harness.terminal import console_of
from tests.mutants.mutant import Mutant
from tests.mutants.targets import PROJECT, TARGETS, Target
from tests.mutants.trial import FAILED, OK, OVER, Copy, prepare

ACCEPTED = Path(__file__).parent / "accepted.toml"
POLL = 0.01  # s
SLACK, FACTOR = 10.0, 4.0  # a trial's time limit: s, and so many times as long as without a mutant

Key = tuple[str, str, str]


@dataclass
class Outcome:
    """What became of a run's mutants.

    Attributes:
        refused: the compiler refuses it, or the tests could not be collected.
        over: its tests did not end in time: it loops without end, or the machine was busy.
    """

    failed: int = 0
    refused: int = 0
    over: list[Mutant] = field(default_factory=list)
    survivors: list[Mutant] = field(default_factory=list)

    def count(self, mutant: Mutant, status: int) -> None:
        """Sort a mutant by pytest's status."""
        if status == OK:
            self.survivors.append(mutant)
        elif status == FAILED:
            self.failed += 1
        elif status == OVER:
            self.over.append(mutant)
        else:
            self.refused += 1


class Copies:
    """Copies of the project, as many as trials run at once; all that they need is removed at the end."""

    def __init__(self, jobs: int) -> None:
        self.stack = ExitStack()
        folder = self.stack.enter_context(Scratch())
        prepare(folder / "cache")
        self.free = []
        for job in range(jobs):
            (folder / str(job)).mkdir()
            self.free.append(Copy(folder / str(job)))
        self.busy: list[tuple[Copy, Mutant]] = []

    def __enter__(self) -> Copies:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        for copy, _mutant in self.busy:
            copy.stop()
        self.stack.close()

    def without_a_mutant(self, target: Target) -> float:
        """Seconds of a target's tests as they are.

        Raises:
            SystemExit: they fail.
        """
        copy = self.free[-1]
        for _ in range(2):  # the first time they build what all others find in the cache
            copy.begin(target.file, (PROJECT / target.file).read_text(), target.tests, 1800.0, Counter())
            while (result := copy.result()) is None:
                time.sleep(POLL)
            if result[0] != OK:
                raise SystemExit(
                    f"{target.file}: its tests fail without a mutant ({result[1] or 'see below'}):\n"
                    + copy.log.read_text()[-3000:]
                )
        return copy.seconds

    def run(self, target: Target, mutants: list[Mutant], limit: float) -> Iterator[tuple[Mutant, int]]:
        """Each mutant with pytest's status, as they come."""
        waiting, killers = list(reversed(mutants)), Counter[str]()
        while waiting or self.busy:
            while waiting and self.free:
                mutant, copy = waiting.pop(), self.free.pop()
                self.busy.append((copy, mutant))
                copy.begin(mutant.file, mutant.text, target.tests, limit, killers)
            time.sleep(POLL)
            for copy, mutant in list(self.busy):
                result = copy.result()
                if result is not None:
                    self.busy.remove((copy, mutant))
                    self.free.append(copy)
                    status, killer = result
                    killers[killer] += 1
                    yield mutant, status


def accepted() -> dict[Key, str]:
    """The reasons of the survivors that are accepted."""
    entries = tomllib.loads(ACCEPTED.read_text()).get("survivor", [])
    return {(e["file"], was, becomes): e["reason"] for e in entries for was, becomes in e["mutants"]}


def chosen(only: str) -> dict[Target, list[Mutant]]:
    """The mutants that a filter leaves, by target."""

    def fits(mutant: Mutant) -> bool:
        return only in mutant.file or f"{mutant.file}:{mutant.number}".endswith(only) or only in mutant.was

    by_target = {target: [m for m in target.mutants() if fits(m)] for target in TARGETS}
    return {target: mutants for target, mutants in by_target.items() if mutants}


def verdict(outcome: Outcome, tried: set[Key], reasons: Mapping[Key, str]) -> list[str]:
    """What is wrong: survivors without a reason, reasons without a survivor."""
    survived = {mutant.key for mutant in outcome.survivors}
    undecided = {mutant.key for mutant in outcome.over}
    wrong = [f"survives: {mutant}" for mutant in outcome.survivors if mutant.key not in reasons]
    files = {target.file: {m.key for m in target.mutants()} for target in TARGETS}
    for key in reasons:
        shown = f"{key[0]}\n    - {key[1]}\n    + {key[2]}"
        if key not in files.get(key[0], ()):
            wrong.append(f"accepted.toml lists what is no mutant any more; take it out: {shown}")
        elif key in tried - undecided - survived:
            wrong.append(f"accepted.toml lists what a test kills now; take it out: {shown}")
    return wrong


def main(arguments: list[str]) -> int:
    """Run the mutants; 1 if one survives that is not accepted."""
    parser = argparse.ArgumentParser("python -m tests.mutants", description=__doc__)
    parser.add_argument(
        "only", nargs="?", default="", help="part of a file's name, file:line, part of a line"
    )
    parser.add_argument("--list", action="store_true", help="print the mutants and run none")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="trials at once")
    options = parser.parse_args(arguments)
    targets = chosen(options.only)
    total = sum(map(len, targets.values()))
    if not total:
        files = ", ".join(Path(target.file).name for target in TARGETS)
        print(f'no mutant has "{options.only}"; files: {files}', file=sys.stderr)
        return 2
    if options.list:
        print(*(mutant for mutants in targets.values() for mutant in mutants), sep="\n")
        return 0
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    outcome, console, reasons = Outcome(), console_of(), accepted()
    begun = time.monotonic()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Copies(options.jobs) as copies, Progress(*columns, console=console_of(stderr=True)) as progress:
        task = progress.add_task("mutants", total=total)
        for target, mutants in targets.items():
            progress.update(task, description=Path(target.file).name)
            limit = SLACK + FACTOR * copies.without_a_mutant(target)
            for mutant, status in copies.run(target, mutants, limit):
                outcome.count(mutant, status)
                progress.advance(task)
                if status == OK and mutant.key not in reasons:
                    console.print(f"survives: {mutant}", markup=False, highlight=False)
    wrong = verdict(outcome, {m.key for mutants in targets.values() for m in mutants}, reasons)
    for mutant in outcome.over:
        console.print(f"does not end in time: {mutant}", markup=False, highlight=False)
    print(*(w for w in wrong if not w.startswith("survives")), sep="\n", end="")
    listed = sum(mutant.key in reasons for mutant in outcome.survivors)
    print(
        f"{total} mutants in {time.monotonic() - begun:.0f} s: {outcome.failed} fail a test, "
        f"{outcome.refused} do not compile or load, {len(outcome.over)} do not end in time, "
        f"{len(outcome.survivors)} survive, {listed} of them accepted"
    )
    return int(bool(wrong))


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(128 + signal.SIGINT)
