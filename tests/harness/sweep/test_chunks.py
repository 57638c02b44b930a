"""Trials in chunks: neither the cuts, nor the order, nor the threads change the counts."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen.cache import FLOORS
from harness.sweep import chunks, sweep
from harness.sweep.chunks import Chunk, ClusterError, Job, Outcomes, Pool, TrialType, cut, run_all, run_chunk
from harness.sweep.sweep import plan_sweep
from models.commands import Status
from tests.harness.sweep.runner import Runner, dog, install

TRIAL_TYPES = (TrialType("a", {}, (), 7500), TrialType("b", {}, (), 7500), TrialType("c", {}, (), 7500))
JOB = Job("cts", ("x",), tuple((np.radians(h),) for h in (20, 25, 30, 35)), TRIAL_TYPES, 50, 7)


@pytest.fixture
def runner(monkeypatch: pytest.MonkeyPatch) -> Runner:
    return install(monkeypatch, Runner(dog))


def counted(job: Job, size: int, threads: int) -> Outcomes:
    outcomes = Outcomes(job)
    with ThreadPoolExecutor(threads) as executor:
        run_all(outcomes, Pool(executor, threads), lambda chunk: None, size=size)
    return outcomes


def test_points_that_no_seed_changes_are_counted() -> None:
    # given three types: where one always ends on the same tick, where all fail, and where a seed matters
    outcomes = Outcomes(JOB)
    outcomes.ticks[0] = 1 + np.arange(50)
    outcomes.ticks[0, ::3] = 400
    outcomes.ticks[2] = 500
    outcomes.ticks[2, 45:48] = 501
    # then
    assert outcomes.repeated == 1
    # and four trials of a type may be equal by chance
    few = Outcomes(replace(JOB, trials=14))
    few.ticks[:] = 500
    assert few.repeated == 0


def test_counts_do_not_depend_on_chunks_and_threads(runner: Runner) -> None:
    # given the result of each trial, one by one
    ticks, sums = np.zeros((4, 50), int), np.zeros((4, len(chunks.SUMS)), int)
    for p, threshold in enumerate((20, 25, 30, 35)):
        for i in range(50):
            status, tick, commands, anomalies = dog(threshold, 7 + i, None)
            if status == Status.SUCCESS:
                ticks[p, i] = tick
                sums[p, 0] += commands
            sums[p, 1] += status == Status.RUNNING
            for anomaly, count in anomalies.items():
                sums[p, 1 + anomaly] += count
    assert sums[:, 1].sum() > 0  # there are timeouts
    # then any chunks give the same counts
    for size, threads in ((1, 1), (3, 4), (7, 2), (50, 1), (64, 3), (1000, 2)):
        outcomes = counted(JOB, size, threads)
        assert outcomes.done == 200
        assert (outcomes.ticks == ticks).all()
        assert (outcomes.sums == sums).all()


def test_every_trial_runs_once_with_its_own_seed(runner: Runner) -> None:
    counted(JOB, 13, 2)
    assert Counter(runner.seeds) == dict.fromkeys(range(7, 57), 4)


@pytest.mark.parametrize(
    ("name", "has_fmus"),
    [
        ("models/cmec.py", False),
        ("codegen/batch/batch.py", False),
        ("harness/sweep/chunks.py", False),
        ("fmus/ssp.py", True),
    ],
)
def test_one_byte_of_the_program_makes_another_program(
    name: str, has_fmus: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for part in ("models", "codegen", "fmus", "harness/sweep"):
        left_out = shutil.ignore_patterns("__pycache__", "build")
        shutil.copytree(FLOORS / part, tmp_path / part, ignore=left_out)
    monkeypatch.setattr("codegen.cache.FLOORS", tmp_path)
    before = chunks.program.__wrapped__(has_fmus=has_fmus)
    content = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(content[:-2] + bytes([content[-2] ^ 1]) + content[-1:])
    assert chunks.program.__wrapped__(has_fmus=has_fmus) != before


def test_a_tick_beyond_16_bits_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    # given a trial of a day, which is 2,160,000 ticks
    install(monkeypatch, Runner(lambda threshold, seed, _: (Status.SUCCESS, 2_000_000 + seed, 0, {})))
    day = replace(JOB, trial_types=(TrialType("day", {}, (), 2_160_000),))
    assert counted(day, 10, 1).ticks[0, :3].tolist() == [2_000_007, 2_000_008, 2_000_009]


@given(st.sets(st.integers(0, 99), max_size=10).map(sorted), st.integers(1, 40))
@settings(max_examples=100, deadline=None)
def test_missing_trials_are_cut_into_pieces_that_cover_each_once(marks: list[int], size: int) -> None:
    # given a job of 100 trials of which every other stretch between the marks is done
    outcomes = Outcomes(replace(JOB, points=JOB.points[:2]))
    for start, stop in list(pairwise(marks))[::2]:
        outcomes.add(
            Chunk(start, stop, np.zeros(stop - start, np.uint16), np.zeros((1, len(chunks.SUMS)), int))
        )
    # then pieces and what is done make up the job
    pieces = list(cut(outcomes.missing(), size))
    assert all(stop - start <= size for start, stop in pieces)
    covered = [k for start, stop in [*pieces, *outcomes.spans] for k in range(start, stop)]
    assert sorted(covered) == list(range(100))


def test_a_chunk_travels_with_the_points_that_it_needs_only() -> None:
    part = JOB.part(49, 101)
    assert (part.points, part.first) == (JOB.points[0:3], 0)
    assert (JOB.part(100, 150).points, JOB.part(100, 150).first) == (JOB.points[2:3], 2)


def test_at_most_two_chunks_for_each_core_are_under_way(runner: Runner) -> None:
    most = under_way = 0

    class Counting(ThreadPoolExecutor):
        def submit(self, *arguments, **options):  # type: ignore[no-untyped-def]
            nonlocal most, under_way
            under_way += 1
            most = max(most, under_way)
            return super().submit(*arguments, **options)

    def keep(chunk: Chunk) -> None:
        nonlocal under_way
        under_way -= 1

    with Counting(2) as executor:
        run_all(Outcomes(JOB), Pool(executor, 2), keep, size=1)
    assert most == 4


@pytest.mark.parametrize(
    ("system", "ticks", "left", "expected"),
    [
        ("cts", 7500, 10**7, 32_768),
        ("cts", 250, 10**7, 32_768),
        ("cts", 7500, 40_000, 5_000),  # 4 for each of 2 cores
        ("cts", 7500, 1_000, 2_048),
        ("cts", 75_000, 10**7, 3_276),  # ten times as long
        ("cts", 75_000, 1_000, 204),
        ("full", 2_160_000, 10**7, 14),  # a day
        ("full", 10**9, 10**7, 1),
    ],
)
def test_chunks_of_longer_trials_hold_fewer_trials(system: str, ticks: int, left: int, expected: int) -> None:
    job = replace(JOB, system=system, trial_types=(TrialType("a", {}, (), ticks),))
    assert chunks.chunk_size(job, left, 2) == expected


def test_a_chunk_whose_workers_die_is_submitted_again_three_times(runner: Runner) -> None:
    class KilledWorker(Exception):  # noqa: N818 - as distributed calls it
        pass

    class Dying(ThreadPoolExecutor):
        deaths = 0

        def submit(self, function, /, *arguments, **options):  # type: ignore[no-untyped-def]
            if self.deaths:
                self.deaths -= 1
                return super().submit(self.die)
            return super().submit(function, *arguments, **options)

        def die(self) -> None:
            raise KilledWorker("worker gone")

    with Dying(1) as executor:
        executor.deaths = 3
        outcomes = Outcomes(JOB)
        run_all(outcomes, Pool(executor, 1), lambda chunk: None, size=100)
        assert outcomes.done == 200
        executor.deaths = 8
        with pytest.raises(ClusterError, match="the cluster lost every worker that ran a chunk: worker gone"):
            run_all(Outcomes(JOB), Pool(executor, 1), lambda chunk: None, size=100)


def test_a_worker_with_another_program_does_not_run_chunks(runner: Runner) -> None:
    with pytest.raises(ClusterError, match="a worker runs another version of this program"):
        run_chunk(JOB, 0, 10, "another")


KILLED = """
import sys
import pytest
sys.path.insert(0, {here!r})
from pathlib import Path
from tests.harness.sweep.runner import Runner, dog, install
from harness.sweep import chunks
from harness.sweep import sweep
install(pytest.MonkeyPatch(), Runner(dog, pause=0.03))
chunks.SMALLEST = chunks.LARGEST["cts"] = 10
sweep.run(sweep.plan_sweep("two", thresholds="20:29", trials=100), Path(sys.argv[1]))
"""


def test_a_killed_sweep_keeps_its_chunks(runner: Runner, tmp_path: Path) -> None:
    # given a process that is killed when some chunks are done
    script = KILLED.format(here=str(Path(__file__).parents[3]))
    process = subprocess.Popen([sys.executable, "-c", script, str(tmp_path / "s")])
    path, deadline = (
        tmp_path / "s" / "sweep.journal",
        time.monotonic() + 300,
    )  # generous: the machine may be busy
    while not (path.exists() and path.read_bytes().count(b"\n") > 5):
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    # when the same sweep is run
    notes: list[str] = []
    planned = plan_sweep("two", thresholds="20:29", trials=100)
    sweep.run(planned, tmp_path / "s", note=notes.append)
    # then it goes on, and comes to the same
    assert int(notes[0].split()[0]) >= 50
    assert len(runner.seeds) == 1000 - int(notes[0].split()[0])
    sweep.run(planned, tmp_path / "whole")
    for name in ("sweep.csv", "recommendation.json", "sweep.png"):
        assert (tmp_path / "s" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
