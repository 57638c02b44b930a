"""Scenarios as written: what a file may hold, and what is refused by which key."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from harness.sweep.components import find_components
from harness.trial.plan import interfaces_of_system, plan
from harness.trial.scenario import (
    FAULTS,
    Disturbance,
    Scenario,
    ScenarioError,
    Setting,
    Street,
    about,
    checked,
    load,
    parse,
    shipped,
    toml_of,
)
from models.canine import Canine
from models.streets import CanineInStreets
from tests.harness.trial.whole_scenario import WHOLE


def test_every_key_of_a_file_is_read() -> None:
    scenario = parse(WHOLE, "my.toml", "my")
    assert (scenario.name, scenario.system, scenario.reading, scenario.seed) == ("my", "cts", "literal", 7)
    assert scenario.duration == 60.0
    assert scenario.waypoints == ((25.0, 0.0), (25.0, -12.5))
    assert scenario.origin == (32.5, -85.25)
    assert scenario.start == (1.0, 2.0, 90.0)
    assert scenario.faults == (
        Disturbance("plant.heading", "offset", 10.0, 12.0, 5.0),
        Disturbance("radio", "lost", 20.0),
    )


def test_the_text_of_a_scenario_reads_back_to_the_same_scenario() -> None:
    scenario = parse(WHOLE, "my.toml", 'a "name"').override(['cmec.override="a\\n"'])
    assert parse(scenario.text(), "text") == scenario
    assert parse(scenario.text(), "text").text() == scenario.text()


def test_settings_of_the_command_line_win_over_those_of_the_file() -> None:
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
        ("duration = nan", "my.toml: duration is nan; expected a number from 0 to 86400 s"),
        ("system = 3", "my.toml: system is 3; expected a text"),
        ('system = "ful"', 'my.toml: system is "ful"; expected the path of an .ssp, or did you mean "full"?'),
        (
            'reading = "litteral"',
            'my.toml: reading is "litteral"; expected one of calibrated, field, guarded, '
            'literal; did you mean "literal"?',
        ),
        (
            "waypoints = [[1, 2], [1, 2, 3]]",
            "my.toml: waypoints[2] is [1, 2, 3]; expected a pair [north, east] in m, each from "
            "-100000 to 100000",
        ),
        (
            f"waypoints = {[[1, 2]] * 17}",
            "my.toml: waypoints has 17 elements; expected up to 16 pairs [north, east] in m, each "
            "within 100000",
        ),
        (
            "fence = [[0, 0], [0, 9]]",
            "my.toml: fence is no polygon: it has 2 corners, expected 3 to 7; list its corners one after "
            "another around it",
        ),
        (
            "fence = [[0, 0], [9, 9], [9, 0], [0, 12]]",
            "my.toml: fence is no polygon: its edges from corner 1 and from corner 3 cross or touch; list "
            "its corners one after another around it",
        ),
        (
            "fence = [[0, 0], [0, 2e5], [9, 0]]",
            "my.toml: fence[2] is [0, 200000.0]; expected a pair [north, east] in m, each from -100000 "
            "to 100000",
        ),
        (
            f"fence = {[[k, k * k] for k in range(8)]}",
            "my.toml: fence has 8 elements; expected up to 7 pairs [north, east] in m, each within 100000",
        ),
        (
            "seed = 1\nwaypoints = [[1, 2]\n[start]",
            "my.toml: line 3 is `[start]` (Unclosed array); expected a ] at the end of each list",
        ),
        (
            "waypoints = [[1, 2]",
            "my.toml: line 1 is `waypoints = [[1, 2]` (Unclosed array); expected a ] at the end of each list",
        ),
        (
            "seed =  # none",
            "my.toml: line 1 is `seed =  # none` (Invalid value); expected a number, true, false, a text in "
            'quotes ("STOP") or a list ([35.73, 0.0])',
        ),
        (
            "\nreading: literal",
            "my.toml: line 2 is `reading: literal` (Expected '=' after a key in a key/value pair); expected "
            "key = value; a key with a dot stands in quotes",
        ),
        (
            "seed = 1\nseed = 2",
            "my.toml: line 2 is `seed = 2` (Cannot overwrite a value); expected each key once",
        ),
        ("[start", "my.toml: line 1 is `[start`: expected ']' at the end of a table declaration"),
        ("[start]\nnort = 1", 'my.toml: [start]: unknown key "nort"; did you mean "north"?'),
        (
            "[origin]\nlatitude = 91",
            "my.toml: [origin]: latitude is 91; expected a number from -90 to 90 deg",
        ),
        (
            "[[street]]\nto = [9, 0]",
            'my.toml: [[street]] 1: lacks "from", one end of the street\'s middle, [north, east] in m',
        ),
        (
            "[[street]]\nfrom = [0, 0]\nto = [9, 0]",
            'my.toml: [[street]] 1: lacks "half_width", from the street\'s middle to its wall, in m',
        ),
        (
            "[[street]]\nfrom = [0, 0]\nto = [9, 0]\nwidth = 3",
            'my.toml: [[street]] 1: lacks "half_width", from the street\'s middle to its wall, in m; it has '
            '"width"',
        ),
        (
            "[[street]]\nfrom = [0, 0]\nto = [9]\nhalf_width = 1",
            "my.toml: [[street]] 1: to is [9]; expected a pair "
            "[north, east] in m, each from -100000 to 100000",
        ),
        (
            "[[street]]\nfrom = [0, 0]\nto = [0, 0]\nhalf_width = 1",
            "my.toml: [[street]] 1: to is where from is, [0.0, 0.0]; expected another place",
        ),
        (
            "[[street]]\nfrom = [0, 0]\nto = [9, 0]\nhalf_width = 0",
            "my.toml: [[street]] 1: half_width is 0; expected a number from 0.1 to 1000 m",
        ),
        (
            "[[street]]\nfrom = [0, 0]\nto = [9, 0]\nhalf_width = 1\nwidth = 2",
            'my.toml: [[street]] 1: unknown key "width"; did you mean "half_width"?',
        ),
        ("[[street]]\n" * 17, "my.toml: there are 17 [[street]]; expected up to 16"),
        (
            "[[pole]]\nat = [0, inf]",
            "my.toml: [[pole]] 1: at is [0, inf]; expected a pair [north, east] in m, each from "
            "-100000 to 100000",
        ),
        ("[[pole]]\nat = [0, 0]\n" * 9, "my.toml: there are 9 [[pole]]; expected up to 8"),
        ('[[set]]\n"a.b" = 1', 'my.toml: [[set]] 1: lacks "at", the time in s'),
        ("[[set]]\nat = 1", 'my.toml: [[set]] 1: sets nothing; expected "component.input" = value'),
        ("[[set]]\nat = 2\nuntil = 1", "my.toml: [[set]] 1: until is 1; expected a number from 2 to 86400 s"),
        (
            '[[fault]]\nsignal = "a.b"\nat = 1',
            f'my.toml: [[fault]] 1: lacks "kind", one of {", ".join(FAULTS)}',
        ),
        (
            '[[fault]]\nsignal = "a.b"\nkind = "of"\nat = 1',
            f'my.toml: [[fault]] 1: kind is "of"; expected one of {", ".join(sorted(FAULTS))}; '
            'did you mean "off"?',
        ),
        (
            '[[fault]]\nkind = "off"\nat = 1',
            'my.toml: [[fault]] 1: lacks "signal", what it disturbs: "component.output"',
        ),
        ('[[fault]]\nkind = "off"\nsignal = "a.b"', 'my.toml: [[fault]] 1: lacks "at", the time in s'),
        (
            '[[fault]]\nkind = "off"\nsignal = "a.b"\nat = 1\nvalue = 2',
            'my.toml: [[fault]] 1: value is 2; the kind "off" takes none',
        ),
        (
            '[[fault]]\nkind = "scale"\nsignal = "a.b"\nat = 1',
            'my.toml: [[fault]] 1: lacks "value", the factor',
        ),
        (
            '[[fault]]\nkind = "dropouts"\nsignal = "a.b"\nat = 1\nvalue = 1.5',
            "my.toml: [[fault]] 1: value is 1.5; expected a number from 0 to 1: the share of samples that "
            "are lost",
        ),
        (
            '[[fault]]\nkind = "noise"\nsignal = "a.b"\nat = 1\nvalue = -1',
            "my.toml: [[fault]] 1: value is -1; expected a number from 0: the standard deviation, in "
            "the signal's unit",
        ),
        (
            '[[fault]]\nkind = "offset"\nsignal = "a.b"\nat = 1\nvalue = inf',
            "my.toml: [[fault]] 1: value is inf; expected a number: what is added, in the signal's unit",
        ),
        (
            '[[fault]]\nkind = "jump"\nsignal = "a.b"\nat = 1\nvalue = 2',
            'my.toml: [[fault]] 1: lacks "until", the time in s: the jump fades until then',
        ),
        (
            '[[fault]]\nkind = "off"\nsignal = "a.b"\nat = 1\nuntl = 2',
            'my.toml: [[fault]] 1: unknown key "untl"; did you mean "until"?',
        ),
        (
            "[parameters]\ncmec.moving_deviation = 1",
            "my.toml: [parameters]: cmec is {'moving_deviation': 1}; "
            'expected a value; a key with a dot is quoted: "block.name" = value',
        ),
    ],
)
def test_a_file_is_refused_by_the_key_that_is_wrong(text: str, error: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        parse(text, "my.toml")
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
    assert len(shipped()) == 15


def test_a_scenario_that_does_not_exist_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(ScenarioError) as caught:
        load("three_waypoints")
    assert str(caught.value) == 'there is no scenario "three_waypoints"; did you mean "three_waypoint"?'


def test_a_target_that_is_no_scenario_is_refused_with_what_to_type(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a folder with a scenario, a log in a folder, an FMU, and bytes
    monkeypatch.chdir(tmp_path)
    Path("base.toml").write_text("waypoints = [[25, 0]]")
    Path("out/demo").mkdir(parents=True)
    Path("out/demo/trial.mcap").touch()
    Path("dog.fmu").touch()
    Path("bytes").write_bytes(b"a = 1\xff")
    expected = "a scenario (.toml), a package (.ssp) or a log (.mcap)"
    for target, error in (
        ("nothere.toml", 'there is no file "nothere.toml"; did you mean "base.toml"?'),
        ("none/base.toml", 'there is no file "none/base.toml"; there is no folder "none"'),
        ("two_waypoint.toml", 'there is no file "two_waypoint.toml"; did you mean "two_waypoint"?'),
        ("base", 'there is no scenario "base"; did you mean "base.toml"?'),
        ("out/demo", f'out/demo: is a folder; expected {expected}; did you mean "out/demo/trial.mcap"?'),
        ("out", f"out: is a folder; expected {expected}"),
        (".", f'.: is a folder; expected {expected}; did you mean "base.toml"?'),
        (
            "dog.fmu",
            f"dog.fmu: is an FMU; expected {expected}: `canine run --plant dog.fmu` puts it into a trial, "
            "`canine check dog.fmu` looks at it",
        ),
        (
            "out/demo/trial.mcap",
            "out/demo/trial.mcap: is a log; expected a scenario (.toml) or the name of a shipped one; "
            "`canine run out/demo/trial.mcap` runs it",
        ),
        ("bytes", "bytes: line 1: byte 0xff is not UTF-8; save the file as UTF-8"),
    ):
        with pytest.raises(ScenarioError) as caught:
            load(target)
        assert str(caught.value) == error
    with pytest.raises(ScenarioError, match=r'there is no scenario "a{300}"; known: '):
        load("a" * 300)
    with pytest.raises(ScenarioError, match=r'there is no scenario "four"; known: .*, three, .*, two, '):
        load("four", known=("two", "three"))


def test_a_setting_given_twice_is_refused_under_either_of_its_names() -> None:
    for second in ("cmec.max_turns=2", " controller.max_turns = 2"):
        with pytest.raises(ScenarioError) as caught:
            Scenario("my").override(["cmec.max_turns=1", "cmec.dead_time=2", second])
        assert str(caught.value) == (
            f"--set {second}: --set cmec.max_turns=1 is the same parameter; set it once"
        )


def test_a_setting_replaces_the_files_under_either_of_its_names() -> None:
    for written in ("cmec.max_turns", "controller.max_turns"):
        scenario = Scenario("my", parameters={written: 3}).override(["cmec.max_turns=1"])
        assert scenario.parameters == {"cmec.max_turns": 1}


def test_a_scenario_without_waypoints_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "nowhere.toml"
    path.write_text("seed = 1\n")
    with pytest.raises(ScenarioError, match=r"nowhere.toml: waypoints is \[\]; expected 1 to 16 pairs"):
        load(str(path))
    assert load(str(path), mission=False).waypoints == ()


def test_a_setting_without_a_value_is_refused() -> None:
    for setting in ("cmec", "cmec=", "=3"):
        with pytest.raises(ScenarioError, match=f"--set {setting}: expected block.name=value, as in"):
            Scenario("my").override([setting])


def test_a_scenario_made_in_python_is_checked_and_completed_like_a_file() -> None:
    # given lists and whole numbers, as Python's users write them
    scenario = Scenario(
        "mine", waypoints=[(25, 0), (25, -3)], duration=60, folder=Path("here"),
        sets=(Setting("controller.override", "STOP", 1, 2),),
    )  # fmt: skip
    # when
    result = checked(scenario)
    # then
    assert (result.waypoints, result.folder) == (((25.0, 0.0), (25.0, -3.0)), Path("here"))
    assert isinstance(result.duration, float)
    assert result.sets == (Setting("controller.override", "STOP", 1.0, 2.0),)
    with pytest.raises(ScenarioError, match=r"mine: waypoints is \[\]; expected 1 to 16 pairs"):
        checked(Scenario("mine"))
    with pytest.raises(ScenarioError, match=r"cmec\.max_turns is None; expected a number, a bool"):
        checked(Scenario("mine", parameters={"cmec.max_turns": None}))  # type: ignore[dict-item]


def test_rule_7_a_fence_is_read_and_written() -> None:
    text = "waypoints = [[25, 0]]\nfence = [[-9, -9], [40, -9], [40, 9]]"
    scenario = parse(text, "my.toml")
    assert scenario.fence == ((-9.0, -9.0), (40.0, -9.0), (40.0, 9.0))
    assert parse(scenario.text(), "again").fence == scenario.fence
    assert "fence" not in replace(scenario, fence=()).text()
    with pytest.raises(ScenarioError, match="mine: fence is no polygon: its corners lie on one line"):
        checked(Scenario("mine", waypoints=[(25, 0)], fence=[(0, 0), (1, 1), (2, 2)]))


def test_streets_and_poles_are_read_and_written_and_choose_the_dog_in_them() -> None:
    text = (
        "waypoints = [[25, 0]]\n[[street]]\nfrom = [0, 0]\nto = [50, 1.5]\nhalf_width = 2\n"
        "[[pole]]\nat = [25, 0]\n[[pole]]\nat = [9, -9]\n"
    )
    scenario = parse(text, "my.toml")
    assert scenario.streets == (Street((0.0, 0.0), (50.0, 1.5), 2.0),)
    assert scenario.poles == ((25.0, 0.0), (9.0, -9.0))
    assert parse(scenario.text(), "again", "my") == replace(scenario, name="scenario")
    # either makes the plant the dog in streets, whose parameters have the dog's addresses too
    for one in (scenario, replace(scenario, streets=()), replace(scenario, poles=())):
        assert one.own_system is not None
        assert one.own_system.components["plant"] is CanineInStreets
    own = scenario.override(["canine.drift=1"]).override(["canine_in_streets.drift=2"])
    assert own.parameters == {"canine_in_streets.drift": 2}
    assert own.own_system is not None
    values = plan(own, interfaces_of_system(own.own_system)).values["plant"]
    assert values["drift"] == pytest.approx(math.radians(2))
    expected = {
        "street_count": 1,
        "street_end_north[1]": 50,
        "street_end_east[1]": 1.5,
        "street_half_width[1]": 2,
    }
    expected |= {"pole_count": 2, "pole_north[1]": 25, "pole_north[2]": 9, "pole_east[2]": -9}
    assert expected.items() <= values.items()
    plain = replace(scenario, streets=(), poles=())
    assert plain.own_system is not None
    assert plain.own_system.components["plant"] is Canine
    assert not [
        name
        for name in plan(plain, interfaces_of_system(plain.own_system)).values["plant"]
        if "street" in name
    ]


def test_what_no_street_leads_to_is_noted() -> None:
    street = Street((0, 0), (50, 0), 1)
    scenario = Scenario("mine", waypoints=[(25, 7.9), (40, 8.1)], start=(0, -3, 0), streets=(street,))
    assert scenario.own_system is not None
    notes = plan(scenario, interfaces_of_system(scenario.own_system)).notes
    assert [note for note in notes if "street" in note] == [
        "the start is 2 m outside of all streets, which hold the animal once it enters one",
        "waypoint 2 is 7.1 m outside of all streets, beyond cmec.capture_radius = 7 m: it cannot be reached "
        "from them",
    ]
    # and another controller's d' counts as well
    led = find_components(controller="quarter_turn").system(scenario)
    near = scenario.override(["quarter_turn.capture_radius=5"])
    assert [note[:57] for note in plan(near, interfaces_of_system(led)).notes if "waypoint" in note] == [
        "waypoint 1 is 6.9 m outside of all streets, beyond quarte",
        "waypoint 2 is 7.1 m outside of all streets, beyond quarte",
    ]


def test_a_scenario_that_runs_a_package_needs_no_waypoints() -> None:
    scenario = Scenario("mine", system="toy.ssp", folder=Path("there"))
    assert checked(scenario).package == Path("there/toy.ssp")


def test_values_are_spelled_as_toml_reads_them() -> None:
    for value, text in (
        (True, "true"), (3, "3"), (0.1, "0.1"), ([1, [2.5]], "[1, [2.5]]"), ((False,), "[false]"),
        ('a "b" \\', '"a \\"b\\" \\\\"'), ("\n\t\U0001f415", '"\\U0000000a\\U00000009\U0001f415"'),
    ):  # fmt: skip
        assert toml_of(value) == text
        assert parse(f"[parameters]\nx = {text}", "my.toml").parameters["x"] == (
            list(value) if isinstance(value, tuple) else value
        )


def test_each_shipped_scenario_is_described_by_one_sentence() -> None:
    for name in shipped():
        assert 20 < len(about(name)) < 140
        assert "#" not in about(name)


def test_a_setting_with_a_line_break_is_kept_whole_and_so_no_number() -> None:
    scenario = load("three_waypoint").override(["cmec.dead_time=2\nmax_turns=9"])
    assert scenario.parameters["cmec.dead_time"] == "2\nmax_turns=9"
