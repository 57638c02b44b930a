"""One mission, whatever carries it: within this process, by a serial device, by TCP to a board's program."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from harness.log.log import FILE, read_log
from harness.onboard.radio import Mission
from harness.station.mission_files import load
from tests.harness.command import canine
from tests.harness.station.dogs import NEAR, obedient
from tests.harness.vest.devices import require_qemu

SPEED = ("--speed", "8")
VESTS = {"host": (*SPEED,), "stm32f405": ("--target", "stm32f405", "--tcp", "0")}  # QEMU: by the clock


@contextmanager
def vest(scenario: Path, out: Path, *arguments: str) -> Iterator[str]:
    """`canine vest`, until the context ends; where its radio is."""
    command = [sys.executable, "-m", "harness.main", "vest", str(scenario), "--out", str(out), *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as running:
        assert running.stdout
        try:
            name, _, address = running.stdout.readline().strip().partition(": ")
            assert name == "radio"
            yield address
        finally:
            running.terminate()


@pytest.mark.parametrize("carrier", ["in_process", *VESTS])
def test_a_mission_succeeds_whatever_carries_it(
    carrier: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a dog that obeys, and a mission to one waypoint
    scenario, out = obedient(tmp_path, NEAR), tmp_path / "station"
    lead = ("station", "--headless", "--mission", scenario, "--start", "--json", "--out", out)
    # when the station leads it
    if carrier == "in_process":
        status, printed, error = canine(capsys, *lead, "--simulate", scenario, *SPEED)
    else:
        if carrier == "stm32f405":
            require_qemu()
        with vest(scenario, tmp_path / "vest", *VESTS[carrier]) as radio:
            status, printed, error = canine(capsys, *lead, "--port", radio)
    # then it succeeds, and what was on board was this mission
    assert status == 0, error
    summary = json.loads(printed)
    assert (summary["outcome"], summary["waypoints_reached"]) == ("success", 1), error
    draft = load(str(scenario))
    assert draft.home
    log = read_log(out / FILE)
    assert log["telemetry.mission_id"][-1] == Mission(draft.home, draft.waypoints).id
