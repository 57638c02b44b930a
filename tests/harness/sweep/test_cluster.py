"""Sweeps on a real Dask cluster of this machine: a scheduler and workers in processes of their own."""

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
from logging.handlers import BufferingHandler
from pathlib import Path

import pytest
from distributed.client import logger as log_of_client

from harness.sweep import chunks, sweep
from harness.sweep.chunks import ClusterError
from harness.sweep.sweep import wanted
from models.errors import UsageError

Start = Callable[..., subprocess.Popen[bytes]]
WAIT_S = 60.0


class Cluster:
    """A scheduler, and workers that are started one by one."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.file, self.folder, self.stack = folder / "scheduler.json", folder, stack
        self.process("dask_scheduler", "--port", "0", "--host", "127.0.0.1")
        deadline = time.monotonic() + WAIT_S
        while not self.file.exists() or not self.file.read_text().endswith("}"):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        self.address = json.loads(self.file.read_text())["address"]

    def process(self, name: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{name}", "--scheduler-file", str(self.file)]
        log = self.stack.enter_context((self.folder / f"{name}.log").open("ab"))
        process = subprocess.Popen([*command, "--no-dashboard", *options], stdout=log, stderr=log)
        self.stack.callback(process.wait)
        self.stack.callback(process.kill)
        return process

    def worker(self, preload: str = "") -> subprocess.Popen[bytes]:
        """A worker with one thread, in which some Python is run first."""
        options = ["--nthreads", "1", "--no-nanny", "--local-directory", str(self.folder)]
        return self.process("dask_worker", *options, *(["--preload", preload] if preload else []))


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    with ExitStack() as stack:
        folder = tmp_path / "cluster"
        folder.mkdir()
        yield Cluster(folder, stack)


def test_a_killed_worker_costs_its_chunk_and_nothing_else(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    # given a sweep that this machine's threads have run, and a cluster of two workers
    asked = wanted("three", thresholds="20:60:20", trials=1000)
    sweep.run(asked, tmp_path / "here")
    doomed, _ = cluster.worker(), cluster.worker()
    monkeypatch.setattr(chunks, "SMALLEST", 300)
    monkeypatch.setitem(chunks.LARGEST, "cts", 300)
    progress: list[int] = []

    def kill_one(done: int) -> None:
        progress.append(done)
        if len(progress) == 3:
            os.kill(doomed.pid, signal.SIGKILL)

    # when one is killed on the way
    sweep.run(asked, tmp_path / "there", cluster.address, progress=kill_one)
    # then
    assert doomed.wait() == -signal.SIGKILL
    assert progress == list(range(300, 3001, 300))
    for name in ("sweep.csv", "recommendation.json", "sweep.png"):
        assert (tmp_path / "there" / name).read_bytes() == (tmp_path / "here" / name).read_bytes()


@pytest.mark.parametrize(
    ("preload", "message"),
    [
        ("from harness.sweep import chunks; chunks.program = lambda: 'other'", "has another version of this"),
        ("import sys; sys.modules['harness'] = None", "cannot run this program"),
    ],
)  # fmt: skip
def test_a_worker_with_another_program_or_none_is_refused(
    cluster: Cluster, tmp_path: Path, preload: str, message: str
):
    cluster.worker(preload)
    with pytest.raises(ClusterError) as caught:
        sweep.run(wanted("two", trials=10), tmp_path / "s", cluster.address)
    assert f"{cluster.address}: worker tcp://" in str(caught.value)
    assert message in str(caught.value)
    assert list((tmp_path / "s").iterdir()) == []


def test_a_cluster_without_workers_is_refused(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(chunks, "ANSWER_S", 1.0)
    with pytest.raises(ClusterError, match=r"has no workers; start some with `dask worker tcp://"):
        sweep.run(wanted("two", trials=10), tmp_path, cluster.address)


def test_a_cluster_that_goes_away_is_said_and_chunks_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    asked = wanted("two", thresholds="20:29", trials=1000)
    monkeypatch.setitem(chunks.LARGEST, "cts", 512)
    said = BufferingHandler(1000)
    monkeypatch.setattr(log_of_client, "handlers", [said])
    with ExitStack() as stack:
        folder = tmp_path / "cluster"
        folder.mkdir()
        cluster = Cluster(folder, stack)
        cluster.worker()

        def lose(done: int) -> None:
            if done >= 1024:
                stack.close()

        with pytest.raises(ClusterError, match="gone away"):
            sweep.run(asked, tmp_path / "s", cluster.address, progress=lose)
    assert said.buffer == []  # no traceback of Dask's
    notes: list[str] = []
    sweep.run(asked, tmp_path / "s", note=notes.append)
    assert int(notes[0].split()[0]) >= 1024


def test_an_address_that_answers_not_is_refused_within_seconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(chunks, "ANSWER_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:  # it listens, and says nothing
        port = silent.getsockname()[1]
        for address in (f"tcp://127.0.0.1:{port}", "tcp://127.0.0.1:1", "nonsense", "http://127.0.0.1:80"):
            started = time.monotonic()
            with pytest.raises(UsageError) as caught:
                sweep.run(wanted("two", trials=10), tmp_path, address)
            assert str(caught.value).startswith(
                f"--dask {address}: no Dask scheduler answers there within 1 s ("
            )
            assert "expected an address such as tcp://host:8786" in str(caught.value)
            assert time.monotonic() - started < 10.0
