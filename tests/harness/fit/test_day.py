"""What a day does to an animal, from logs: laws followed, effects estimated, and what cannot be told."""

from __future__ import annotations

import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from scipy.optimize import minimize

from harness.fit.day import Days, Effect, Mission, delaying, estimate_day, laws_given, slowing, within_range
from harness.fit.estimate import days_of
from harness.fit.report import show
from harness.fit.tracks import Track, Trial, measure
from harness.log.channel import Array
from models.commands import Command
from models.day import rested
from models.errors import CanineError
from tests.harness.fit import dogs

OWN = laws_given([])
LASTING = OWN | {"fatigue_time": 1e7, "habituation_time": 1e7}


def mission(program: dogs.Program, *, success: bool = False, rest: float = 0.0) -> Mission:
    """A mission of the dog of `dogs`, measured."""
    track = replace(dogs.motion(dogs.commands(program), dogs.DOG), success=success)
    return Mission(track, measure(track, dogs.PLANT), rest)


def told(responses: list[tuple[Command, bool]], *, success: bool = True, rest: float = 0.0) -> Mission:
    """A mission in which the animal stands and is told to turn; who turns is given, not measured."""
    command = dogs.commands([step for side, _ in responses for step in ((side, 0.2), (Command.NONE, 0.2))])
    still = dogs.track(command, np.zeros(len(command)), np.zeros(len(command)))
    trial = Trial("t", heard=[(10 * k, side, obeyed) for k, (side, obeyed) in enumerate(responses)])
    return Mission(replace(still, success=success), trial, rest)


def drawn(days: int, gain: float, seed: int = 1) -> list[list[Mission]]:
    """Days of eight missions with four vibrations each, of an animal that obeys with 64 and 60 %."""
    rng = np.random.default_rng(seed)
    result = []
    for _ in range(days):
        day, habituation = [], 0.0
        for _ in range(8):
            responses = []
            for felt in range(1, 5):
                habituation += gain * (1 - habituation) if felt > 2 else 0.0
                side = Command(int(rng.choice([Command.LEFT, Command.RIGHT])))
                rate = {Command.LEFT: 0.64, Command.RIGHT: 0.6}[side] * (1 - habituation)
                responses.append((side, bool(rng.random() < rate)))
            day.append(told(responses))
            habituation *= 0.5
        result.append(day)
    return result


def effect(result: dict[str, Any], name: str) -> dict[str, Any]:
    facts: dict[str, Any] = result["effects"][name]
    return facts


def test_speeds_of_a_day_give_the_share_that_fatigue_takes() -> None:
    # given missions of a dog that loses half of its speed when it is tired, each with a fatigue of its own
    day: list[Mission] = []
    fatigue = 0.0
    for _ in range(8):
        program: dogs.Program = [(Command.FORWARD, 12.0), (Command.STOP, 4.0), (Command.NONE, 1.0)]
        speed = 5.0 * (1 - 0.5 * (fatigue + 0.026 * (1 - fatigue)))  # after some 26 of 1000 m
        speed += 0.05 * (-1) ** len(day)
        track = dogs.motion(dogs.commands(program), dogs.DOG | {"cruise": speed})
        one = Mission(track, measure(track, dogs.PLANT), 0.0)
        day.append(one)
        way = speed * 12 - speed**2 / (2 * 1.7) + speed**2 / (2 * 2.9)
        fatigue += (1 - fatigue) * (1 - math.exp(-way / 1000))
    # when the law that tired it is taken as given
    facts = effect(estimate_day([day], LASTING), "fatigue_slows")
    # then the share and the rested speed are found
    assert facts["estimate"] == pytest.approx(0.5, abs=0.03)
    assert facts["rested"] == pytest.approx(5.0, abs=0.05)
    assert facts["interval"][0] < 0.5 < facts["interval"][1]
    assert (facts["n"], facts["verdict"]) == (8, "shown")


def test_delays_of_forward_give_what_fatigue_adds() -> None:
    # given a dog that is late by 0.12 s when rested, and by 0.04 s more in each mission
    day = []
    for number in range(6):
        command = dogs.commands([(Command.FORWARD, 10.0), (Command.STOP, 4.0)])
        track = dogs.later(command, dogs.DOG, 0.12 + 0.04 * number)
        day.append(Mission(track, measure(track, dogs.PLANT), 0.0))
    result = estimate_day([day], LASTING)
    fatigues = [fatigue for fatigue, _ in result["delays"]]
    slope = 0.04 / float(np.mean(np.diff(fatigues)))
    facts = effect(result, "fatigue_delays")
    assert facts["estimate"] == pytest.approx(slope, rel=0.03)
    assert facts["rested"] == pytest.approx(0.12, abs=0.02)
    assert facts["verdict"] == "shown"


def test_the_gain_of_habituation_is_found_within_its_interval() -> None:
    # given thirty days of a dog with a gain of 0.3, a reward that takes half, and no effect of fatigue
    own = LASTING | {"start_fatigue": 0.5, "reward_relief": 0.5}
    result = estimate_day(drawn(30, 0.3), own)
    facts = effect(result, "habituation_gain")
    assert facts["interval"][0] < 0.3 < facts["interval"][1]
    assert facts["interval"][1] - facts["interval"][0] < 0.2
    assert facts["verdict"] == "shown"
    # only vibrations beyond the free ones count as values of it
    assert facts["n"] == 30 * 8 * 2
    # and all of them are of a dog that is equally tired, which tells nothing of fatigue
    verdict = effect(result, "fatigue_disobeys")["verdict"]
    assert verdict.startswith("cannot be estimated: all responses are of fatigues within 0.02")
    assert result["parameters"] == {"canine.habituation_gain": facts["estimate"]}


def test_an_interval_covers_the_gain_as_often_as_it_says() -> None:
    own = LASTING | {"start_fatigue": 0.5}
    covered = 0
    for seed in range(16):
        low, high = effect(estimate_day(drawn(6, 0.2, seed), own), "habituation_gain")["interval"]
        covered += low - 0.005 <= 0.2 <= high + 0.005
    assert covered >= 13  # of 16: fewer by chance in 0.7 % of such tests


def test_the_likelihood_is_that_of_the_law() -> None:
    # given some days, and the law written out anew
    days, own = drawn(4, 0.3), LASTING | {"start_fatigue": 0.5}

    def surprise(theta: Array) -> float:
        total = 0.0
        for day in days:
            habituation = 0.0
            for one in day:
                for felt, (_, side, obeyed) in enumerate(one.trial.heard, start=1):
                    habituation += theta[2] * (1 - habituation) if felt > 2 else 0.0
                    chance = theta[0 if side == Command.LEFT else 1] * (1 - habituation)
                    total -= math.log(chance if obeyed else 1 - chance)
                habituation *= 0.5
        return total

    # when it is maximized by a library
    best = minimize(surprise, [0.5, 0.5, 0.2], bounds=[(0.01, 0.99)] * 3)
    # then it is largest where the fit says
    facts = effect(estimate_day(days, own), "habituation_gain")
    assert facts["estimate"] == pytest.approx(best.x[2], abs=0.011)
    # and the interval ends where twice its logarithm has fallen by 3.84
    for end in facts["interval"]:
        held = [(0.01, 0.99), (0.01, 0.99), (end, end)]
        profile = minimize(surprise, [0.5, 0.5, end], bounds=held)
        assert 2 * (profile.fun - best.fun) == pytest.approx(3.84, abs=0.9)


def test_fatigue_and_rests_are_followed_over_the_day() -> None:
    # given two missions of a dog, with a rest of 500 s between them
    program: dogs.Program = [(Command.FORWARD, 10.0), (Command.STOP, 5.0), (Command.NONE, 1.0)] * 3
    first, second = mission(program, rest=500.0), mission(program)
    result = estimate_day([[first, second]], OWN | {"fatigue_time": 400.0})
    # when its way is worked out by hand: 3 runs to 4.1 m/s at 1.7 m/s2, stopped at 2.9 m/s2
    way = 3 * (4.1 * 10 - 4.1**2 / (2 * 1.7) + 4.1**2 / (2 * 2.9))
    tired = 1 - math.exp(-way / 1000)
    # then the second mission begins with what fading leaves of it
    delayed = [fatigue for fatigue, _ in result["delays"]]
    begun = delayed[len(delayed) // 2]
    assert begun == pytest.approx(rested(tired, 0, 0, 500 + 20, {"fatigue_time": 400.0})[0], rel=0.05)


HEEDED_TWICE = [(Command.LEFT, obeyed) for obeyed in (True, True, False, False, False)]


def test_a_failed_mission_is_no_reward() -> None:
    # given missions in which the free vibrations alone are obeyed, and a reward that takes all
    own = LASTING | {"reward_relief": 1.0}

    def likeliest(*, success: bool) -> float:
        days = [[told(HEEDED_TWICE, success=success)] * 3] * 4
        return float(effect(estimate_day(days, own), "habituation_gain")["estimate"])

    # then a habit explains it where each mission was a success, and not where it would have lasted
    assert likeliest(success=True) > 0.9
    assert likeliest(success=False) < 0.6


def test_a_habit_fades_between_vibrations_too() -> None:
    # given the same missions, and habits that last, or fade before the next vibration
    days = [[told(HEEDED_TWICE)]] * 8
    own = [LASTING | {"free_vibrations": 0, "habituation_time": time} for time in (1e7, 0.02)]
    lasting, fading = (effect(estimate_day(days, each), "habituation_gain") for each in own)
    # then one that fades cannot explain that only the later ones are ignored
    assert lasting["verdict"] == "shown"
    assert fading["interval"][0] == 0


def test_intervals_of_the_lines_cover_what_is_true_as_often_as_they_say() -> None:
    # given speeds and delays that scatter about their lines, eight at a time
    rng = np.random.default_rng(1)
    covered = np.zeros(2)
    for _ in range(500):
        fatigue = rng.uniform(0, 0.5, 8)
        speeds = slowing(np.column_stack([fatigue, 5 * (1 - 0.4 * fatigue) + rng.normal(0, 0.5, 8)]))
        late = delaying(np.column_stack([fatigue, 0.1 + 0.3 * fatigue + rng.normal(0, 0.2, 8)]))
        for place, (estimated, true) in enumerate(((speeds, 0.4), (late, 0.3))):
            assert estimated.interval is not None
            covered[place] += estimated.interval[0] <= true <= estimated.interval[1]
    # then 95 % of the intervals hold the truth, +-3 points
    assert covered / 500 == pytest.approx([0.95, 0.95], abs=0.03)


@pytest.mark.parametrize(
    ("estimated", "verdict"),
    [
        (Effect("habituation_gain", 12, 0.3, (0.1, 0.5)), "shown"),
        (Effect("habituation_gain", 12, 0.3, (0.0, 0.5)), "not shown: the interval includes 0"),
        (Effect("habituation_gain", 12, 0.3, (0.0, 0.97)), "the logs tell nothing of it"),
        (Effect("fatigue_slows", 8, -0.3, (-0.4, -0.1)), "below 0: the animal does not tire by this law"),
        (Effect("fatigue_delays", 8, 1.0, (-0.4, 3.0)), "not shown: the interval includes 0"),
        (Effect("fatigue_slows", 8, math.nan, (math.nan, math.nan)), "not shown: the interval includes 0"),
        (Effect("fatigue_slows", 8, why="so it is"), "cannot be estimated: so it is"),
    ],
)
def test_what_may_be_concluded_is_said(estimated: Effect, verdict: str) -> None:
    assert estimated.verdict == verdict


def test_what_the_model_does_not_take_is_left_out_of_the_parameters_and_told() -> None:
    # given an animal that loses more of its speed than the model takes, and one that slows down on FORWARD
    fitted = {"canine.fatigue_slows": 0.95, "canine.habituation_gain": 0.3, "canine.speeding_up": -0.2}
    # when
    kept, notes = within_range(fitted)
    # then
    assert kept == {"canine.habituation_gain": 0.3}
    left_out = "the animal is beyond its model, and this is left out of the parameters"
    assert notes == [
        f"canine.fatigue_slows is 0.95; expected a number from 0 up to 0.9; {left_out}",
        f"canine.speeding_up is -0.2; expected a number from 0 m/s2; {left_out}",
    ]


def test_a_short_day_says_what_it_lacks() -> None:
    result = estimate_day([[mission(dogs.SCHOOL)]], OWN)
    verdicts = {name: facts["verdict"] for name, facts in result["effects"].items()}
    assert verdicts == {
        "fatigue_slows": "cannot be estimated: cruising speed: 1 values; at least 5 are needed",
        "fatigue_delays": "cannot be estimated: FORWARD from rest: 1 values; at least 5 are needed",
        "fatigue_disobeys": "cannot be estimated: 2 responses to LEFT and RIGHT; at least 10 are needed",
        "habituation_gain": "cannot be estimated: 0 responses to vibrations beyond the free ones; "
        "at least 10 are needed",
    }
    assert result["parameters"] == {}


def unknown_from_7_to_8_s(track: Track) -> Track:
    """The same motion, of which a second of a run is not known."""
    usable = (track.time < 7) | (track.time >= 8)
    return replace(track, usable=usable, speed=np.where(usable, track.speed, math.nan))


def test_where_the_motion_is_not_known_the_last_known_speed_is_held() -> None:
    # given five missions of a dog that runs steadily when its speed is lost for a second
    one = mission([(Command.FORWARD, 12.0), (Command.STOP, 4.0), (Command.NONE, 1.0)] * 2)
    gap = replace(one, track=unknown_from_7_to_8_s(one.track))
    whole, lost = (estimate_day([[each] * 5], LASTING) for each in (one, gap))
    # then the fatigue is that of the whole log, and the seconds are counted
    assert lost["delays"] == pytest.approx(np.array(whole["delays"]), abs=1e-12)
    assert lost["seconds_unknown"] == pytest.approx(5 * 1.0)
    assert lost["seconds"] == pytest.approx(5 * 34.0)
    assert whole["seconds_unknown"] == 0
    # and told beside the effects
    printed = {id(day): table_of(day) for day in (whole, lost)}
    assert "the motion is not known in 5.0 of 170.0 s; the last known speed is held" in printed[id(lost)]
    assert "not known" not in printed[id(whole)]


def table_of(day: dict[str, Any]) -> str:
    """What is printed of a day's effects."""
    text = io.StringIO()
    show({"trials": [], "sources": [], "statistics": {}, "responses": {}, "notes": [], "day": day},
         Console(file=text, width=200))  # fmt: skip
    return text.getvalue()


def test_a_mission_whose_motion_is_never_known_is_refused() -> None:
    one = mission(dogs.SCHOOL)
    lost = replace(one.track, usable=np.zeros(len(one.track.time), dtype=bool))
    days = Days([[Path("a"), Path("b")]], [10.0], OWN)
    with pytest.raises(CanineError, match="b: its motion is never known, and a day needs the way run in"):
        days.missions({Path("a"): (one.track, one.trial), Path("b"): (lost, one.trial)})


def lay(folder: Path, *names: str) -> list[Path]:
    """Empty logs in a folder."""
    logs = [folder / name for name in names]
    for log in logs:
        log.parent.mkdir(parents=True, exist_ok=True)
        log.write_bytes(b"")
    return logs


def test_missions_are_in_the_order_in_which_people_count(tmp_path: Path) -> None:
    names = ["am2.mcap", "april30.mcap", "march2/1.mcap", "march2-late/1.mcap", "march10.mcap", "pm1.mcap"]
    logs = lay(tmp_path, *names)
    assert days_of([tmp_path]) == [logs]


@pytest.mark.parametrize("again", ["folder", "log of it", "log by another path", "log in a row"])
def test_a_log_in_two_places_is_refused(tmp_path: Path, again: str) -> None:
    first, second = lay(tmp_path, "day-1/1.mcap", "day-1/2.mcap")
    day = first.parent
    named = {
        "folder": [day, day], "log of it": [day, second], "log in a row": [first, second, first],
        "log by another path": [day, day / ".." / "day-1" / "2.mcap"],
    }[again]  # fmt: skip
    with pytest.raises(CanineError, match=r"\.mcap: is named twice, and would be two missions; name it once"):
        days_of(named)


@pytest.mark.parametrize(
    "names",
    [
        ("day-1/mission-1/trial.mcap", "day-1/mission-2/trial.mcap", "day-2/mission-1/trial.mcap"),
        ("day-1/mission-1/trial.mcap", "day-2/mission-1/trial.mcap"),
        ("day-1/1.mcap", "day-1/2.mcap", "day-2/1.mcap"),
    ],
)
def test_a_folder_of_days_is_refused(tmp_path: Path, names: tuple[str, ...]) -> None:
    lay(tmp_path, *names)
    with pytest.raises(CanineError) as refused:
        days_of([tmp_path])
    assert str(refused.value) == (
        f"{tmp_path}: its folders day-1, day-2 hold several logs, or folders with logs; expected the "
        "missions of one day, side by side or each in a folder of its own: name each folder"
    )
    # and a folder with one day is that day
    assert [len(day) for day in days_of([tmp_path / "day-1"])] == [sum("day-1" in name for name in names)]


def test_each_folder_is_a_day_and_so_are_logs_in_a_row(tmp_path: Path) -> None:
    # given two folders with missions whose numbers are counted, and three logs beside them
    lay(tmp_path, *(f"{name}/trial.mcap" for name in ("a/mission-10", "a/mission-2", "b/mission-1")))
    lay(tmp_path, "x.mcap", "y.mcap", "z.mcap")
    a, b, x, y, z = (tmp_path / name for name in ("a", "b", "x.mcap", "y.mcap", "z.mcap"))
    days = days_of([z, x, a, b, y])
    assert days == [
        [z, x],
        [a / "mission-2" / "trial.mcap", a / "mission-10" / "trial.mcap"],
        [b / "mission-1" / "trial.mcap"],
        [y],
    ]


@pytest.mark.parametrize(
    ("rests", "words"),
    [
        ([-1.0], "rest is -1 s; expected 0 to 1e+06 s"),
        ([1.0, 2.0, 3.0], "rest: 3 rests, and the day of a has 3 missions; expected one for all, or 2"),
        ([math.nan], "rest is nan s; expected 0 to 1e+06 s"),
    ],
)
def test_rests_that_are_not_between_missions_are_refused(rests: list[float], words: str) -> None:
    with pytest.raises(CanineError) as refused:
        Days([[Path("a"), Path("b"), Path("c")]], rests, OWN)
    assert str(refused.value) == words


def test_a_day_whose_mission_was_left_out_is_refused() -> None:
    one = mission(dogs.SCHOOL)
    days = Days([[Path("a"), Path("b"), Path("c")]], [10.0, 20.0], OWN)
    trial = (one.track, one.trial)
    assert [m.rest for m in days.missions(dict.fromkeys(map(Path, "abc"), trial))[0]] == [10.0, 20.0, 0.0]
    with pytest.raises(CanineError, match="b: was left out, and a day needs all its missions"):
        days.missions({Path("a"): trial, Path("c"): trial})


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("canine.fatigue_slows=0.3", "canine.fatigue_slows=0.3: a fit takes only what it does not"),
        ("canine.fatigue_time=long", "expected a number from 1 up to 10000000 s"),
        ("canine.fatigue_time=0", "canine.fatigue_time is 0; expected a number from 1"),
        ("canine.free_vibrations=1.5", "expected a whole number"),
    ],
)
def test_what_is_taken_as_given_is_checked(setting: str, words: str) -> None:
    with pytest.raises(CanineError) as refused:
        laws_given([setting])
    assert words in str(refused.value)
    assert laws_given(["canine.fatigue_way=500"])["fatigue_way"] == 500


@pytest.mark.parametrize(("success", "tired"), [(False, 1 - math.exp(-1)), (True, 0.0)])
def test_a_mission_that_failed_away_from_home_is_completed_by_the_way_home(
    success: bool, tired: float
) -> None:
    # given a log that ends 1000 m from home, and a mission after it
    first = told([(Command.LEFT, False)], success=success)
    first = replace(first, track=replace(first.track, way_home=1000.0))
    result = estimate_day([[first, mission(dogs.SCHOOL)]], LASTING)
    # then a dog that failed has run it when it sets out again
    assert result["delays"][0][0] == pytest.approx(tired, abs=1e-4)
