"""`canine parameters`: what it lists is what a scenario accepts."""

import json
from typing import Any

import pytest

from harness.trial.parameters import ParameterRow, parameters_of
from harness.trial.plan import interfaces_of_system, plan
from harness.trial.scenario import Scenario, ScenarioError
from models.system import BLOCKS, SYSTEMS
from tests.harness.command import canine

FULL = interfaces_of_system(SYSTEMS["full"])
ROWS = [row for row in parameters_of(BLOCKS) if row.name.split(".")[0] in {i.block for i in FULL.values()}]


def planned(name: str, value: Any) -> float:
    """What a scenario that sets the parameter comes to, SI."""
    block, _, variable = name.partition(".")
    values = plan(Scenario(parameters={name: value}), FULL).values
    (component,) = [name for name, interface in FULL.items() if interface.block == block]
    return values[component][variable]


@pytest.mark.parametrize("row", [row for row in ROWS if not row.size], ids=lambda row: row.name)
def test_a_scenario_accepts_the_default_and_the_ends_of_the_range(row: ParameterRow) -> None:
    for value in (row.default, row.min, row.max):
        if value is not None:
            planned(row.name, bool(value) if row.type == "Boolean" else value)


LIMITED = [
    row
    for row in ROWS
    if not row.size and row.type != "Boolean" and (row.min is not None or row.max is not None)
]


@pytest.mark.parametrize("row", LIMITED, ids=lambda row: row.name)
def test_a_scenario_refuses_what_is_beyond_the_range(row: ParameterRow) -> None:
    beyond = [] if row.min is None else [row.min - 1]
    beyond += [] if row.max is None else [row.max + 1]
    for value in beyond:
        with pytest.raises(ScenarioError, match="; expected "):
            planned(row.name, value)


def test_angles_are_in_degrees() -> None:
    (row,) = [row for row in ROWS if row.name == "cmec.moving_deviation"]
    assert (row.unit, row.default, row.min) == ("deg", 49.0, 0.0)  # Table 5.2
    (drift,) = [row for row in ROWS if row.name == "canine.drift"]
    assert drift.unit == "deg/s"


def test_the_list_of_one_block_as_a_table_and_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    # when
    status, text, _ = canine(capsys, "parameters", "cmec")
    _, as_json, _ = canine(capsys, "parameters", "controller", "--json")
    # then
    rows = json.loads(as_json)
    lines = [line for line in text.splitlines()[1:] if line.startswith("cmec.")]
    assert status == 0
    assert [line.split("  ")[0].partition("[")[0] for line in lines] == [row["name"] for row in rows]
    assert {row["name"].partition(".")[0] for row in rows} == {"cmec"}
    assert "cmec.waypoint_north[1..16]  m      -100000 to 100000" in text
    assert rows[0] == {
        "name": "cmec.capture_radius", "type": "Real", "unit": "m", "size": None, "min": 0.0, "max": None,
        "default": 7.0, "choices": {}, "meaning": "d': distance at which a waypoint counts as reached",
    }  # fmt: skip


def test_the_list_has_the_defaults_of_the_reading_that_is_asked_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    # given limits that firmware has (rules 2 to 4 of SAFETY.md), and the angle that the text states
    expected = {
        "calibrated": (1.0, 1e6, False, 5.0),
        "guarded": (5.0, 0.3, True, 5.0),
        "literal": (1.0, 1e6, False, 20.0),
    }
    names = ("progress_distance", "rest_speed_sd", "guarded", "turn_end_deviation")
    for reading, values in expected.items():
        # when they are listed
        _, text, _ = canine(capsys, "parameters", "cmec", "--reading", reading, "--json")
        defaults = {row["name"]: row["default"] for row in json.loads(text)}
        # then the list has them
        assert tuple(defaults[f"cmec.{name}"] for name in names) == values


def test_a_list_without_the_limits_of_firmware_says_how_many_differ(
    capsys: pytest.CaptureFixture[str],
) -> None:
    # progress_distance, rest_speed_sd, guarded and reset_turns
    note = "note: defaults of the reading calibrated; 4 are others in guarded, the reading of firmware"
    assert note in canine(capsys, "parameters", "cmec")[2]
    # and nothing is said where none does
    assert "defaults" not in canine(capsys, "parameters", "cmec", "--reading", "guarded")[2]
    assert "defaults" not in canine(capsys, "parameters", "canine")[2]


def test_the_list_names_the_sets_that_a_block_can_take(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        "sets: dissertation, measured, built_up, ideal, table_5_1; --set canine=d"
        in (canine(capsys, "parameters", "canine")[2])
    )
    assert "sets: dissertation, built_up, ideal; --set sensors=" in canine(capsys, "parameters", "sensors")[2]
    assert "sets" not in canine(capsys, "parameters", "watchdog")[2]


def test_without_a_block_all_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    rows = json.loads(canine(capsys, "parameters", "--json")[1])
    assert {row["name"].partition(".")[0] for row in rows} == {
        block.title() for block in BLOCKS if block.group("parameter")
    }


def test_a_block_that_does_not_exist_is_refused_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, errors = canine(capsys, "parameters", "cmek")
    assert (status, errors) == (2, 'canine: there is no block "cmek"; did you mean "cmec"?\n')
