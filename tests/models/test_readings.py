"""The readings set existing parameters within their ranges, to the values of CHOICES.md."""

from __future__ import annotations

import math

import pytest

from models.cmec import Cmec
from models.readings import ON_BOARD, PUBLISHED, READINGS, start_heading_deviation
from models.system import BLOCKS, ESTIMATORS

OWNERS = {block.title(): block for block in BLOCKS}


@pytest.mark.parametrize("reading", READINGS)
def test_every_parameter_exists_and_its_value_is_in_range(reading: str) -> None:
    for address, value in READINGS[reading].items():
        block, _, name = address.partition(".")
        declared = {v.name: v for v in OWNERS[block].group("parameter")}
        declared[name].check(float(value), address)


def test_the_published_readings_set_the_same_parameters_and_the_guarded_one_sets_more() -> None:
    assert READINGS.keys() == {*PUBLISHED, ON_BOARD} == {"calibrated", "literal", "field", "guarded"}
    keys = {frozenset(READINGS[reading]) for reading in PUBLISHED}
    assert len(keys) == 1
    assert READINGS["calibrated"].keys() < READINGS["guarded"].keys()


def test_the_field_reading_is_the_calibrated_one_with_turns_by_waypoint() -> None:
    differing = dict(READINGS["field"].items() - READINGS["calibrated"].items())
    assert differing == {"cmec.reset_turns": True}


def test_the_guarded_reading_is_the_calibrated_one_with_the_limits_and_turns_by_waypoint() -> None:
    differing = dict(READINGS["guarded"].items() - READINGS["calibrated"].items())
    own = {name: value for name, value in differing.items() if name.startswith("cmec.")}
    limits = {"cmec.guarded": True, "cmec.progress_distance": 5.0, "cmec.rest_speed_sd": 0.3}
    assert own == {"cmec.reset_turns": True, **limits}


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_the_guarded_reading_limits_what_every_estimator_calls_valid(estimator: str) -> None:
    limits = {name.partition(".")[2] for name in READINGS["guarded"] if name.startswith(f"{estimator}.")}
    assert limits >= {"max_position_sd", "max_speed_sd", "recovery_time", "recovery_speed"}
    assert READINGS["guarded"][f"{estimator}.max_position_sd"] == Cmec.variables()["capture_radius"].start[0]


def test_the_published_readings_have_no_limits() -> None:
    parameters = Cmec.variables()
    assert parameters["guarded"].start == (0,)
    assert parameters["rest_speed_sd"].start[0] > 1e5  # m/s


def test_values_are_those_of_the_page_of_choices() -> None:
    in_degrees = {
        reading: {
            n.partition(".")[2]: round(math.degrees(v), 9) if "end" in n else v for n, v in values.items()
        }
        for reading, values in READINGS.items()
        if reading in PUBLISHED
    }
    assert in_degrees == {
        "calibrated": {
            "turn_end_deviation": 5,
            "limit_stop_deviation": True,
            "count_reissue": False,
            "reset_turns": False,
        },
        "literal": {
            "turn_end_deviation": 20,
            "limit_stop_deviation": False,
            "count_reissue": True,
            "reset_turns": True,
        },
        "field": {
            "turn_end_deviation": 5,
            "limit_stop_deviation": True,
            "count_reissue": False,
            "reset_turns": True,
        },
    }


@pytest.mark.parametrize(
    ("reading", "waypoints", "degrees"),
    [
        ("literal", 1, 10),
        ("literal", 2, 10),
        ("calibrated", 1, 10),
        ("calibrated", 2, 0),
        ("field", 1, 10),
        ("field", 2, 0),
    ],
)
def test_heading_at_the_start(reading: str, waypoints: int, degrees: float) -> None:
    assert math.degrees(start_heading_deviation(reading, waypoints)) == pytest.approx(degrees)
