"""How long a command takes to start, beside the bare imports of the libraries that it cannot do without."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fmus.folder import build_folder

ROUNDS = 9
CANINE = str(Path(sys.executable).with_name("canine"))


@dataclass(frozen=True)
class Start:
    """A command, the imports that it is compared with, and how many times their time it may take."""

    command: tuple[str, ...]
    imports: str
    demand: float
    status: int = 0


STARTS = (
    Start(("--help",), "typer, rich", 3),
    Start(("bark",), "typer, rich", 3, status=2),
    Start(("run", "--bark"), "typer, rich", 3, status=2),
    Start(("firmware",), "typer, rich", 3, status=2),
    Start(("run", "--seed", "many"), "typer, rich", 3, status=2),
    Start(("check", str(build_folder() / "fmi2" / "four_state.fmu")), "fmpy, numpy, typer, rich", 2),
    Start(("wiring",), "fmpy, numpy, typer, rich", 2),
)


def seconds(command: Sequence[str], status: int = 0) -> float:
    """How long a command takes; Python may keep its bytecode, as it does where `canine` is installed."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=False)
        elapsed = time.perf_counter() - start
    if done.returncode != status:
        raise RuntimeError(f"{' '.join(command)}: exit status {done.returncode}\n{done.stderr.decode()}")
    return elapsed


def rows() -> tuple[list[tuple[str, str, str, str]], list[str]]:
    """The table's rows, and what falls short of its demand."""
    table, short = [], []
    for start in STARTS:
        ratio, ours, theirs = measured(start)
        name = f"canine {' '.join(start.command)}, against imports of {start.imports}"
        table.append((name, f"{1e3 * ours:.0f} ms", f"{1e3 * theirs:.0f} ms", f"{ratio:.2f}"))
        if ratio > start.demand:
            short.append(
                f"canine {' '.join(start.command)} takes {ratio:.2f} times the imports of "
                f"{start.imports}; expected at most {start.demand}"
            )
    return table, short


def measured(start: Start) -> tuple[float, float, float]:
    """Median ratio of a command's time to that of its imports, and the medians of both [s]."""
    command = [CANINE, *start.command]
    imports = [sys.executable, "-c", f"import {start.imports}"]
    seconds(command, start.status)  # compiles the bytecode
    pairs = [(seconds(command, start.status), seconds(imports)) for _ in range(ROUNDS)]
    ours, theirs = zip(*pairs, strict=True)
    return statistics.median(a / b for a, b in pairs), statistics.median(ours), statistics.median(theirs)


if __name__ == "__main__":
    for row in rows()[0]:
        print(*row, sep="   ")
