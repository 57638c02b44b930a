"""Whole trials with FMUs made elsewhere: run in a worker; all files if they go wrong."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from harness.log.log import read_log
from harness.trial import trial
from harness.trial.instances import is_foreign
from harness.trial.package import write_package
from harness.trial.prepare import prepared
from harness.trial.request import Changes, build_missing, requested
from harness.trial.scenario import load
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

DOG = [V("command", "input", "Integer"), *(V(n, unit=u) for n, u in (("north", "m"), ("east", "m")))]
DOG += [V("heading", unit="rad"), V("speed", unit="m/s")]
MOVES = "v[4] = v[0] == 1 ? 5 : 0; v[1] += v[4] * h; "
FILES = {"trial.mcap", "summary.json", "trial.html", "trial.png"}


def canine(folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """The command, as a user runs it."""
    command = [sys.executable, "-m", "harness.main", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=240)


def test_a_crash_ends_the_command_with_1_and_all_files_up_to_it(tmp_path: Path) -> None:
    # given a dog that prints, and whose process ends as if all were well
    noise = 'extern int puts(const char *); puts("noise"); extern void exit(int); if (t > 1.99) exit(0);'
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES + noise)
    # when
    ran = canine(tmp_path, "run", "two_waypoint", "--plant", dog, "--json", "--out", tmp_path / "out")
    # then
    text = "plant dog.fmu: fmi2DoStep ended the process at t = 2 s, with exit status 0"
    assert ran.returncode == 1
    assert ran.stderr.splitlines()[-1] == f"canine: {text}"
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert json.loads(ran.stdout) == summary
    assert "an FMU wrote to stdout: noise | noise | noise | noise | noise (and 46 lines more)" in ran.stderr
    assert (summary["outcome"], summary["ticks"], summary["stopped_by"]) == ("stopped", 51, text)
    fault = {"kind": "exit", "component": "plant", "fmu": "dog.fmu", "call": "fmi2DoStep", "time": 2.0}
    assert summary["fault"] == {"text": text, **fault}
    log = read_log(tmp_path / "out" / "trial.mcap")
    assert log.broken == text
    assert log["plant.north"].tolist() == pytest.approx([0.2 * k for k in range(51)], abs=1e-9)


@pytest.mark.parametrize("command", [("run", "two_waypoint"), ("faults", "faulty")])
def test_a_limit_of_the_command_line_ends_a_hanging_fmu(tmp_path: Path, command: tuple[str, ...]) -> None:
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES + "if (t > 1.99) for (volatile int i = 0;; i++) { }")
    ran = canine(tmp_path, *command, "--plant", dog, "--call-limit", "0.5")
    assert ran.returncode == 1
    assert "plant dog.fmu: fmi2DoStep did not come back within 0.5 s at t = 2 s" in ran.stderr


def test_a_worker_does_not_outlive_a_killed_parent(tmp_path: Path) -> None:
    # given a trial with a hanging dog, whose worker tells its process
    told = tmp_path / "process"
    step = "extern int getpid(void), fprintf(void *, const char *, ...), fclose(void *);"
    step += "extern void *fopen(const char *, const char *); if (t > 0.99) {"
    step += f'void *f = fopen("{told}", "w"); fprintf(f, "%d", getpid()); fclose(f);'
    step += "for (volatile int i = 0;; i++) { } }"
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES + step)
    command = [sys.executable, "-m", "harness.main", "run", "two_waypoint", "--plant", str(dog)]
    parent = subprocess.Popen(
        [*command, "--call-limit", "3000"],
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    while not (told.exists() and told.read_text()):
        time.sleep(0.05)
    worker = int(told.read_text())
    # when
    parent.kill()
    parent.wait()
    # then
    for _ in range(200):
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        if "Z" in Path(f"/proc/{worker}/stat").read_text().split()[2]:  # waits for init to take note
            return
        time.sleep(0.05)
    os.kill(worker, signal.SIGKILL)
    pytest.fail("the worker is still there")


def test_firmware_on_board_leads_a_dog_made_elsewhere_in_the_worker_as_without_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a dog of others, and the program on board
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES, depends=False)
    scenario = replace(load("two_waypoint"), duration=6.0)
    with requested(scenario, Changes(swaps={"plant": dog}, onboard="pil:host")) as request:
        build_missing(request)
        with prepared(request) as ready:
            # when
            trial.run(request, ready, tmp_path / "worker")
            monkeypatch.setattr("harness.trial.instances.is_foreign", lambda request: False)
            trial.run(request, ready, tmp_path / "here")
    # then the logs are the same, telemetry included
    logs = [(tmp_path / name / "trial.mcap").read_bytes() for name in ("worker", "here")]
    assert logs[0] == logs[1]
    log = read_log(tmp_path / "worker" / "trial.mcap")
    assert log["telemetry.time"][-1] > 5.0
    assert log["plant.north"][-1] > 1.0


def test_only_what_others_built_runs_in_a_worker(tmp_path: Path) -> None:
    # given our own trial, its log run again, and one with a copy of our own dog under its name
    with requested("two_waypoint", Changes()) as request:
        build_missing(request)
        assert not is_foreign(request)
        own = request.ssp.parent / "fmi2" / "pedestrian.fmu"
        with prepared(request) as ready:
            trial.run(replace(request, scenario=replace(request.scenario, duration=1.0)), ready, tmp_path)
    with requested(str(tmp_path / "trial.mcap"), Changes()) as request:
        assert not is_foreign(request)
    with requested("two_waypoint", Changes(swaps={"plant": own})) as request:
        assert not is_foreign(request)
    copy = tmp_path / "pedestrian.fmu"
    copy.write_bytes(own.read_bytes())
    with requested("two_waypoint", Changes(swaps={"plant": copy})) as request:
        assert not is_foreign(request)
    copy.write_bytes(own.read_bytes() + b"x")
    with requested("two_waypoint", Changes(swaps={"plant": copy})) as request:
        assert is_foreign(request)


def test_what_has_been_changed_in_our_folder_runs_in_a_worker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given copies of our package and our FMUs in a folder of builds, and one byte more in each
    with requested("two_waypoint", Changes()) as request:
        build_missing(request)
    package, own = tmp_path / request.ssp.name, tmp_path / "fmi2" / "pedestrian.fmu"
    shutil.copy(request.ssp, package)
    shutil.copytree(request.ssp.parent / "fmi2", own.parent)
    for module in ("harness.trial.instances", "harness.cosim.origin"):
        monkeypatch.setattr(f"{module}.build_folder", lambda: tmp_path)
    for changed in (package, own):
        with requested("two_waypoint", Changes(swaps={"plant": own})) as request:
            ours = replace(request, package=package)
            assert not is_foreign(ours)
            content = changed.read_bytes()
            changed.write_bytes(content + b"x")
            assert is_foreign(ours)
            changed.write_bytes(content)


def test_a_package_that_we_wrote_of_an_fmu_of_others_runs_in_a_worker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given packages of our own FMUs, and of a dog of others, in a folder of builds
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES, depends=False)
    scenario = replace(load("two_waypoint"), duration=1.0)
    packages = []
    for name, swaps in (("own", {}), ("evil", {"plant": dog})):
        with requested(scenario, Changes(swaps=swaps)) as request:
            build_missing(request)
            with prepared(request) as ready:
                write_package(request, ready, tmp_path / f"{name}.ssp")
        packages.append(tmp_path / f"{name}.ssp")
    (tmp_path / "fmi2").symlink_to(request.own_package.parent / "fmi2")
    for module in ("harness.trial.instances", "harness.cosim.origin"):
        monkeypatch.setattr(f"{module}.build_folder", lambda: tmp_path)
    # when, then
    for package, foreign in zip(packages, (False, True), strict=True):
        with requested(str(package), Changes()) as request:
            assert is_foreign(request) is foreign


def test_a_fault_before_the_first_tick_leaves_an_earlier_trial_as_it_was(tmp_path: Path) -> None:
    # given the files of a trial
    out = tmp_path / "out"
    assert canine(tmp_path, "run", "two_waypoint", "--out", out).returncode == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    # when another crashes as it is instantiated
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES, start="*(volatile int *)8 = 1;")
    ran = canine(tmp_path, "run", "two_waypoint", "--plant", dog, "--json", "--out", out)
    # then
    assert (ran.returncode, ran.stdout) == (1, "")
    assert "load and fmi2Instantiate ended the process" in ran.stderr
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
