"""Days of missions: what is carried from one to the next, and that it is what single trials do."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness import run_trial
from harness.day import missions
from harness.day.missions import Asked, Result, plan_days, run
from harness.sweep import sweep
from harness.trial.scenario import load
from models.day import rested
from models.errors import CanineError
from tests.harness.command import canine
from tests.harness.pictures import size

MISSION = "three_waypoint"


@pytest.fixture(scope="module")
def day() -> Result:
    """Days with a short, a usual and an endless rest."""
    return run(plan_days(Asked(MISSION, rests=(0.0, 600.0, 1e6), missions=4, days=600, reading="field")))


def test_a_dog_begins_a_mission_as_the_last_one_and_the_rest_have_left_it(day: Result) -> None:
    short, usual, endless = day.curves
    # given rested dogs in the first mission, which is the same whatever the rest
    for curve in day.curves:
        assert not curve.fatigue[0].any()
        assert not curve.habituation[0].any()
        assert curve.ticks[0].tobytes() == short.ticks[0].tobytes()
    # then after rest and reward of so many seconds they begin the second as the closed form says
    tired, accustomed = short.fatigue[1], short.habituation[1]
    assert usual.fatigue[1] == pytest.approx(rested(tired, 0, 0, 600, {})[0], rel=1e-12)
    assert usual.habituation[1] == pytest.approx(rested(0, accustomed, 0, 600, {})[1], rel=1e-12)
    assert 0.05 < tired.mean() < 0.25
    # and those that never rest are ever more tired, while a rest for ever leaves nothing
    assert np.all(np.diff(short.fatigue, axis=0) > 0)
    assert endless.fatigue.max() < 1e-100


def test_tired_dogs_succeed_less_often(day: Result) -> None:
    # given 600 days, when a dog that never rests begins its fourth mission
    rows = {curve.rest: curve.rows for curve in day.curves}
    # then it succeeds less often than a rested one, beyond both intervals
    assert rows[0.0][3]["ci_high"] < rows[1e6][3]["ci_low"]
    assert rows[0.0][3]["mean_fatigue"] > 0.15 > rows[1e6][3]["mean_fatigue"]


def test_a_success_is_a_reward() -> None:
    # given a dog with a habit, two free vibrations and nothing that fades
    asked = Asked(
        MISSION, rests=(0.0,), missions=2, days=300,
        settings=(
            "canine.start_habituation=0.4", "canine.habituation_gain=0", "canine.habituation_time=1e7",
            "canine.reward_relief=0.75",
        ),
    )  # fmt: skip
    (curve,) = run(plan_days(asked)).curves
    # then a success takes three quarters of it, a failure nothing
    success = curve.ticks[0] > 0
    assert 50 < success.sum() < 250
    assert curve.habituation[1][success] == pytest.approx(0.1, rel=1e-3)
    assert curve.habituation[1][~success] == pytest.approx(0.4, rel=1e-3)


def test_a_dog_that_failed_runs_home_before_its_next_mission() -> None:
    # given a first turn that fails the trial, on a leg of 35 m, and no fading
    asked = Asked(
        MISSION, rests=(0.0,), missions=2, days=50,
        settings=("cmec.max_turns=0", "canine.fatigue_time=1e7", "canine.fatigue_way=1000"),
    )  # fmt: skip
    (curve,) = run(plan_days(asked)).curves
    failed = curve.ticks[0] == 0
    assert failed.sum() > 20
    # then its way is there and back: half of them ran farther than the leg and the stop behind it are long
    way = -1000 * np.log(1 - curve.fatigue[1][failed])
    assert np.median(way) > 35.73 + 4.86**2 / (2 * 2.72)
    assert not curve.timeouts.any()


def test_a_mission_whose_time_is_up_fails_and_is_counted_and_the_dog_goes_home() -> None:
    # given 6 s, in which the dog speeds up at 1.78 m/s2 and runs some 22.5 m
    short = replace(load(MISSION), duration=6.0)
    result = run(plan_days(Asked(short, missions=2, days=20, rests=(0.0,))))
    way = -1000 * np.log(1 - result.curves[0].fatigue[1])
    assert way == pytest.approx(2 * (4.86 * 6 - 4.86**2 / (2 * 1.78)), rel=0.05)
    assert [row["timeouts"] for row in result.curves[0].rows] == [20, 20]
    assert [row["successes"] for row in result.curves[0].rows] == [0, 0]
    assert [row["mean_time_s"] for row in result.curves[0].rows] == [None, None]


def test_a_mission_that_a_limit_stopped_is_counted_as_such() -> None:
    # given a fence that the first leg crosses
    asked = Asked(MISSION, missions=1, days=20, reading="guarded", settings=("cmec.fence_radius=10",))
    (row,) = run(plan_days(asked)).curves[0].rows
    assert (row["stopped"], row["timeouts"], row["successes"]) == (20, 0, 0)


def test_days_with_another_estimator_are_other_days() -> None:
    four, six = (plan_days(Asked(MISSION, system="full", estimator=e)) for e in ("four_state", "six_state"))
    assert (four.identity["estimator"], six.identity["estimator"]) == ("four_state", "six_state")


def test_the_first_mission_is_a_sweeps_trials_of_that_dog(day: Result, tmp_path: Path) -> None:
    planned = sweep.plan_sweep(
        MISSION, plant="canine_all_day", thresholds="49", trials=600, reading="field",
        vary=["canine.start_fatigue=0:0.5:0.5"],
    )  # fmt: skip
    table, _ = sweep.run(planned, tmp_path)
    fresh, tired = table
    assert fresh.successes == day.curves[0].rows[0]["successes"]
    # and a parameter of the day can be varied
    assert tired.successes < fresh.successes


def test_a_day_has_the_bits_of_single_trials_by_co_simulation(tmp_path: Path) -> None:
    # given a day of three missions that succeed, of a dog whose states act from the first on
    settings = ["canine.start_fatigue=0.3", "canine.start_habituation=0.2", "canine.free_vibrations=0"]
    asked = Asked(MISSION, missions=3, days=60, seed=4, reading="field", settings=settings)
    result = run(plan_days(asked))
    (curve,) = result.curves
    day = int(np.flatnonzero((curve.ticks > 0).all(axis=0))[0])
    fatigue, habituation = 0.3, 0.2
    for mission, scenario in enumerate(result.missions_of(curve, day)):
        assert (curve.fatigue[mission, day], curve.habituation[mission, day]) == (fatigue, habituation)
        # when each is run alone with FMUs, from where the last one ended and after its rest
        trial = run_trial(scenario, plant="canine_all_day", out=tmp_path / str(mission))
        # then it ends on the same tick, with the same states
        assert trial.outcome == "success"
        assert trial.log.time[-1] == pytest.approx(0.04 * curve.ticks[mission, day])
        tired, accustomed = (float(trial.log[f"plant.{name}"][-1]) for name in ("fatigue", "habituation"))
        fatigue, habituation = rested(tired, accustomed, True, 600.0, {})


def test_a_day_does_not_depend_on_how_it_is_cut(day: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missions, "PIECE", 37)
    again = run(plan_days(day.planned.asked))
    for one, other in zip(day.curves, again.curves, strict=True):
        for name in ("ticks", "timeouts", "stopped", "fatigue", "habituation"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def test_controllers_meet_the_same_seeds_and_have_settings_of_their_own() -> None:
    # given two controllers, one without a turn
    asked = Asked(
        MISSION, controllers=("cmec", "quarter_turn"), rests=(60.0,), missions=2, days=60,
        settings=("quarter_turn.max_turns=0", "canine.fatigue_slows=0.1"),
    )  # fmt: skip
    result = run(plan_days(asked))
    cmec, other = result.curves
    # then the setting acts where that one leads
    assert cmec.rows[0]["successes"] > other.rows[0]["successes"] == 0
    assert result.planned.animal["fatigue_slows"] == 0.1


def test_what_is_beyond_its_bound_is_told() -> None:
    within = plan_days(Asked(MISSION))
    assert len(within.notes) == 2
    assert "assumed" in within.notes[0]
    slow = plan_days(Asked(MISSION, settings=("canine.fatigue_slows=0.8",)))
    assert slow.notes[2].endswith("Table 5.1, if a day ends at full fatigue")
    beyond = plan_days(Asked(MISSION, settings=("canine.habituation_gain=0.6",)))
    assert beyond.notes[2:] == [
        "canine.habituation_gain is 0.6, beyond the bound of about 0.35: by our own sweeps, a larger one "
        "would not fit the counts of Table 4.4"
    ]


def test_what_is_stated_of_the_dog_and_what_is_still_assumed_is_told() -> None:
    # given a speed and an effect of fatigue, as fits of logs and of days give them
    settings = ("canine.cruise_speed=4.2", "canine_all_day.fatigue_slows=0.4", "canine.left_success=0.7")
    assumed, rested_dog = plan_days(Asked(MISSION, settings=settings)).notes
    # then each note says so, and what it is still true of
    assert "; stated: fatigue_slows; still assumed: start_fatigue, start_habituation, fatigue_way" in assumed
    assert "; stated: cruise_speed, left_success; still assumed: speeding_up, slowing_down" in rested_dog
    assert rested_dog.endswith("drift_deviation, right_success")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"missions": 0}, "missions is 0; expected 1 to 1000"),
        ({"days": 0}, "days is 0; expected 1 to 100000000"),
        ({"rests": (600.0, -1.0)}, "rest is -1 s; expected 0 to 1e+06 s"),
        ({"rests": (float("nan"),)}, "rest is nan s; expected"),
        ({"rests": ()}, "rest is empty; expected at least one"),
        ({"rests": (1.0, 1.0)}, "rest: 1.0 is named twice"),
        ({"controllers": ("cmec", "cmec")}, "controllers: cmec is named twice"),
        ({"controllers": ("cmecc",)}, 'there is no controller "cmecc"'),
        ({"seed": 2**31 - 1}, "the last mission would have seed 2147491646; expected at most 2147483647"),
        ({"days": 10**8}, "are 800000000 trials; expected at most 100000000: take fewer days"),
        ({"settings": ("canine.fatigue_slow=1",)}, "canine.fatigue_slow"),
        ({"target": "three"}, 'there is no scenario "three"'),
    ],
)
def test_what_no_day_can_have_is_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(CanineError) as refused:
        plan_days(Asked(**({"target": MISSION} | change)))
    assert words in str(refused.value)


def test_an_fmu_made_elsewhere_leads_no_day(tmp_path: Path) -> None:
    fmu = tmp_path / "mine.fmu"
    fmu.write_bytes(b"not ours")
    with pytest.raises(CanineError, match=r"mine\.fmu: is an FMU made elsewhere; a day runs our own blocks"):
        plan_days(Asked(MISSION, controllers=(str(fmu),)))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small day by the command."""
    from harness import main  # noqa: PLC0415

    folder = tmp_path_factory.mktemp("day")
    options = ["--missions", "3", "--rest", "0,600", "--controllers", "cmec,quarter_turn", "--days", "40"]
    assert main.run(["day", MISSION, *options, "--out", str(folder)]) == 0
    return folder


def test_the_command_writes_table_picture_page_and_json(written: Path) -> None:
    rows = list(csv.DictReader((written / "day.csv").read_text().splitlines()))
    facts = json.loads((written / "day.json").read_text())
    # then there is a row for each controller, rest and mission, the same in both
    names = ["controller", "rest_s", "mission", "trials", "successes", "success_rate", "ci_low", "ci_high"]
    assert list(rows[0])[:8] == names
    assert list(rows[0])[8:] == ["mean_fatigue", "mean_habituation", "mean_time_s", "timeouts", "stopped"]
    assert len(rows) == 2 * 2 * 3
    assert [float(row["success_rate"]) for row in rows] == [row["success_rate"] for row in facts["curves"]]
    assert [row["mission"] for row in rows[:4]] == ["1", "2", "3", "1"]
    assert {row["trials"] for row in rows} == {"40"}
    assert facts["animal"]["fatigue_way"] == 1000
    assert any("assumed" in note for note in facts["notes"])
    assert size((written / "day.png").read_bytes()) == (1650, 1350)
    page = (written / "day.html").read_text()
    assert "quarter_turn, rest 600 s" in page
    assert "nobody measured" in page


def test_the_command_prints_the_table_or_json_and_says_what_it_replaces(
    written: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, printed, errors = canine(
        capsys, "day", MISSION, "--missions", 1, "--days", 20, "--out", written, "--json"
    )
    assert status == 0
    assert json.loads(printed)["curves"][0]["trials"] == 20
    assert "another day, which these replace" in errors
    status, printed, errors = canine(capsys, "day", MISSION, "--missions", 1, "--days", 20, "--out", written)
    assert status == 0
    assert "fatigue" in printed
    assert "note: fatigue and habituation are assumed" in printed
    assert "replace" not in errors


def test_the_command_refuses_a_rest_that_is_no_number(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, errors = canine(capsys, "day", MISSION, "--rest", "60,long")
    assert status == 2
    assert '--rest "long": expected a number, in s' in errors
