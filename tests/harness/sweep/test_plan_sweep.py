"""What a sweep is asked for: a scenario made in Python, windows that are varied, messages in users' units."""

import math
import time
from dataclasses import replace
from pathlib import Path

import pytest

from harness.front_door import run_sweep
from harness.sweep.axis import SweepError
from harness.sweep.chunks import Job, TrialType, pool_at
from harness.sweep.sweep import plan_sweep
from harness.trial.scenario import Disturbance, Scenario, ScenarioError, Setting
from models.errors import UsageError

LEG = Scenario("leg", waypoints=((20.0, 0.0),), duration=60.0)


def test_a_scenario_made_in_python_is_swept(tmp_path: Path) -> None:
    # when
    result = run_sweep(LEG, thresholds="40:50:10", trials=5, out=tmp_path)
    # then
    assert [row["threshold_deg"] for row in result.rows] == [40.0, 50.0]
    assert result.recommendation["sweep"] == "leg"
    assert result.notes == ()


def test_a_scenario_made_in_python_is_checked_before_it_is_swept() -> None:
    with pytest.raises(ScenarioError, match=r"leg: duration is -1\.0; expected a number from 0 to 86400 s"):
        plan_sweep(Scenario("leg", waypoints=((20.0, 0.0),), duration=-1.0))


def test_what_cannot_act_in_a_sweep_is_noted() -> None:
    # given an order after the end
    scenario = Scenario(
        "leg", waypoints=((20.0, 0.0),), duration=60.0, sets=(Setting("controller.override", "STOP", 70.0),)
    )
    notes: list[str] = []
    # when
    plan_sweep(scenario, note=notes.append)
    # then
    assert notes == ["leg: [[set]] 1, controller.override at 70 s, never acts: the trial lasts 60 s"]


def test_a_system_with_another_block_is_named_in_words() -> None:
    planned = plan_sweep("two", thresholds="30", plant="canine_in_streets", trials=1)
    assert planned.about == (
        "two: deviation threshold h' 30 to 30 deg, 1 trials a point from seed 1 on, "
        "cts with canine_in_streets, calibrated"
    )
    full = plan_sweep("two", thresholds="30", system="full", estimator="six_state", trials=1)
    assert "full with six_state, calibrated" in full.about
    assert "seed 1 on, cts, calibrated" in plan_sweep("two", thresholds="30", trials=1).about


def test_a_plant_in_streets_without_any_is_noted() -> None:
    notes: list[str] = []
    plan_sweep("two", thresholds="30", plant="canine_in_streets", trials=1, note=notes.append)
    same = "there is no street and no pole: canine_in_streets does what canine does"
    assert notes == [f"two_waypoint: {same}"]
    # and a sweep that places some, a dog with streets, or one with a day of its own, is none
    plan_sweep(
        "two", vary=["canine.street_count=0:1:1"], plant="canine_in_streets", trials=1, note=notes.append
    )
    plan_sweep("crossing", thresholds="30", trials=1, note=notes.append)
    plan_sweep("two", thresholds="30", plant="canine_all_day", trials=1, note=notes.append)
    assert len(notes) == 1


def test_an_unknown_target_is_refused_with_all_that_are_known() -> None:
    with pytest.raises(ScenarioError) as caught:
        plan_sweep("four")
    assert 'there is no scenario "four"; known: ' in str(caught.value)
    assert ", three, three_waypoint, two, two_waypoint" in str(caught.value)


@pytest.mark.parametrize(
    ("thresholds", "error"),
    [
        ("20:300", "its end is 300; expected a number from 0 up to 229.1 deg"),
        ("-5:30", "its start is -5; expected a number from 0 up to 229.1 deg"),
        ("240:300", "its start is 240; expected a number from 0 up to 229.1 deg"),
    ],
)
def test_a_range_is_refused_by_the_limit_that_was_typed(thresholds: str, error: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        plan_sweep("two", thresholds=thresholds)
    assert str(caught.value) == f"--thresholds {thresholds}: {error}"


def test_an_empty_range_is_not_the_default_range() -> None:
    with pytest.raises(SweepError, match=r"--thresholds : expected a:b:step, as in 15:90:5"):
        plan_sweep("two", thresholds="")


def test_a_single_value_is_one_point() -> None:
    assert [list(map(int, point)) for point in plan_sweep("two", thresholds="49").points] == [[49]]


def test_the_end_of_an_outage_is_varied_from_its_start_on() -> None:
    settings = ["sensors.outage_start=[12]"]
    planned = plan_sweep("two", vary=["sensors.outage_end[1]=12:20:4"], system="full", settings=settings)
    assert [int(end) for (end,) in planned.points] == [12, 16, 20]
    with pytest.raises(ScenarioError) as caught:
        plan_sweep("two", vary=["sensors.outage_end[1]=10:20:5"], system="full", settings=settings)
    assert str(caught.value) == (
        "two_waypoint: window 1 of sensors: outage_start[1] is 12 s and outage_end[1] is 10 s, before it; "
        "expected outage_end[1] from 12 s on"
    )
    with pytest.raises(ScenarioError, match=r"outage_end\[1\] is not set"):
        plan_sweep("two", vary=["sensors.outage_start[1]=0:8:4"], system="full")


@pytest.mark.parametrize(
    ("address", "example"),
    [
        ("localhost", "tcp://localhost:8786"),
        ("tcp://localhost", "tcp://localhost:8786"),
        ("10.0.0.1:", "tcp://10.0.0.1:8786"),
        ("tcp://host:http", "tcp://host:8786"),
        ("", "tcp://host:8786"),
        ("::1", "tcp://[::1]:8786"),
        ("tcp://[fe80::1]", "tcp://[fe80::1]:8786"),
        ("tls://localhost", "tls://localhost:8786"),
    ],
)
def test_an_address_without_a_port_is_refused_at_once_with_an_example(address: str, example: str) -> None:
    job = Job("cts", (), ((),), (TrialType("two", {}, (), 10),), 1, 1)
    began = time.monotonic()
    with pytest.raises(UsageError) as caught, pool_at(address, job):
        pass
    assert str(caught.value) == (
        f"--dask {address}: is not the address of a scheduler; expected host and port, as in {example}, "
        "which `dask scheduler` prints"
    )
    assert time.monotonic() - began < 5


def test_a_scenarios_faults_go_with_the_job() -> None:
    # given faults of a signal, and of the radio
    noise = Disturbance("plant.heading", "noise", 1.0, 3.0, 90.0)
    scenario = Scenario("short", waypoints=((20.0, 0.0),), faults=(noise, Disturbance("radio", "lost", 2.0)))
    # when
    job = plan_sweep(scenario, thresholds="30", trials=1).job
    # then
    (link,) = job.faults
    assert (link.source, link.source_variable) == ("plant", "heading")
    (trial_type,) = job.trial_types
    values = {"kind": 4.0, "first": 25.0, "after": 75.0, "value": pytest.approx(math.pi / 2)}
    assert values.items() <= trial_type.values["fault_1"].items()
    assert [(c.tick, c.variable, c.value) for c in trial_type.changes] == [(50, "link_ok", 0.0)]
    # and a component that stalls
    stall = Disturbance("controller", "stall", 2.0, 3.0)
    with_stall = plan_sweep(replace(scenario, faults=(noise, stall)), thresholds="30", trials=1)
    assert with_stall.job.stalls == {"controller": ((50, 75),)}
    assert (
        with_stall.fingerprint
        != plan_sweep(replace(scenario, faults=(noise,)), thresholds="30", trials=1).fingerprint
    )
    # and other faults make another sweep
    other = plan_sweep(replace(scenario, faults=()), thresholds="30", trials=1)
    assert other.fingerprint != plan_sweep(scenario, thresholds="30", trials=1).fingerprint


@pytest.mark.parametrize(
    ("signal", "system", "text"),
    [
        ("sensors.gps_north", "cts", 'the system "cts" has no sensors; sweep with --system full'),
        ("plant.speed", "full", "the sensors answer with what is not finite"),
    ],
)
def test_a_fault_that_a_sweep_cannot_have_is_refused(signal: str, system: str, text: str) -> None:
    scenario = Scenario(waypoints=((20.0, 0.0),), faults=(Disturbance(signal, "nan", 1.0),))
    with pytest.raises(UsageError, match=text):
        plan_sweep(scenario, system=system, thresholds="30")
