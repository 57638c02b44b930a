"""The two readings set existing parameters within their ranges, to the values of CHOICES.md."""

from __future__ import annotations

import math

import pytest

from models.canine import Canine
from models.cmec import Cmec
from models.readings import READINGS, start_heading_deviation

BLOCKS = {"cmec": Cmec, "canine": Canine}


@pytest.mark.parametrize("reading", READINGS)
def test_every_parameter_exists_and_its_value_is_in_range(reading: str) -> None:
    for address, value in READINGS[reading].items():
        block, _, name = address.partition(".")
        declared = {v.name: v for v in BLOCKS[block].group("parameter")}
        declared[name].check(float(value), address)


def test_both_readings_set_the_same_parameters() -> None:
    assert READINGS.keys() == {"calibrated", "literal"}
    assert READINGS["calibrated"].keys() == READINGS["literal"].keys()


def test_values_are_those_of_the_page_of_choices() -> None:
    in_degrees = {
        reading: {
            n.partition(".")[2]: round(math.degrees(v), 9) if "end" in n else v for n, v in values.items()
        }
        for reading, values in READINGS.items()
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
    }


@pytest.mark.parametrize(
    ("reading", "waypoints", "degrees"),
    [("literal", 1, 10), ("literal", 2, 10), ("calibrated", 1, 10), ("calibrated", 2, 0)],
)
def test_heading_at_the_start(reading: str, waypoints: int, degrees: float) -> None:
    assert math.degrees(start_heading_deviation(reading, waypoints)) == pytest.approx(degrees)
