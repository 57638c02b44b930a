"""Whole trials with the loop in C and with the one in Python: the same logs, summaries and errors."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest

from harness.cosim.fmu import FmuError
from harness.cosim.stepping import Loop, Order
from harness.cosim.walk import NativeWalk, Walk
from harness.trial import trial
from harness.trial.prepare import prepared
from harness.trial.request import Changes, Request, build_missing, requested
from harness.trial.scenario import Scenario, load
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

CTS = Scenario("straight", system="cts", waypoints=((25.0, 0.0),), duration=60.0)
# a dog made elsewhere, in km/h and degrees: it runs north at 18 km/h and turns a little to and fro
DOG = [V("command", "input", "Integer"), *(V(n, unit=u) for n, u in (("north", "m"), ("east", "m")))]
DOG += [V("course", unit="deg"), V("v", unit="km/h")]
MOVES = (
    "v[4] = v[0] == 1 ? 18 : 0; v[3] = 3 * sin(t); v[1] += v[4] / 3.6 * h; v[2] += v[4] * h * sin(t) / 60;"
)
MAPPING = """[outputs]
speed = { name = "v", factor = 0.2777777777777778 }
heading = { name = "course", factor = 0.017453292519943295 }
"""

# the scenario, its parameters and how it is run: each kind of trial, each order with each FMI version
CASES: dict[str, tuple[str | Scenario, Mapping[str, Any], Changes]] = {
    "two_waypoint": ("two_waypoint", {}, Changes()),
    "three_waypoint": ("three_waypoint", {}, Changes("jacobi")),
    "four_waypoint": ("four_waypoint", {}, Changes("sequential", "3")),
    "five_waypoint": ("five_waypoint", {}, Changes("jacobi", "3")),
    "left_45, literal": (replace(load("left_45"), reading="literal"), {}, Changes(fmi="3")),
    "left_90, an outage": (
        "left_90", {"sensors.outage_start": [2.0], "sensors.outage_end": [9.0]}, Changes("jacobi")
    ),
    "right_45, 10 Hz GPS": ("right_45", {"sensors.gps_period": 0.1}, Changes()),
    "right_90, 1 Hz GPS": ("right_90", {"sensors.gps_period": 1.0}, Changes("sequential", "3")),
    "distance_100, guarded, AHRS": (replace(load("distance_100"), reading="guarded"), {}, Changes(ahrs=True)),
    "patrol, override and lost link": ("patrol", {}, Changes()),
    "patrol in jacobi order": ("patrol", {}, Changes("jacobi", "3")),
    "true state": (CTS, {}, Changes(fmi="3")),
    "another estimator": ("two_waypoint", {}, Changes(estimator="six_state")),
}  # fmt: skip


def run(request: Request, out: Path, loop: Loop) -> tuple[bytes, dict[str, Any]]:
    """The log, and the summary without what differs from run to run."""
    request = replace(request, loop=loop)
    with prepared(request) as ready:
        summary = trial.run(request, ready, out / loop)
    log = (out / loop / "trial.mcap").read_bytes()
    kept = {key: value for key, value in summary.items() if key not in ("real_time_factor", "log")}
    return log, json.loads(json.dumps(kept))


@pytest.fixture
def walks(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The class of each walk that was made."""
    made: list[str] = []
    begin = Walk.__init__

    def noted(self: Walk, *arguments: Any, **options: Any) -> None:
        made.append(type(self).__name__)
        begin(self, *arguments, **options)

    monkeypatch.setattr(Walk, "__init__", noted)
    return made


@pytest.mark.parametrize("case", CASES)
def test_both_loops_leave_the_same_log_and_summary(case: str, tmp_path: Path, walks: list[str]) -> None:
    target, parameters, changes = CASES[case]
    scenario = load(target) if isinstance(target, str) else target
    scenario = replace(
        scenario, duration=min(scenario.duration, 60.0), parameters={**scenario.parameters, **parameters}
    )
    with requested(scenario, changes) as request:
        build_missing(request)
        # when
        native, python = (run(request, tmp_path, loop) for loop in get_args(Loop))
    # then
    assert walks == [NativeWalk.__name__, Walk.__name__]
    assert native[0] == python[0]
    assert native[1] == python[1]
    assert native[1]["ticks"] > 200


@pytest.mark.parametrize("order", ["sequential", "jacobi"])
@pytest.mark.parametrize(
    ("version", "fault"),
    [
        (2, ("", "")),
        (3, ("", "")),
        (2, ("if (t > 1.99) v[1] = NAN;", 'plant dog.fmu: output "north" is nan at t = 2.04 s')),
        (3, ("if (t > 1.99) return 3;", "plant dog.fmu: fmi3DoStep returned error at t = 2 s")),
    ],
)
def test_a_dog_made_elsewhere_is_led_alike_and_fails_alike(
    version: int, fault: tuple[str, str], order: Order, tmp_path: Path
) -> None:
    code, text = fault
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES + code, version=version, depends=False)
    dog.with_suffix(".toml").write_text(MAPPING)
    ends: list[tuple[bytes, object]] = []
    loops: tuple[Loop, ...] = get_args(Loop)
    scenario = replace(load("two_waypoint"), duration=20.0)
    with requested(scenario, Changes(order, swaps={"plant": dog})) as request:
        build_missing(request)
        for loop in loops:
            try:
                ends.append(run(request, tmp_path, loop))
            except FmuError as error:
                ends.append(((tmp_path / loop / "trial.mcap").read_bytes(), str(error)))
    assert ends[0] == ends[1]
    assert text in str(ends[0][1])


def test_a_trial_without_the_loop_in_c_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given a machine that cannot compile it
    monkeypatch.setattr("harness.cosim.walk._library", lambda: "no compiler for this machine")
    request = Request(replace(load("two_waypoint"), duration=2.0))
    build_missing(request)
    # when, then
    note = "the loop is Python's, a tenth as fast: no compiler for this machine"
    assert run(request, tmp_path, "native")[1]["notes"] == [note]
    assert run(request, tmp_path, "python")[1]["notes"] == []
