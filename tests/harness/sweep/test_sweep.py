"""`canine sweep`: its options, its table, its errors, and the files that it leaves."""

from __future__ import annotations

import csv
import json
import math
import os
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from matplotlib.image import imread
from scipy.stats import binomtest

from harness.sweep import chunks, journal, sweep
from harness.sweep.axis import SweepError
from harness.sweep.sweep import plan_sweep
from harness.sweep.table import wilson
from models.commands import Status
from models.errors import UsageError
from models.kit.units import DEG
from tests.harness import command
from tests.harness.sweep.runner import Runner, Trial, dog, install

HEADER = (
    "trials,successes,success_rate,ci_low,ci_high,mean_time_s,sd_time_s,mean_commands,timeouts,"
    "forward_failure,turn_failure,direction_switch,no_command,trial_failure,lost_link,invalid_estimate,"
    "bad_input,budget_spent,no_progress,departing,time_out,outside_fence"
)


@pytest.fixture
def runner(monkeypatch: pytest.MonkeyPatch) -> Runner:
    """Trials with known results, without compiling."""
    return install(monkeypatch, Runner(dog))


def canine(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Exit status, standard output and error of `canine sweep`."""
    return command.canine(capsys, "sweep", *arguments)


# options


def test_sweep_two_runs_the_texts_two_waypoint_trials() -> None:
    planned = plan_sweep("two")
    assert planned.job.trials == 1000
    assert [math.degrees(p[0]) for p in planned.job.points] == pytest.approx(range(15, 91))
    assert planned.job.varied == ("controller.moving_deviation",)
    (trial_type,) = planned.job.trial_types
    assert trial_type.values["controller"]["waypoint_north[1]"] == 25.0
    assert trial_type.values["controller"]["turn_end_deviation"] == 5 * DEG  # calibrated
    assert trial_type.values["plant"]["start_heading_deviation"] == 10 * DEG
    assert trial_type.ticks == 7500  # 300 s at 25 Hz
    assert (planned.job.system, planned.job.seed) == ("cts", 1)


def test_sweep_three_runs_four_types_of_trials_in_turns() -> None:
    planned = plan_sweep("three", reading="literal")
    assert [trial_type.name for trial_type in planned.job.trial_types] == [
        "right_90",
        "left_90",
        "right_45",
        "left_45",
    ]
    assert [math.degrees(p[0]) for p in planned.job.points] == pytest.approx(range(15, 66))
    east = [trial_type.values["controller"]["waypoint_east[2]"] for trial_type in planned.job.trial_types]
    assert east == [35.73, -35.73, 22.4224, -22.4224]
    assert {c.values["controller"]["turn_end_deviation"] for c in planned.job.trial_types} == {20 * DEG}


def test_a_scenario_is_swept_with_all_its_settings(tmp_path: Path) -> None:
    # given
    file = tmp_path / "meadow.toml"
    file.write_text(
        'system = "full"\nreading = "literal"\nseed = 7\nduration = 60\n'
        "waypoints = [[20, 5], [0, 9]]\nstart = { north = 1, heading = 90 }\n"
        '[parameters]\n"canine.drift" = 2\n'
        '[[set]]\nat = 1.01\nuntil = 2\n"controller.override" = "STOP"\n'
    )
    # when
    planned = plan_sweep(str(file), settings=["canine.left_success=0.5"])
    # then
    assert (planned.name, planned.reading, planned.job.seed, planned.job.system) == (
        "meadow",
        "literal",
        7,
        "cts",
    )
    (trial_type,) = planned.job.trial_types
    assert trial_type.values["plant"]["drift"] == pytest.approx(2 * DEG)
    assert trial_type.values["plant"]["left_success"] == 0.5
    assert trial_type.values["plant"]["start_north"] == 1.0
    assert trial_type.values["plant"]["start_heading"] == pytest.approx(math.pi / 2)
    assert trial_type.ticks == 1500
    # from the first tick at or after 1.01 s = 25.25 ticks on, until 2 s = 50 ticks
    assert [(c.tick, c.component, c.variable, c.value) for c in trial_type.changes] == [
        (26, "controller", "override", 2.0),
        (50, "controller", "override", 0.0),
    ]
    # and with more than one waypoint the thresholds are those of 5.3.6
    assert len(planned.job.points) == 51


def test_any_parameter_can_be_varied_in_users_units() -> None:
    planned = plan_sweep("two", vary=["canine.drift=-0.2:0.2:0.1", "cmec.max_turns=1:3:1"])
    assert planned.job.varied == ("plant.drift", "controller.max_turns")
    assert planned.points[0] == planned.points[0]
    assert [[float(v) for v in p] for p in planned.points[:4]] == [[-0.2, 1], [-0.2, 2], [-0.2, 3], [-0.1, 1]]
    assert planned.job.points[0] == pytest.approx((-0.2 * DEG, 1.0))
    assert len(planned.job.points) == 15
    # a switch is varied from 0 to 1, an element of a vector by its name
    assert plan_sweep("two", vary=["cmec.reset_turns=0:1:1"]).job.points == ((0.0,), (1.0,))
    assert plan_sweep("two", vary=["controller.waypoint_north[1]=20:30:5"]).job.points == (
        (20.0,),
        (25.0,),
        (30.0,),
    )


@pytest.mark.parametrize(
    ("target", "plant", "vary"),
    [
        ("three", None, "cmec.drift=0:4:2"),
        ("three", None, "cmec.drift_sd=0:2:1"),
        ("three", None, "cmec.drift_persistence=0:1:0.5"),
        ("three", None, "cmec.response_time=0:0.4:0.2"),
        ("three", None, "cmec.response_sd=0:0.2:0.1"),
        ("three", None, "cmec.braking=0:4:2"),
        ("three", None, "canine.cruise_speed_deviation=0:2:1"),
        ("three", "canine_all_day", "canine.habituation_gain=0:0.4:0.2"),
        ("three", "canine_all_day", "canine.start_fatigue=0:1:0.5"),
        ("crossing", None, "canine.street_half_width[1]=1:2:0.5"),
        ("downtown_two", None, "canine.pole_range=0:50:25"),
    ],
)
def test_what_a_controller_aims_by_and_what_a_dog_meets_can_be_varied(
    target: str, plant: str | None, vary: str
) -> None:
    planned = plan_sweep(target, vary=[vary], plant=plant, reading="field")
    assert len(planned.job.points) == 3


def test_thresholds_are_varied_beside_another_parameter_in_any_steps() -> None:
    planned = plan_sweep("two", thresholds="20:21:0.25", vary=["cmec.capture_radius=5:7:1"])
    assert [axis.column for axis in planned.axes] == ["threshold_deg", "cmec.capture_radius"]
    assert [len(axis.values) for axis in planned.axes] == [5, 3]
    assert plan_sweep("two", vary=["controller.moving_deviation=20:40:5"]).axes[0].column == "threshold_deg"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"thresholds": "30:40:5:1"}, "--thresholds 30:40:5:1: expected a:b:step, as in 15:90:5"),
        ({"thresholds": "30:20"}, "--thresholds 30:20: the range is empty, 30 is more than 20"),
        ({"thresholds": "20:30:0"}, "--thresholds 20:30:0: the step is 0; expected more than 0"),
        ({"thresholds": "20:30:-1"}, "the step is -1"),
        ({"thresholds": "a:30"}, '--thresholds a:30: "a" is not a number'),
        ({"thresholds": "nan:30"}, '"nan" is not a number'),
        ({"thresholds": "1:inf"}, '"inf" is not a number'),
        ({"thresholds": "1:1e99"}, '"1e99" is not a number'),
        ({"thresholds": "0:200:0.001"}, "has more than 10000 points; take larger steps"),
        (
            {"thresholds": "15:300"},
            "--thresholds 15:300: its end is 300; expected a number from 0 up to 229.1 deg",
        ),
        ({"thresholds": "-1:20"}, "--thresholds -1:20: its start is -1; expected a number from 0"),
        ({"vary": ["cmec.moving_deviatoin=1:2:1"]}, 'no parameter "moving_deviatoin"; did you mean "moving'),
        ({"vary": ["cmce.drift=1:2:1"]}, 'no block or component "cmce"; did you mean "cmec"?'),
        ({"vary": ["cmec.drift"]}, "--vary cmec.drift: expected block.name=a:b:step"),
        ({"vary": ["cmec.waypoint_north=1:2:1"]}, "is a vector; vary one element, as in cmec.waypoint_n"),
        ({"vary": ["cmec.max_turns=1:2:0.5"]}, "is 1.5; expected a whole number from 0 up to 1000"),
        ({"vary": ["cmec.reset_turns=0:2:1"]}, "is 2; expected true or false"),
        ({"vary": ["canine.seed=1:5:1"]}, "each trial has its own seed; choose the first with --seed"),
        (
            {"vary": ["cmec.moving_deviation=1:2:1", "controller.moving_deviation=3:4:1"]},
            "controller.moving_deviation is varied twice",
        ),
        (
            {"vary": ["cmec.stop_hold=1:2:1", "cmec.dead_time=1:2:1"], "thresholds": "15:20"},
            "3 parameters are varied (cmec.moving_deviation, cmec.stop_hold, cmec.dead_time); expected",
        ),
        ({"settings": ["cmec.moving_deviation=30"]}, "--set cmec.moving_deviation=30: the parameter is"),
        ({"settings": ["cmec.moving_deviation"]}, "expected block.name=value"),
        ({"trials": 0}, "--trials 0: expected at least 1"),
        ({"trials": 10, "seed": 2147483640}, "take at most 8 trials, or a smaller --seed"),
        ({"trials": 1_000_000_000}, "expected at most 100000000: take at most 1315789 a point"),
        ({"settings": ["sensors.gps_sigma=1"]}, 'the system "cts" has no sensors; sweep with --system full'),
    ],
)  # fmt: skip
def test_invalid_options_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError) as caught:
        plan_sweep("two", **arguments)
    assert message in str(caught.value)


def test_a_sweep_of_too_many_points_in_two_dimensions_is_refused() -> None:
    with pytest.raises(SweepError, match="15100 points; expected at most 10000: take larger steps"):
        plan_sweep("two", thresholds="0:75:0.5", vary=["cmec.capture_radius=1:10.9:0.1"])


def test_a_scenario_on_a_foreign_package_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "theirs.toml"
    file.write_text('system = "theirs.ssp"\nwaypoints = [[25, 0]]')
    with pytest.raises(SweepError, match=r"runs the package theirs.ssp; a sweep compiles our own systems"):
        plan_sweep(str(file))
    with pytest.raises(UsageError, match='there is no scenario "tow"'):
        plan_sweep("tow")


def test_a_scenario_that_sets_a_connected_input_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "push.toml"
    file.write_text('waypoints = [[25, 0]]\n[[set]]\nat = 1\n"controller.speed" = 2')
    with pytest.raises(UsageError, match=r"controller.speed is connected; only free inputs can be set"):
        plan_sweep(str(file))


# the table


def test_the_table_has_the_numbers_found_by_hand(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given four trials at 20 and 21 deg
    known = {
        (20, 1): (Status.SUCCESS, 100, 1, {1: 2}),
        (20, 2): (Status.FAILED, 50, 3, {5: 1}),
        (20, 3): (Status.SUCCESS, 200, 2, {1: 1, 4: 1}),
        (20, 4): (Status.RUNNING, 7500, 0, {8: 3}),
        (21, 1): (Status.FAILED, 60, 3, {5: 1}),
        (21, 2): (Status.STOPPED, 60, 0, {6: 1}),
        (21, 3): (Status.FAILED, 60, 3, {5: 1}),
        (21, 4): (Status.IDLE, 7500, 0, {}),
    }
    install(monkeypatch, Runner(lambda threshold, seed, _: known[threshold, seed]))
    # when
    status, text, _ = canine(capsys, "two", "--thresholds", "20:21", "--trials", 4, "--out", tmp_path)
    # then: mean (4 s + 8 s) / 2, deviation sqrt(2^2 + 2^2) s; Wilson's interval of 2 in 4 and 0 in 4
    assert status == 0
    lines = (tmp_path / "sweep.csv").read_text().splitlines()
    assert lines[0] == "threshold_deg," + HEADER
    assert lines[1] == (
        "20,4,2,0.500000,0.150039,0.849961,6.000000,2.828427,1.500000,1,3,0,0,1,1,0,0,3,0,0,0,0,0"
    )
    assert lines[2] == "21,4,0,0.000000,0.000000,0.489891,,,,1,0,0,0,0,2,1,0,0,0,0,0,0,0"
    assert len(lines) == 3
    assert "20   50.0 %" in text
    assert "too few successes" in text
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "recommendation.json", "sweep.csv", "sweep.html", "sweep.png"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("successes", "trials"), [(0, 1), (1, 1), (2, 4), (951, 1000), (1000, 1000), (0, 50)]
)
def test_wilsons_interval_is_scipys(successes: int, trials: int) -> None:
    other = binomtest(successes, trials).proportion_ci(method="wilson")
    assert wilson(successes, trials) == pytest.approx((other.low, other.high), abs=1e-12)


def test_types_of_trials_take_turns_and_each_has_its_rate(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given dogs that never master left 90, and right 45 with even seeds div 4 only
    def outcome(threshold: int, seed: int, own: dict[str, float]) -> Trial:
        east = own["controller.waypoint_east[2]"]
        good = {35.73: True, -35.73: False, 22.4224: (seed // 4) % 2 == 0, -22.4224: True}[east]
        return (Status.SUCCESS if good else Status.FAILED), 500, 0, {}

    runner = install(monkeypatch, Runner(outcome))
    # when
    canine(capsys, "three", "--thresholds", "30:30", "--trials", 40, "--seed", 100, "--out", tmp_path)
    # then
    (row,) = csv.DictReader((tmp_path / "sweep.csv").open())
    assert [row[name] for name in ("right_90", "left_90", "right_45", "left_45")] == [
        "1.000000", "0.000000", "0.500000", "1.000000"
    ]  # fmt: skip
    assert (row["trials"], row["successes"]) == ("40", "25")
    assert Counter(runner.seeds) == Counter(range(100, 140))


def test_every_point_meets_the_same_dogs(runner: Runner, tmp_path: Path) -> None:
    sweep.run(plan_sweep("two", thresholds="20:29", trials=30, seed=5), tmp_path)
    assert Counter(runner.seeds) == dict.fromkeys(range(5, 35), 10)


def test_a_row_does_not_depend_on_the_other_points(runner: Runner, tmp_path: Path) -> None:
    for name, thresholds in (("a", "20:20"), ("b", "15:40:5")):
        sweep.run(plan_sweep("two", thresholds=thresholds, trials=50), tmp_path / name)
    alone, among = ((tmp_path / name / "sweep.csv").read_text().splitlines() for name in "ab")
    assert alone[1] == among[2]


# the command


def test_the_command_leaves_table_picture_and_recommendation(
    runner: Runner, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # when
    status, text, _ = canine(capsys, "two", "--thresholds", "15:60", "--trials", 400, "--out", tmp_path / "s")
    # then the success rate rises by 1 % a degree
    assert status == 0
    assert "best success rate: deviation threshold h' " in text
    assert "no optimum inside is shown, larger values may do better" in text
    assert "/s/: recommendation.json, sweep.csv, sweep.html, sweep.png" in text
    result = json.loads((tmp_path / "s" / "recommendation.json").read_text())
    assert result["varied"]["threshold_deg"] == {
        "name": "deviation threshold h'", "parameter": "controller.moving_deviation", "unit": "deg",
        "from": 15, "to": 60, "points": 46,
    }  # fmt: skip
    assert result["success"]["range"]["threshold_deg"][1] == 60
    assert "McNemar" in result["rule"]
    height, width, _ = imread(tmp_path / "s" / "sweep.png").shape
    assert (width, height) == (1800, 1200)
    # and --json prints the recommendation
    _, text, _ = canine(
        capsys, "two", "--thresholds", "15:60", "--trials", 400, "--json", "--out", tmp_path / "s"
    )
    assert json.loads(text) == result


@pytest.mark.usefixtures("runner")
def test_a_table_too_long_for_the_terminal_says_where_the_other_rows_are(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    # given 27 points, of which the terminal shows 13 at most
    _, text, _ = canine(capsys, "two", "--thresholds", "20:46", "--trials", 4, "--out", tmp_path)
    # then every third is shown, and so it says
    lines = [line.split()[0] for line in text.splitlines() if line.endswith(" 0  ")]
    assert lines == [str(degrees) for degrees in range(20, 47, 3)]
    assert "1 row of every 3; all 27 are in sweep.csv\n" in text


@pytest.mark.usefixtures("runner")
def test_a_single_point_says_once_that_there_is_nothing_to_compare(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    _, text, _ = canine(capsys, "two", "--thresholds", "20", "--trials", 4, "--out", tmp_path)
    assert text.count("nothing to compare") == 1
    assert "Pareto" not in text
    # and the file has each criterion as before
    advice = json.loads((tmp_path / "recommendation.json").read_text())
    assert advice["success"]["text"].startswith("best success rate: one point")


def test_a_sweep_over_two_parameters_draws_maps(
    runner: Runner, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--thresholds", "20:40:10", "--vary", "cmec.capture_radius=5:6:0.5", "--trials", 20)
    status, _, _ = canine(capsys, "two", *options, "--out", tmp_path)
    assert status == 0
    rows = list(csv.DictReader((tmp_path / "sweep.csv").open()))
    assert [(row["threshold_deg"], row["cmec.capture_radius"]) for row in rows[:4]] == [
        ("20", "5"), ("20", "5.5"), ("20", "6"), ("30", "5")
    ]  # fmt: skip
    height, width, _ = imread(tmp_path / "sweep.png").shape
    assert (width, height) == (2100, 1050)


def test_invalid_options_end_the_command_with_status_2_and_no_traceback(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments in (
        ("two", "--thresholds", "9:3"),
        ("nothing",),
        ("two", "--vary", "x"),
        ("two", "--trials", "0"),
        ("two", "--trials", "many"),
        ("two", "--system", "whole"),
        ("two", "--seed", "-1"),
        (),
    ):
        status, text, error = canine(capsys, *arguments, "--out", tmp_path / "s")
        assert (status, text) == (2, "")
        assert "Traceback" not in error
        assert not (tmp_path / "s").exists()


# files


def interrupt_after(trials: int) -> Callable[[int], None]:
    """A progress bar that gets Ctrl-C."""

    def progress(done: int) -> None:
        if done >= trials:
            raise KeyboardInterrupt

    return progress


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten trials a chunk; and no picture, which takes half a second."""
    monkeypatch.setattr("harness.sweep.plots.sweep_png", lambda *_: b"picture")
    monkeypatch.setattr(chunks, "SMALLEST", 10)
    monkeypatch.setitem(chunks.LARGEST, "cts", 10)


ASKED: dict[str, Any] = {"thresholds": "20:29", "trials": 33}


def test_an_interrupted_sweep_goes_on_from_its_journal(
    runner: Runner, small_chunks: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a sweep that was never interrupted, and one that was twice
    planned = plan_sweep("two", **ASKED)
    sweep.run(planned, tmp_path / "whole")
    for trials in (100, 200):
        with pytest.raises(KeyboardInterrupt):
            sweep.run(planned, tmp_path / "s", progress=interrupt_after(trials))
        assert [p.name for p in (tmp_path / "s").iterdir()] == ["sweep.journal"]
        # whose last line is torn each time
        path = tmp_path / "s" / "sweep.journal"
        content = path.read_bytes()
        path.write_bytes(content[:-25])
        kept = len(content.splitlines()) - 2
    # when it goes on, in other chunks, once those that were under way at the interruption have ended
    for thread in threading.enumerate():
        if thread.name.startswith("ThreadPoolExecutor"):
            thread.join(60)
    monkeypatch.setitem(chunks.LARGEST, "cts", 17)
    runner.seeds.clear()
    notes: list[str] = []
    sweep.run(planned, tmp_path / "s", note=notes.append)
    # then only what was not there is run
    assert notes == [
        f"{path}: 1 damaged line left out; those trials run again",
        f"{10 * kept} of 330 trials are there from before; going on",
    ]
    assert len(runner.seeds) == 330 - 10 * kept
    for name in ("sweep.csv", "recommendation.json", "sweep.png"):
        assert (tmp_path / "s" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    assert not path.exists()


def test_a_sweep_ended_by_ctrl_c_says_how_to_go_on(
    runner: Runner, small_chunks: None, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    append = journal.Journal.append

    def interrupted(self: journal.Journal, chunk: chunks.Chunk) -> None:
        append(self, chunk)
        raise KeyboardInterrupt

    command = ("two", "--thresholds", "20:21", "--trials", 40, "--out", tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(journal.Journal, "append", interrupted)
        status, _, error = canine(capsys, *command)
    assert status == 130
    assert error == (
        f"canine: ended by Ctrl-C; what is done is kept in {tmp_path}: the same command goes on there\n"
    )
    status, _, error = canine(capsys, *command)
    assert (status, error) == (0, "note: 10 of 80 trials are there from before; going on\n")


def test_a_folder_with_another_sweeps_journal_is_refused(
    runner: Runner, small_chunks: None, tmp_path: Path
) -> None:
    with pytest.raises(KeyboardInterrupt):
        sweep.run(plan_sweep("two", **ASKED), tmp_path, progress=interrupt_after(50))
    content = (tmp_path / "sweep.journal").read_bytes()
    for other, differs in (
        (plan_sweep("two", **ASKED | {"trials": 34}), "trials: 33, now 34"),
        (plan_sweep("two", **ASKED, seed=2), "seed: 1, now 2"),
        (plan_sweep("two", **ASKED, reading="literal"), "reading: calibrated, now literal"),
        (
            plan_sweep("two", **ASKED, settings=["cmec.dead_time=2"]),
            "scenarios.two_waypoint.parameters.cmec.dead_time: none, now 2",
        ),
        (
            plan_sweep("two", **ASKED | {"thresholds": "20:30"}),
            "varied.threshold_deg.to: 29, now 30, varied.threshold_deg.points: 10, now 11",
        ),
    ):
        with pytest.raises(UsageError) as caught:
            sweep.run(other, tmp_path)
        assert str(caught.value) == (
            f"{tmp_path}: holds another unfinished sweep (two: deviation threshold h' 20 to 29 deg in steps "
            f"of 1, 33 trials a point from seed 1 on, cts, calibrated); it differs in {differs}. Run that "
            "again to finish it, remove sweep.journal, or choose another folder with --out"
        )
        assert (tmp_path / "sweep.journal").read_bytes() == content


def test_a_sweep_does_not_go_on_with_another_version_of_the_models(
    runner: Runner, small_chunks: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(KeyboardInterrupt):
        sweep.run(plan_sweep("two", **ASKED), tmp_path, progress=interrupt_after(50))
    monkeypatch.setattr(sweep, "program", lambda **_: "another")
    with pytest.raises(UsageError, match=r"holds another unfinished sweep .* in another version of the prog"):
        sweep.run(plan_sweep("two", **ASKED), tmp_path)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({}, "sweep-two"),
        ({"thresholds": "20:30", "trials": 7, "reading": "calibrated", "seed": 1}, "sweep-two"),
        ({"reading": "literal", "system": "full"}, "sweep-two-literal-full"),
        ({"seed": 7}, "sweep-two-seed7"),
        ({"vary": ["cmec.moving_deviation=20:30:5"]}, "sweep-two"),
        ({"vary": ["cmec.waypoint_north[1]=20:30:5"]}, "sweep-two-cmec.waypoint_north1"),
        (
            {"thresholds": "20:30", "vary": ["canine.drift=0:1:1"], "system": "full"},
            "sweep-two-full-threshold_deg-canine.drift",
        ),
    ],
)
def test_the_default_folder_carries_what_differs(options: dict[str, Any], name: str) -> None:
    assert sweep.default_folder(plan_sweep("two", **options)) == Path("out", name)


def test_the_default_folder_of_a_scenario_carries_what_differs_from_its_file(tmp_path: Path) -> None:
    file = tmp_path / "meadow.toml"
    file.write_text('reading = "literal"\nseed = 7\nwaypoints = [[20, 5]]')
    assert sweep.default_folder(plan_sweep(str(file))) == Path("out/sweep-meadow")
    other = plan_sweep(str(file), reading="calibrated", seed=1)
    assert sweep.default_folder(other) == Path("out/sweep-meadow-calibrated-seed1")


def test_results_of_another_sweep_are_replaced_with_a_note_that_names_what_differs(
    runner: Runner, small_chunks: None, tmp_path: Path
) -> None:
    def notes_of(trials: int = 20, settings: Sequence[str] = ()) -> list[str]:
        notes: list[str] = []
        planned = plan_sweep("two", thresholds="20:21", trials=trials, settings=settings)
        sweep.run(planned, tmp_path, note=notes.append)
        return notes

    # given the results of a sweep, then the same again says nothing
    assert notes_of() == []
    assert notes_of() == []
    # and others say what they replace
    begin = f"{tmp_path}: has the results of another sweep, which these replace "
    assert notes_of(trials=21, settings=["canine.shaking=false"]) == [
        f"{begin}(trials: 20, now 21, scenarios.two_waypoint.parameters.canine.shaking: none, now false)"
    ]
    (tmp_path / "recommendation.json").write_text('{"sweep": "two", "trials": 21}')  # of an earlier version
    assert notes_of(trials=21) == []
    (tmp_path / "recommendation.json").write_text("mine")
    assert notes_of() == [f"{begin}(recommendation.json is not of canine)"]


def test_a_full_disk_is_named_and_no_chunk_is_lost(
    runner: Runner, small_chunks: None, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    command = ("two", "--thresholds", "20:29", "--trials", 33, "--out")
    canine(capsys, *command, tmp_path / "whole")
    # given a disk on which 2000 bytes fit
    room, write = 2000, os.write

    def little(handle: int, data: memoryview) -> int:
        nonlocal room
        if not room:
            raise OSError(28, "No space left on device")
        written = write(handle, data[:room])
        room -= written
        return written

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", little)
        status, _, error = canine(capsys, *command, tmp_path / "s")
    # then
    assert status == 1
    assert error == (
        f"canine: {tmp_path}/s/sweep.journal: cannot be written (No space left on device); the chunks "
        "before are kept: make room, and the same command goes on there\n"
    )
    assert not (tmp_path / "s" / "sweep.csv").exists()
    status, _, error = canine(capsys, *command, tmp_path / "s")
    assert (status, error[:5]) == (0, "note:")
    assert (tmp_path / "s" / "sweep.csv").read_bytes() == (tmp_path / "whole" / "sweep.csv").read_bytes()


def test_a_sweep_on_a_full_disk_leaves_nothing_behind(
    runner: Runner, small_chunks: None, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    # given a disk on which nothing fits, and one on which the first line alone does
    def full(handle: int, data: memoryview) -> int:
        raise OSError(28, "No space left on device")

    def one_line(handle: int, data: memoryview) -> int:
        return write(handle, data) if b'"about"' in bytes(data) else full(handle, data)

    write = os.write
    for little, then in (
        (full, "make room, or choose another folder with --out"),
        (one_line, "make room, and give the command again"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(os, "write", little)
            status, _, error = canine(capsys, "two", "--thresholds", "20:29", "--out", tmp_path)
        assert status == 1
        assert error == (
            f"canine: {tmp_path}/sweep.journal: cannot be written (No space left on device); {then}\n"
        )
        assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_take_the_results_is_refused_at_once(
    runner: Runner, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a" / "sweep.csv").mkdir(parents=True)
    (tmp_path / "file").touch()
    for folder, status, message in (
        ("a", 2, f"{tmp_path}/a/sweep.csv: is a folder; remove it, or choose another one with --out"),
        ("file/b", 2, f"{tmp_path}/file/b/sweep.journal: cannot be written (Not a directory)"),
    ):
        got, _, error = canine(capsys, "two", "--trials", 4, "--out", tmp_path / folder)
        assert got == status
        assert error.startswith(f"canine: {message}")
    assert runner.seeds == []


def test_results_that_cannot_be_written_wait_in_the_journal(
    runner: Runner, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, content: bytes) -> None:
        raise OSError(28, "No space left on device")

    command = ("two", "--thresholds", "20:21", "--trials", 4, "--out", tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        status, _, error = canine(capsys, *command)
    assert status == 1
    assert f"{tmp_path}: cannot be written (No space left on device)" in error
    runner.seeds.clear()
    status, _, error = canine(capsys, *command)
    assert (status, runner.seeds) == (0, [])
    assert error == "note: 8 of 8 trials are there from before; going on\n"


def test_earlier_results_stay_until_new_ones_are_complete(
    runner: Runner, small_chunks: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def results() -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name != "sweep.journal"}

    # given the results of a sweep
    sweep.run(plan_sweep("two", thresholds="20:21", trials=20), tmp_path)
    earlier = results()
    assert sorted(earlier) == [
        "recommendation.json", "sweep.csv", "sweep.html", "sweep.png"
    ]  # fmt: skip
    # when another one is interrupted, or no picture can be made of it
    with pytest.raises(KeyboardInterrupt):
        sweep.run(plan_sweep("two", **ASKED), tmp_path, progress=interrupt_after(50))
    with monkeypatch.context() as patch:
        patch.setattr("harness.sweep.plots.sweep_png", Mock(side_effect=MemoryError))
        with pytest.raises(MemoryError):
            sweep.run(plan_sweep("two", **ASKED), tmp_path)
    # then they are still there, all of them
    assert results() == earlier
    sweep.run(plan_sweep("two", **ASKED), tmp_path)
    assert results()["sweep.csv"].count(b"\n") == 11


@pytest.mark.parametrize("plant", ["canine", "canine_in_streets"])
def test_a_flat_sweep_says_so_once(plant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given trials that nearly all succeed, at thresholds that are alike
    options = ("--plant", plant, "--thresholds", "44:46", "--trials", 30, "--out", tmp_path)
    status, printed, _ = command.canine(capsys, "sweep", "two", *options)
    # then one line says that there is no optimum, and for what
    assert status == 0
    (line,) = (line for line in printed.splitlines() if "no optimum" in line)
    assert line.startswith("best success rate, shortest time, fastest of those with")
    assert line.count("best measured at") == 2
    # and the file has it, beside a text for each
    result = json.loads((tmp_path / "recommendation.json").read_text())
    assert result["advice"] == [line, result["pareto"]["text"]]
    assert result["both"]["text"].startswith(
        "fastest of those with the best success rate: no value of deviation threshold h'"
    )
