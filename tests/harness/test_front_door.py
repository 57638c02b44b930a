"""Python's way in: the examples of its docstrings, and that it does what the command does."""

import doctest
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

import harness
from fmus.folder import build_folder
from harness import front_door
from harness.front_door.arguments import named_from_python
from harness.log.log import read_log
from harness.trial import ReadingName
from harness.trial.scenario import ScenarioError
from models.errors import CanineError, UsageError
from models.readings import READINGS
from tests.harness.command import canine
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

PLAN = {"target": "five_buildings", "begin": "home", "end": "goal"}
FINDER = doctest.DocTestFinder(exclude_empty=True)
EXAMPLES = {
    name: test
    for name in harness.__all__
    for test in FINDER.find(getattr(front_door, name), name, module=front_door)
    if test.examples
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_of_a_function_prints_what_it_says(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    failures: list[str] = []
    doctest.DocTestRunner().run(EXAMPLES[name], out=failures.append)
    assert not failures, "".join(failures)


def test_the_example_of_the_page_runs_as_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = (Path(front_door.__file__).parents[1] / "README.md").read_text()
    example, *_ = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    names: dict[str, Any] = {}
    exec(example, names)
    assert names["speed"].max() > 1
    assert 0 <= names["failures"] <= 5
    assert 30 <= names["best"] <= 50


def test_every_function_has_an_example() -> None:
    functions = {name for name in harness.__all__ if not isinstance(getattr(harness, name), type)}
    assert functions == {
        "compare_logs",
        "load_scenario",
        "open_log",
        "recover_log",
        "run_day",
        "run_faults",
        "run_fit",
        "run_plan",
        "run_replay",
        "run_tune",
        "run_study",
        "run_matrix",
        "run_sweep",
        "run_trial",
        "scenarios",
    }
    assert functions <= set(EXAMPLES)


def test_names_of_the_front_door_are_those_of_the_package() -> None:
    assert harness.__all__ == front_door.__all__
    assert set(harness.__all__) <= set(dir(harness))
    with pytest.raises(AttributeError, match="module 'harness' has no attribute 'run_trail'"):
        getattr(harness, "run_trail")  # noqa: B009 - which type checkers refuse


def test_the_names_of_readings_that_options_take_are_those_there_are() -> None:
    assert get_args(ReadingName) == tuple(READINGS)


def test_importing_the_package_imports_no_library() -> None:
    program = "import sys, harness; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    modules = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    imported = set(modules.stdout.split())
    assert "harness" in imported
    assert not imported & {
        "casadi",
        "fmpy",
        "matplotlib",
        "mcap",
        "numpy",
        "pandas",
        "rich",
        "scipy",
        "typer",
    }
    assert not imported & {"codegen", "fmus", "models"}


def test_a_trial_from_python_leaves_the_log_that_the_command_leaves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given
    canine(
        capsys, "run", "two_waypoint", "--seed", 3, "--set", "cmec.moving_deviation=37",
        "--set", "canine.shaking=false", "--out", tmp_path / "command",
    )  # fmt: skip
    # when
    result = harness.run_trial(
        "two_waypoint", seed=3, parameters={"cmec.moving_deviation": 37, "canine.shaking": False},
        out=tmp_path / "python",
    )  # fmt: skip
    # then
    assert result.log_path.read_bytes() == (tmp_path / "command" / "trial.mcap").read_bytes()
    summary = json.loads(result.summary_path.read_text())
    assert dict(result.summary) == summary
    assert (result.outcome, result.time_s) == (summary["outcome"], summary["time_s"])
    assert (result.waypoints_reached, result.anomalies) == (
        summary["waypoints_reached"],
        summary["anomalies"],
    )
    assert result.directional_commands == summary["directional_commands"]
    assert result.position_error_m == summary["position_error_m"]
    assert result.log is result.log
    assert result.picture_path.is_file()
    assert result.page_path.is_file()


def test_a_scenario_of_numpy_numbers_runs_as_the_same_in_plain_ones(tmp_path: Path) -> None:
    # given
    plain = harness.Scenario(
        "numbers", waypoints=[(10.0, 0.0)], duration=2.0,
        parameters={"canine.shaking": False, "sensors.accel_bias": [1.0, 3.0]},
    )  # fmt: skip
    numpy = harness.Scenario(
        "numbers", waypoints=np.array([[10.0, 0.0]]), duration=np.float64(2.0),  # type: ignore[arg-type]
        parameters={"canine.shaking": np.False_, "sensors.accel_bias": np.array([1.0, 3.0])},  # type: ignore[dict-item]
    )  # fmt: skip
    # when
    results = [harness.run_trial(s, out=tmp_path / str(i)) for i, s in enumerate((plain, numpy))]
    # then
    assert results[0].log_path.read_bytes() == results[1].log_path.read_bytes()
    assert results[0].log.parameter("sensors.accel_bias[2]") == 3.0


@pytest.mark.parametrize(
    ("keywords", "error"),
    [
        ({}, "leg: waypoints is []; expected 1 to 16 pairs [north, east] in m"),
        ({"waypoints": [(1,)]}, "leg: waypoints[1] is [1]; expected a pair [north, east] in m"),
        ({"seed": -1}, "leg: seed is -1; expected a whole number from 0 to 2147483647"),
        ({"start": (0.0, 0.0)}, "leg: start is (0.0, 0.0); expected 3 numbers"),
        ({"origin": (1.0,)}, "leg: origin is (1.0,); expected 2 numbers"),
        ({"sets": (("controller.override", "STOP"),)}, "leg: sets is (('controller.override', 'STOP'),)"),
        (
            {"reading": "litteral"},
            'leg: reading is "litteral"; expected one of calibrated, field, guarded, literal',
        ),
        ({"parameters": {"cmec.max_turns": None}}, "cmec.max_turns is None; expected a number, a bool"),
    ],
)
def test_a_scenario_made_in_python_is_checked_like_a_file(keywords: dict[str, object], error: str) -> None:
    scenario = harness.Scenario("leg", **keywords)  # type: ignore[arg-type]
    with pytest.raises(ScenarioError) as caught:
        harness.run_trial(scenario)
    assert str(caught.value).startswith(error)


def test_a_trial_that_does_not_exist_or_does_not_fit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match='there is no scenario "three_waypoints"; did you mean'):
        harness.run_trial("three_waypoints", out=tmp_path)
    with pytest.raises(UsageError, match='cmec has no parameter "max_turn"; did you mean "max_turns"'):
        harness.run_trial("two_waypoint", parameters={"cmec.max_turn": 1}, out=tmp_path)
    with pytest.raises(UsageError, match='there is no estimator "three_stat"; did you mean'):
        harness.run_replay(tmp_path, estimator="three_stat")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("function", "keywords", "error"),
    [
        ("run_trial", {"seed": 2**40}, "seed is 1099511627776; expected a whole number from 0 to 2147483647"),
        ("run_trial", {"seed": -1}, "seed is -1; expected a whole number from 0 to 2147483647"),
        ("run_trial", {"seed": 1.5}, "seed is 1.5; expected a whole number from 0 to 2147483647"),
        ("run_trial", {"order": "x"}, "order is 'x'; expected one of 'sequential', 'jacobi'"),
        ("run_trial", {"fmi": 4}, "fmi is 4; expected one of 2, 3"),
        ("run_trial", {"call_limit": 0}, "call_limit is 0 s; expected a number from 0.1 to 3600 s"),
        ("run_trial", {"memory_limit": "2"}, "memory_limit is '2'; expected a number from 0.5 to 1024 GiB"),
        ("run_trial", {"plant": "x.fmu"}, 'there is no FMU "x.fmu"'),
        (
            "run_trial",
            {"plant": "robot"},
            'there is no plant "robot"; expected the path of an FMU, or the name',
        ),
        ("run_trial", {"parameters": ["a"]}, "parameters is ['a']; expected a mapping"),
        ("run_sweep", {"reading": "x"}, "reading is 'x'; expected one of 'calibrated', 'literal'"),
        ("run_matrix", {"controllers": "cmec"}, "controllers is 'cmec'; expected a list"),
        ("run_sweep", {"trials": "5"}, "trials is '5'; expected a whole number"),
        ("run_sweep", {"thresholds": [20, 30]}, "thresholds is [20, 30]; expected a text"),
        ("run_sweep", {"vary": "x"}, "vary is 'x'; expected a mapping"),
        ("run_sweep", {"seed": 2**40}, "seed is 1099511627776; expected a whole number from 0 to 2147483647"),
        ("run_sweep", {"vary": {"cmec.capture_radius": "x"}}, 'vary cmec.capture_radius=x: "x" is not a'),
        ("run_sweep", {"vary": {"cmec.seed": ""}}, "vary cmec.seed=: expected block.name=a:b:step, as in"),
        ("run_sweep", {"thresholds": "9:8:7:6"}, "thresholds 9:8:7:6: expected a:b:step, as in 15:90:5"),
        ("run_sweep", {"trials": 2**33}, "trials 8589934592: the last would have seed 8589934592, expected"),
        ("run_sweep", {"ahrs": True}, "ahrs: the system cts has no sensors; sweep with system full"),
        ("run_sweep", {"estimator": "six_state"}, "estimator six_state: the system cts gives the"),
        ("run_sweep", {"dask_ca": "a.pem"}, "dask_ca a.pem: needs the cluster's address, dask tls://host:"),
        ("run_matrix", {"dask": "tcp://h:1", "dask_key": "k"}, "dask_key k: tcp://h:1 is not encrypted"),
        (
            "run_sweep",
            {"thresholds": "30", "parameters": {"cmec.moving_deviation": 3}},
            "parameters cmec.moving_deviation=3: the parameter is varied; leave out one of the two",
        ),
        (
            "run_trial",
            {"parameters": {"cmec.max_turns": 3, "controller.max_turns": 4}},
            "parameters controller.max_turns=4: parameters cmec.max_turns=3 is the same parameter; set it",
        ),
        ("run_trial", {"onboard": "pil:host", "loop": "native"}, "onboard pil:host: the processor is called"),
        ("run_study", {"name": "pitch", "seeds": 1}, "seeds 1: expected 2 or more, since a spread is stated"),
        ("run_day", {"missions": 1.5}, "missions is 1.5; expected a whole number"),
        ("run_day", {"rest": "60"}, "rest is '60'; expected a number or a list of them, in s"),
        ("run_day", {"rest": [60, "x"]}, "rest[1] is 'x'; expected a number, in s"),
        ("run_day", {"controllers": "cmec"}, "controllers is 'cmec'; expected a list, [\"cmec\","),
        ("run_day", {"controllers": ["cmic"]}, 'there is no controller "cmic"; expected the path'),
        ("run_day", {"days": 0}, "days is 0; expected a whole number from 1 on"),
        ("run_day", {"missions": None}, "missions is None; expected a whole number from 1 on"),
        ("run_day", {"logs": -1}, "logs is -1; expected a whole number from 0 on"),
        ("run_day", {"days": 10**9}, "days is 1000000000; expected 1 to 100000000"),
        ("run_day", {"rest": []}, "rest is empty; expected at least one"),
        ("run_day", {"rest": -1}, "rest is -1 s; expected 0 to"),
        ("run_day", {"system": "ful"}, "system ful: there is no such system"),
        ("run_day", {"estimator": 5, "system": "full"}, 'there is no estimator "5"'),
        ("run_matrix", {"scenarios": None}, "scenarios is None; expected a list"),
        ("run_matrix", {"plants": []}, "plants is empty; expected one name at least"),
        (
            "run_faults",
            {"scenario": "two_waypoint", "onboard": "x"},
            'onboard "x": expected one of fmu, pil:',
        ),
        ("run_plan", PLAN | {"spacings": 20}, "spacings is 20; expected a list, in m"),
        ("run_plan", PLAN | {"spacings": None}, "spacings is None; expected a list, in m"),
        (
            "run_plan",
            PLAN | {"spacings": [float("nan")]},
            "spacing nan: expected a length of more than d', 7",
        ),
        ("run_plan", PLAN | {"spacings": ["x"]}, "spacings[0] is 'x'; expected a number, in m"),
        ("run_plan", PLAN | {"longest": None}, "longest is None; expected a number"),
        ("run_plan", PLAN | {"longest": float("nan")}, "longest is nan; expected 1 to 10"),
        ("run_plan", PLAN | {"ways": None}, "ways is None; expected a whole number from 1 on"),
        ("run_plan", PLAN | {"origin": 5}, "origin is 5; expected latitude and longitude in deg"),
        ("run_plan", PLAN | {"begin": 3}, 'begin is 3; expected a name, "home", or a pair of numbers'),
        (
            "run_plan",
            PLAN | {"end": "gaol"},
            'end "gaol": expected latitude,longitude in deg, or a named point of',
        ),
        ("run_plan", PLAN | {"clearances": [None]}, "clearances[0] is None; expected a number, in m"),
        ("run_plan", PLAN | {"trials": "5"}, "trials is '5'; expected a whole number"),
        ("run_plan", PLAN | {"longest": "2"}, "longest is '2'; expected a number"),
        ("run_plan", PLAN | {"reading": "calibrated"}, "five_buildings: the reading calibrated counts turns"),
        ("run_fit", {"logs": "nowhere"}, 'there is no log "nowhere"'),
        ("run_fit", {"logs": 5}, "logs is 5; expected a list"),
        (
            "run_fit",
            {"logs": "x", "turned": 0},
            "turned is 0 deg/s; expected a number from 0.001 to 90",
        ),
        ("run_fit", {"logs": "x", "source": "sensors"}, "source is 'sensors'; expected one of 'plant', 'est"),
        (
            "run_fit",
            {"logs": "x", "parameters": {"canine.fatigue_time": 9}},
            "parameters is {'canine.fatigue_time': 9}; expected rest with them",
        ),
        ("run_faults", {"scenario": "x", "at": -1}, "at is -1 s; expected a number from 0 to 86400 s"),
        ("run_tune", {"recording": "x", "estimator": "four"}, 'there is no estimator "four"'),
        ("run_tune", {"recording": "x", "estimator": 5}, "estimator is 5; expected a name"),
        ("run_replay", {"recording": "x", "estimator": 5}, "estimator is 5; expected a text"),
        ("run_tune", {"recording": "x", "hold": "sigma_bias"}, "hold is 'sigma_bias'; expected a list"),
        ("run_replay", {"recording": "x", "outage": -1}, "outage is -1 s; expected a number from 1 to 600 s"),
        ("run_replay", {"recording": "x", "outage": "5"}, "outage is '5'; expected a number from 1"),
        ("run_replay", {"recording": "x", "every": 0}, "every is 0 s; expected a number from 0.25 to 3600 s"),
    ],
)
def test_wrong_arguments_of_the_front_door_are_named(
    function: str, keywords: dict[str, object], error: str, tmp_path: Path
) -> None:
    with pytest.raises(UsageError) as caught:
        getattr(harness, function)(**keywords, out=tmp_path / "out")
    assert str(caught.value).startswith(error)
    assert not (tmp_path / "out").exists()


def test_a_command_in_an_error_from_python_keeps_its_options(tmp_path: Path) -> None:
    # given an FMU in the place of a scenario, whose error names the command for it
    dog = tmp_path / "dog.fmu"
    dog.write_bytes(b"")
    with pytest.raises(UsageError) as caught:
        harness.run_trial(dog, out=tmp_path / "out")
    assert f"`canine run --plant {dog}` puts it into a trial" in str(caught.value)


def test_errors_and_notes_from_python_name_what_the_function_has() -> None:
    # given a function with a note and an error that name options, two of which are arguments of its own
    other = "a--call-limit, `canine run --out x`, /tmp/--out: '--out', --seeds"
    text = f"--call-limit 3: leave --out out, or {other}"

    @named_from_python
    def call(call_limit: float, out: str = "", *, fails: bool = False) -> harness.FitResult:
        if fails:
            raise CanineError(text)
        return harness.FitResult(Path(out), {"notes": [text], "assumes": [text], "logs": [text]}, (text,))

    # then these alone are named as arguments
    expected = f"call_limit 3: leave out out, or {other}"
    assert call(3).notes == (expected,)
    assert call(3).report == {"notes": [expected], "assumes": [expected], "logs": [text]}
    with pytest.raises(CanineError) as caught:
        call(3, fails=True)
    assert caught.value.args == (expected,)


def test_a_day_with_a_wrong_number_of_logs_removes_none(tmp_path: Path) -> None:
    # given a log of an earlier day
    log = tmp_path / "cmec-rest600" / "day-1" / "mission-1" / "trial.mcap"
    log.parent.mkdir(parents=True)
    log.write_bytes(b"an earlier mission")
    # when
    with pytest.raises(UsageError, match="logs is -1"):
        harness.run_day("two_waypoint", missions=1, days=1, logs=-1, out=tmp_path)
    # then
    assert log.read_bytes() == b"an earlier mission"


def test_limits_from_python_end_an_fmu_that_hangs_with_a_summary_up_to_there(tmp_path: Path) -> None:
    # given a dog that hangs on the second tick
    outputs = [V(name) for name in ("north", "east", "speed", "heading")]
    dog = tiny_fmu(tmp_path / "dog.fmu", outputs, "if (t > 0.03) for (volatile int i = 0;; i++) { }")
    # when
    with pytest.raises(harness.EndedByFaultError, match=r"did not come back within 0\.3 s") as caught:
        harness.run_trial("two_waypoint", plant=dog, call_limit=0.3, out=tmp_path / "out")
    # then
    assert caught.value.summary["ticks"] == 2
    assert caught.value.summary == json.loads((tmp_path / "out" / "summary.json").read_text())


def test_a_log_shows_itself_in_one_line(tmp_path: Path) -> None:
    log = harness.run_trial("two_waypoint", out=tmp_path).log
    assert repr(log) == (
        f"Log({str(tmp_path / 'trial.mcap')!r}, {len(log.time)} ticks of sensors, estimator, controller, "
        "command_module, plant)"
    )


def test_a_sweep_from_python_has_the_rows_of_its_file(tmp_path: Path) -> None:
    # when, with a dog that never obeys a LEFT or RIGHT
    disobedient = {"canine.right_success": 0.0, "canine.left_success": 0.0}
    sweep = harness.run_sweep(
        "three", vary={"cmec.capture_radius": "5:7:2"}, trials=8, parameters=disobedient, out=tmp_path
    )
    # then
    assert [row["cmec.capture_radius"] for row in sweep.rows] == [5.0, 7.0]
    assert [(row["successes"], row["mean_time_s"]) for row in sweep.rows] == [(0.0, None)] * 2
    assert json.loads(sweep.recommendation_path.read_text()) == sweep.recommendation
    assert len(sweep.table_path.read_text().splitlines()) == 3
    assert sweep.picture_path.is_file()


def test_a_day_from_python_has_the_rows_of_its_command_and_logs_that_a_fit_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given days by the command
    options = ("--missions", 3, "--rest", "60,600", "--days", 20, "--reading", "field", "--seed", 4)
    setting = ("--set", "canine.fatigue_slows=0.5")
    canine(capsys, "day", "two_waypoint", *options, *setting, "--out", tmp_path / "command")
    # when
    done: list[float] = []
    day = harness.run_day(
        "two_waypoint", missions=3, rest=(60, 600.0), days=20, reading="field", seed=4,
        parameters={"canine.fatigue_slows": 0.5}, logs=1, out=tmp_path / "python", progress=done.append,
    )  # fmt: skip
    # then
    for name in ("day.csv", "day.json"):
        assert (day.folder / name).read_bytes() == (tmp_path / "command" / name).read_bytes()
    assert json.loads(day.report_path.read_text()) == day.report
    assert [row["mission"] for row in day.rows] == [1, 2, 3, 1, 2, 3]
    assert any("are assumed" in note for note in day.notes)
    assert max(done) == 2 * 3 * 20
    assert all(path.is_file() for path in (day.table_path, day.page_path, day.picture_path))
    # and its logs are a day
    logged = day.folder / "cmec-rest60" / "day-1"
    fit = harness.run_fit(logged, rest=60, parameters={"canine.fatigue_time": 3600}, out=tmp_path / "fit")
    assert fit.report["day"]["missions"] == 3
    assert fit.report["day"]["given"]["fatigue_time"] == 3600
    assert set(fit.effects) == {
        "fatigue_slows", "fatigue_delays", "fatigue_disobeys", "habituation_gain"
    }  # fmt: skip


def test_a_fit_from_python_has_the_files_of_its_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a trial with a turn
    log = harness.run_trial("right_90", out=tmp_path / "trial").log_path
    canine(capsys, "fit", log, "--source", "estimator", "--turned", 8, "--out", tmp_path / "command")
    # when
    read: list[int] = []
    fit = harness.run_fit([log], source="estimator", turned=8, out=tmp_path / "python", progress=read.append)
    # then
    for name in ("fit.json", "fit.toml"):
        assert (fit.folder / name).read_bytes() == (tmp_path / "command" / name).read_bytes()
    assert json.loads(fit.report_path.read_text())["parameters"] == fit.parameters
    assert fit.responses["right_success"]["n"] >= 1
    assert fit.effects == {}
    assert read == [1]
    assert all(path.is_file() for path in (fit.parameters_path, fit.page_path, fit.picture_path))


def test_a_plan_from_python_takes_a_scenario_and_places_by_numbers(tmp_path: Path) -> None:
    # given a dog that drifts to the left, and 120 m of open ground beside a hut on a map in metres
    corners = [[40, 0], [50, 0], [50, 9], [40, 9], [40, 0]]
    hut = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [corners]}}
    yard = tmp_path / "yard.geojson"
    yard.write_text(json.dumps({"type": "FeatureCollection", "units": "metres", "features": [hut]}))
    dog = harness.Scenario("left", waypoints=[(9.0, 0.0)], parameters={"canine.drift": -2.0}, reading="field")
    # when
    shares: list[float] = []
    plan = harness.run_plan(
        yard, (0, 0), (120, 0), along="open", clearances=[3], spacings=[None, 30], scenario=dog, trials=512,
        seed=7, out=tmp_path / "plan", progress=shares.append,
    )  # fmt: skip
    # then
    assert json.loads(plan.report_path.read_text()) | {"assumes": plan.assumes} == plan.report
    assert plan.report["parameters"] == {"canine.drift": -2.0}
    assert plan.report["seed"] == 7
    assert any("and give scenario or parameters" in text for text in plan.assumes)
    recommended = plan.recommended
    assert recommended
    assert recommended["waypoints"] == [[30, 0], [60, 0], [90, 0], [120, 0]]
    assert plan.shortest["waypoints"] == [[120, 0]]
    assert shares == [1.0]
    assert plan.picture_path.is_file()
    assert harness.load_scenario(plan.scenario_path).parameters == {"canine.drift": -2.0}
    # and without the place of the map on the earth there is no mission
    assert not plan.mission_path.exists()
    assert any("no mission is written" in note for note in plan.notes)


def test_faults_from_python_have_the_files_of_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a scenario with two faults of its own
    own = tmp_path / "mine.toml"
    own.write_text(
        'waypoints = [[20, 0]]\n[[fault]]\nsignal = "radio"\nkind = "lost"\nat = 2\nuntil = 4\n'
        '[[fault]]\nsignal = "sensors.gps_north"\nkind = "offset"\nat = 2\nvalue = 5.0\n'
    )
    canine(capsys, "faults", own, "--seed", 2, "--out", tmp_path / "command")
    # when
    done: list[float] = []
    faults = harness.run_faults(own, seed=2, out=tmp_path / "python", progress=done.append)
    # then
    assert faults.report_path.read_bytes() == (tmp_path / "command" / "faults.json").read_bytes()
    assert faults.table_path.is_file()
    assert [row["fault"] for row in faults.rows][:2] == ["no fault", "lost radio"]
    assert faults.rows[1]["verdict"] == "stopped"
    assert done == [1, 2, 3]


def test_a_tuning_from_python_has_the_files_of_its_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = harness.run_trial("three_waypoint", out=tmp_path / "trial").log_path
    canine(capsys, "tune", log, "--hold", "sigma_bias", "--out", tmp_path / "command")
    tuned = harness.run_tune(log, hold=["sigma_bias"], out=tmp_path / "python")
    for name in ("tune.json", "tune.toml"):
        assert (tuned.folder / name).read_bytes() == (tmp_path / "command" / name).read_bytes()
    assert tuned.noises == json.loads(tuned.report_path.read_text())["noises"]
    assert all(path.is_file() for path in (tuned.parameters_path, tuned.page_path, tuned.picture_path))


def test_progress_and_notes_come_back_to_the_caller(tmp_path: Path) -> None:
    # given the first nine tenths of a log
    whole = harness.run_trial("two_waypoint", out=tmp_path / "whole").log_path.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 9 // 10])
    assert "the file ends early" in read_log(cut).broken
    # when
    times: list[float] = []
    result = harness.run_trial(cut, out=tmp_path / "again", progress=times.append)
    # then
    assert len(result.notes) == 1
    assert result.notes[0].startswith(f"{cut}: the log is not whole, the file ends early")
    assert times == sorted(times)
    assert times[-1] == pytest.approx(result.log.time[-1], abs=1.0)


def test_an_estimator_made_elsewhere_takes_the_place_of_ours(tmp_path: Path) -> None:
    # given our own estimator's FMI 3.0 FMU, from a file
    own = harness.run_trial("two_waypoint", out=tmp_path / "own")
    swapped = harness.run_trial(
        "two_waypoint", estimator=build_folder() / "fmi3" / "four_state.fmu", out=tmp_path / "swapped"
    )
    # then
    assert (own.log["estimator.north"] == swapped.log["estimator.north"]).all()
    assert swapped.log.metadata["swaps"] == {"estimator": "estimator.fmu"}


def test_other_blocks_of_ours_take_a_place_by_name(tmp_path: Path) -> None:
    # given the straight way, along which nobody needs a turn
    result = harness.run_trial(
        "two_waypoint", controller="quarter_turn", plant="differential_drive", fmi=3, out=tmp_path,
        parameters={"quarter_turn.turn_deviation": 80, "differential_drive.wheel_slip_deviation": 0},
    )  # fmt: skip
    # then the robot goes there and back, by its own drive: 1.5 m/s less 5 % slip
    assert result.outcome == "success"
    assert result.log["plant.speed"].max() == pytest.approx(1.425)
    assert result.log.metadata["roles"]["controller"] == "quarter_turn"
    # and its log runs again
    again = harness.run_trial(tmp_path / "trial.mcap", out=tmp_path / "again")
    assert (again.log["controller.command"] == result.log["controller.command"]).all()


def test_a_log_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(CanineError, match=r"nowhere\.mcap: cannot be read"):
        harness.open_log(tmp_path / "nowhere.mcap")
