"""Plans: a scenario in SI for each component, inputs that change by time, refusals by address."""

import math
from dataclasses import replace

import numpy as np
import pytest

from harness.cosim.fmu import Access
from harness.cosim.rename import Rename
from harness.cosim.roles import MISSION
from harness.cosim.stepping import Event
from harness.trial.plan import Interface, interface_of_fmu, interfaces_of_system, plan, values_of
from harness.trial.scenario import Scenario, ScenarioError, Setting, Written, load, parse
from models.canine import Canine
from models.cmec import Cmec
from models.kit.declaration import Boolean, Integer, Type, Variable
from models.system import SYSTEMS
from tests.harness.cosim.descriptions import fmu, quantity
from tests.harness.trial.whole_scenario import WHOLE

FULL, CTS = interfaces_of_system(SYSTEMS["full"]), interfaces_of_system(SYSTEMS["cts"])


def test_a_scenario_is_resolved_to_si_values_of_each_component() -> None:
    # when
    resolved = plan(parse(WHOLE, "my.toml"), CTS)
    # then
    controller, plant = resolved.values["controller"], resolved.values["plant"]
    assert controller["moving_deviation"] == math.radians(37)
    assert controller["turn_end_deviation"] == math.radians(20)  # the literal reading
    assert (controller["max_turns"], controller["start"], controller["waypoint_count"]) == (3, 1, 2)
    assert (controller["waypoint_north[2]"], controller["waypoint_east[2]"]) == (25, -12.5)
    assert (controller["home_north"], controller["home_east"]) == (1, 2)
    assert (plant["seed"], plant["start_north"], plant["start_east"]) == (7, 1, 2)
    assert plant["start_heading"] == math.pi / 2
    assert plant["start_heading_deviation"] == math.radians(10)
    assert plant["shaking"] == 0.0


def test_an_input_that_is_set_for_a_time_returns_to_its_start_value() -> None:
    events = plan(parse(WHOLE, "my.toml"), CTS).events
    assert events == (
        Event(10.0, "controller", "override", 2.0),
        Event(12.5, "controller", "override", 0.0),
        Event(10.0, "controller", "link_ok", 0.0),
        Event(12.5, "controller", "link_ok", 1.0),
        Event(20.0, "controller", "link_ok", 0.0),  # the radio is lost
    )


def test_vectors_are_set_by_lists_and_by_single_elements() -> None:
    text = """[parameters]
    "sensors.outage_start" = [12, 30.5]
    "sensors.outage_end" = [20]
    "sensors.outage_end[2]" = 40"""
    values = plan(parse(text, "my.toml"), FULL).values["sensors"]
    assert [values[n] for n in ("outage_start[1]", "outage_start[2]", "outage_end[2]")] == [12, 30.5, 40]


@pytest.mark.parametrize(
    ("setting", "error"),
    [
        ("cmek.max_turns=2", 'my: cmek.max_turns: no block or component "cmek"; did you mean "cmec.max_turns"?'),  # noqa: E501
        ("cmek.max_turn=2", 'my: cmek.max_turn: no block or component "cmek"; did you mean "cmec"?'),
        (
            "cmec.max_turn=2",
            'my: cmec.max_turn: controller cmec has no parameter "max_turn"; did you mean "max_turns"?',
        ),
        ("cmec.max_turns=2.5", "my: cmec.max_turns is 2.5; expected a whole number from 0 up to 1000"),
        ("cmec.max_turns=true", "my: cmec.max_turns is true; expected a whole number from 0 up to 1000"),
        ("cmec.moving_deviation=300", "my: cmec.moving_deviation is 300; expected a number from 0 up to 229.1 deg"),  # noqa: E501
        ("cmec.moving_deviation=inf", "my: cmec.moving_deviation is inf; expected a number from 0 up to 229.1 deg"),  # noqa: E501
        ("cmec.reset_turns=1", "my: cmec.reset_turns is 1; expected true or false"),
        ("cmec.waypoint_north=1", "my: cmec.waypoint_north is a vector; expected a list, or one element by name: waypoint_north[1]"),  # noqa: E501
        ('cmec.waypoint_north=[1, "a"]', 'my: cmec.waypoint_north[2] is "a"; expected a number from -100000 up to 100000 m'),  # noqa: E501
        ("cmec.waypoint_north[17]=1", "my: cmec.waypoint_north[17]: controller cmec has no element [17] of waypoint_north; expected waypoint_north[1] to waypoint_north[16]"),  # noqa: E501
        ("max_turns=2", 'my: max_turns: no block or component "max_turns"; did you mean "cmec.max_turns"?'),
        ("canine.max_turns=2", 'my: canine.max_turns: plant canine has no parameter "max_turns"; did you mean "cmec.max_turns"?'),  # noqa: E501
        ("canine.seed=-1", "my: canine.seed is -1; expected a whole number from 0 up to 2147483647"),
        ("cmec", '--set cmec: expected block.name=value, as in "cmec.moving_deviation=37"'),
    ],
)  # fmt: skip
def test_a_parameter_is_refused_by_its_address(setting: str, error: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        plan(Scenario("my").override([setting]), FULL)
    assert str(caught.value) == error


NUMBERS = fmu(
    "numbers",
    quantity("p", "parameter", Type.INTEGER, access=Access("Int8", np.int8)),
    quantity("i", "parameter", Type.INTEGER, access=Access("Int64", np.int64)),
    quantity("u", "parameter", Type.INTEGER, access=Access("UInt64", np.uint64)),
    quantity("f", "input", access=Access("Float32", np.float32)),
    quantity("x", "input", Type.INTEGER, access=Access("Int8", np.int8)),
)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("p", 300, "is 300; expected a whole number from -128 up to 127"),
        ("u", -1, "is -1; expected a whole number from 0 up to 1.844674407e+19"),
        ("i", 2**53 + 1, "is 9007199254740993, which no double holds; expected a whole number from -9.22"),
        (
            "i",
            2.0**63,
            "is 9.223372036854776e+18; expected a whole number from -9.223372037e+18 up to 9.223372037e+18",
        ),
        ("f", 1e300, "is 1e+300; expected a number from -3.402823466e+38 up to 3.402823466e+38"),
        ("x", -129, "is -129; expected a whole number from -128 up to 127"),
    ],
)
def test_a_value_that_an_fmus_type_does_not_hold_is_refused(name: str, value: float, text: str) -> None:
    scenario = Scenario("my", sets=(Setting(f"a.{name}", value, 1.0, None),))
    if name not in NUMBERS.inputs:
        scenario = Scenario("my", parameters={f"a.{name}": value})
    with pytest.raises(ScenarioError) as caught:
        plan(scenario, {"a": interface_of_fmu("a", NUMBERS)})
    assert f"a.{name} {text}" in str(caught.value)


def test_a_whole_number_beyond_all_doubles_is_refused() -> None:
    interfaces = {"a": interface_of_fmu("a", NUMBERS)}
    with pytest.raises(ScenarioError, match=r"a\.i is 10*; expected a whole number"):
        plan(Scenario("my", parameters={"a.i": 10**400}), interfaces)
    with pytest.raises(ScenarioError, match=r"a\.f is -10*; expected a number"):
        plan(Scenario("my", sets=(Setting("a.f", -(10**400), 1.0, None),)), interfaces)


def test_a_parameter_that_a_scenario_sets_by_its_block_and_by_its_role_is_refused() -> None:
    twice = Scenario("my", parameters={"cmec.capture_radius": 5.0, "controller.capture_radius": 9.0})
    with pytest.raises(
        ScenarioError, match=r"my: controller\.capture_radius: cmec\.capture_radius is the same"
    ):
        plan(twice, FULL)


def test_a_set_gives_a_component_its_parameters_and_one_by_its_own_name_wins_over_it() -> None:
    # given a set by the block's name, and one by the component's, behind a parameter of its own
    parameters: dict[str, Written] = {"canine.slowing_down_deviation": 0.5}
    parameters |= {"canine": "table_5_1", "sensors": "ideal"}
    # when
    values = plan(Scenario("my", parameters=parameters), FULL).values
    # then
    drawn = ("cruise_speed_deviation", "slowing_down_deviation", "bumper_search_max")
    assert [values["plant"][name] for name in drawn] == [1.49, 0.5, 5]
    assert (values["sensors"]["gps_wander"], values["sensors"]["gps_speed_noise"]) == (0, 0.05)


@pytest.mark.parametrize(
    ("parameters", "error"),
    [
        ({"canine": "table_51"}, 'canine: there is no set "table_51" of parameters of the plant; did you'),
        ({"cmec": "measured"}, 'cmec: there is no set "measured" of parameters of the controller; known'),
        ({"plant": 1}, "plant is 1; expected the name of a set"),
        ({"plant": "ideal", "canine": "table_5_1"}, "canine: plant is the same component; choose one set"),
        ({"dog": "table_5_1"}, 'dog: no block or component "dog"'),
    ],
)  # fmt: skip
def test_a_set_that_a_component_cannot_take_is_refused(parameters: dict[str, Written], error: str) -> None:
    with pytest.raises(ScenarioError, match=f"^my: {error}"):
        plan(Scenario("my", parameters=parameters), FULL)


def test_the_heading_at_the_start_varies_in_two_waypoint_trials_only() -> None:
    for name, degrees in (("two_waypoint", 10.0), ("three_waypoint", 0.0)):
        deviation = plan(load(name), FULL).values["plant"]["start_heading_deviation"]
        assert deviation == pytest.approx(math.radians(degrees))


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
def test_of_several_settings_of_an_input_the_one_that_started_last_holds(
    entries: list[tuple[float, float | None, str]], expected: list[tuple[float, float]]
) -> None:
    text = "".join(
        f"[[set]]\nat = {at}\n{'' if until is None else f'until = {until}'}\n'cmec.override' = '{value}'\n"
        for at, until, value in entries
    )
    events = plan(parse(text, "my.toml"), FULL).events
    assert [(e.time, e.value) for e in events] == expected


def variable(kind: Type | str, name: str, start: float = 0.0) -> Variable:
    declared = Variable(kind, name, start=start)
    declared.name = name
    return declared


def test_a_renamed_parameter_or_input_is_set_by_the_roles_name() -> None:
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
    interface = Interface("ctl", home, inputs, "controller ctl.fmu", foreign=True, renames=renames)
    text = """start = { north = 500 }
    [[set]]
    at = 1
    until = 2
    "controller.override" = "STOP"
    [[set]]
    at = 3
    "controller.start" = false"""
    # when
    resolved = plan(parse(text, "my.toml"), {"controller": interface})
    # then
    assert resolved.values["controller"] == {"go": 1.0, "hn": 0.5}
    assert resolved.events == (
        Event(1.0, "controller", "cmd", 21.0),
        Event(2.0, "controller", "cmd", 1.0),
        Event(3.0, "controller", "go", 0.0),
    )


def test_a_renamed_parameter_is_set_by_one_of_its_names() -> None:
    interface = Interface(
        "ctl",
        {name: variable("m", name) for name in ("home_north", "hn")},
        {},
        "controller ctl.fmu",
        renames={"home_north": Rename("hn", mapped=True)},
    )
    scenario = Scenario("my", parameters={"controller.home_north": 1.0, "controller.hn": 2.0})
    with pytest.raises(ScenarioError, match=r"controller\.hn: controller\.home_north is the same parameter"):
        plan(scenario, {"controller": interface})


def test_a_controller_is_started_unless_the_package_binds_or_connects_its_start() -> None:
    interface = Interface("x", {}, {"start": variable(Boolean, "start")}, "x x.fmu")
    interfaces = {"controller": interface, "plant": interface}
    bound = {"controller": {"start": 0.0}}
    connected = {"controller": {"start"}}
    assert plan(Scenario("my"), interfaces).values == {"controller": {"start": 1.0}, "plant": {}}
    assert plan(Scenario("my"), interfaces, bound).values == {"controller": {}, "plant": {}}
    assert plan(Scenario("my"), interfaces, {}, connected).values == {"controller": {}, "plant": {}}


def test_an_input_that_was_set_returns_to_the_value_that_the_package_binds() -> None:
    text = "[[set]]\nat = 1\nuntil = 2\n'controller.override' = 'STOP'"
    events = plan(parse(text, "my.toml"), FULL, {"controller": {"override": 3.0}}).events
    assert [e.value for e in events] == [2.0, 3.0]


def test_mission_parameters_that_a_package_lacks_are_noted() -> None:
    interface = Interface(
        "x", {n: v for n, v in FULL["plant"].parameters.items() if n != "seed"}, {}, "plant x.fmu"
    )
    assert plan(Scenario("my", system="x.ssp"), {"plant": interface}).notes == (
        "plant x.fmu: has no parameter seed; not set",
        "x.ssp: has no component sensors; seed not set",
        "x.ssp: has no component controller; home_north, home_east not set",
    )


def test_an_animal_that_knows_no_streets_is_said_to_run_without_them() -> None:
    plant = Interface("x", FULL["plant"].parameters, {}, "plant canine")
    (note,) = [text for text in plan(load("crossing"), {**FULL, "plant": plant}).notes if "street" in text]
    assert note.startswith("plant canine: has no parameter street_count, street_north")
    assert note.endswith("; not set; it runs as if there were none of them")


def test_a_mission_parameter_with_another_meaning_is_refused_unless_the_package_binds_it() -> None:
    known = {"start_heading": FULL["plant"].parameters["start_heading"]}
    interface = Interface("x", known, {}, "plant x.fmu", misfits={"start_heading": "plant x.fmu: in deg"})
    with pytest.raises(ScenarioError) as caught:
        plan(Scenario("my"), {"plant": interface})
    assert str(caught.value) == "my: plant x.fmu: in deg"
    bound = {"plant": {"start_heading": 9.0}}
    assert plan(Scenario("my"), {"plant": interface}, bound).values == {"plant": {}}


FENCE = ((-20.0, -21.0), (60.0, -22.0), (61.0, 60.0))


def test_rule_7_a_fence_sets_the_controllers_corners() -> None:
    fenced = plan(replace(load("three_waypoint"), fence=FENCE), FULL).values["controller"]
    corners = [(fenced[f"fence_north[{i}]"], fenced[f"fence_east[{i}]"]) for i in (1, 2, 3)]
    assert (fenced["fence_count"], *corners) == (3, *FENCE)
    without = plan(load("three_waypoint"), FULL).values["controller"]
    assert not any(name.startswith("fence") for name in without)


def test_a_scenarios_own_keys_set_the_mission_within_the_ranges_of_the_blocks() -> None:
    values = plan(replace(load("three_waypoint"), fence=FENCE), FULL).values
    for role, names in MISSION.items():
        assert names <= {n.partition("[")[0] for n in values[role]}
    seed, north = int(Canine.seed.max or 0), Canine.start_north.max
    for text, is_accepted in (
        (f"seed = {seed}", True),
        (f"seed = {seed + 1}", False),
        (f"start = {{ north = {north} }}", True),
        (f"start = {{ north = {north}1 }}", False),
        (f"waypoints = {[[0, 0]] * (Cmec.waypoint_north.size or 0)}", True),
        (f"waypoints = {[[0, 0]] * ((Cmec.waypoint_north.size or 0) + 1)}", False),
    ):
        if is_accepted:
            assert parse(text, "my.toml").name == "scenario"
        else:
            with pytest.raises(ScenarioError):
                parse(text, "my.toml")


def test_parameters_of_the_log_are_those_that_the_components_start_with() -> None:
    # given
    values = plan(parse(WHOLE, "my.toml"), CTS).values
    # when
    logged = values_of(CTS, values)
    # then each parameter of each component has a value, set or declared
    assert len(logged) == sum(len(interface.parameters) for interface in CTS.values())
    assert float(logged["controller.moving_deviation"]) == math.radians(37)
    assert float(logged["controller.capture_radius"]) == 7.0
    assert float(logged["controller.waypoint_north[2]"]) == 25.0
    renamed = Interface(
        "x", {"home_north": variable("m", "home_north"), "hn": variable("m", "hn")}, {}, "x",
        renames={"home_north": Rename("hn", 0.001, mapped=True)},
    )  # fmt: skip
    assert values_of({"controller": renamed}, {"controller": {"hn": 0.5}}) == {
        "controller.home_north": "500.0", "controller.hn": "0.5"
    }  # fmt: skip


def test_a_lost_radio_that_nobody_hears_is_called_a_fault() -> None:
    # given a system whose controller takes no radio
    plants = {"plant": CTS["plant"]}
    scenario = parse('[[fault]]\nsignal = "radio"\nkind = "lost"\nat = 1.0\n', "my.toml")
    with pytest.raises(
        ScenarioError, match=r'^scenario: \[\[fault\]\] lost radio: no block or component "controller"'
    ):
        plan(scenario, plants)
