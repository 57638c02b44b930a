"""How long commands take to start, beside the bare imports of the libraries that they cannot do without."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from fmus.folder import build_folder
from harness.sweep.chunks import Outcomes, Pool, run_all
from harness.sweep.sweep import plan_sweep

ROUNDS = 9
CANINE = str(Path(sys.executable).with_name("canine"))
Row = tuple[str, str, str, str]


@dataclass(frozen=True)
class Start:
    """A command, the imports that it is compared with, and how many times their time it may take.

    Attributes:
        work: makes the time [s] of what the command is there for, which is taken off.
    """

    command: tuple[str, ...]
    imports: str
    demand: float
    status: int = 0
    work: Callable[[], float] = lambda: 0.0


def seconds(command: Sequence[str], status: int = 0) -> float:
    """How long a command takes in an empty folder; Python keeps its bytecode, as for whoever installs it.

    Raises:
        RuntimeError: it ends with another exit status.
    """
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=False)
        elapsed = time.perf_counter() - start
    if done.returncode != status:
        raise RuntimeError(f"{' '.join(command)}: exit status {done.returncode}\n{done.stderr.decode()}")
    return elapsed


def trials_of_sweep() -> float:
    """Seconds for the trials of `canine sweep two` alone, on all cores."""
    job, cores = plan_sweep("two").job, os.cpu_count() or 1
    with ThreadPoolExecutor(cores) as executor:
        start = time.perf_counter()
        run_all(Outcomes(job), Pool(executor, cores), lambda chunk: None)
        return time.perf_counter() - start


def starts() -> list[Start]:
    """What is measured."""
    usage, looks = "typer, rich", "fmpy, numpy, typer, rich"
    return [
        Start(("--help",), usage, 3),
        Start(("--version",), usage, 3),
        Start(("bark",), usage, 3, status=2),
        Start(("run", "--bark"), usage, 3, status=2),
        Start(("firmware",), usage, 3, status=2),
        Start(("run", "--seed", "many"), usage, 3, status=2),
        Start(("check", str(build_folder() / "fmi2" / "four_state.fmu")), looks, 2),
        Start(("wiring",), looks, 2),
        Start(("sweep", "two"), "numpy, matplotlib.pyplot, typer, rich", 2, work=trials_of_sweep),
    ]


def measured(start: Start) -> tuple[float, float, float]:
    """Median ratio of a command's time, less its work, to that of its imports; medians of both times [s]."""
    command = [CANINE, *start.command]
    imports = [sys.executable, "-c", f"import {start.imports}"]
    seconds(command, start.status)  # compiles bytecode, fills the cache
    start.work()
    rounds = [(seconds(command, start.status), seconds(imports), start.work()) for _ in range(ROUNDS)]
    ratio = statistics.median((ours - work) / theirs for ours, theirs, work in rounds)
    ours, theirs, _ = zip(*rounds, strict=True)
    return ratio, statistics.median(ours), statistics.median(theirs)


def rows() -> tuple[list[Row], list[str]]:
    """The table's rows, and what falls short of its demand."""
    table: list[Row] = []
    short = []
    for start in starts():
        ratio, ours, theirs = measured(start)
        arguments = " ".join(Path(word).name if word.endswith(".fmu") else word for word in start.command)
        name = f"canine {arguments}, against importing {start.imports} (at most {start.demand:g} times)"
        table.append((name, f"{1e3 * ours:.0f} ms", f"{1e3 * theirs:.0f} ms", f"{ratio:.2f} times as long"))
        if ratio > start.demand:
            short.append(
                f"canine {arguments} takes {ratio:.2f} times as long as importing {start.imports}; "
                f"expected at most {start.demand:g}"
            )
    return table, short


if __name__ == "__main__":
    for row in rows()[0]:
        print(*row, sep="   ")
