"""Pairs of vectors: windows with a start and an end, points with a north and an east."""

import pytest

from harness.trial.pairs import is_paired
from harness.trial.plan import interfaces_of_system, plan
from harness.trial.scenario import Scenario, ScenarioError
from models.kit.declaration import Parameter
from models.system import BLOCKS, SYSTEMS

FULL = interfaces_of_system(SYSTEMS["full"])
MISSION = Scenario("my", waypoints=((25.0, 0.0), (25.0, 25.0)))


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        (
            ["sensors.outage_start=[12]"],
            "my: window 1 of sensors: outage_start[1] is 12 s and outage_end[1] is not set; "
            "expected outage_end[1] from 12 s on",
        ),
        (
            ["sensors.outage_start=[2, 12]", "sensors.outage_end=[3, 5.5]"],
            "my: window 2 of sensors: outage_start[2] is 12 s and outage_end[2] is 5.5 s, before it; "
            "expected outage_end[2] from 12 s on",
        ),
        (
            ["sensors.outage_start[8]=1"],
            "my: window 8 of sensors: outage_start[8] is 1 s and outage_end[8] is not set; "
            "expected outage_end[8] from 1 s on",
        ),
        (
            ["cmec.waypoint_north=[1, 2, 3]"],
            "my: cmec.waypoint_north[3] is set and cmec.waypoint_east[3] is not; set both, or neither",
        ),
        (
            ["controller.waypoint_east[16]=3"],
            "my: cmec.waypoint_east[16] is set and cmec.waypoint_north[16] is not; set both, or neither",
        ),
    ],
)
def test_half_of_a_pair_is_refused_by_its_number(settings: list[str], error: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        plan(MISSION.override(settings), FULL)
    assert str(caught.value) == error


def test_whole_pairs_are_accepted() -> None:
    settings = [
        "sensors.outage_start=[2, 12]", "sensors.outage_end=[3, 14]",
        "cmec.waypoint_north=[1, 2, 3]", "cmec.waypoint_east=[1, 2, 3]", "cmec.waypoint_count=3",
    ]  # fmt: skip
    resolved = plan(MISSION.override(settings), FULL)
    assert resolved.values["sensors"]["outage_end[2]"] == 14
    assert resolved.values["controller"]["waypoint_east[3]"] == 3
    assert plan(MISSION.override(["sensors.outage_end=[3]"]), FULL).notes == ()  # from the start on


def test_an_end_that_a_sweep_varies_is_not_needed_in_the_plan() -> None:
    scenario = MISSION.override(["sensors.outage_start=[12]"])
    assert plan(scenario, FULL, varied=["sensors.outage_end[1]"]).values["sensors"] == {
        "seed": 1, "outage_start[1]": 12
    }  # fmt: skip
    with pytest.raises(ScenarioError, match=r"outage_end\[1\] is not set"):
        plan(scenario, FULL, varied=["sensors.outage_end[2]"])


def test_each_vector_of_windows_or_points_declares_its_other_half() -> None:
    # given the vectors of all blocks
    vectors = {
        f"{block.title()}.{p.name}": p
        for block in BLOCKS for p in block.group("parameter") if isinstance(p, Parameter) and p.size
    }  # fmt: skip
    # then those that are no pair are triples, one for each axis, or a profile, whose values stand alone
    places = {f"cmec.{kind}_{axis}" for kind in ("waypoint", "fence") for axis in ("north", "east")}
    places |= {f"{c}.waypoint_{axis}" for c in ("quarter_turn", "proportional") for axis in ("north", "east")}
    places |= {
        f"{dog}.{kind}_{axis}" for dog in ("canine_in_streets", "canine_all_day")
        for kind in ("street", "street_end", "pole") for axis in ("north", "east")
    }  # fmt: skip
    paired = {"sensors.outage_start", "sensors.outage_end"} | places
    others = {name for name, p in vectors.items() if p.size != 3 and not name.startswith("profile.")}
    others -= {f"{dog}.street_half_width" for dog in ("canine_in_streets", "canine_all_day")}  # one for each
    assert others == paired
    assert {name: p.begins or p.beside for name, p in vectors.items() if p.begins or p.beside} == {
        "sensors.outage_end": "outage_start",
        "cmec.waypoint_east": "waypoint_north", "cmec.fence_east": "fence_north",
        "quarter_turn.waypoint_east": "waypoint_north", "proportional.waypoint_east": "waypoint_north",
        **{
            f"{dog}.{kind}_east": f"{kind}_north" for dog in ("canine_in_streets", "canine_all_day")
            for kind in ("street", "street_end", "pole")
        },
    }  # fmt: skip
    assert is_paired("sensors", "outage_start[3]")
    assert not is_paired("cmec", "max_turns")
