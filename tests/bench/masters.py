"""The loop over FMUs beside the masters of others, in a worker and not, with its log and without it.

`python -m tests.bench.masters TOOL PACKAGE.ssp TICKS` prints the seconds that another tool takes. Each runs
in a process of its own, since they are C++, and one that crashes must not end the bench.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from fmus.folder import build_folder
from harness.cosim.loop import Simulation
from harness.cosim.ssp import open_ssp
from harness.cosim.worker.contained import Contained
from harness.trial.prepare import prepared
from harness.trial.request import Changes, requested
from models.kit.timing import TICK
from tests.bench import logs
from tests.bench.timing import paired

TICKS = 20_000
LOGGED_TICKS = 2_000
ROUNDS = 5
Row = tuple[str, str, str, str]


def ecos(package: Path, ticks: int) -> float:
    """Seconds of ecos (C++, through ecospy)."""
    from ecospy import EcosSimulation  # noqa: PLC0415 - not in each environment

    with EcosSimulation(TICK, ssp_path=str(package)) as simulation:
        if not simulation.init():
            raise RuntimeError(f"ecos does not initialize {package}")
        start = time.perf_counter()
        simulation.step(ticks)
        return time.perf_counter() - start


def libcosim(package: Path, ticks: int) -> float:
    """Seconds of libcosim (C++, through libcosimpy)."""
    from libcosimpy.CosimExecution import CosimExecution  # noqa: PLC0415 - not in each environment

    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(package) as archive:
            archive.extractall(folder)
        execution = CosimExecution.from_ssp_file(folder, round(TICK * 1e9))  # ns
        start = time.perf_counter()
        execution.step(ticks)
        return time.perf_counter() - start


TOOLS: dict[str, Callable[[Path, int], float]] = {"ecos": ecos, "libcosim": libcosim}


def theirs(tool: str, package: Path) -> float:
    """Seconds of another tool, in a process of its own."""
    command = [sys.executable, "-m", "tests.bench.masters", tool, str(package), str(TICKS)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def ours(package: Path, *, contained: bool = False) -> float:
    """Seconds of our loop over the same package, in the order of the other tools."""
    with ExitStack() as stack:
        system = stack.enter_context(open_ssp(package))
        simulation: Simulation | Contained = stack.enter_context(Simulation(system, order="jacobi"))
        if contained:
            simulation = stack.enter_context(Contained(system, simulation.fmus, order="jacobi"))
        start = time.perf_counter()
        simulation.run(duration=(TICKS - 1) * TICK)
        return time.perf_counter() - start


def logged(fmi: int, *, contained: bool = False) -> float:
    """Seconds of a trial's loop with its log."""
    with (
        requested("three_waypoint", Changes(fmi=str(fmi))) as request,
        prepared(request) as ready,
        ExitStack() as stack,
    ):
        simulation: Simulation | Contained
        if contained:
            simulation = Contained(ready.system, ready.fmus, ready.plan.values, plants=ready.plants)
        else:
            simulation = Simulation(ready.system, ready.plan.values, plants=ready.plants)
        stack.enter_context(simulation)
        return logs.with_log_of(simulation, request, ready, LOGGED_TICKS)


def rows() -> list[Row]:
    """The table's rows; libcosim refuses FMI 3."""
    return [row for fmi, tools in ((2, ("ecos", "libcosim")), (3, ("ecos",))) for row in rows_of(fmi, tools)]


def rows_of(fmi: int, tools: Sequence[str]) -> Iterator[Row]:
    """The rows of a version of our FMUs, beside the other tools that are installed."""
    package = build_folder() / f"full.fmi{fmi}.ssp"
    for tool in tools:
        if find_spec(f"{tool}py"):
            yield row(f"FMI {fmi}, against {tool}'s", partial(ours, package), partial(theirs, tool, package))
    inside = partial(ours, package, contained=True)
    yield row(f"FMI {fmi}, against the same in a worker", partial(ours, package), inside)
    first, second = partial(logged, fmi), partial(logged, fmi, contained=True)
    yield row(f"FMI {fmi}, with the log, against the same in a worker", first, second, LOGGED_TICKS)


def row(what: str, first: Callable[[], float], second: Callable[[], float], ticks: int = TICKS) -> Row:
    """Our ticks a second, the others', and how many times as fast ours are."""
    a, b, ratio = paired(first, second, ROUNDS)
    return (
        f"loop over 5 FMUs, {what}",
        f"{ticks / a:,.0f} ticks/s",
        f"{ticks / b:,.0f} ticks/s",
        f"{ratio:.2f}",
    )


if __name__ == "__main__":
    print(TOOLS[sys.argv[1]](Path(sys.argv[2]), int(sys.argv[3])))
