"""Many trials in chunks, on this machine's cores or on a Dask cluster; the order does not change the counts.

The trials are numbered point by point. Number k is trial i = k mod `trials` of point k div `trials`; its type
is number i mod (number of types), its seed is `seed` + i. So every point meets the same dogs (common random
numbers), and two numbers, start and stop, define a chunk. A chunk's results are integers: their sums depend
neither on how the trials were cut into chunks nor on which worker ran them when.
"""

from __future__ import annotations

import asyncio
import logging
import os
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from codegen.batch.batch import Batch, Change, Stalls
from codegen.cache import TRACED, sources
from harness.sweep.tls import Certificates, check_use, open_note, refusal, security_of
from models.commands import ENDS, Status
from models.disturbance import FaultyLink
from models.errors import CanineError, UsageError
from models.kit.block import Block
from models.modes import Anomaly
from models.system import CONTROLLER, ESTIMATOR, PLANT, System, find_system

if TYPE_CHECKING:  # fmpy: sweeps of our own blocks do without
    from harness.cosim.fmu import Fault

TICK_S = Block.sample_time
ANOMALIES = tuple(a.name.lower() for a in Anomaly if a is not Anomaly.NONE)
OBSERVED = (
    "controller.status",
    "controller.directional_commands",
    *(f"controller.anomalies[{i + 1}]" for i in range(len(ANOMALIES))),
)
SUMS = ("commands", "timeouts", *ANOMALIES)  # commands: of successful trials
RUNS = ("harness/sweep/chunks.py", "harness/sweep/cosimulated.py", "harness/cosim", "harness/trial")
# trials in a chunk at most: it takes some tenths of a second
LARGEST = {"cts": 32_768, "full": 4_096, "full_ahrs": 4_096}
SMALLEST = 2048  # trials in a chunk at least: fewer would leave vector lanes empty
USUAL = 7500  # ticks, 300 s; chunks of longer trials hold fewer, so that Ctrl-C is answered and loses little
ROUNDS = 4  # chunks for each core at least, above SMALLEST: so no core waits long for another
ANSWER_S = 15.0  # s in which a scheduler must answer, a busy one too
ALONE_S = 60.0  # s to wait for a cluster without workers: for the first to start, or after all were lost
ATTEMPTS = 3  # times to submit a chunk again after the scheduler gave it up because its workers died
POLL_S = 0.5  # s
ENOUGH = 5  # equal trials of a type, from which it is no chance

Progress = Callable[[int], None]
Note = Callable[[str], None]
Integers = npt.NDArray[np.int64]


Piece = tuple[int, int]  # start and stop of trials


class ClusterError(CanineError):
    """The cluster cannot run the chunks, or no longer answers."""


class Trials(Protocol):
    """Trials that run in chunks: a job, or the jobs of several cells.

    Attributes:
        trials: at each point.
        point_count: number of points.
        type_names: of the types of trials, which take turns at each point.
        dtype: the smallest integer type that holds the index of any tick.
        has_fmus: does it run FMUs?
    """

    @property
    def trials(self) -> int: ...

    @property
    def point_count(self) -> int: ...

    @property
    def type_names(self) -> tuple[str, ...]: ...

    @property
    def dtype(self) -> type[np.unsignedinteger[Any]]: ...

    @property
    def has_fmus(self) -> bool: ...

    @property
    def total(self) -> int:
        """Number of trials."""

    def part(self, start: int, stop: int) -> Trials:
        """The same with only the points that the trials start <= k < stop need."""

    def rounds(self, outcomes: Outcomes, width: int) -> Iterator[Iterable[Piece]]:
        """The trials that `outcomes` lacks, cut for so many cores; each round begins after the one before."""

    def run(self, start: int, stop: int) -> Chunk:
        """Run the trials start <= k < stop."""

    def packed(self) -> Trials:
        """With all that the trials need on another machine."""

    def prepare(self) -> None:
        """Make what the trials need in this process."""

    def abandon(self) -> None:
        """End the trials that run in this process: nobody wants their results."""


@dataclass(frozen=True)
class TrialType:
    """One type of trial, such as `right_90`.

    Attributes:
        values: start values by component and name, SI.
        changes: of inputs, by tick.
        ticks: index of the last tick.
    """

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
    """The trials of a sweep as plain data, which travels to workers.

    Attributes:
        system: name of one of SYSTEMS.
        estimator, plant, controller: which of ours it has; an estimator only if it has one.
        varied: the parameters that differ between the points, `component.parameter`.
        points: (points, varied), SI.
        trial_types: they take turns; all set the same variables at the same ticks, to different values.
        trials: at each point.
        seed: of the first trial at each point.
        first: index of `points[0]` among all points, if this is a part of a job.
        faults: where the scenario's faults act.
        stalls: when components are not stepped, ticks from and to before.
    """

    system: str
    varied: tuple[str, ...]
    points: tuple[tuple[float, ...], ...]
    trial_types: tuple[TrialType, ...]
    trials: int
    seed: int
    first: int = 0
    estimator: str = ESTIMATOR
    faults: tuple[FaultyLink, ...] = ()
    plant: str = PLANT
    controller: str = CONTROLLER
    stalls: Stalls = field(default_factory=dict)

    def __post_init__(self) -> None:
        first, *others = self.trial_types
        for trial_type in others:
            alike = (trial_type.changes, trial_type.ticks, trial_type.flat.keys())
            if alike != (first.changes, first.ticks, first.flat.keys()):
                raise ValueError(f"{trial_type.name} sets other things, or at other times, than {first.name}")

    @property
    def wired(self) -> System:
        """The system with its blocks and its faults."""
        system = find_system(self.system, self.estimator, self.plant, self.controller)
        return system.with_faults(self.faults)

    @property
    def point_count(self) -> int:
        """Number of points."""
        return len(self.points)

    @property
    def total(self) -> int:
        """Number of trials."""
        return len(self.points) * self.trials

    @property
    def has_fmus(self) -> bool:
        """No: the batch runner has the blocks' C."""
        return False

    @property
    def type_names(self) -> tuple[str, ...]:
        """The names of the types of trials."""
        return tuple(trial_type.name for trial_type in self.trial_types)

    @property
    def by_type(self) -> tuple[str, ...]:
        """The start values that differ between the types, `component.name`."""
        flat = [trial_type.flat for trial_type in self.trial_types]
        return tuple(name for name in flat[0] if len({values[name] for values in flat}) > 1)

    def rows(self) -> npt.NDArray[np.float64]:
        """The values at each point for each type of trial: (points * types, varied + by_type)."""
        by_type = [[trial_type.flat[name] for name in self.by_type] for trial_type in self.trial_types]
        width = len(self.varied) + len(self.by_type)
        rows = [(*p, *v) for p in self.points for v in by_type]
        return np.array(rows, dtype=np.float64).reshape(len(rows), width)

    @property
    def dtype(self) -> type[np.unsignedinteger[Any]]:
        """The smallest integer type that holds the index of any tick."""
        return index_type(max(trial_type.ticks for trial_type in self.trial_types))

    def part(self, start: int, stop: int) -> Job:
        """The same job with only the points that the trials start <= k < stop need."""
        first, last = start // self.trials, (stop - 1) // self.trials
        return replace(self, points=self.points[first : last + 1], first=first)

    def rounds(self, outcomes: Outcomes, width: int) -> Iterator[Iterable[Piece]]:
        """All trials that `outcomes` lacks, in one round."""
        yield cut(outcomes.missing(), chunk_size(self, self.total - outcomes.done, width))

    def packed(self) -> Job:
        """Itself: it is plain data."""
        return self

    def prepare(self) -> None:
        """Compile the batch runner."""
        batch_of(self)

    def abandon(self) -> None:
        """Nothing: a chunk takes some tenths of a second."""

    def run(self, start: int, stop: int) -> Chunk:
        """Run the trials start <= k < stop in the batch runner.

        Raises:
            CompileError: the compiler refuses the batch runner.
        """
        point, number = np.divmod(np.arange(start, stop), self.trials)
        first, types = self.trial_types[0], len(self.trial_types)
        results = batch_of(self).run(
            first.values,
            self.rows(),
            ((point - self.first) * types + number % types).astype(np.int32),
            (self.seed + number).astype(np.int32),
            first.ticks,
            changes=first.changes,
            stalls=self.stalls,
        )
        status = results.values[:, 0]
        success = status == Status.SUCCESS
        ticks = np.where(success, results.ticks, 0).astype(self.dtype)
        counts = results.values.astype(np.int64)
        counts[:, 0] = np.where(success, results.values[:, 1], 0)
        counts[:, 1] = ~np.isin(status, list(ENDS))
        sums = np.add.reduceat(counts, np.flatnonzero(np.diff(point, prepend=-1)))
        return Chunk(start, stop, ticks, sums)


def index_type(last: int) -> type[np.unsignedinteger[Any]]:
    """The smallest integer type that holds the index of a tick up to the last."""
    return np.uint16 if last < 2**16 else np.uint32


@dataclass(frozen=True)
class FmuFailure:
    """A fault of an FMU that ended a trial.

    Attributes:
        number: of the trial at its point.
        fault: what the FMU did; of kind `refused` where it was not run.
        text: in words.
    """

    number: int
    fault: Fault
    text: str


@dataclass(frozen=True, eq=False)
class Chunk:
    """The results of the trials start <= k < stop.

    Attributes:
        ticks: (stop - start,) the tick on which each trial succeeded, 0 if it failed. No trial succeeds on
            tick 0, since the dog must be recalled before.
        sums: (points, SUMS) counts at the points that the chunk touches.
        fmu_failures: ended trials, which count as failed; the numbers are those of the chunk's only point.
        gave_up: the point's other trials are not worth while.
        notes: what the user should know of the point's first trial.
    """

    start: int
    stop: int
    ticks: npt.NDArray[np.unsignedinteger[Any]]
    sums: Integers
    fmu_failures: tuple[FmuFailure, ...] = ()
    gave_up: bool = False
    notes: tuple[str, ...] = ()


class Outcomes:
    """The results of a job's trials so far.

    Attributes:
        ticks: (points, trials) as in `Chunk`.
        sums: (points, SUMS).
        spans: start and stop of each chunk that is done.
        fmu_failures: ended trials, by point; `notes`: of the first trial, by point.
        ran: (points,) trials that are to be counted at each point: all, or those before it was given up.
    """

    def __init__(self, job: Trials) -> None:
        self.job = job
        self._flat = np.zeros(job.total, dtype=job.dtype)
        self.ticks = self._flat.reshape(job.point_count, job.trials)
        self.sums: Integers = np.zeros((job.point_count, len(SUMS)), dtype=np.int64)
        self.spans: list[Piece] = []
        self.fmu_failures: dict[int, list[FmuFailure]] = {}
        self.notes: dict[int, tuple[str, ...]] = {}
        self.ran = [job.trials] * job.point_count

    @property
    def done(self) -> int:
        """Number of trials that have run, or will not."""
        left_out = self.job.point_count * self.job.trials - sum(self.ran)
        return left_out + sum(stop - start for start, stop in self.spans)

    def add(self, chunk: Chunk) -> None:
        """Add a chunk's results."""
        self._flat[chunk.start : chunk.stop] = chunk.ticks
        first = chunk.start // self.job.trials
        self.sums[first : first + len(chunk.sums)] += chunk.sums
        if chunk.fmu_failures:
            self.fmu_failures.setdefault(first, []).extend(chunk.fmu_failures)
        if chunk.notes:
            self.notes[first] = chunk.notes
        is_alone = all(start // self.job.trials != first for start, _ in self.spans)
        if chunk.gave_up and is_alone:
            self.ran[first] = chunk.stop - first * self.job.trials
        self.spans.append((chunk.start, chunk.stop))

    @property
    def repeated(self) -> int:
        """Number of points at which all trials of a type succeeded on the same tick: no seed matters."""
        types = len(self.job.type_names)
        kept = self.ticks[:, : self.job.trials // types * types].reshape(len(self.ticks), -1, types)
        if kept.shape[1] < ENOUGH:
            return 0
        same = (kept == kept[:, :1]).all(axis=1) & (kept[:, 0] > 0)
        return int(same.any(axis=1).sum())

    def missing(self) -> Iterator[Piece]:
        """Start and stop of each stretch of trials that no chunk has covered."""
        covered, trials = 0, self.job.trials
        given_up = [(k * trials + n, (k + 1) * trials) for k, n in enumerate(self.ran) if n < trials]
        for start, stop in [*sorted([*self.spans, *given_up]), (self.job.total, self.job.total)]:
            if start > covered:
                yield covered, start
            covered = stop


def cut(stretches: Iterable[Piece], size: int) -> Iterator[Piece]:
    """Cut stretches of trials into pieces of at most `size`."""
    for start, stop in stretches:
        for first in range(start, stop, size):
            yield first, min(first + size, stop)


_batches: dict[tuple[object, ...], Batch] = {}
_compiling = threading.Lock()


def batch_of(job: Job) -> Batch:
    """The native batch runner for a job; each process compiles it once.

    Raises:
        CompileError: the compiler refuses it.
    """
    varied = (*job.varied, *job.by_type)
    key = (job.system, job.estimator, job.plant, job.controller, job.faults, varied)
    with _compiling:
        if key not in _batches:
            _batches[key] = Batch(job.wired, varied, OBSERVED, ("controller.status", ENDS))
        no_trials = np.zeros(0, dtype=np.int32)  # compile once, before the threads start
        first = job.trial_types[0]
        _batches[key].run(
            first.values,
            job.rows(),
            no_trials,
            no_trials,
            first.ticks,
            changes=first.changes,
            stalls=job.stalls,
        )
        return _batches[key]


@cache
def program(*, has_fmus: bool) -> str:
    """A hash of everything that decides a trial's outcome: models, generator, this file, tools' versions.

    Args:
        has_fmus: co-simulated trials depend on our FMUs' shim and on FMPy too.
    """
    floors, tools = (("fmus",), ("fmpy",)) if has_fmus else ((), ())
    return sources((*TRACED, *floors, *RUNS), ("ziglang", "casadi", *tools))


def run_chunk(job: Trials, start: int, stop: int, made_for: str) -> Chunk:
    """Run the trials start <= k < stop in this process.

    Args:
        job: with at least the points of these trials.
        made_for: `program` of the sweep, which must be the same here: other versions give other results.

    Raises:
        ClusterError: this process runs another version.
        CompileError: the compiler refuses the batch runner.
    """
    here = program(has_fmus=job.has_fmus)
    if made_for != here:
        raise ClusterError(f"a worker runs another version of this program, {here[:12]}")
    return job.run(start, stop)


def chunk_size(job: Job, left: int, width: int) -> int:
    """Trials in a chunk: at most LARGEST, so few that each core gets ROUNDS chunks, but at least SMALLEST.

    If few trials are left, SMALLEST decides: a core may then get fewer chunks, or none.

    Args:
        left: trials to run.
        width: number of cores.
    """
    longest = max(USUAL, *(trial_type.ticks for trial_type in job.trial_types))
    largest, smallest = (max(1, trials * USUAL // longest) for trials in (LARGEST[job.system], SMALLEST))
    return max(smallest, min(largest, -(-left // (ROUNDS * width))))


@dataclass(frozen=True)
class Pool:
    """The cores that run chunks.

    Attributes:
        width: number of chunks that the executor runs at a time.
        check: raises ClusterError if the cluster no longer answers.
    """

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
    """Run the trials that `outcomes` lacks; at most two chunks for each core are under way at a time.

    Args:
        keep: called with each chunk that is done, before it is added to `outcomes`.
        progress: called with the number of trials done.
        size: trials in a chunk; `chunk_size` by default.

    Raises:
        ClusterError: the cluster cannot run the chunks.
        CanineError: as a chunk's run raises it.
    """
    if size:
        _run_round(outcomes, cut(outcomes.missing(), size), pool, keep, progress)
        return
    for pieces in outcomes.job.rounds(outcomes, pool.width):
        _run_round(outcomes, pieces, pool, keep, progress)


def _run_round(
    outcomes: Outcomes,
    cut_pieces: Iterable[Piece],
    pool: Pool,
    keep: Callable[[Chunk], None],
    progress: Progress | None,
) -> None:
    """Run these pieces."""
    job, pieces = outcomes.job, iter(cut_pieces)
    under_way: dict[Future[Chunk], tuple[int, int, int]] = {}

    def submit(start: int, stop: int, attempts: int = ATTEMPTS) -> None:
        part = job.part(start, stop)
        made_for = program(has_fmus=part.has_fmus)
        future = pool.executor.submit(run_chunk, part, start, stop, made_for)
        under_way[future] = start, stop, attempts

    for piece in islice(pieces, 2 * pool.width):
        submit(*piece)
    while under_way:
        finished, _ = wait(under_way, POLL_S, FIRST_COMPLETED)
        pool.check()
        for future in finished:
            start, stop, attempts = under_way.pop(future)
            try:
                chunk = future.result()
            except CancelledError:
                raise ClusterError("the cluster's scheduler has gone away") from None
            except Exception as reason:
                # the scheduler gives a chunk up after several workers died while they ran it
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


ADDRESS = re.compile(r"(\w+://)?(\[[0-9a-fA-F:%.]+\]|[^\s:/\[\]]+):\d{1,5}/?|inproc://.+")  # of a scheduler


def pool_at(
    address: str | None,
    job: Trials,
    note: Note = lambda text: None,
    certificates: Certificates = Certificates(),  # noqa: B008 - it is frozen
) -> AbstractContextManager[Pool]:
    """This machine's cores, or the Dask cluster whose scheduler has this address.

    Args:
        note: called with a line for the user.
        certificates: for an address that begins with tls://.

    Raises:
        UsageError: no scheduler answers at the address within ANSWER_S, or a certificate does not fit.
        ClusterError: the cluster has no workers after ALONE_S, or one of them cannot run this program.
    """
    check_use(address, certificates)
    return _here(job) if address is None else _cluster(address, job, note, certificates)


def cores() -> int:
    """The cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _here(job: Trials) -> Iterator[Pool]:
    job.prepare()
    executor = ThreadPoolExecutor(cores())
    try:
        yield Pool(executor, cores())
    finally:
        job.abandon()
        executor.shutdown(wait=False, cancel_futures=True)


def _host(text: str) -> str:
    """The host in what is meant as host and port; an address of IPv6 in its brackets."""
    bare = text.strip("/")
    if bare.startswith("[") or bare.count(":") > 1:
        return f"[{bare.strip('[').partition(']')[0]}]"
    return bare.partition(":")[0] or "host"


@contextmanager
def _cluster(address: str, job: Trials, note: Note, certificates: Certificates) -> Iterator[Pool]:
    if not ADDRESS.fullmatch(address):
        scheme, _, rest = address.rpartition("://")
        raise UsageError(
            f"--dask {address}: is not the address of a scheduler; expected host and port, as in "
            f"{scheme or 'tcp'}://{_host(rest)}:8786, which `dask scheduler` prints"
        )
    security = security_of(address, certificates)
    if open_to := open_note(address):
        note(open_to)
    from distributed import Client  # noqa: PLC0415 - it takes a second, which other sweeps need not wait

    for name in ("distributed", "distributed.client"):  # the client's logger has a level of its own
        logging.getLogger(name).setLevel(logging.CRITICAL)  # faults are raised as ClusterError instead
    try:
        asyncio.run(_greet(address, security))
        client: Any = Client(  # type: ignore[no-untyped-call]
            address, timeout=ANSWER_S, security=security, set_as_default=False
        )
    except Exception as reason:  # anything may answer there, and in any way
        cause = refusal(reason) or str(reason) or "silence"
        raise UsageError(
            f"--dask {address}: no Dask scheduler answers there within {ANSWER_S:g} s ({cause}); expected an "
            "address such as tcp://host:8786, as `dask scheduler` prints it"
        ) from None
    with client:
        width = _check_workers(client, address, note, has_fmus=job.has_fmus)
        executor = client.get_executor(pure=False, retries=2)
        try:
            yield Pool(executor, width, _watch(client, address))
        finally:
            executor.shutdown(wait=False)


async def _greet(address: str, security: Any) -> None:
    """Check that a Dask scheduler answers; a client without one takes long to give up."""
    from distributed.core import rpc  # noqa: PLC0415

    keys = security.get_connection_args("client") if security else None
    async with rpc(address, timeout=ANSWER_S, connection_args=keys) as scheduler:  # type: ignore[no-untyped-call]
        identity = await asyncio.wait_for(scheduler.identity(), ANSWER_S)
    if identity["type"] != "Scheduler":
        raise OSError(f"a {identity['type']} does")


def _check_workers(client: Any, address: str, note: Note, *, has_fmus: bool) -> int:
    """The number of the workers' threads; waits for a first worker, refuses those with another program."""
    if not client.nthreads():
        note(f"{address}: the cluster has no workers yet; waiting up to {ALONE_S:g} s for one")
    try:
        client.wait_for_workers(1, timeout=ALONE_S)
    except TimeoutError:
        raise ClusterError(
            f"{address}: the cluster has no workers; start some with `dask worker {address}` in an "
            "environment with this package"
        ) from None
    here = program(has_fmus=has_fmus)
    for worker, answer in client.run(program, has_fmus=has_fmus, on_error="return").items():
        if isinstance(answer, Exception):
            raise ClusterError(
                f"{address}: worker {worker} cannot run this program ({answer}); install this package there"
            )
        if answer != here:
            raise ClusterError(
                f"{address}: worker {worker} has another version of this program, {answer[:12]}; "
                f"expected {here[:12]}; install this one there"
            )
    return max(1, sum(int(threads) for threads in client.nthreads().values()))


def _watch(client: Any, address: str) -> Callable[[], None]:
    """A check that fails if the scheduler has gone, or if there were no workers for ALONE_S."""
    last_seen = time.monotonic()

    def check() -> None:
        nonlocal last_seen
        if client.status != "running":
            raise ClusterError(f"{address}: the cluster's scheduler has gone away")
        if client.scheduler_info(n_workers=1)["workers"]:
            last_seen = time.monotonic()
        if time.monotonic() - last_seen > ALONE_S:
            raise ClusterError(f"{address}: the cluster has had no workers for {ALONE_S:g} s")

    return check
