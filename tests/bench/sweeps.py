"""Sweeps at native speed beside their peers: the simulator by hand in C, in numpy, the loop over FMUs."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from codegen.batch.areas import Areas
from codegen.batch.batch import Batch
from harness.cosim.loop import Simulation
from harness.routes.score import PLACE
from harness.sweep.chunks import LARGEST, OBSERVED, Job, Outcomes, Pool, batch_of, cut, run_all, run_chunk
from harness.sweep.chunks import program as this_program
from harness.sweep.sweep import plan_sweep
from harness.trial import ReadingName
from harness.trial.prepare import prepared
from harness.trial.request import Changes, requested
from models.commands import ENDS
from models.kit.units import DEG
from tests.bench.cts_numpy import EVERY_EQUATION, FAST, Compiled, Setting, by_hand, setting, simulate

ROUNDS = 7
NUMPY_TRIALS = 20_000
LOOP_TICKS = 800
FULL_TRIALS = 8  # at each point of the sweep with sensors and estimator
EVERY = "every equation on every tick"
ALL_ON_TRIALS = 200  # at each point of the sweep with all that a scenario can switch on
TIRED = ("canine.habituation_gain=0.3", "canine.start_fatigue=0.2")
CORNERS = ((-60, -60), (200, -60), (200, 200), (-60, 200))  # m: of a fence about all of the streets
FENCE = (
    f"cmec.fence_count={len(CORNERS)}",
    *(f"cmec.fence_north[{i}]={north}" for i, (north, _) in enumerate(CORNERS, start=1)),
    *(f"cmec.fence_east[{i}]={east}" for i, (_, east) in enumerate(CORNERS, start=1)),
)
ALL_ON_CASES: dict[str, tuple[ReadingName, tuple[str, ...]]] = {
    "streets, poles, fatigue, aiming off, areas watched": ("field", ("cmec=aim_off", *TIRED)),
    "the same, and the safety rules with a fence": ("guarded", ("cmec=aim_off", *TIRED, *FENCE)),
}
SQUARE = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]])
AREAS = Areas([[SQUARE + np.array([north, east])] for north in (5, 20, 40) for east in (-12, 4, 20)])
# expected: two ratios, and ticks/s on one core of the full system and with all on
BY_HAND, BOTH_CORES, FULL, ALL_ON = 4.0, 1.8, 3e6, 15e6

Row = tuple[str, str, str, str]


def rows() -> tuple[list[Row], list[str]]:
    """The table's rows, and the results that fall short of what is expected."""
    jobs = [plan_sweep(target).job for target in ("two", "three")]
    ticks = sum(map(ticks_of, jobs))
    trials = sum(job.total for job in jobs)
    with tempfile.TemporaryDirectory() as folder:
        peers: list[tuple[str, Callable[[], float]]] = []
        for name, flags in ((EVERY, (EVERY_EQUATION,)), ("only what decides", ())):
            place = Path(folder) / str(len(peers))
            place.mkdir()
            compiled = by_hand(place, (*FAST, *flags))
            peers.append((name, lambda compiled=compiled: rate_by_hand(compiled, jobs)))  # type: ignore[misc]
        ours: list[float] = []
        theirs: list[list[float]] = [[] for _ in peers]
        for _ in range(ROUNDS):
            ours.append(ticks / core_seconds_of(lambda: run_alone(*jobs)))
            for rates, (_, peer) in zip(theirs, peers, strict=True):
                rates.append(peer())
    table: list[Row] = []
    short: list[str] = []
    rate = statistics.median(ours)
    for (name, _), rates in zip(peers, theirs, strict=True):
        ratio = statistics.median(o / r for o, r in zip(ours, rates, strict=True))
        table.append(
            (
                f"{trials:,} trials of sweep two + three on one core, against scalar C by hand: {name}",
                million(rate),
                million(statistics.median(rates)),
                f"{ratio:.2f}",
            )
        )
        if ratio < BY_HAND and name == EVERY:
            short.append(f"the sweep is {ratio:.2f} times as fast as C by hand ({name}); expected {BY_HAND}")
    numpy_rate = ticks_by_numpy()
    table.append(("the same, against numpy", million(rate), million(numpy_rate), f"{rate / numpy_rate:.0f}"))
    loop_rate = ticks_by_fmus("cts")
    table.append(
        (
            "the same, against the loop over FMUs",
            million(rate),
            million(loop_rate),
            f"{rate / loop_rate:,.0f}",
        )
    )
    one, two, both = on_two_cores(jobs[1])
    table.append(("sweep three on two cores, against one", f"{two:.2f} s", f"{one:.2f} s", f"{both:.2f}"))
    if both < BOTH_CORES:
        short.append(f"two cores are {both:.2f} times as fast as one; expected {BOTH_CORES}")
    full_rate = rate_alone(plan_sweep("three", system="full", trials=FULL_TRIALS).job)
    loop_rate = ticks_by_fmus("full")
    table.append(
        (
            "sensors and estimator in the loop, on one core, against the loop over FMUs",
            million(full_rate),
            million(loop_rate),
            f"{full_rate / loop_rate:,.0f}",
        )
    )
    if full_rate < FULL:
        short.append(f"the full system does {million(full_rate)} on a core; expected {million(FULL)}")
    for name, (reading, settings) in ALL_ON_CASES.items():
        all_on = rate_all_on(reading, settings)
        table.append(
            (
                f"{name}, on one core, against sweep two + three",
                million(all_on),
                million(rate),
                f"{all_on / rate:.2f}",
            )
        )
        if all_on < ALL_ON:
            short.append(f"{name}: a core does {million(all_on)}; expected {million(ALL_ON)}")
    return table, short


def million(rate: float) -> str:
    """Ticks per second."""
    return f"{rate / 1e6:,.2f} M ticks/s"


def seconds_of(work: Callable[[], object]) -> float:
    """How long it takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def core_seconds_of(work: Callable[[], object]) -> float:
    """How long it takes of its core, however busy the core is."""
    start = time.thread_time()
    work()
    return time.thread_time() - start


def run_alone(*jobs: Job) -> None:
    """Run all chunks of sweeps, one after another, as a worker does."""
    for job in jobs:
        for start, stop in cut([(0, job.total)], LARGEST[job.system]):
            run_chunk(job.part(start, stop), start, stop, this_program(has_fmus=False))


def rate_alone(job: Job) -> float:
    """Ticks per second on one core."""
    ticks = ticks_of(job)
    return ticks / min(core_seconds_of(lambda: run_alone(job)) for _ in range(ROUNDS))


def rate_all_on(reading: ReadingName, settings: Sequence[str]) -> float:
    """Ticks per second on one core among streets and poles, the areas beside them watched."""
    job = plan_sweep(
        "downtown_two", trials=ALL_ON_TRIALS, reading=reading, plant="canine_all_day", settings=settings
    ).job
    varied = (*job.varied, *job.by_type)
    batch = Batch(job.wired, varied, OBSERVED, ("controller.status", ENDS), watch=PLACE)
    ticks = ticks_in(batch, job, AREAS)  # which compiles
    return ticks / min(core_seconds_of(lambda: ticks_in(batch, job, AREAS)) for _ in range(ROUNDS))


def ticks_of(job: Job) -> int:
    """The number of ticks of all the sweep's trials."""
    return ticks_in(batch_of(job), job)


def ticks_in(batch: Batch, job: Job, areas: Areas | None = None) -> int:
    """Run all the sweep's trials in a batch; their ticks."""
    point, number = np.divmod(np.arange(job.total), job.trials)
    first, types = job.trial_types[0], len(job.trial_types)
    results = batch.run(
        first.values,
        job.rows(),
        (point * types + number % types).astype(np.int32),
        (job.seed + number).astype(np.int32),
        first.ticks,
        areas=areas,
    )
    return int(results.ticks.sum())


def settings_of(job: Job) -> list[tuple[Setting, list[tuple[float, float]], int]]:
    """The same sweep for the peers: setting, route and number of trials of each point and type."""
    settings = []
    for (threshold,) in job.points:
        for trial_type in job.trial_types:
            controller = trial_type.values["controller"]
            count = int(controller["waypoint_count"])
            route = [
                (controller[f"waypoint_north[{i}]"], controller[f"waypoint_east[{i}]"])
                for i in range(1, count + 1)
            ]
            spread = trial_type.values["plant"]["start_heading_deviation"]
            values = setting(moving_deviation=threshold, start_heading_deviation=spread)
            settings.append((values, route, job.trials // len(job.trial_types)))
    return settings


def rate_by_hand(compiled: Compiled, jobs: Sequence[Job]) -> float:
    """Ticks per second of the loop in C over the sweeps; its draws differ, so it counts its own ticks."""
    work = [item for job in jobs for item in settings_of(job)]
    ticks = 0
    start = time.thread_time()
    for seed, item in enumerate(work):
        ticks += int(compiled.run(*item, seed=seed)["ticks"].sum())
    return ticks / (time.thread_time() - start)


def ticks_by_numpy() -> float:
    """Ticks per second of numpy over many trials of one setting."""
    route = [(35.73, 0.0), (35.73, 35.73)]
    start = time.thread_time()
    outcomes = simulate(setting(moving_deviation=49 * DEG), route, NUMPY_TRIALS, 1)
    return float(outcomes["ticks"].sum()) / (time.thread_time() - start)


def ticks_by_fmus(system: str) -> float:
    """Ticks per second of the loop over FMUs, without a log."""
    with requested("three_waypoint", Changes()) as request:
        request = replace(request, scenario=replace(request.scenario, system=system))  # noqa: PLW2901
        with prepared(request) as ready:
            rates = []
            for _ in range(ROUNDS):
                with Simulation(ready.system, ready.plan.values) as simulation:
                    start = time.thread_time()
                    simulation.run(ready.plan.events, duration=(LOOP_TICKS - 1) * 0.04)
                    rates.append(LOOP_TICKS / (time.thread_time() - start))
            return statistics.median(rates)


def on_two_cores(job: Job) -> tuple[float, float, float]:
    """Median seconds of a sweep on one core and on two, and the median of their ratios."""

    def on(cores: int) -> float:
        with ThreadPoolExecutor(cores) as executor:
            return seconds_of(lambda: run_all(Outcomes(job), Pool(executor, cores), lambda chunk: None))

    batch_of(job)
    pairs = [(on(1), on(2)) for _ in range(ROUNDS)]
    one, two = zip(*pairs, strict=True)
    return statistics.median(one), statistics.median(two), statistics.median(a / b for a, b in pairs)
