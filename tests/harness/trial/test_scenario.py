"""Scenarios: what is read, what it means in SI, and what is refused."""

import math
from pathlib import Path

import pytest

from harness.cosim.loop import Event
from harness.cosim.roles import MISSION, Rename
from harness.trial.plan import Interface, interfaces_of_system, plan
from harness.trial.scenario import Scenario, ScenarioError, load, parse, shipped
from models.canine import Canine
from models.cmec import Cmec
from models.kit.declaration import Boolean, Integer, Variable
from models.system import SYSTEMS

FULL, CTS = interfaces_of_system(SYSTEMS["full"]), interfaces_of_system(SYSTEMS["cts"])
WHOLE = """
system = "cts"
reading = "literal"
seed = 7
duration = 60
waypoints = [[25, 0], [25, -12.5]]
origin = { latitude = 32.5, longitude = -85.25 }
start = { north = 1, east = 2, heading = 90 }
[parameters]
"cmec.moving_deviation" = 37
"controller.max_turns" = 3
"canine.shaking" = false
[[set]]
at = 10.0
until = 12.5
"controller.override" = "STOP"
"cmec.link_ok" = false
"""


def test_every_key_is_read() -> None:
    scenario = parse(WHOLE, "my.toml", "my")
    assert (scenario.name, scenario.system, scenario.reading, scenario.seed) == ("my", "cts", "literal", 7)
    assert scenario.duration == 60.0
    assert scenario.waypoints == ((25.0, 0.0), (25.0, -12.5))
    assert scenario.origin == (32.5, -85.25)
    assert scenario.start == (1.0, 2.0, 90.0)


def test_it_means_si_values_for_each_component() -> None:
    # when
    found = plan(parse(WHOLE, "my.toml"), CTS)
    # then
    controller, plant = found.values["controller"], found.values["plant"]
    assert controller["moving_deviation"] == math.radians(37)
    assert controller["turn_end_deviation"] == math.radians(20)  # the literal reading
    assert (controller["max_turns"], controller["start"], controller["waypoint_count"]) == (3, 1, 2)
    assert (controller["waypoint_north[2]"], controller["waypoint_east[2]"]) == (25, -12.5)
    assert (controller["home_north"], controller["home_east"]) == (1, 2)
    assert (plant["seed"], plant["start_north"], plant["start_east"]) == (7, 1, 2)
    assert plant["start_heading"] == math.pi / 2
    assert plant["start_heading_deviation"] == math.radians(10)
    assert plant["shaking"] == 0.0


def test_settings_by_time_end_with_what_was_before() -> None:
    events = plan(parse(WHOLE, "my.toml"), CTS).events
    assert events == (
        Event(10.0, "controller", "override", 2.0),
        Event(12.5, "controller", "override", 0.0),
        Event(10.0, "controller", "link_ok", 0.0),
        Event(12.5, "controller", "link_ok", 1.0),
    )


def test_vectors_take_lists_and_single_elements() -> None:
    text = '[parameters]\n"sensors.outage_start" = [12, 30.5]\n"sensors.outage_end[2]" = 40'
    values = plan(parse(text, "my.toml"), FULL).values["sensors"]
    assert [values[n] for n in ("outage_start[1]", "outage_start[2]", "outage_end[2]")] == [12, 30.5, 40]


def test_the_text_reads_back_to_the_same_scenario() -> None:
    scenario = parse(WHOLE, "my.toml", 'a "name"').override(['cmec.override="a\\n"'])
    assert parse(scenario.text(), "text") == scenario
    assert parse(scenario.text(), "text").text() == scenario.text()


def test_settings_of_the_command_line_win_over_the_file() -> None:
    scenario = parse(WHOLE, "my.toml").override(["cmec.moving_deviation=49", "cmec.override=left"], seed=3)
    assert scenario.parameters["cmec.moving_deviation"] == 49
    assert scenario.parameters["cmec.override"] == "left"
    assert scenario.seed == 3


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("sede = 1", 'my.toml: unknown key "sede"; did you mean "seed"?'),
        ("seed = 1.5", "my.toml: seed is 1.5; expected a whole number from 0 to 2147483647"),
        ("seed = true", "my.toml: seed is true; expected a whole number from 0 to 2147483647"),
        ("seed = -1", "my.toml: seed is -1; expected a whole number from 0 to 2147483647"),
        (
            'name = "../../outside"',
            'my.toml: name is "../../outside"; expected a plain name, without / and \\',
        ),
        ('name = ".."', 'my.toml: name is ".."; expected a plain name, without / and \\'),
        ('name = "a\\\\b"', 'my.toml: name is "a\\\\b"; expected a plain name, without / and \\'),
        ("duration = nan", "my.toml: duration is nan; expected a number from 0 to 86400"),
        ("system = 3", "my.toml: system is 3; expected a text"),
        ('system = "ful"', 'my.toml: system is "ful"; expected the path of an .ssp, or did you mean "full"?'),
        (
            'reading = "litteral"',
            'my.toml: reading is "litteral"; expected one of calibrated, literal; did you mean "literal"?',
        ),
        (
            "waypoints = [[1, 2, 3]]",
            "my.toml: waypoints is [1, 2, 3]; expected up to 16 pairs [north, east] in m, each within 100000",
        ),
        ("[start]\nnort = 1", 'my.toml: [start]: unknown key "nort"; did you mean "north"?'),
        ("[origin]\nlatitude = 91", "my.toml: [origin]: latitude is 91; expected a number from -90 to 90"),
        ('[[set]]\n"a.b" = 1', 'my.toml: [[set]] 1: lacks "at", the time in s'),
        ("[[set]]\nat = 1", 'my.toml: [[set]] 1: sets nothing; expected "component.input" = value'),
        ("[[set]]\nat = 2\nuntil = 1", "my.toml: [[set]] 1: until is 1; expected a number from 2 to 86400"),
        (
            "[parameters]\ncmec.moving_deviation = 1",
            "my.toml: [parameters]: cmec is {'moving_deviation': 1}; "
            'expected a value; a key with a dot is quoted: "block.name" = value',
        ),
    ],
)
def test_a_file_is_refused_by_its_key(text: str, error: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        parse(text, "my.toml")
    assert str(caught.value) == error


@pytest.mark.parametrize(
    ("setting", "error"),
    [
        ("cmek.max_turns=2", 'my: cmek.max_turns: no block or component "cmek"; did you mean "cmec"?'),
        (
            "cmec.max_turn=2",
            'my: cmec.max_turn: controller cmec has no parameter "max_turn"; did you mean "max_turns"?',
        ),
        ("cmec.max_turns=2.5", "my: cmec.max_turns is 2.5; expected a whole number from 0 up to 1000"),
        ("cmec.max_turns=true", "my: cmec.max_turns is true; expected a whole number from 0 up to 1000"),
        ("cmec.moving_deviation=300", "my: cmec.moving_deviation is 300; expected a number from 0 up to 229.2 deg"),  # noqa: E501
        ("cmec.moving_deviation=inf", "my: cmec.moving_deviation is inf; expected a number from 0 up to 229.2 deg"),  # noqa: E501
        ("cmec.reset_turns=1", "my: cmec.reset_turns is 1; expected true or false"),
        ("cmec.waypoint_north=1", "my: cmec.waypoint_north is a vector; expected a list, or one element by name: waypoint_north[1]"),  # noqa: E501
        ("cmec", '--set cmec: expected block.name=value, as in "cmec.moving_deviation=37"'),
    ],
)  # fmt: skip
def test_a_setting_is_refused_by_its_name(setting: str, error: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        plan(Scenario("my").override([setting]), FULL)
    assert str(caught.value) == error


def test_the_shipped_trials_have_the_geometry_of_figure_4_8() -> None:
    # given legs and the way home for each type, in m (perimeter 122 m)
    legs = {
        "right_90": (35.73, 35.73, 50.53, 90),
        "left_90": (35.73, 35.73, 50.53, -90),
        "right_45": (31.71, 31.71, 58.59, 45),
        "left_45": (31.71, 31.71, 58.59, -45),
    }
    for name, (first, second, home, turn) in legs.items():
        (n1, e1), (n2, e2) = load(name).waypoints
        assert math.hypot(n1, e1) == pytest.approx(first)
        assert math.hypot(n2 - n1, e2 - e1) == pytest.approx(second, abs=1e-3)
        assert math.hypot(n2, e2) == pytest.approx(home, abs=5e-3)
        assert math.degrees(math.atan2(e2 - e1, n2 - n1)) == pytest.approx(turn, abs=1e-3)
    assert load("three_waypoint").waypoints == load("right_90").waypoints
    assert load("two_waypoint").waypoints == ((25.0, 0.0),)
    assert len(shipped()) == 10


def test_the_heading_at_the_start_varies_in_two_waypoint_trials_only() -> None:
    for name, degrees in (("two_waypoint", 10.0), ("three_waypoint", 0.0)):
        deviation = plan(load(name), FULL).values["plant"]["start_heading_deviation"]
        assert deviation == pytest.approx(math.radians(degrees))


def test_a_scenario_that_is_not_there_is_missed_by_name() -> None:
    with pytest.raises(ScenarioError) as caught:
        load("three_waypoints")
    assert str(caught.value) == 'there is no scenario "three_waypoints"; did you mean "three_waypoint"?'


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        # a value that starts when another ends, listed before it
        ([(10, 12, "STOP"), (12, None, "RECALL")], [(10, 2), (12, 3)]),
        ([(12, None, "RECALL"), (10, 12, "STOP")], [(10, 2), (12, 3)]),
        # one inside another: what was before it comes back
        ([(5, 20, "STOP"), (10, 12, "FORWARD")], [(5, 2), (10, 1), (12, 2), (20, 0)]),
        ([(10, 12, "FORWARD"), (5, 20, "STOP")], [(5, 2), (10, 1), (12, 2), (20, 0)]),
        # both from the same time on: the last listed
        ([(5, 20, "STOP"), (5, 8, "LEFT")], [(5, 4), (8, 2), (20, 0)]),
        # one that starts within and outlasts the other
        ([(5, 10, "STOP"), (8, 15, "LEFT")], [(5, 2), (8, 4), (10, 4), (15, 0)]),
    ],
)
def test_the_entry_that_started_last_holds(
    entries: list[tuple[float, float | None, str]], expected: list[tuple[float, float]]
) -> None:
    text = "".join(
        f"[[set]]\nat = {at}\n{'' if until is None else f'until = {until}'}\n'cmec.override' = '{value}'\n"
        for at, until, value in entries
    )
    events = plan(parse(text, "my.toml"), FULL).events
    assert [(e.time, e.value) for e in events] == expected


def variable(kind: type | str, name: str, start: float = 0.0) -> Variable:
    made = Variable(kind, name, start=start)
    made.name = name
    return made


def test_what_a_mapping_file_renames_is_set_by_the_roles_name() -> None:
    # given a controller whose start is called go, whose override counts in tens, and whose home is in km
    cmec = FULL["controller"]
    renames = {
        "start": Rename("go", mapped=True),
        "override": Rename("cmd", 10.0, 1.0, mapped=True),
        "home_north": Rename("hn", 0.001, mapped=True),
    }
    inputs = {n: cmec.inputs[n] for n in ("start", "override")}
    inputs |= {"go": variable(Boolean, "go"), "cmd": variable(Integer, "cmd", start=1)}
    home = {"home_north": cmec.parameters["home_north"], "hn": variable("m", "hn")}
    part = Interface("ctl", home, inputs, "controller ctl.fmu", foreign=True, renames=renames)
    text = """start = { north = 500 }
    [[set]]
    at = 1
    until = 2
    "controller.override" = "STOP"
    [[set]]
    at = 3
    "controller.start" = false"""
    # when
    found = plan(parse(text, "my.toml"), {"controller": part})
    # then
    assert found.values["controller"] == {"go": 1.0, "hn": 0.5}
    assert found.events == (
        Event(1.0, "controller", "cmd", 21.0),
        Event(2.0, "controller", "cmd", 1.0),
        Event(3.0, "controller", "go", 0.0),
    )


def test_start_is_given_to_a_controller_only_and_only_if_nothing_else_gives_it() -> None:
    part = Interface("x", {}, {"start": variable(Boolean, "start")}, "x x.fmu")
    parts = {"controller": part, "plant": part}
    for bound, fed, expected in (
        ({}, {}, {"start": 1.0}),
        ({"controller": {"start": 0.0}}, {}, {}),
        ({}, {"controller": {"start"}}, {}),
    ):
        values = plan(Scenario("my"), parts, bound, fed).values
        assert values == {"controller": expected, "plant": {}}


def test_an_input_falls_back_to_what_the_package_binds() -> None:
    text = "[[set]]\nat = 1\nuntil = 2\n'controller.override' = 'STOP'"
    events = plan(parse(text, "my.toml"), FULL, {"controller": {"override": 3.0}}).events
    assert [e.value for e in events] == [2.0, 3.0]


def test_what_a_package_lacks_is_noted() -> None:
    part = Interface(
        "x", {n: v for n, v in FULL["plant"].parameters.items() if n != "seed"}, {}, "plant x.fmu"
    )
    assert plan(Scenario("my", system="x.ssp"), {"plant": part}).notes == (
        "plant x.fmu: has no parameter seed; not set",
        "x.ssp: has no component sensors; seed not set",
        "x.ssp: has no component controller; home_north, home_east not set",
    )


def test_a_parameter_that_does_not_fit_is_refused_unless_the_package_gives_it() -> None:
    known = {"start_heading": FULL["plant"].parameters["start_heading"]}
    part = Interface("x", known, {}, "plant x.fmu", misfits={"start_heading": "plant x.fmu: in deg"})
    with pytest.raises(ScenarioError) as caught:
        plan(Scenario("my"), {"plant": part})
    assert str(caught.value) == "my: plant x.fmu: in deg"
    assert plan(Scenario("my"), {"plant": part}, {"plant": {"start_heading": 9.0}}).values == {"plant": {}}


def test_the_keys_of_a_scenario_are_the_roles_parameters_and_their_ranges() -> None:
    values = plan(load("three_waypoint"), FULL).values
    for role, names in MISSION.items():
        assert names <= {n.partition("[")[0] for n in values[role]}
    seed, north = int(Canine.seed.max or 0), Canine.start_north.max
    for text, good in (
        (f"seed = {seed}", True),
        (f"seed = {seed + 1}", False),
        (f"start = {{ north = {north} }}", True),
        (f"start = {{ north = {north}1 }}", False),
        (f"waypoints = {[[0, 0]] * (Cmec.waypoint_north.size or 0)}", True),
        (f"waypoints = {[[0, 0]] * ((Cmec.waypoint_north.size or 0) + 1)}", False),
    ):
        if good:
            assert parse(text, "my.toml").name == "scenario"
        else:
            with pytest.raises(ScenarioError):
                parse(text, "my.toml")


def test_a_trial_to_nowhere_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "nowhere.toml"
    path.write_text("seed = 1\n")
    with pytest.raises(ScenarioError, match=r"nowhere.toml: waypoints is \[\]; expected 1 to 16 pairs"):
        load(str(path))
