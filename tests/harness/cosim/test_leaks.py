"""What is opened again and again is closed again: memory, files, mappings, folders, processes."""

import gc
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Literal

import fmpy
import fmpy.fmi2
import fmpy.fmi3
import pytest

from fmus.build import build_fmu
from fmus.folder import build_folder
from harness.cosim.archive import unpack
from harness.cosim.fmu import FmuError, FmuInstance, describe
from harness.cosim.ssp import FmuComponent, FmuSystem
from harness.cosim.worker.contained import Contained
from harness.cosim.worker.process import WorkerProcess
from models.pedestrian import Pedestrian
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

PAGE = resource.getpagesize()
ROUNDS = 3


def used() -> tuple[int, int, int]:
    """What this process holds: open files, mappings, bytes in memory."""
    gc.collect()
    return (
        len(os.listdir("/proc/self/fd")),
        len(Path("/proc/self/maps").read_text().splitlines()),
        int(Path("/proc/self/statm").read_text().split()[1]) * PAGE,
    )


def assert_that_nothing_is_kept(once: Callable[[], None], times: int, most: int) -> None:
    """Do it so often in each of three rounds, after a few times: in one of them at least it is given no more
    than `most` bytes. What leaks takes them in each; the allocator may, in one."""
    for _ in range(max(2, times // 10)):
        once()
    files, mappings, size = used()
    grown = []
    for _ in range(ROUNDS):
        for _ in range(times):
            once()
        files_now, mappings_now, size_now = used()
        grown.append(size_now - size)
        size = size_now
    assert files_now == files
    assert mappings_now <= mappings + 8  # the allocator's own
    assert min(grown) <= most


@pytest.mark.parametrize("version", [2, 3])
def test_our_fmu_instantiated_a_thousand_times_keeps_nothing(tmp_path: Path, version: Literal[2, 3]) -> None:
    # given the library of our FMU, loaded once
    path = build_fmu(Pedestrian, build_folder() / f"fmi{version}", version)
    unpack(path, tmp_path)
    read = fmpy.read_model_description(path)
    kind = fmpy.fmi2.FMU2Slave if version == 2 else fmpy.fmi3.FMU3Slave
    slave = kind(
        guid=read.guid,
        unzipDirectory=str(tmp_path),
        modelIdentifier=read.coSimulation.modelIdentifier,
        instanceName="plant",
    )

    def live() -> None:
        slave.instantiate()
        if version == 2:
            slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        slave.doStep(0.0, 0.04)
        slave.terminate()
        free = slave.fmi2FreeInstance if version == 2 else slave.fmi3FreeInstance
        free(slave.component)

    # then 150 bytes an instance would be seen
    assert_that_nothing_is_kept(live, 334, 50_000)
    slave.freeLibrary()


@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_opened_and_closed_again_and_again_keeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: Literal[2, 3]
) -> None:
    # given a folder for temporary files
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    path = build_fmu(Pedestrian, build_folder() / f"fmi{version}", version)

    def live() -> None:
        with FmuInstance("plant", path) as instance:
            instance.initialize({})

    # then neither a description (some 100 kB) nor a library stays, and one folder at most, for all of them
    assert_that_nothing_is_kept(live, 30, 500_000)
    assert len(list(tmp_path.iterdir())) <= 1


def test_the_folder_of_our_fmus_goes_with_the_process(tmp_path: Path) -> None:
    # given a process that opens one of our FMUs, and ends
    path = build_fmu(Pedestrian, build_folder() / "fmi3", 3)
    program = (
        "import os, sys; from pathlib import Path; from harness.cosim.fmu import FmuInstance\n"
        "with FmuInstance('plant', Path(sys.argv[1])): pass\n"
        "print(len(os.listdir(os.environ['TMPDIR'])))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program, path],
        env=os.environ | {"TMPDIR": str(tmp_path)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    # then the folder that it was unpacked into was there, and is gone
    assert ended.stdout == "1\n"
    assert list(tmp_path.iterdir()) == []


def test_workers_that_end_well_or_ill_leave_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given an FMU made elsewhere that ends well, and one that ends its process
    fmus = [
        tiny_fmu(tmp_path / f"{name}.fmu", [V("x")], step, depends=False)
        for name, step in (("good", "v[0] += 1;"), ("bad", "extern void exit(int); if (t > 0.2) exit(0);"))
    ]
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    pids = set()

    def live() -> None:
        with WorkerProcess() as process:
            for fmu in (fmus[0], fmus[0], fmus[1], fmus[0]):
                system = FmuSystem("toy", {"plant": FmuComponent("plant", fmu)}, ())
                with suppress(FmuError), Contained(system, {"plant": describe(fmu)}, process=process) as run:
                    run.run(duration=0.4)
                pids.add(process.pid)

    # then
    assert_that_nothing_is_kept(live, 1, 2_000_000)
    assert len(pids) == 2 * 5  # a process for each that ended well, and one after each that did not
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)
    assert list(temporary.iterdir()) == []
    assert "/dev/shm" not in Path("/proc/self/maps").read_text()
