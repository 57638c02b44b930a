"""Many trials in chunks, on this machine's cores or on a Dask cluster: in any order, with the same counts.

Trials are numbered point by point: number k is trial i = k mod `trials` of point k div `trials`, of type_
i mod (number of types), with seed `seed` + i. So every point meets the same dogs (common random numbers),
and a chunk is no more than two numbers; its trials are listed where it runs. What a chunk comes to are
integers, so nothing depends on how trials were cut into chunks, or on who ran them when.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.batch.batch import Batch, Change
from codegen.toolchains.compiler import compiler_version
from models.cmec import Anomaly
from models.commands import ENDS, Status
from models.errors import CanineError, UsageError
from models.system import SYSTEMS

ANOMALIES = tuple(a.name.lower() for a in Anomaly if a is not Anomaly.NONE)
OBSERVED = (
    "controller.status",
    "controller.directional_commands",
    *(f"controller.anomalies[{i + 1}]" for i in range(len(ANOMALIES))),
)
SUMS = ("commands", "timeouts", *ANOMALIES)  # commands: of successful trials
LARGEST = {"cts": 32_768, "full": 4_096}  # trials of up to USUAL in a chunk: some tenths of a second
SMALLEST = 2048  # the last trials of a chunk have lanes to themselves
USUAL = 7500  # ticks, 300 s; chunks of longer trials have fewer: Ctrl-C is answered, little is lost
ROUNDS = 4  # chunks that a core gets at least, if they are not too small: none waits long for another
ANSWER_S = 5.0  # s in which a scheduler, and its workers, must answer
ALONE_S = 60.0  # s that a sweep waits for a cluster that has lost all its workers
ATTEMPTS = 3  # times that a chunk is handed in again after the scheduler gave it up: its workers died
POLL_S = 0.5  # s

Progress = Callable[[int], None]
Integers = npt.NDArray[np.int64]


class ClusterError(CanineError):
    """The cluster cannot run the chunks, or has gone away."""


@dataclass(frozen=True)
class TrialType:
    """One type of trial: start values (SI) by component, changes of inputs, index of the last tick."""

    name: str
    values: dict[str, dict[str, float]]
    changes: tuple[Change, ...]
    ticks: int

    @property
    def flat(self) -> dict[str, float]:
        """The start values by `component.name`."""
        return {f"{c}.{n}": value for c, values in self.values.items() for n, value in values.items()}


@dataclass(frozen=True)
class Job:
    """What is to be run, as plain data.

    Attributes:
        system: name of one of SYSTEMS.
        varied: what differs between the points, `component.parameter`.
        points: (points, varied), SI.
        types: the types of trials, which take turns; they set the same, and differ in its values alone.
        trials: of each point.
        seed: of the first trial of each point.
        first: index of `points[0]`, if they are some out of more.
    """

    system: str
    varied: tuple[str, ...]
    points: tuple[tuple[float, ...], ...]
    types: tuple[TrialType, ...]
    trials: int
    seed: int
    first: int = 0

    def __post_init__(self) -> None:
        first, *others = self.types
        for type_ in others:
            alike = (type_.changes, type_.ticks, type_.flat.keys())
            if alike != (first.changes, first.ticks, first.flat.keys()):
                raise ValueError(f"{type_.name} sets other things, or at other times, than {first.name}")

    @property
    def total(self) -> int:
        """Number of trials."""
        return len(self.points) * self.trials

    @property
    def by_type(self) -> tuple[str, ...]:
        """What differs between the types, `component.name`."""
        flat = [type_.flat for type_ in self.types]
        return tuple(name for name in flat[0] if len({values[name] for values in flat}) > 1)

    def rows(self) -> npt.NDArray[np.float64]:
        """(points * types, varied + by_type) the values of each point for each type_."""
        own = [[type_.flat[name] for name in self.by_type] for type_ in self.types]
        width = len(self.varied) + len(self.by_type)
        return np.array([(*p, *v) for p in self.points for v in own]).reshape(-1, width)

    @property
    def dtype(self) -> type[np.unsignedinteger[Any]]:
        """What holds the index of any tick."""
        return np.uint16 if max(type_.ticks for type_ in self.types) < 2**16 else np.uint32

    def of(self, start: int, stop: int) -> Job:
        """The same with only the points that the trials from `start` to before `stop` need."""
        first, last = start // self.trials, (stop - 1) // self.trials
        return replace(self, points=self.points[first : last + 1], first=first)


@dataclass(frozen=True, eq=False)
class Chunk:
    """What the trials from `start` to before `stop` came to.

    Attributes:
        ticks: (stop - start,) the tick on which a trial succeeded, 0 if it did not: none succeeds on the
            first, since the dog must first be recalled.
        sums: (points, SUMS) of the points that the chunk touches.
    """

    start: int
    stop: int
    ticks: npt.NDArray[np.unsignedinteger[Any]]
    sums: Integers


class Outcomes:
    """What all trials came to, as far as they are done.

    Attributes:
        ticks: (points, trials) as in `Chunk`.
        sums: (points, SUMS).
        spans: start and stop of the chunks that are done.
    """

    def __init__(self, job: Job) -> None:
        self.job = job
        self._flat = np.zeros(job.total, dtype=job.dtype)
        self.ticks = self._flat.reshape(len(job.points), job.trials)
        self.sums: Integers = np.zeros((len(job.points), len(SUMS)), dtype=np.int64)
        self.spans: list[tuple[int, int]] = []

    @property
    def done(self) -> int:
        """Number of trials."""
        return sum(stop - start for start, stop in self.spans)

    def add(self, chunk: Chunk) -> None:
        """Take in a chunk's counts."""
        self._flat[chunk.start : chunk.stop] = chunk.ticks
        first = chunk.start // self.job.trials
        self.sums[first : first + len(chunk.sums)] += chunk.sums
        self.spans.append((chunk.start, chunk.stop))

    def missing(self) -> Iterator[tuple[int, int]]:
        """The stretches of trials that no chunk has covered."""
        at = 0
        for start, stop in [*sorted(self.spans), (self.job.total, self.job.total)]:
            if start > at:
                yield at, start
            at = stop


def cut(stretches: Iterable[tuple[int, int]], size: int) -> Iterator[tuple[int, int]]:
    """Stretches of trials in pieces of at most `size`."""
    for start, stop in stretches:
        for at in range(start, stop, size):
            yield at, min(at + size, stop)


_batches: dict[tuple[str, tuple[str, ...]], Batch] = {}
_one_at_a_time = threading.Lock()


def batch_of(job: Job) -> Batch:
    """The native batch runner that a job needs; made once a process, whichever thread comes first.

    Raises:
        CompileError: the compiler refuses it.
    """
    varied = (*job.varied, *job.by_type)
    key = (job.system, varied)
    with _one_at_a_time:
        if key not in _batches:
            _batches[key] = Batch(SYSTEMS[job.system], varied, OBSERVED, ("controller.status", ENDS))
        nobody = np.zeros(0, dtype=np.int32)  # of no trials: compiled here, not in many threads at once
        type_ = job.types[0]
        _batches[key].run(type_.values, job.rows(), nobody, nobody, type_.ticks, changes=type_.changes)
        return _batches[key]


@cache
def program() -> str:
    """A hash of what decides a trial's outcome: models, generator, this file, versions of the tools."""
    floors = Path(__file__).parents[2]
    digest = hashlib.sha256(f"{compiler_version()} casadi {version('casadi')}".encode())
    files = [p for floor in ("models", "codegen") for p in (floors / floor).rglob("*")]
    for path in sorted([*files, Path(__file__)]):
        if path.suffix in (".py", ".c", ".h", ".jinja"):
            content = path.read_bytes()
            digest.update(f"\n{path.relative_to(floors).as_posix()} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def run_chunk(job: Job, start: int, stop: int, made_for: str) -> Chunk:
    """Run the trials from `start` to before `stop`, in this process.

    Args:
        job: with at least the points of these trials.
        made_for: the program that asks; another one could come to other results.

    Raises:
        ClusterError: this is another program.
        CompileError: the compiler refuses the batch runner.
    """
    if made_for != program():
        raise ClusterError(f"a worker runs another version of this program, {program()[:12]}")
    point, number = np.divmod(np.arange(start, stop), job.trials)
    type_, types = job.types[0], len(job.types)
    results = batch_of(job).run(
        type_.values,
        job.rows(),
        ((point - job.first) * types + number % types).astype(np.int32),
        (job.seed + number).astype(np.int32),
        type_.ticks,
        changes=type_.changes,
    )
    status = results.values[:, 0]
    success = status == Status.SUCCESS
    ticks = np.where(success, results.ticks, 0).astype(job.dtype)
    counts = results.values.astype(np.int64)
    counts[:, 0] = np.where(success, results.values[:, 1], 0)
    counts[:, 1] = ~np.isin(status, list(ENDS))
    sums = np.add.reduceat(counts, np.flatnonzero(np.diff(point, prepend=-1)))
    return Chunk(start, stop, ticks, sums)


def chunk_size(job: Job, left: int, width: int) -> int:
    """Trials in a chunk: some tenths of a second's, and so few that each core gets ROUNDS chunks at least.

    But not fewer than are worth the call: of little that is left, a core may get fewer chunks, or none.

    Args:
        left: trials to be run.
        width: cores.
    """
    longest = max(USUAL, *(type_.ticks for type_ in job.types))
    largest, smallest = (max(1, trials * USUAL // longest) for trials in (LARGEST[job.system], SMALLEST))
    return max(smallest, min(largest, -(-left // (ROUNDS * width))))


@dataclass(frozen=True)
class Pool:
    """Who runs chunks: an executor, how many it runs at a time, and what tells that it is all gone."""

    executor: Executor
    width: int
    check: Callable[[], None] = lambda: None


def run_all(
    outcomes: Outcomes,
    pool: Pool,
    keep: Callable[[Chunk], None],
    progress: Progress | None = None,
    size: int = 0,
) -> None:
    """Run what is missing in `outcomes`; a bounded number of chunks is under way at any time.

    Args:
        keep: is given each chunk that is done, before it is taken in.
        progress: is told the number of trials done.
        size: trials in a chunk; by default as `chunk_size` says.

    Raises:
        ClusterError: chunks cannot be run on the cluster.
        CanineError: of what fails in a chunk.
    """
    job, made_for = outcomes.job, program()
    left = job.total - outcomes.done
    pieces = cut(outcomes.missing(), size or chunk_size(job, left, pool.width))
    waiting: dict[Future[Chunk], tuple[int, int, int]] = {}

    def submit(start: int, stop: int, attempts: int = ATTEMPTS) -> None:
        future = pool.executor.submit(run_chunk, job.of(start, stop), start, stop, made_for)
        waiting[future] = start, stop, attempts

    for piece in islice(pieces, 2 * pool.width):
        submit(*piece)
    while waiting:
        finished, _ = wait(waiting, POLL_S, FIRST_COMPLETED)
        pool.check()
        for future in finished:
            start, stop, attempts = waiting.pop(future)
            try:
                chunk = future.result()
            except CancelledError:
                raise ClusterError("the cluster's scheduler has gone away") from None
            except Exception as reason:
                # the scheduler gives a chunk up when several workers died while they had it
                if type(reason).__name__ != "KilledWorker":
                    raise
                if not attempts:
                    raise ClusterError(f"the cluster lost every worker that ran a chunk: {reason}") from None
                submit(start, stop, attempts - 1)
                continue
            keep(chunk)
            outcomes.add(chunk)
            if progress:
                progress(outcomes.done)
            for piece in islice(pieces, 1):
                submit(*piece)


def pool_at(address: str | None, job: Job) -> AbstractContextManager[Pool]:
    """This machine's cores, or the cluster of a Dask scheduler's address.

    Raises:
        UsageError: nothing answers at the address.
        ClusterError: the cluster has no workers, or one that cannot run this program.
    """
    return _here(job) if address is None else _cluster(address)


@contextmanager
def _here(job: Job) -> Iterator[Pool]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    batch_of(job)
    executor = ThreadPoolExecutor(cores)
    try:
        yield Pool(executor, cores)
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


@contextmanager
def _cluster(address: str) -> Iterator[Pool]:
    from distributed import Client  # noqa: PLC0415 - it takes a second, which other sweeps need not wait

    for name in ("distributed", "distributed.client"):  # which has a level of its own
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is said as an error
    try:
        asyncio.run(_greet(address))
        client: Any = Client(  # type: ignore[no-untyped-call]
            address, timeout=ANSWER_S, set_as_default=False
        )
    except Exception as reason:  # who knows what answers there, and how
        raise UsageError(
            f"--dask {address}: no Dask scheduler answers there within {ANSWER_S:g} s "
            f"({str(reason) or 'silence'}); expected an address such as tcp://host:8786, as `dask scheduler` "
            "prints it"
        ) from None
    with client:
        width = _check_workers(client, address)
        executor = client.get_executor(pure=False, retries=2)
        try:
            yield Pool(executor, width, _watch(client, address))
        finally:
            executor.shutdown(wait=False)


async def _greet(address: str) -> None:
    """See whether Dask answers at all; a client that finds nobody takes long to end."""
    from distributed.core import rpc  # noqa: PLC0415

    async with rpc(address, timeout=ANSWER_S) as scheduler:  # type: ignore[no-untyped-call]
        known = await asyncio.wait_for(scheduler.identity(), ANSWER_S)
    if known["type"] != "Scheduler":
        raise OSError(f"a {known['type']} does")


def _check_workers(client: Any, address: str) -> int:
    """How many threads the workers have; refuse workers that would not come to the same results."""
    try:
        client.wait_for_workers(1, timeout=ANSWER_S)
    except TimeoutError:
        raise ClusterError(
            f"{address}: the cluster has no workers; start some with `dask worker {address}` in an "
            "environment with this package"
        ) from None
    for worker, answer in client.run(program, on_error="return").items():
        if isinstance(answer, Exception):
            raise ClusterError(
                f"{address}: worker {worker} cannot run this program ({answer}); install this package there"
            )
        if answer != program():
            raise ClusterError(
                f"{address}: worker {worker} has another version of this program, {answer[:12]}; "
                f"expected {program()[:12]}; install this one there"
            )
    return max(1, sum(int(threads) for threads in client.nthreads().values()))


def _watch(client: Any, address: str) -> Callable[[], None]:
    """Give up when the scheduler has gone, or all workers are gone for long."""
    seen = time.monotonic()

    def check() -> None:
        nonlocal seen
        if client.status != "running":
            raise ClusterError(f"{address}: the cluster's scheduler has gone away")
        if client.scheduler_info(n_workers=1)["workers"]:
            seen = time.monotonic()
        if time.monotonic() - seen > ALONE_S:
            raise ClusterError(f"{address}: the cluster has had no workers for {ALONE_S:g} s")

    return check
