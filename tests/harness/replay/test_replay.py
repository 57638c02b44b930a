"""Replays of a recording through the estimator's FMU, with simulated outages."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from fmus.build import build_fmu
from fmus.folder import build_folder
from harness.cosim.fmu import FmuError
from harness.log.log import read_log
from harness.recording.recording import RecordingError
from harness.recording.signals import SensorSignals
from harness.replay.comparison import HELD, MEAN, Configuration, EstimateError, compare, hold_speed
from harness.replay.fmu import run_fmu
from harness.replay.outage import Outage
from harness.replay.replay import apart, paired_t_test, replay, report, show, statistics
from harness.replay.source import ReplaySource, open_source
from harness.replay.windows import Outages
from harness.trial import trial
from harness.trial.prepare import prepared
from harness.trial.request import Request, build_missing
from harness.trial.scenario import load
from models.errors import CanineError
from models.four_state import FourState
from models.kit.model import Model
from tests.harness.command import canine
from tests.harness.cosim.tiny_fmu import V, strict, tiny_fmu
from tests.harness.replay.logs import walk as walk_of_log
from tests.harness.replay.logs import write

PROJECT = Path(__file__).resolve().parents[3]
NOTHING_ELSE: dict[str, Any] = {
    "dropped": {},
    "left_out": {},
    "set": {},
    "verdicts": {},
}  # of a replay's result
WALK = Path(os.environ.get("CANINE_DATA", PROJECT.parent / "shared" / "data")) / "walk_ublox_imu"
FOUR = compare("four_state")
walk_is_there = pytest.mark.skipif(not WALK.is_dir(), reason=f"no recording in {WALK}")


@pytest.fixture(scope="module")
def walk() -> ReplaySource:
    return open_source(WALK)


def outage(errors: dict[str, tuple[float, float]], start: float = 0.0, standing: bool = False) -> Outage:
    return Outage(start, start + 10.0, 12.0, errors, {}, np.zeros(0), standing)


@walk_is_there
def test_outages_fit_between_settling_and_the_last_fix(walk: ReplaySource) -> None:
    chosen = walk.outages(10, 5)
    windows = chosen.windows
    assert windows[0] == (22.0, 32.0)  # the walk begins at 11.5 s
    assert windows[-1] == (122.0, 132.0)  # the last fix is at 132.5 s
    assert len(windows) == 21
    assert chosen.left_out == {} == walk.dropped


@walk_is_there
def test_the_fmu_and_the_python_model_agree_to_the_bit_over_the_walk(walk: ReplaySource) -> None:
    # given the first 20 s of the walk with an outage in them
    signals = walk.signals([(12.0, 15.0)])
    ticks = 500
    # when both run over them
    fmu = run_fmu(build_fmu(FourState, build_folder() / "fmi2", 2), signals, ticks, {"fuzzy": 0})
    model = Model(FourState, {"fuzzy": 0})
    model.initialize()
    names = FourState.flat_names("input")
    expected = []
    for tick in range(ticks):
        for name in names:
            model[name] = float(getattr(signals, name)[tick])
        model.step()
        expected.append(model.output.copy())
    # then they agree to the bit
    for i, name in enumerate(FourState.flat_names("output")):
        np.testing.assert_array_equal(fmu[name], np.array(expected)[:, i], err_msg=name)


@walk_is_there
def test_a_fix_inside_an_outage_does_not_reach_the_estimator(walk: ReplaySource) -> None:
    # given an outage
    window = (40.0, 50.0)
    ticks = int(window[1] / 0.04) + 1
    path = build_fmu(FourState, build_folder() / "fmi2", 2)
    plain = walk.signals([window])
    assert not plain.gps_fix[(plain.t >= window[0]) & (plain.t <= window[1])].any()
    # then the estimator's position input stands still, and the estimate runs on dead reckoning
    inside = (plain.t > window[0]) & (plain.t <= window[1])
    assert np.ptp(plain.gps_north[inside]) == 0.0
    estimate = run_fmu(path, plain, ticks, {})
    deviation = estimate["north_sd"][inside[:ticks]]
    assert deviation[-1] > 10 * deviation[0]


@walk_is_there
def test_every_configuration_is_compared_with_the_same_fix(walk: ReplaySource, tmp_path: Path) -> None:
    chosen = walk.outages(10, 40)
    replayed = replay(walk, FOUR, chosen)
    assert len(replayed.outages) == 3
    result = report(walk, FOUR, chosen, replayed, tmp_path)
    expected = [HELD, MEAN, "no pitch", "pitch", "fuzzy", "pitch, floor", "fuzzy, floor, cap"]
    assert list(result["configurations"]) == expected
    written = json.loads((tmp_path / "outages.json").read_text())
    assert written == result
    assert (tmp_path / "replay.png").read_bytes().startswith(b"\x89PNG")
    # the strong baseline of this walk: a person walks 12.5 m in 10 s and turns, yet ends within metres
    assert result["configurations"][HELD]["position_error_m"]["median"] < 5.0


def test_speed_held_goes_on_along_the_heading() -> None:
    # given 2 m/s to the east from the last fix at tick 25, at (3, 4)
    ticks = 51
    values: dict[str, Any] = {name: np.zeros(ticks) for name in SensorSignals.__dataclass_fields__}
    values["heading_meas"] = np.full(ticks, np.pi / 2)
    values["gps_fix"] = np.arange(ticks) == 25
    values["gps_north"], values["gps_east"] = np.full(ticks, 3.0), np.full(ticks, 4.0)
    values["gps_speed"] = np.full(ticks, 2.0)
    values["origin_latitude"] = values["origin_longitude"] = 0.0
    # when the speed is held for a second
    held = hold_speed(values, ticks)
    # then 25 ticks of 0.08 m follow, all east
    assert held["north"][50] == pytest.approx(3.0, abs=1e-12)
    assert held["east"][50] == pytest.approx(4.0 + 2.0, abs=1e-12)
    assert held["speed"][50] == 2.0


def test_the_mean_speed_is_that_of_the_fixes_of_three_seconds() -> None:
    # given fixes each second with the speeds 9, 1, 2, 3, 6 m/s, the last of them at 4 s
    ticks = 126
    values: dict[str, Any] = {name: np.zeros(ticks) for name in SensorSignals.__dataclass_fields__}
    values["gps_fix"] = (np.arange(ticks) % 25 == 0) & (np.arange(ticks) <= 100)
    values["gps_speed"] = np.repeat([9.0, 1.0, 2.0, 3.0, 6.0, 6.0], 25)[:ticks]
    values["gps_speed"] = np.append(values["gps_speed"], 6.0)[:ticks]
    values["origin_latitude"] = values["origin_longitude"] = 0.0
    # when it is held for a second
    held = hold_speed(values, ticks, 3.0)
    # then it is (1 + 2 + 3 + 6) / 4 = 3 m/s, north
    assert held["speed"][125] == 3.0
    assert held["north"][125] == pytest.approx(3.0, abs=1e-12)


def test_outages_that_end_standing_still_are_judged_apart(capsys: pytest.CaptureFixture[str]) -> None:
    # given three outages that end in motion, and one at rest in which a filter ran away
    outages = [
        outage({HELD: (1.0, 0.1), "pitch": (2.0, 0.2)}),
        outage({HELD: (3.0, 0.1), "pitch": (5.0, 0.2)}, start=10.0),
        outage({HELD: (2.0, 0.1), "pitch": (5.0, 0.2)}, start=20.0),
        outage({HELD: (0.5, 0.0), "pitch": (40.0, 4.0)}, start=30.0, standing=True),
    ]
    # when
    parts = apart(outages)
    show({**NOTHING_ELSE, **statistics(outages), **parts}, Console(width=120))
    # then
    assert parts["moving"]["configurations"]["pitch"]["position_error_m"]["mean"] == pytest.approx(4.0)
    assert parts["standing"]["configurations"]["pitch"]["position_error_m"]["mean"] == pytest.approx(40.0)
    # by hand: the differences are -1, -2 and -3
    assert parts["moving"]["paired_t_tests"][0]["position_error_m"]["t"] == pytest.approx(-2 * 3**0.5)
    assert apart(outages[:2])["standing"] is None
    # and the terminal has both, and the test of those in motion
    text = capsys.readouterr().out
    assert "in motion" in text
    assert "standing still" in text
    assert "40.00" in text
    assert "paired t-test, n = 3: in motion," in text
    assert "-3.46" in text
    assert "t below 0: the one named first has the larger error" in text
    # with their units
    assert "position [m]" in text
    assert "speed [m/s]" in text


def test_the_log_of_a_trial_gives_the_trials_estimate_again(tmp_path: Path) -> None:
    # given the log of a trial through sensors and estimator
    request = Request(replace(load("three_waypoint"), duration=20.0))
    build_missing(request)
    with prepared(request) as ready:
        trial.run(request, ready, tmp_path)
    log = read_log(tmp_path / "trial.mcap")
    # when the estimator runs over it again without an outage
    source = open_source(tmp_path)
    again = run_fmu(build_fmu(FourState, build_folder() / "fmi2", 2), source.signals([]), len(log.time), {})
    # then it gives the trial's estimate to the bit, and another one with an outage
    for name in ("north", "east", "speed", "accel_bias"):
        np.testing.assert_array_equal(again[name], log[f"estimator.{name}"], err_msg=name)
    (window,) = source.outages(5, 20).windows
    without = run_fmu(
        build_fmu(FourState, build_folder() / "fmi2", 2), source.signals([window]), len(log.time), {}
    )
    assert not np.array_equal(without["north"], again["north"])
    # and the baseline, which holds the speed of the last fix, errs by the change of the dog's speed
    (replayed,) = replay(source, FOUR, Outages(4, [(10.0, 14.0)], {}, "")).outages
    signals = source.signals([(10.0, 14.0)])
    before = signals.gps_speed[np.flatnonzero(signals.gps_fix & (signals.t < 10.0))[-1]]
    at_end = signals.reference_speed[np.flatnonzero(signals.reference_fix & (signals.t <= 14.0))[-1]]
    assert replayed.errors[HELD][1] == pytest.approx(abs(before - at_end)) != 0.0
    assert replayed.errors["pitch"][1] != 0.0


def test_a_log_without_fixes_has_no_outages(tmp_path: Path) -> None:
    parameters = {"sensors.outage_end": [1000.0]}
    request = Request(replace(load("three_waypoint"), duration=3.0, parameters=parameters))
    build_missing(request)
    with prepared(request) as ready:
        trial.run(request, ready, tmp_path)
    source = open_source(tmp_path / "trial.mcap")
    with pytest.raises(RecordingError, match="no outage of 1 s can be judged; it has no fix"):
        replay(source, FOUR, source.outages(1, 1))


def test_the_log_of_a_trial_without_sensors_is_refused(tmp_path: Path) -> None:
    request = Request(replace(load("two_waypoint"), system="cts", duration=1.0))
    build_missing(request)
    with prepared(request) as ready:
        trial.run(request, ready, tmp_path)
    with pytest.raises(RecordingError, match=r'no signal "sensors.accel_x"; expected a trial with sensors'):
        open_source(tmp_path / "trial.mcap")


@pytest.mark.parametrize(("value", "name"), [("NAN", "nan"), ("-INFINITY", "-inf")])
def test_an_estimate_that_is_not_finite_is_refused_with_its_time(
    tmp_path: Path, value: str, name: str
) -> None:
    # given an estimator that answers no number from 0.08 s on
    variables = [V("accel_x", "input"), V("north"), V("east"), V("speed")]
    path = tiny_fmu(tmp_path / "filter.fmu", variables, f"v[2] = t > 0.05 ? {value} : 1;")
    source = open_source(write(tmp_path / "trial.mcap", walk_of_log(1)))
    # then no error is averaged over it
    with pytest.raises(
        EstimateError, match=rf'filter.fmu: output "east" is {name} at t = 0.08 s; expected a finite'
    ):
        Configuration(path.name, str(path)).run(source.signals([]), 25)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("size", "steps"), [(0.008, [5, 10, 15, 20, 25, 30, 35]), (0.12, [1] * 3 + [2] * 3 + [3])]
)
def test_an_estimator_with_a_step_of_its_own_is_replayed_at_it(
    tmp_path: Path, version: int, size: float, steps: list[int]
) -> None:
    # given an estimator that counts its steps and gives the acceleration of the last one
    variables = [V("accel_x", "input"), V("y"), V("n", type="Integer")]
    step = strict(size) + "v[1] = v[0];"
    path = tiny_fmu(tmp_path / "own.fmu", variables, step, version=version, step_size=size, fixed=True)
    signals = open_source(write(tmp_path / "trial.mcap", walk_of_log(1))).signals([])
    # when
    estimate = run_fmu(path, signals, 7, {})
    # then it takes the signals on the ticks on which it begins a step
    assert estimate["n"].tolist() == steps
    taken = [0, 0, 0, 3, 3, 3, 6] if size > 0.04 else range(7)
    assert estimate["y"].tolist() == [signals.accel_x[tick] for tick in taken]


@pytest.mark.parametrize("size", [0.04, 0.2])
def test_an_estimator_without_feedthrough_gives_what_it_was_before_the_step(
    tmp_path: Path, size: float
) -> None:
    # given one that gives the acceleration of its last step, and whose outputs depend on its state alone
    variables = [V("accel_x", "input"), V("y"), V("n", type="Integer")]
    step = strict(size) + "v[1] = v[0];"
    path = tiny_fmu(tmp_path / "own.fmu", variables, step, step_size=size, fixed=True, depends=False)
    signals = open_source(write(tmp_path / "trial.mcap", walk_of_log(1))).signals([])
    # when
    estimate = run_fmu(path, signals, 12, {})
    # then an answer is there when the step has ended, as in a trial
    every = round(size / 0.04)
    assert estimate["n"].tolist() == [tick // every for tick in range(12)]
    began = [(tick // every - 1) * every for tick in range(12)]
    assert estimate["y"].tolist() == [signals.accel_x[tick] if tick >= 0 else 0 for tick in began]


def test_an_estimator_that_asks_to_end_ends_the_replay(tmp_path: Path) -> None:
    variables = [V("accel_x", "input"), V("y")]
    path = tiny_fmu(tmp_path / "ends.fmu", variables, "v[31] = t > 0.1;", version=3)
    signals = open_source(write(tmp_path / "trial.mcap", walk_of_log(1))).signals([])
    with pytest.raises(FmuError, match=r"^estimator ends\.fmu: asks to end the simulation at t = 0\.12 s$"):
        run_fmu(path, signals, 7, {})


FILTER = [V("gps_north", "input"), V("north"), V("east"), V("speed")]
CRASHES = "*(volatile int *)8 = 1;"


def test_an_fmu_that_crashes_costs_no_other_estimator_its_results(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given three outages, an FMU that crashes in the second of them, and one that does not
    log = write(tmp_path / "trial.mcap", walk_of_log(40))
    bad = tiny_fmu(tmp_path / "bad.fmu", FILTER, f"v[1] = v[0]; if (t > 20) {CRASHES}")
    good = tiny_fmu(tmp_path / "good.fmu", FILTER, "v[1] = v[0];")
    replayed = ("replay", log, "--outage", 5, "--every", 8)
    monkeypatch.setattr("harness.replay.replay.replay_picture", lambda *_, **__: b"")  # seconds to draw
    arguments = ("--estimator", f"six_state,{good}", "--out", tmp_path / "good")
    status, expected, error = canine(capsys, *replayed, *arguments, "--json")
    assert (status, error) == (0, "")
    # when
    arguments = ("--estimator", f"{bad},six_state,{good}", "--out", tmp_path / "out")
    status, result, error = canine(capsys, *replayed, *arguments, "--json")
    # then the others have the same numbers, and it has a verdict
    told = json.loads(result)
    assert status == 1
    verdict = "estimator bad.fmu: fmi2DoStep ended the process at t = 20.04 s: segmentation fault"
    assert told["verdicts"] == {"bad.fmu": verdict}
    assert error == f"canine: {verdict}\n"
    assert len(told["outages"]) > 2
    for part in ("configurations", "paired_t_tests", "moving", "outages"):
        assert told[part] == json.loads(expected)[part]
    # and the table has both
    status, text, error = canine(capsys, *replayed, *arguments)
    rows = {line.split()[0]: line.split()[1:3] for line in text.splitlines() if ".fmu" in line}
    assert (status, rows["bad.fmu"]) == (1, ["failed", "-"])
    mean = told["configurations"]["good.fmu"]["position_error_m"]["mean"]
    assert rows["good.fmu"] == [str(len(told["outages"])), f"{mean:.2f}"]
    assert error.count("ended the process") == 1


def test_fmus_that_all_fail_are_all_named(tmp_path: Path) -> None:
    source = open_source(write(tmp_path / "trial.mcap", walk_of_log(40)))
    paths = [tiny_fmu(tmp_path / f"{name}.fmu", FILTER, "return 3;") for name in ("one", "two")]
    with pytest.raises(CanineError, match=r"one\.fmu: fmi2DoStep .*\n.*two\.fmu: fmi2DoStep returned error"):
        replay(source, compare(",".join(map(str, paths))), source.outages(5, 8))


def test_an_estimator_of_ours_that_fails_ends_the_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given one of ours that answers no number, beside others
    source = open_source(write(tmp_path / "trial.mcap", walk_of_log(40)))
    estimate = Configuration._estimate

    def spoiled(configuration: Configuration, *arguments: Any) -> dict[str, Any]:
        values = estimate(configuration, *arguments)
        return {n: v * np.nan if configuration.name == "pitch" else v for n, v in values.items()}

    monkeypatch.setattr(Configuration, "_estimate", spoiled)
    # then nobody takes its absence for a result
    with pytest.raises(EstimateError, match=r'^pitch: output "north" is nan'):
        replay(source, FOUR, source.outages(5, 8))


def test_what_was_left_out_or_dropped_is_told_in_all_places(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a walk with a bad fix and a hole of fixes
    signals = walk_of_log(40)
    signals["gps_north"][round(7 / 0.04)] = np.nan
    signals["gps_fix"][round(24 / 0.04) : round(26 / 0.04)] = 0
    source = replace(open_source(write(tmp_path / "trial.mcap", signals)), broken="the file ends early")
    chosen = source.outages(5, 5)
    drawn: dict[str, Any] = {}
    monkeypatch.setattr(
        "harness.replay.replay.replay_picture", lambda *_, **words: drawn.update(words) or b""
    )
    # when
    result = report(source, FOUR, chosen, replay(source, FOUR, chosen), tmp_path)
    show(result, Console(width=120))
    # then the file, the picture and the terminal have the numbers by cause
    written = json.loads((tmp_path / "outages.json").read_text())
    assert written["dropped"] == {"fixes with a value that is not finite": 1}
    assert written["left_out"] == {"no fix near the end": 1, "fixes missing before the start": 1}
    assert written["broken"] == "the file ends early"
    lines = (
        "left out: 2 outages: 1 × no fix near the end, 1 × fixes missing before the start\n"
        "dropped: 1 × fixes with a value that is not finite\n"
    )
    assert lines in capsys.readouterr().out
    assert drawn["not_used"] == lines + "not whole: the file ends early"


def test_rows_that_set_has_changed_are_marked_and_the_title_has_the_estimators_that_are_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a walk without a magnetometer, and a parameter that both configurations of one estimator get
    source = open_source(write(tmp_path / "trial.mcap", walk_of_log(40)))
    chosen = source.outages(5, 5)
    comparison = compare("six_state,seven_state,two_bias", ["two_bias.gate=9"])
    drawn: list[Any] = []

    def draw(*these: Any, **words: Any) -> bytes:
        drawn.extend((these, words))
        return b""

    monkeypatch.setattr("harness.replay.replay.replay_picture", draw)
    # when
    result = report(source, comparison, chosen, replay(source, comparison, chosen), tmp_path)
    show(result, Console(width=120))
    # then the file, the table and the picture say which rows these are, and what was set
    assert result["set"] == {key: ["two_bias.gate=9"] for key in ("two_bias", "two_bias, floor, cap")}
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("  ")[0] for line in lines[2:7]] == [
        "speed held", "mean speed", "six_state", "two_bias *", "two_bias, floor, cap *"
    ]  # fmt: skip
    assert "* with --set two_bias.gate=9" in lines
    (_, estimates, errors), words = drawn
    assert list(estimates) == list(errors)
    assert list(estimates)[3:] == ["two_bias *", "two_bias, floor, cap *"]
    assert words["title"] == "trial: six_state, two_bias through outages of 5 s"
    assert words["not_used"] == "* with --set two_bias.gate=9"


def test_statistics_of_three_outages_are_those_found_by_hand() -> None:
    # given three outages with errors of 1, 3 and 5 m against 2, 5 and 8 m
    outages = [
        outage({"a": (1.0, 0.0), "b": (2.0, 0.0)}),
        outage({"a": (3.0, 0.0), "b": (5.0, 0.0)}, start=10.0),
        outage({"a": (5.0, 0.0), "b": (8.0, 0.0)}, start=20.0),
    ]
    result = statistics(outages)
    # then mean 3, sd 2, median 3, p90 = 3 + 0.8 * 2
    a = result["configurations"]["a"]["position_error_m"]
    assert a == pytest.approx({"mean": 3.0, "sd": 2.0, "median": 3.0, "p90": 4.6})
    # differences -1, -2 and -3: mean -2, sd 1, so t = -2 / (1 / sqrt(3))
    (pair,) = result["paired_t_tests"]
    assert pair["position_error_m"]["t"] == pytest.approx(-2 * 3**0.5)
    assert pair["n"] == 3
    # velocities that never differ have no t
    assert pair["velocity_error_m_s"] == {"t": None, "p": None}
    # and of two outages there is no test
    (pair,) = statistics(outages[:2])["paired_t_tests"]
    assert (pair["n"], pair["position_error_m"], pair["velocity_error_m_s"]) == (2, None, None)


@pytest.mark.parametrize("least", [1e-200, 1e-10])
def test_differences_of_less_than_a_nanometre_are_none(least: float) -> None:
    # t would be infinite, or 1, and p 0, or 0.36, where nothing differs
    assert paired_t_test(np.array([0, 0, 0, 0, least, 0])) is None
    assert paired_t_test(np.array([0, 0, 0, 0, 1e-3, 0])) is not None


def test_outages_that_overlap_an_earlier_one_are_left_out_of_the_t_test() -> None:
    # given four outages of which the second shares half of the first
    errors = [{"a": (e, 0.0), "b": (2 * e, 0.0)} for e in (1.0, 50.0, 2.0, 3.0)]
    outages = [outage(e, start) for e, start in zip(errors, (0.0, 5.0, 10.0, 20.0), strict=True)]
    # then the test is of the others, as by hand above, and the mean of all
    result = statistics(outages)
    assert result["paired_t_tests"][0]["position_error_m"]["t"] == pytest.approx(-2 * 3**0.5)
    assert result["configurations"]["a"]["position_error_m"]["mean"] == pytest.approx(14.0)


def test_a_single_outage_has_no_spread_and_no_test(capsys: pytest.CaptureFixture[str]) -> None:
    result = statistics([outage({"a": (1.0, 0.5), "b": (2.0, 0.5)})])
    assert result["configurations"]["a"]["position_error_m"]["sd"] is None
    show({**NOTHING_ELSE, **result}, Console())
    assert "-" in capsys.readouterr().out


def test_a_folder_without_a_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"expected one file"):
        open_source(tmp_path)
