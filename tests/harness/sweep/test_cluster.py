"""Sweeps on a real Dask cluster of this machine: a scheduler and workers in processes of their own.

The machine may be busy, so nothing is timed: tests wait for events, with PATIENCE_S as the limit.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from logging.handlers import BufferingHandler
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
from distributed import Client
from distributed.client import logger as log_of_client

from harness.sweep import chunks, matrix, sweep
from harness.sweep.chunks import ClusterError
from harness.sweep.cosimulated import Cosimulated
from harness.sweep.sweep import plan_sweep
from harness.trial.scenario import Scenario
from models.errors import UsageError
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

PATIENCE_S = 300.0


class Cluster:
    """A scheduler, and workers that are started one by one."""

    def __init__(self, folder: Path, stack: ExitStack, *security: str) -> None:
        self.file, self.folder, self.stack = folder / "scheduler.json", folder, stack
        self.security = security
        protocol = ("--protocol", "tls") if security else ()
        self.process("dask_scheduler", "--port", "0", "--host", "127.0.0.1", *protocol)
        wait_until(lambda: self.file.exists() and self.file.read_text().endswith("}"))
        self.address = json.loads(self.file.read_text())["address"]

    def process(self, name: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{name}", "--scheduler-file", str(self.file)]
        log = self.stack.enter_context((self.folder / f"{name}.log").open("ab"))
        command += ["--no-dashboard", *self.security, *options]
        process = subprocess.Popen(command, stdout=log, stderr=log)
        self.stack.callback(process.wait)
        self.stack.callback(process.kill)
        return process

    def worker(self, preload: str = "") -> subprocess.Popen[bytes]:
        """A worker with one thread, which runs some Python first."""
        options = ["--nthreads", "1", "--no-nanny", "--local-directory", str(self.folder)]
        return self.process("dask_worker", *options, *(["--preload", preload] if preload else []))

    def worker_addresses(self, count: int) -> list[str]:
        """The addresses of the workers, as soon as there are so many."""
        with Client(self.address, timeout=PATIENCE_S, set_as_default=False) as client:  # type: ignore[no-untyped-call]
            client.wait_for_workers(count, timeout=PATIENCE_S)
            return list(client.nthreads())


def wait_until(event: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not event():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scheduler and workers that are slow to answer are not what these tests are about."""
    monkeypatch.setattr(chunks, "ANSWER_S", PATIENCE_S)
    monkeypatch.setattr(chunks, "ALONE_S", PATIENCE_S)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    with ExitStack() as stack:
        folder = tmp_path / "cluster"
        folder.mkdir()
        yield Cluster(folder, stack)


def test_a_killed_worker_costs_its_chunk_and_nothing_else(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a sweep that this machine's threads have run, and a cluster of two workers
    planned = plan_sweep("three", thresholds="20:60:20", trials=1000)
    sweep.run(planned, tmp_path / "here")
    doomed, _ = cluster.worker(), cluster.worker()
    cluster.worker_addresses(2)
    monkeypatch.setattr(chunks, "SMALLEST", 300)
    monkeypatch.setitem(chunks.LARGEST, "cts", 300)
    progress: list[int] = []

    def kill_one(done: int) -> None:
        progress.append(done)
        if len(progress) == 3:
            os.kill(doomed.pid, signal.SIGKILL)

    # when one is killed on the way
    sweep.run(planned, tmp_path / "there", cluster.address, progress=kill_one)
    # then
    assert doomed.wait() == -signal.SIGKILL
    assert progress == list(range(300, 3001, 300))
    for name in ("sweep.csv", "recommendation.json", "sweep.png"):
        assert (tmp_path / "there" / name).read_bytes() == (tmp_path / "here" / name).read_bytes()


@pytest.mark.parametrize(
    ("preload", "message"),
    [
        ("from harness.sweep import chunks as c; c.program = lambda **_: 'other'", "has another version"),
        ("import sys; sys.modules['harness'] = None", "cannot run this program"),
    ],
)  # fmt: skip
def test_a_worker_with_another_program_or_none_is_refused(
    cluster: Cluster, tmp_path: Path, preload: str, message: str
) -> None:
    cluster.worker(preload)
    with pytest.raises(ClusterError) as caught:
        sweep.run(plan_sweep("two", trials=10), tmp_path / "s", cluster.address)
    assert f"{cluster.address}: worker tcp://" in str(caught.value)
    assert message in str(caught.value)
    assert list((tmp_path / "s").iterdir()) == []


def test_a_cluster_without_workers_is_refused_after_a_while(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(chunks, "ALONE_S", 1.0)
    notes: list[str] = []
    with pytest.raises(ClusterError, match=r"has no workers; start some with `dask worker tcp://"):
        sweep.run(plan_sweep("two", trials=10), tmp_path, cluster.address, note=notes.append)
    assert notes == [f"{cluster.address}: the cluster has no workers yet; waiting up to 1 s for one"]


def test_a_sweep_waits_for_the_first_worker(cluster: Cluster, tmp_path: Path) -> None:
    # given a cluster whose worker starts only after the sweep has noted that there is none
    notes: list[str] = []

    def start_worker(text: str) -> None:
        notes.append(text)
        cluster.worker()

    sweep.run(plan_sweep("two", thresholds="30:31", trials=10), tmp_path, cluster.address, note=start_worker)
    assert len(notes) == 1
    assert (tmp_path / "sweep.csv").is_file()


def test_a_sweep_that_loses_its_cluster_says_so_and_keeps_its_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = plan_sweep("two", thresholds="20:29", trials=1000)
    monkeypatch.setitem(chunks.LARGEST, "cts", 512)
    monkeypatch.setattr(chunks, "SMALLEST", 512)
    dask_log = BufferingHandler(1000)
    monkeypatch.setattr(log_of_client, "handlers", [dask_log])
    with ExitStack() as stack:
        folder = tmp_path / "cluster"
        folder.mkdir()
        cluster = Cluster(folder, stack)
        cluster.worker()

        def lose(done: int) -> None:
            if done >= 1024:
                stack.close()

        with pytest.raises(ClusterError, match="gone away"):
            sweep.run(planned, tmp_path / "s", cluster.address, progress=lose)
    assert dask_log.buffer == []  # no traceback of Dask's
    notes: list[str] = []
    sweep.run(planned, tmp_path / "s", note=notes.append)
    assert int(notes[0].split()[0]) >= 1024


def test_an_address_without_a_scheduler_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given Dask's client, which would take long to give up
    client = Mock()
    monkeypatch.setattr("distributed.Client", client)
    monkeypatch.setattr(chunks, "ANSWER_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:  # it listens, and says nothing
        port = silent.getsockname()[1]
        for address in (f"tcp://127.0.0.1:{port}", "tcp://127.0.0.1:1", "http://127.0.0.1:80"):
            with pytest.raises(UsageError) as caught:
                sweep.run(plan_sweep("two", trials=10), tmp_path, address)
            assert str(caught.value).startswith(
                f"--dask {address}: no Dask scheduler answers there within 1 s ("
            )
            assert "expected an address such as tcp://host:8786" in str(caught.value)
    # then it was never asked
    client.assert_not_called()


def test_the_address_of_a_worker_is_refused(cluster: Cluster, tmp_path: Path) -> None:
    cluster.worker()
    (address,) = cluster.worker_addresses(1)
    with pytest.raises(UsageError, match=r"no Dask scheduler answers there within .* \(a Worker does\)"):
        sweep.run(plan_sweep("two", trials=10), tmp_path, address)


def test_a_sweep_gives_up_when_all_workers_are_gone_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    # given a cluster that loses its workers, and a clock
    now = 0.0
    monkeypatch.setattr(chunks, "time", SimpleNamespace(monotonic=lambda: now))
    monkeypatch.setattr(chunks, "ALONE_S", 60.0)
    workers: dict[str, Any] = {"w": 1}
    client = Mock(status="running", scheduler_info=lambda n_workers: {"workers": workers})
    check = chunks._watch(client, "tcp://a")
    # when they are gone for 60 s, and there again
    now = 100.0
    check()
    workers.clear()
    now = 160.0
    check()
    workers["w"] = 1
    now = 200.0
    check()
    # then it goes on, until they are gone for longer
    workers.clear()
    now = 260.0
    check()
    now = 260.1
    with pytest.raises(ClusterError, match="tcp://a: the cluster has had no workers for 60 s"):
        check()
    workers["w"] = 1
    client.status = "closed"
    with pytest.raises(ClusterError, match="tcp://a: the cluster's scheduler has gone away"):
        check()


def test_an_fmu_travels_to_the_workers_of_a_cluster(cluster: Cluster, tmp_path: Path) -> None:
    # given a dog and its mapping file, which the workers cannot read where they are
    outputs = [V(n, unit=u) for n, u in (("x", "m"), ("y", "m"), ("heading", "rad"), ("speed", "m/s"))]
    moves = "v[4] = (v[0] == 1 || v[0] == 3) ? 5 : 0; v[1] += (v[0] == 3 ? -1 : 1) * v[4] * h;"
    dog = tiny_fmu(tmp_path / "dog.fmu", [V("command", "input", "Integer"), *outputs], moves)
    dog.with_suffix(".toml").write_text('[outputs]\nnorth = "x"\neast = "y"\n')
    leg = Scenario("leg", system="cts", waypoints=((25.0, 0.0),), duration=60.0)
    planned = matrix.plan_matrix(["cmec"], [str(dog)], [leg], trials=2)
    elsewhere = replace(
        planned.work.packed(), cells=tuple(_moved(cell) for cell in planned.work.packed().cells)
    )
    # when
    cluster.worker()
    with chunks.pool_at(cluster.address, elsewhere) as pool:
        outcomes = chunks.Outcomes(elsewhere)
        chunks.run_all(outcomes, pool, lambda chunk: None)
    # then both trials succeed there
    (point,) = matrix.result_of(planned, outcomes).table.values()
    assert (point.trials, point.successes, point.fmu_failures) == (2, 2, ())


def _moved(cell: object) -> Cosimulated:
    """A cell whose FMU is nowhere but in the cell."""
    assert isinstance(cell, Cosimulated)
    dog = cell.foreign["plant"]
    return replace(cell, swaps={**cell.swaps, "plant": replace(dog, path=Path("/nowhere/dog.fmu"))})
