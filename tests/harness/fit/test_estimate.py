"""Statistics pooled over trials, and trials read from logs."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, truncnorm

from harness.fit.estimate import (
    FitError,
    before_redrawing,
    estimate,
    find_logs,
    interval_of_deviation,
    interval_of_mean,
    pool,
    read_tracks,
)
from harness.fit.tracks import STATISTICS, Trial, measure
from harness.log.channel import Array
from harness.log.log import LogError
from harness.trial import trial
from harness.trial.prepare import prepared
from harness.trial.request import Changes, build_missing, requested
from models.canine import Canine
from models.commands import Command, Status
from models.kit.model import Model
from models.kit.units import DEG
from tests.conftest import Native
from tests.harness.command import canine
from tests.harness.fit.dogs import DOG, PLANT, SCHOOL, columns, commands, motion, track, write

# many trials of a known animal

Trials = Callable[[dict[str, float], range], list[Trial]]


@pytest.fixture
def school(native: Callable[..., Native]) -> Trials:
    """The model's dogs, in C, through SCHOOL."""
    command = commands(SCHOOL)

    def run(parameters: dict[str, float], seeds: range) -> list[Trial]:
        trials = []
        for seed in seeds:
            dog = native(Canine, parameters={"shaking": 0, **parameters, "seed": seed})
            begin = dog["body_heading"]
            steps = dog.run(command=command[:-1])
            speed, heading = (np.concatenate([[s], steps[n]]) for s, n in ((0, "speed"), (begin, "heading")))
            trials.append(measure(track(command, speed, heading, aim=0.0), PLANT))
        return trials

    return run


def test_known_statistics_lie_in_their_intervals_as_often_as_these_claim(school: Trials) -> None:
    # given 20 batches of 30 trials of a dog unlike Table 5.1's, whose draws are practically never redrawn
    known = {
        "cruise_speed": (3.6, 0.6), "speeding_up": (2.2, 0.4), "slowing_down": (3.1, 0.5),
        "right_turn_rate": (60 * DEG, 12 * DEG), "left_turn_rate": (-75 * DEG, 15 * DEG),
        "drift": (-1.5 * DEG, 1.1 * DEG), "start_heading": (20 * DEG, 6 * DEG),
    }  # fmt: skip
    rates = {"left_success": 0.8, "right_success": 0.35}
    parameters = rates | {key: mean for key, (mean, _) in known.items()}
    parameters |= {f"{key}_deviation": deviation for key, (_, deviation) in known.items()}
    trials = school(parameters, range(1, 601))
    batches = [pool(trials[i : i + 30], PLANT.turned) for i in range(0, 600, 30)]
    # when it is counted how often the known value lies in the interval
    covered: dict[str, int] = {}
    for statistic in STATISTICS:
        mean, deviation = (statistic.scale * value for value in known[statistic.key])
        rows = [batch["statistics"][statistic.key] for batch in batches]
        covered[f"{statistic.key} mean"] = sum(within(mean, row["mean_interval"]) for row in rows)
        covered[f"{statistic.key} sd"] = sum(within(deviation, row["sd_interval"]) for row in rows)
    for name, rate in rates.items():
        covered[name] = sum(within(rate, batch["responses"][name]["interval"]) for batch in batches)
    # then each of the 16 does so in as many of 20 batches as is likely at 95 %, and all together no more
    assert len(covered) == 16
    assert min(covered.values()) >= binom.ppf(1e-4, 20, 0.95), covered
    low, high = binom.interval(0.999, 16 * 20, 0.95)
    assert low <= sum(covered.values()) <= high, covered


def within(value: float, interval: tuple[float, float]) -> bool:
    return interval[0] <= value <= interval[1]


def test_the_models_redrawing_is_undone_in_the_parameters(school: Trials) -> None:
    # given decelerations as wide as Table 5.1's: the model draws 5 % of them again, below 0.2 of the mean
    mean, deviation = 2.72, 1.31
    trials = school({"slowing_down_deviation": deviation}, range(1, 401))
    result = pool(trials, PLANT.turned)
    # then what it draws is that of the normal distribution cut off there (scipy's), not Table 5.1's
    cut = truncnorm((0.2 - 1) * mean / deviation, np.inf, mean, deviation)
    row = result["statistics"]["slowing_down"]
    assert cut.mean() == pytest.approx(2.859, abs=1e-3)
    assert row["mean"] == pytest.approx(cut.mean(), abs=4 * cut.std() / math.sqrt(400))
    # and the parameters are the model's own, to 3 standard errors and more: less than what was seen
    assert result["parameters"]["canine.slowing_down"] < row["mean"] - 0.05
    assert result["parameters"]["canine.slowing_down"] == pytest.approx(mean, rel=0.1)
    assert result["parameters"]["canine.slowing_down_deviation"] == pytest.approx(deviation, rel=0.15)


@pytest.mark.parametrize(("mean", "deviation"), [(2.72, 1.31), (4.86, 1.49), (3.0, 0.1), (1.0, 2.0)])
def test_redrawing_is_undone_exactly(mean: float, deviation: float) -> None:
    cut = truncnorm((0.2 - 1) * mean / deviation, np.inf, mean, deviation)
    assert before_redrawing(cut.mean(), cut.std()) == pytest.approx((mean, deviation), rel=1e-6)


def test_a_spread_too_wide_for_redrawing_is_left_as_it_is_and_noted() -> None:
    assert before_redrawing(1.0, 0.9) is None
    trials = [Trial("t", {"speeding_up": value}) for value in (0.1, 0.1, 5.0)]
    result = pool(trials, PLANT.turned)
    assert result["parameters"]["canine.speeding_up"] == pytest.approx(5.2 / 3, rel=1e-5)  # as it is
    assert any(note.startswith("acceleration: spread too widely for the model") for note in result["notes"])


# intervals and the rest of pooling


def test_intervals_are_students_and_chi_squares() -> None:
    # t(0.975, 4) = 2.776, chi2(0.025, 4) = 0.4844, chi2(0.975, 4) = 11.143; s^2 = 2.5
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    half = 2.776 * math.sqrt(2.5 / 5)
    assert interval_of_mean(values) == pytest.approx((3 - half, 3 + half), abs=1e-3)
    assert interval_of_deviation(values) == pytest.approx(
        (math.sqrt(10 / 11.143), math.sqrt(10 / 0.4844)), rel=1e-4
    )
    assert interval_of_mean(values[:1]) is None
    assert interval_of_deviation(values[:1]) is None


def test_rates_have_wilsons_interval() -> None:
    # given 29 of 45, which is Table 5.1's 0.64; Wilson 1927: centre and half width by hand
    trials = [Trial("t", {}, {"left_success": [i < 29], "right_success": []}) for i in range(45)]
    row = pool(trials, PLANT.turned)["responses"]["left_success"]
    z, n, p = 1.959964, 45, 29 / 45
    centre, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    assert row["interval"] == pytest.approx(
        [(centre - half) / (1 + z * z / n), (centre + half) / (1 + z * z / n)]
    )
    assert (row["n"], row["obeyed"], row["rate"]) == (45, 29, p)
    assert pool(trials, PLANT.turned)["responses"]["right_success"]["interval"] is None


def test_turns_too_slow_to_tell_are_noted_by_their_share() -> None:
    # given turn rates of 20 +- 10 deg/s: P(-5 < X < 5) = Phi(-1.5) - Phi(-2.5) = 0.0668 - 0.0062
    trials = [Trial("t", {"right_turn_rate": rate * DEG}) for rate in (20 - 10, 20.0, 20 + 10)]
    notes = pool(trials, 5 * DEG)["notes"]
    assert len(notes) == 1
    assert notes[0].startswith(
        "right turn: by its distribution 6.1 % of the turns are slower than 5 deg/s and"
    )
    assert pool(trials, 0.1 * DEG)["notes"] == []


def test_runs_that_end_too_early_make_the_mean_low_and_are_noted() -> None:
    # given legs of 3 s: a dog of 1.7 m/s2 that cruises at 3.2 m/s does so for 1.1 s, one of 4.1 m/s for 0.6
    trials = [
        measure(motion(commands([(Command.FORWARD, 3.0), (Command.STOP, 3.0)]), {**DOG, "cruise": v}), PLANT)
        for v in (3.2, 4.1)
    ]
    result = pool(trials, PLANT.turned)
    assert result["statistics"]["cruise_speed"]["mean"] == pytest.approx(3.2)
    assert result["notes"][0].startswith("velocity: 1 of 2 trials never had 1 s of steady speed")


def test_nothing_to_estimate_from_says_why_for_each_statistic() -> None:
    trial = measure(motion(commands([(Command.FORWARD, 0.4)]), DOG), PLANT)
    with pytest.raises(FitError) as caught:
        pool([trial], PLANT.turned)
    assert str(caught.value) == (
        "no trial has a stretch to estimate from (velocity: came to less than 1 m/s (1); acceleration: "
        "came to less than 1 m/s (1); deceleration: no STOP of a moving animal; right turn: no RIGHT; left "
        "turn: no LEFT; heading drift: under way for less than 1 s (1); start heading: the log has no "
        "waypoint (1)); give longer trials"
    )


# logs


def test_a_log_without_truth_is_read_by_its_estimate(tmp_path: Path) -> None:
    # given a real trial's log: no plant; invalid while it brakes; between fixes the speed is off by 5 m/s
    logged = columns(component="estimator")
    ticks = len(logged["controller.command"])
    logged["estimator.valid"] = np.where((np.arange(ticks) > 200) & (np.arange(ticks) < 220), 0.0, 1.0)
    logged["estimator.gps_fix"] = (np.arange(ticks) % 6 == 0).astype(float)
    logged["estimator.speed"] = logged["estimator.speed"] + 5 * (1 - logged["estimator.gps_fix"])
    reading = read_tracks([write(tmp_path / "field.mcap", logged)])
    # then
    result = estimate(reading)
    assert result["sources"] == ["estimator"]
    assert result["turned_deg_s"] == pytest.approx(5)
    assert result["statistics"]["cruise_speed"]["mean"] == pytest.approx(4.1)
    assert result["statistics"]["speeding_up"]["mean"] == pytest.approx(1.7)
    assert result["statistics"]["left_turn_rate"]["mean"] == pytest.approx(-80, rel=2e-3)  # drift of 0.3 m/s
    assert result["statistics"]["slowing_down"]["left_out"] == {"the motion is not known throughout": 1}
    # and a threshold of one's own
    assert estimate(reading, turned=60 * DEG)["responses"]["right_success"]["obeyed"] == 0


def test_the_plants_command_counts_before_the_controllers(tmp_path: Path) -> None:
    # given a log in jacobi order: the command reaches the dog a tick later
    logged = columns()
    logged["plant.command"] = logged["controller.command"]
    logged["controller.command"] = np.append(logged["plant.command"][1:], 0.0)
    (read, _), *_ = read_tracks([write(tmp_path / "t.mcap", logged)]).tracks
    np.testing.assert_array_equal(read.command, logged["plant.command"])


@pytest.mark.parametrize(
    ("status", "way"), [(Status.RUNNING, 5.0), (Status.STOPPED, 5.0), (Status.FAILED, 3.0)]
)
def test_the_way_home_is_from_the_last_place_that_is_known(tmp_path: Path, status: int, way: float) -> None:
    # given a waypoint, a home at (0, 0), and a dog that was seen last 3 m north and 4 m east of it
    route = {"waypoint_count": 1, "waypoint_north[1]": 9, "waypoint_east[1]": 0, "home_north": 0,
             "home_east": 0, "capture_radius": 2}  # fmt: skip
    logged = columns()
    for name, metres in (("north", 3.0), ("east", 4.0)):
        logged[f"plant.{name}"] = np.full(len(logged["plant.speed"]), metres)
    logged["plant.east"][-20:] = np.nan
    logged["controller.status"] = np.full(len(logged["plant.speed"]), float(status))
    parameters = {f"controller.{name}": str(value) for name, value in route.items()}
    (read, _), *_ = read_tracks([write(tmp_path / "t.mcap", logged, parameters=parameters)]).tracks
    # then one that failed is recalled to within the capture radius, as in a simulated day
    assert read.way_home == pytest.approx(way)


def test_odd_logs_are_noted(tmp_path: Path) -> None:
    # given logs: whole, the same again, cut short, with another sample time, of the estimate, no log
    first = write(tmp_path / "a" / "trial.mcap", columns(), seed="1")
    (tmp_path / "b.mcap").write_bytes(first.read_bytes())
    (tmp_path / "c.mcap").write_bytes(first.read_bytes()[:-4000])
    write(tmp_path / "d.mcap", columns({**DOG, "cruise": 4.0}), step=0.05, seed="1")
    write(tmp_path / "e.mcap", columns(component="estimator"), seed="5")
    (tmp_path / "f.mcap").write_text("no log at all")
    write(tmp_path / "g.mcap", {"plant.speed": np.zeros(3), "plant.heading": np.zeros(3)})
    # when
    reading = read_tracks(find_logs([tmp_path, first]))
    # then
    assert [track.name.split("/")[1] for track, _ in reading.tracks] == [
        "trial.mcap",
        "c.mcap",
        "d.mcap",
        "e.mcap",
    ]
    same, cut, foreign, silent, mixed, without, steps, seeds = reading.notes
    assert same == f"{tmp_path}/b.mcap: the same log as {first}; counted once"
    assert cut.startswith(f"{tmp_path}/c.mcap: the log is not whole, the file ends early, at byte ")
    assert foreign.startswith(f"log {tmp_path}/f.mcap: not an MCAP file")
    assert foreign.endswith("; left out")
    assert silent == (
        f'{tmp_path}/g.mcap: the log has no signal "controller.command"; expected the log of a guided trial, '
        "such as `canine run` writes, with the motion of plant or estimator; left out"
    )
    assert mixed.startswith("the motion is read from plant of 3, estimator of 1 logs")
    assert (
        steps == "the logs have different sample times: 0.04 s in 3, 0.05 s in 1; each is read with its own"
    )
    assert seeds.startswith("simulated logs with the seed of another, and so its draws: 2;")
    assert without == (
        f"no plant in 1 of 4 logs ({tmp_path.name}/e.mcap): their animal is not the plant of the others; all "
        "count"
    )
    assert reading.left_out == 2
    assert estimate(reading)["left_out_logs"] == 2


def test_logs_of_another_plant_are_left_out_named_and_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given three logs of a dog, and two of a pedestrian
    for number in range(3):
        write(tmp_path / f"dog{number}.mcap", columns(), seed=str(number))
    walker = columns({**DOG, "cruise": 1.4})
    for number in range(2):
        write(tmp_path / f"walker{number}.mcap", walker, seed=str(7 + number), blocks={"plant": "pedestrian"})
    # when
    status, text, _ = canine(capsys, "fit", tmp_path, "--out", tmp_path / "fit")
    # then the pedestrian's speed is in no statistic
    result = json.loads((tmp_path / "fit" / "fit.json").read_text())
    assert status == 0
    assert result["statistics"]["cruise_speed"]["mean"] == pytest.approx(4.1)
    assert (result["plants"], result["left_out_logs"], len(result["trials"])) == (["plant"], 2, 3)
    # and the table says so beside its number of trials, with their names below
    assert text.startswith("3 trials, 2 logs left out (plant)")
    name = tmp_path.name
    assert (
        f"note: 2 of 5 logs ({name}/walker0.mcap, {name}/walker1.mcap) are of the plant pedestrian, most of "
        "plant; left out"
    ) in text


def test_as_many_logs_of_one_plant_as_of_another_are_refused(tmp_path: Path) -> None:
    write(tmp_path / "dog.mcap", columns())
    write(tmp_path / "walker.mcap", columns(), seed="2", blocks={"plant": "pedestrian"})
    with pytest.raises(FitError) as caught:
        read_tracks(find_logs([tmp_path]))
    name = tmp_path.name
    assert str(caught.value) == (
        f"the logs are of different plants, plant: {name}/dog.mcap; pedestrian: {name}/walker.mcap; give the "
        "logs of one of them"
    )


def test_plants_with_different_parameters_are_noted_by_log(tmp_path: Path) -> None:
    # given dogs at other starts and in other streets, of which one is faster by its parameters
    for number, speed in enumerate(("4.86", "4.86", "3.0")):
        places = {"plant.start_north": str(number), "plant.street_end_north[1]": str(number)}
        parameters = {"plant.cruise_speed": speed, **places}
        write(tmp_path / f"{number}.mcap", columns(), seed=str(number), parameters=parameters)
    notes = read_tracks(find_logs([tmp_path])).notes
    assert list(notes) == [
        "plant.cruise_speed is 4.86 (SI) in 2 of 3 logs, and differs in the others "
        f"({tmp_path.name}/2.mcap): the animals are not the same; all count"
    ]


def test_plants_of_different_fmus_with_one_name_are_noted_by_log(tmp_path: Path) -> None:
    for number, content in enumerate((b"a", b"a", b"b")):
        write(tmp_path / f"{number}.mcap", columns(), seed=str(number), attachments={"plant.fmu": content})
    notes = read_tracks(find_logs([tmp_path])).notes
    assert list(notes) == [
        f"the plant is another FMU of the same name in 1 of 3 logs ({tmp_path.name}/2.mcap); all count"
    ]


def test_a_fit_of_other_logs_is_replaced_with_a_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a fit of one log, made twice
    logs = [write(tmp_path / name, columns(), seed=name[0]) for name in ("1.mcap", "2.mcap")]
    for _ in range(2):
        _, _, error = canine(capsys, "fit", logs[0], "--out", tmp_path / "fit")
        assert error == ""
    # when it is made of another
    _, _, error = canine(capsys, "fit", logs[1], "--out", tmp_path / "fit")
    # then that is said
    folder = tmp_path.name
    assert error == (
        f'note: {tmp_path}/fit: has another fit, which this replaces (logs: ["{folder}/1.mcap"], now '
        f'["{folder}/2.mcap"])\n'
    )


def test_logs_that_cannot_be_opened_are_left_out_with_a_note(tmp_path: Path) -> None:
    # given a log among a folder and a broken link, both named as logs are
    good = write(tmp_path / "good.mcap", columns())
    (tmp_path / "folder.mcap").mkdir()
    (tmp_path / "link.mcap").symlink_to(tmp_path / "nowhere")
    reading = read_tracks(find_logs([tmp_path]))
    # then the good one counts
    assert [track.name for track, _ in reading.tracks] == [f"{tmp_path.name}/{good.name}"]
    assert list(reading.notes) == [
        f"{tmp_path}/folder.mcap: cannot be read (Is a directory); expected the log of a trial; left out",
        f"{tmp_path}/link.mcap: cannot be read (No such file or directory); expected the log of a trial; "
        "left out",
    ]
    # and alone it is an error
    with pytest.raises(FitError, match=r"folder\.mcap: cannot be read \(Is a directory\)"):
        read_tracks([tmp_path / "folder.mcap"])


def test_a_log_that_ends_early_is_used_up_to_there(tmp_path: Path) -> None:
    path = write(tmp_path / "t.mcap", columns())
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    (read, source), *_ = read_tracks([path]).tracks
    assert len(read.time) < len(commands(SCHOOL))
    assert measure(read, source).values["cruise_speed"] == pytest.approx(4.1)


def test_errors_name_the_log_and_the_signal_that_it_lacks(tmp_path: Path) -> None:
    def refused(name: str, signals: dict[str, Array], component: str | None = None) -> str:
        with pytest.raises(FitError) as caught:
            read_tracks([write(tmp_path / name, signals)], component)
        return str(caught.value)

    bare = {"plant.speed": np.zeros(3), "plant.heading": np.zeros(3)}
    assert refused("a.mcap", bare).startswith(
        f'{tmp_path}/a.mcap: the log has no signal "controller.command"'
    )
    assert '"estimator.speed"' in refused("b.mcap", columns(), "estimator")
    assert '"plant.speed"' in refused("c.mcap", columns(component="estimator"), "plant")
    single = {name: column[:1] for name, column in columns().items()}
    assert refused("d.mcap", single) == f"{tmp_path}/d.mcap: holds one tick; expected a trial"
    (tmp_path / "empty.mcap").touch()
    with pytest.raises(LogError, match="the file is empty"):
        read_tracks([tmp_path / "empty.mcap"])
    with pytest.raises(FitError, match=r'there is no log ".*nowhere"; expected a trial.mcap, or a folder'):
        find_logs([tmp_path / "nowhere"])
    (tmp_path / "folder").mkdir()
    with pytest.raises(FitError, match=r"folder: the folder holds no .mcap; expected logs of trials"):
        find_logs([tmp_path / "folder"])


# from trials to the command line


def test_the_logs_of_trials_give_the_draws_of_their_dogs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial, "trial_png", lambda log: b"")  # drawing takes longest
    # given two trials of the whole system, sensors and all, with dogs that differ
    spread = {"cruise_speed_deviation": 0.7, "speeding_up_deviation": 0.3, "slowing_down_deviation": 0.4}
    settings = [f"canine.{name}={value}" for name, value in spread.items()]
    dogs = []
    for seed in (1, 3):
        with requested("three_waypoint", Changes(settings=settings, seed=seed)) as request:
            build_missing(request)
            with prepared(request) as ready:
                trial.run(request, ready, tmp_path / str(seed))
        dog = Model(Canine, {**spread, "seed": seed})
        dog.initialize()
        dogs.append(dog)
    # when
    status, text, _ = canine(capsys, "fit", tmp_path, "--out", tmp_path / "fit", "--json")
    # then each trial tells what its dog had drawn
    result = json.loads(text)
    assert status == 0
    assert json.loads((tmp_path / "fit" / "fit.json").read_text()) == result
    drawn = {
        "cruise_speed": "trial_speed", "speeding_up": "trial_speeding_up", "drift": "trial_drift",
        "slowing_down": "trial_slowing_down", "left_turn_rate": "trial_left_rate",
        "right_turn_rate": "trial_right_rate",
    }  # fmt: skip
    scales = {statistic.key: statistic.scale for statistic in STATISTICS}
    compared = 0
    for seed, dog, row in zip((1, 3), dogs, result["trials"], strict=True):
        assert row["log"] == f"{seed}/trial.mcap"
        for key, state in drawn.items():
            if key in row:
                assert row[key] == pytest.approx(dog[state] * scales[key], rel=1e-6), (seed, key)
                compared += 1
    assert compared >= 9  # of 12: not every dog was turned to both sides, or cruised
    assert (tmp_path / "fit" / "fit.png").read_bytes().startswith(b"\x89PNG")
    assert tomllib.loads((tmp_path / "fit" / "fit.toml").read_text())["parameters"] == result["parameters"]

    # and the estimate tells nearly the same, in the terminal
    status, text, _ = canine(
        capsys, "fit", tmp_path / "1", "--source", "estimator", "--out", tmp_path / "fit"
    )
    assert status == 0
    assert text.startswith("1 trial (estimator)")
    assert text.splitlines()[-1].endswith("fit.html, fit.json, fit.png, fit.toml")
    by_estimate = json.loads((tmp_path / "fit" / "fit.json").read_text())["trials"][0]
    for key, tolerance in (("cruise_speed", 0.02), ("speeding_up", 0.1), ("drift", 0.1)):
        assert by_estimate[key] == pytest.approx(result["trials"][0][key], rel=tolerance)


def test_canine_fit_with_wrong_arguments_ends_with_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, error = canine(capsys, "fit", tmp_path / "nowhere")
    assert status == 2
    assert error.splitlines()[-1] == (
        f'canine: there is no log "{tmp_path}/nowhere"; expected a trial.mcap, or a folder that holds some'
    )
    assert canine(capsys, "fit")[0] == 2
    assert canine(capsys, "fit", tmp_path, "--source", "gps")[0] == 2
