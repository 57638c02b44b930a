"""Notes on what a scenario asks for and cannot act."""

import json
import math
from copy import copy
from dataclasses import replace
from pathlib import Path

import pytest

from harness.trial.notes import late_notes
from harness.trial.plan import interfaces_of_system, plan
from harness.trial.scenario import Disturbance, Scenario, Setting, load, shipped
from models.system import SYSTEMS
from tests.harness.command import canine

FULL = interfaces_of_system(SYSTEMS["full"])
FENCE = ((-5.0, -9.0), (40.0, -9.0), (40.0, 9.0), (-5.0, 9.0))
LEG = Scenario("leg", waypoints=((25.0, 0.0),))
STOP = Setting("controller.override", "STOP", 10.0)
TURNED = Disturbance("plant.heading", "jump", 10.0, 20.0, 90.0)


@pytest.mark.parametrize(
    ("scenario", "notes"),
    [
        (LEG, []),
        (
            replace(LEG, waypoints=((0.0, 0.0), (25.0, 0.0))),
            ["waypoint 1 is where the start is: it is reached at once"],
        ),
        (
            replace(LEG, waypoints=((25.0, 0.0), (25.0, 0.0))),
            ["waypoint 2 is where waypoint 1 is: it may be reached where waypoint 1 is"],
        ),
        (
            replace(LEG, waypoints=((25.0, 0.0), (25.0, 7.0), (25.0, 14.01))),
            [
                "waypoint 2 is 7 m from waypoint 1, within cmec.capture_radius = 7 m: "
                "it may be reached where waypoint 1 is",
            ],
        ),
        (
            replace(LEG, waypoints=((25.0, 0.0), (1.0, 0.0))),
            [
                "home is 1 m from waypoint 2, within cmec.capture_radius = 7 m: "
                "it may be reached where waypoint 2 is"
            ],
        ),
        (
            LEG.override(["cmec.capture_radius=30"]),
            [
                "waypoint 1 is 25 m from the start, within cmec.capture_radius = 30 m: it is reached at once",
                "home is 25 m from waypoint 1, within cmec.capture_radius = 30 m: "
                "it may be reached where waypoint 1 is",
            ],
        ),
        (
            LEG.override(["cmec.waypoint_north[3]=9", "cmec.waypoint_east[3]=9"]),
            ["waypoint 3 is not in use: waypoint_count is 1"],
        ),
        (
            replace(LEG, start=(50.0, 0.0, 0.0)).override(["cmec.waypoint_count=2"]),
            ["waypoint 2 is not given: it is 0 m north, 0 m east"],
        ),
        (replace(LEG, duration=0.03), ["duration is 0.03 s, below a tick (0.04 s): nothing moves"]),
        (replace(LEG, duration=0.04), []),
        (
            replace(LEG, duration=9.0, sets=(STOP,)),
            ["[[set]] 1, controller.override at 10 s, never acts: the trial lasts 9 s"],
        ),
        (replace(LEG, duration=10.0, sets=(STOP,)), []),
        (
            replace(LEG, sets=(STOP, replace(STOP, at=10.01, until=10.03))),
            [
                "[[set]] 2, controller.override from 10.01 to 10.03 s, never acts: no tick (every 0.04 s) "
                "is in it"
            ],
        ),
        (replace(LEG, sets=(replace(STOP, at=10.01, until=10.05),)), []),
        (
            replace(LEG, duration=9.0, faults=(TURNED,)),
            ["[[fault]] 1, jump of 90 deg in plant.heading at 10 s, never acts: the trial lasts 9 s"],
        ),
        (
            replace(LEG, faults=(replace(TURNED, at=10.01, until=10.03),)),
            [
                "[[fault]] 1, jump of 90 deg in plant.heading from 10.01 to 10.03 s, never acts: no tick "
                "(every 0.04 s) is in it"
            ],
        ),
        (
            LEG.override(["sensors.outage_start=[3.05]", "sensors.outage_end=[3.06]"]),
            ["sensors.outage_start[1]: no tick (every 0.04 s) is in the window from 3.05 to 3.06 s"],
        ),
        (LEG.override(["sensors.outage_start=[3.05]", "sensors.outage_end=[3.09]"]), []),
        (
            LEG.override(["sensors.outage_start=[12]", "sensors.outage_end=[12]"]),
            ["sensors.outage_start[1]: the window is empty, it starts and ends at 12 s"],
        ),
        (LEG.override(["canine.bumper_search_min=3"]), []),
        (
            LEG.override(["canine.bumper_search_min=3", "canine.bumper_search_max=2"]),
            ["canine.bumper_search_max is 2 s, below bumper_search_min: each search lasts 3 s"],
        ),
        (LEG.override(["cmec=aim_off_lead", "cmec.heading_sd=22"]), []),
        (
            LEG.override(["cmec=aim_off_lead", "cmec.heading_sd=23"]),
            [
                "cmec.response_sd has no effect: a response is learnt from a turn of 8 heading_sd, which is "
                "184 deg; expected below 180 deg"
            ],
        ),
        (LEG.override(["cmec.heading_sd=23"]), []),
        (
            replace(LEG, system="full_ahrs", estimator="six_state"),
            ["six_state takes no attitude: canine_ahrs changes nothing"],
        ),
        (replace(LEG, system="full_ahrs", estimator="seven_state"), []),
        (replace(LEG, estimator="six_state"), []),
        (replace(LEG, fence=FENCE, reading="guarded"), []),
        (
            replace(LEG, fence=FENCE),
            ['the fence does not act without the safety rules: set reading = "guarded"'],
        ),
        (
            replace(
                LEG, fence=FENCE, reading="guarded", start=(-10.0, 0.0, 0.0), waypoints=((30, 0), (30, 25))
            ),
            [
                "the start is outside the fence: the animal may be stopped; on board a START is refused",
                "waypoint 2 is outside the fence: the animal may be stopped; on board a START is refused",
            ],
        ),
        (
            LEG.override(["sensors.outage_start=[12, 400]", "sensors.outage_end=[14, 410]"]),
            ["sensors.outage_start[2] = 400 s never acts: the trial lasts 300 s"],
        ),
    ],
)
def test_what_cannot_act_is_noted(scenario: Scenario, notes: list[str]) -> None:
    assert list(plan(scenario, FULL).notes) == notes


@pytest.mark.parametrize(("varied", "said"), [("controller.dead_time", 1), ("controller.capture_radius", 0)])
def test_nothing_is_said_of_waypoints_that_a_sweep_decides(varied: str, said: int) -> None:
    near = replace(LEG, waypoints=((4.0, 0.0),))
    notes = plan(near, FULL, varied={varied}).notes
    assert sum("within cmec.capture_radius" in note for note in notes) == 2 * said  # waypoint and home


def test_the_shipped_scenarios_need_no_note() -> None:
    for name in shipped():
        scenario = load(name)
        assert scenario.own_system is not None
        assert plan(scenario, interfaces_of_system(scenario.own_system)).notes == ()


def test_what_a_trial_ended_before_is_noted_afterwards() -> None:
    # given an order and an outage within the duration, and an order after it
    scenario = replace(LEG, duration=100.0, sets=(STOP, replace(STOP, at=200.0))).override(
        ["sensors.outage_start=[5, 20]", "sensors.outage_end=[6, 30]"]
    )
    values = plan(scenario, FULL).values
    # then only what lies between the end and the duration is late
    assert late_notes(scenario, FULL, values, 20.0) == []
    assert late_notes(scenario, FULL, values, 8.0) == [
        "[[set]] 1, controller.override at 10 s, never acted: the trial ended at 8.00 s",
        "sensors.outage_start[2] = 20 s never acted: the trial ended at 8.00 s",
    ]


def test_what_a_package_binds_to_another_value_than_the_scenarios_is_noted() -> None:
    # given a package that binds the reading's turn_end_deviation to its own value, a waypoint, and the seed
    bound = {
        "controller": {"turn_end_deviation": 0.3, "waypoint_north[1]": 10.0, "waypoint_east[1]": 0.0},
        "plant": {"seed": 1.0},
    }
    # then those that differ are noted, and the seed, which is the scenario's too, is not
    assert list(plan(LEG, FULL, bound).notes) == [
        "controller cmec: the package binds turn_end_deviation, waypoint_north; the scenario's not set"
    ]


def test_a_start_value_of_an_fmu_that_the_reading_replaces_is_noted() -> None:
    # given a controller of the block's name that starts with a turn_end_deviation of its own
    cmec = FULL["controller"]
    for start, notes in (
        (0.2, ["controller my.fmu: turn_end_deviation is 0.2; "
               'the reading "calibrated" sets it to 0.0872665']),
        (math.radians(5), []),
    ):  # fmt: skip
        variable = copy(cmec.parameters["turn_end_deviation"])
        variable.start = (start,)
        own = replace(
            cmec,
            label="controller my.fmu",
            parameters={**cmec.parameters, "turn_end_deviation": variable},
        )
        # then
        assert list(plan(LEG, {**FULL, "controller": own}).notes) == notes


def test_notes_are_on_stderr_and_in_the_summary(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given an order after the end of the trial, and a waypoint at the start
    path = tmp_path / "my.toml"
    path.write_text(
        "waypoints = [[0, 0], [25, 0]]\nduration = 100\n[[set]]\nat = 90\n'controller.override' = 'STOP'"
    )
    notes = ["waypoint 1 is where the start is: it is reached at once"]
    # when
    status, text, errors = canine(capsys, "run", path, "--out", tmp_path / "out", "--json")
    summary = json.loads(text)
    notes.append(
        f"[[set]] 1, controller.override at 90 s, never acted: the trial ended at {summary['time_s']:.2f} s"
    )
    # then
    assert status == 0
    assert summary["notes"] == notes
    assert json.loads((tmp_path / "out" / "summary.json").read_text()) == summary
    assert errors.splitlines() == [f"note: {note}" for note in notes]
    # when it is run with two seeds, then what all share is said once
    status, text, errors = canine(
        capsys, "run", path, "--seeds", "1:2", "--out", tmp_path / "seeds", "--json"
    )
    summaries = json.loads(text)
    assert [s["notes"][0] for s in summaries] == [notes[0]] * 2
    assert errors.splitlines() == [
        f"note: {notes[0]}",
        *(f"note: seed {s['seed']}: {s['notes'][1]}" for s in summaries),
    ]
