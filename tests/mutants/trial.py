"""One mutant's trial: its tests, run in a fork of this process on a copy of the project."""

from __future__ import annotations

import gc
import importlib.util
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import Phase, settings

from tests.mutants.targets import PROJECT

FLOORS = ("models", "codegen", "fmus", "harness", "tests")
FILES = ("pyproject.toml", "README.md", "Makefile")
IMPORTED = ("casadi", "hypothesis.extra.numpy", "control", "pyubx2", "scipy.stats", "jinja2", "fmpy", "mcap")
OPTIONS = ("-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--hypothesis-seed=0", "--tb=line")
NOT_COPIED = shutil.ignore_patterns("__pycache__", "build", "results", "out")
OK, FAILED, OVER = 0, 1, -1  # pytest's status; -1: not in time; else it could not run the tests


class _Order:
    """Tests that killed mutants before come first; tells which killed this one."""

    def __init__(self, killers: Counter[str], told: Path) -> None:
        self.killers, self.told = killers, told

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items.sort(key=lambda item: -self.killers[item.nodeid])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.told.write_text(report.nodeid)


class Copy:
    """A copy of the project, in which one trial runs at a time.

    Args:
        folder: an empty folder of its own.
    """

    def __init__(self, folder: Path) -> None:
        self.root, self.told, self.log = folder / "project", folder / "killer", folder / "log"
        self.temporary = folder / "tmp"
        self.root.mkdir()
        for floor in FLOORS:
            shutil.copytree(PROJECT / floor, self.root / floor, ignore=NOT_COPIED)
        for file in FILES:
            shutil.copy(PROJECT / file, self.root / file)
        self.pid = 0
        self.until = 0.0

    def begin(self, file: str, text: str, tests: Sequence[str], limit: float, killers: Counter[str]) -> None:
        """Start the tests with a file's text; they are stopped after so many seconds."""
        self.file = self.root / file
        self.before = self.file.read_text()
        self._write(text)
        self.told.unlink(missing_ok=True)
        shutil.rmtree(self.temporary, ignore_errors=True)
        self.temporary.mkdir()
        self.begun = time.monotonic()
        self.until = self.begun + limit
        self.pid = os.fork()
        if self.pid == 0:
            self._run(tests, killers)

    def _run(self, tests: Sequence[str], killers: Counter[str]) -> None:
        """In the fork: leave this project's modules, take the copy's, and end with pytest's status."""
        status: Any = 3
        try:
            os.setsid()
            output = os.open(self.log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(output, 1)
            os.dup2(output, 2)
            for name in [n for n in sys.modules if n.partition(".")[0] in FLOORS]:
                del sys.modules[name]
            os.chdir(self.root)
            sys.path[:] = [str(self.root), *(p for p in sys.path if p not in ("", str(PROJECT)))]
            tempfile.tempdir = os.environ["TMPDIR"] = str(self.temporary)
            status = pytest.main([*OPTIONS, *tests], plugins=[_Order(killers, self.told)])
        finally:
            sys.stdout.flush()
            os._exit(int(status) & 0xFF)

    def result(self) -> tuple[int, str] | None:
        """Pytest's status and the test that failed; None while the tests run. -1 when their time is over."""
        pid, status = os.waitpid(self.pid, os.WNOHANG)
        if pid == 0:
            if time.monotonic() < self.until:
                return None
            self.stop()
            return OVER, ""
        self._end()
        killer = self.told.read_text() if self.told.exists() else ""
        return os.waitstatus_to_exitcode(status), killer

    def stop(self) -> None:
        """End the trial, and all that it started."""
        if self.pid:
            pid = self.pid
            self._end()
            with suppress(ChildProcessError):
                os.waitpid(pid, 0)

    def _end(self) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)
        self.pid = 0
        self.seconds = time.monotonic() - self.begun
        self._write(self.before)

    def _write(self, text: str) -> None:
        """Write the file and remove its bytecode, which looks valid for a text of its second and length."""
        self.file.write_text(text)
        Path(importlib.util.cache_from_source(str(self.file))).unlink(missing_ok=True)


def prepare(cache: Path) -> None:
    """Import what all tests import, once; keep what they build out of the user's cache.

    An example that fails a test is not made smaller, since nobody reads it.
    """
    settings.register_profile("trial", phases=(Phase.explicit, Phase.reuse, Phase.generate))
    settings.load_profile("trial")
    for name in IMPORTED:
        importlib.import_module(name)
    os.environ["ZIG_GLOBAL_CACHE_DIR"] = str(cache)
    sys.dont_write_bytecode = False
    gc.freeze()
