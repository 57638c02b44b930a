"""The study of outages: what must hold on the sets, statistics by another way, the text's own numbers."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from scipy import stats

from harness.recording.recording import RecordingError
from harness.replay.comparison import HELD
from harness.report.figures import charts_of
from harness.studies import outage, published
from harness.studies.outage import MEAN, OURS
from harness.studies.paths import GAITS, walk
from harness.studies.published import FUZZY, INERTIAL, NO_PITCH, PITCH
from harness.studies.statistics import paired, share, summary, unpaired
from harness.studies.study import Options, run_study
from harness.studies.tracking import Configuration, Tracking, Trial
from models.errors import UsageError
from models.four_state import FourState
from models.profile import Profile


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    return run_study("outage", Options(seeds=70, set="dissertation"))


def mean(result: dict[str, Any], title: str, column: str, gait: str = "detection") -> float:
    mean_error: float = result["sets"]["dissertation"][gait]["configurations"][title][column]["mean"]
    return mean_error


@pytest.mark.parametrize("title", [INERTIAL, NO_PITCH, PITCH])
def test_the_set_near_the_text_is_near_its_table_of_errors(result: dict[str, Any], title: str) -> None:
    text = published.OUTAGE[title]
    assert 1 / 1.3 < mean(result, title, "position_error_m") / text.position < 1.3
    assert 1 / 1.3 < mean(result, title, "speed_error_m_s") / text.speed < 1.3


def test_pitch_helps_significantly_and_so_does_gps(result: dict[str, Any]) -> None:
    tests = {
        (t["first"], t["second"]): t for t in result["sets"]["dissertation"]["detection"]["paired_t_tests"]
    }
    for pair in ((INERTIAL, NO_PITCH), (NO_PITCH, PITCH)):
        for column in outage.COLUMNS:
            assert tests[pair][column]["difference"] > 0
            assert tests[pair][column]["df"] == 69
            assert tests[pair][column]["p"] < 0.01


def test_a_speed_that_wanders_about_its_mean_is_hard_to_beat(result: dict[str, Any]) -> None:
    for title in (HELD, MEAN):
        assert mean(result, title, "position_error_m") < mean(result, PITCH, "position_error_m")
    assert mean(result, OURS, "position_error_m") < 0.5 * mean(result, PITCH, "position_error_m")


def test_fuzzy_tuning_loses_running_unless_sigma_has_a_cap(result: dict[str, Any]) -> None:
    at_run = {
        title: mean(result, title, "position_error_m", "running")
        for title in (PITCH, FUZZY, f"{FUZZY}, floors and cap")
    }
    assert at_run[FUZZY] > 3 * at_run[PITCH]
    assert at_run[f"{FUZZY}, floors and cap"] < 0.5 * at_run[FUZZY]


def test_the_table_has_the_text_s_numbers_in_brackets(result: dict[str, Any]) -> None:
    text = io.StringIO()
    outage.show(result, Console(file=text, width=300))
    lines = text.getvalue().splitlines()
    (line,) = (line for line in lines if line.startswith("fuzzy ") and "(7.5)" in line)
    assert "(5.7)" in line
    assert "(1.2)" in line
    assert sum(line.startswith(f"{OURS} ") for line in lines) == 2  # both gaits


def test_pictures_are_drawn_of_the_means_and_of_a_trial_of_each_gait(result: dict[str, Any]) -> None:
    figures = outage.draw(result)
    assert all(chart["marks"] for f in figures.values() for grid in charts_of(f) for chart in grid)
    assert list(figures) == ["outage", "outage_detection", "outage_running"]
    assert [len(figure.axes) for figure in figures.values()] == [2, 4, 4]


def test_an_unknown_set_is_refused_by_name() -> None:
    with pytest.raises(UsageError, match='there is no set "ideel"; did you mean "ideal"'):
        run_study("outage", Options(set="ideel"))


def test_the_text_s_unpaired_p_follows_from_its_means_and_deviations() -> None:
    # Table 3.1 by Student's own formula: 0.0115 and 0.0001
    a, b = published.OUTAGE[PITCH], published.OUTAGE[FUZZY]
    pair = published.UNPAIRED[PITCH, FUZZY]
    for (mean_a, sd_a, mean_b, sd_b), p in zip(
        (
            (a.position, a.position_sd, b.position, b.position_sd),
            (a.speed, a.speed_sd, b.speed, b.speed_sd),
        ),
        pair,
        strict=True,
    ):
        computed = stats.ttest_ind_from_stats(mean_a, sd_a, a.n, mean_b, sd_b, b.n).pvalue
        assert computed == pytest.approx(p, rel=0.1, abs=1e-4)


def test_statistics_of_a_few_numbers_are_those_by_hand() -> None:
    # 1, 2, 3, 6: mean 3, deviations -2 -1 0 3, variance 14/3; t(3; 97.5 %) = 3.1824
    values = summary(np.array([1.0, 2.0, 3.0, 6.0]))
    assert values["mean"] == 3
    assert values["sd"] == pytest.approx((14 / 3) ** 0.5)
    assert values["median"] == 2.5
    assert values["mean_high"] - 3 == pytest.approx(3.1824 * (14 / 3) ** 0.5 / 2, rel=1e-4)
    # differences 1, 1, 3, 3: mean 2, deviation 2/sqrt(3); t = 2 / (2 / sqrt(3) / 2)
    test = paired(np.array([2.0, 3.0, 5.0, 6.0]), np.array([1.0, 2.0, 2.0, 3.0]))
    assert test["t"] == pytest.approx(2 * 3**0.5)
    assert test["df"] == 3
    assert paired(np.ones(3), np.zeros(3)) == {"difference": 1.0, "t": None, "df": 2, "p": None}
    # pooled variance of 0, 2 and 4, 6 is 2: t = -4 / sqrt(2 * (1/2 + 1/2))
    assert unpaired(np.array([0.0, 2.0]), np.array([4.0, 6.0]))["t"] == pytest.approx(-4 / 2**0.5)
    # one value each, or values that do not vary: no variance, no t
    assert unpaired(np.array([0.0]), np.array([4.0])) == {"t": None, "df": 0, "p": None}
    assert unpaired(np.array([1.0, 1.0]), np.array([2.0, 2.0])) == {"t": None, "df": 2, "p": None}
    assert share(0, 10)["high"] == pytest.approx(1.96**2 / (10 + 1.96**2), rel=1e-3)  # Wilson


@pytest.mark.parametrize("gait", GAITS)
def test_a_path_is_the_same_for_the_same_seed_and_as_long_as_the_text_s(gait: str) -> None:
    path, again, other = walk(GAITS[gait], 5), walk(GAITS[gait], 5), walk(GAITS[gait], 6)
    assert path.north.tobytes() == again.north.tobytes()
    assert path.north[:50].tobytes() != other.north[:50].tobytes()
    assert 1000 <= len(path.north) <= 1125  # 40 to 45 s
    steps = np.hypot(np.diff(path.north), np.diff(path.east)) / 0.04
    assert steps[200:].mean() == pytest.approx(GAITS[gait].speed, rel=0.25)
    assert steps[0] < 0.1  # from rest


def test_references_follow_accelerometer_heading_and_fixes() -> None:
    # given straight motion to the east at 1 m/s without noise: every reference is exact but for its speed
    tracking = Tracking("one", Profile, {"pitch": Configuration(FourState, {"fuzzy": 0})})
    profile = {
        "start_heading": np.pi / 2,
        "start_speed": 1.0,
        "duration[1]": 5.0,
        "acceleration_profile[1]": 0.0,
    }
    profile |= {"duration[2]": 0.0, "duration[3]": 0.0, "pitch_profile[3]": 0.0}
    one = tracking.run(251, 1, {}, {"plant": profile, "sensors": {"noisy": 0}}, outage=4.0)
    assert one.truth["east"][-1] == pytest.approx(10.0)
    assert one.time[one.last_fix] < 6.0
    assert one.held()["east"][-1] == pytest.approx(10.0)
    assert one.held(2.0)["speed"][-1] == pytest.approx(1.0)
    assert one.position_error(one.held())[-1] == pytest.approx(0.0, abs=1e-9)
    assert one.inertial()["speed"][-1] == pytest.approx(0.0, abs=1e-9)  # from rest: it knows no speed
    assert one.position_error(one.inertial())[-1] == pytest.approx(10.0)
    assert one.speed_error(one.inertial())[-1] == pytest.approx(1.0)


def test_a_recorded_path_drives_the_trials(tmp_path: Path) -> None:
    # given 100 s of a walk to the north at 1.2 m/s that swings to the east: three trials of 30 s
    time = np.arange(1001) / 10
    rows = "\n".join(f"{t:.1f},{2 * np.sin(0.3 * t):.4f},{1.2 * t:.4f}" for t in time)
    (tmp_path / "dog.csv").write_text(f"t_s,x_m,y_m\n{rows}\n")
    result = run_study("outage", Options(set="ideal", recording=tmp_path / "dog.csv"))
    assert result["seeds"] == 3
    (gait, values) = next(iter(result["sets"]["ideal"].items()))
    assert gait == outage.RECORDED
    truth = values["sample"]["truth"]
    assert (truth["north"][0], truth["east"][0]) == (0, 0)
    assert truth["north"][-1] == pytest.approx(1.2 * 29.92, abs=0.1)
    # then speed and heading keep the animal within a few metres over 10 s, of which it goes 13 m
    assert values["configurations"][HELD]["position_error_m"]["mean"] < 5
    # and neither table nor pictures name the text's figures, which are those of another walk
    text = io.StringIO()
    outage.show(result, Console(file=text, width=200))
    assert "(21.5)" not in text.getvalue()
    words = " ".join(text.getvalue().split())
    assert (
        "3 trials: the path has 3 stretches without a jump or overlap, each of 30 s and for one trial"
        in words
    )
    assert set(outage.draw(result)) == {"outage", "outage_recorded_path"}


def test_two_trials_are_too_few_for_a_test_of_their_halves() -> None:
    result = run_study("outage", Options(seeds=2, set="ideal"))
    json.dumps(result, allow_nan=False)
    text = io.StringIO()
    outage.show(result, Console(file=text, width=200))
    assert "in position, unpaired: halves of the trials too few for a test" in text.getvalue()
    assert "stretches" not in text.getvalue()


def test_a_folder_is_no_path(tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as refusal:
        run_study("outage", Options(recording=tmp_path))
    assert str(refusal.value) == (
        f"{tmp_path}: is a folder; expected a csv of positions with the columns t_s, x_m, y_m, "
        "or a trial's log"
    )


def test_a_path_of_one_stretch_is_refused(tmp_path: Path) -> None:
    rows = "\n".join(f"{t:.1f},0,{t:.1f}" for t in np.arange(500) / 10)
    (tmp_path / "dog.csv").write_text(f"t_s,x_m,y_m\n{rows}\n")
    with pytest.raises(RecordingError, match="got one stretch of 30 s without a jump; expected two"):
        run_study("outage", Options(set="ideal", recording=tmp_path / "dog.csv"))


def test_the_mean_speed_is_that_of_the_fixes_of_its_time() -> None:
    # given fixes after 0, 1 and 2 s at 1, 2 and 4 m/s, heading east, and 1 s without
    ticks = 76
    fix = np.isin(np.arange(ticks), (0, 25, 50)).astype(float)
    speed = np.repeat([1.0, 2.0, 4.0], [25, 25, 26])
    zeros = np.zeros(ticks)
    sensed = {"gps_fix": fix, "gps_speed": speed, "gps_north": zeros, "gps_east": zeros + 5.0}
    one = Trial({}, {**sensed, "heading_meas": zeros + np.pi / 2, "accel_x": zeros}, {})
    assert one.last_fix == 50
    assert one.held()["speed"][-1] == 4.0
    assert one.held()["east"][-1] == pytest.approx(5.0 + 4.0)
    assert one.held(1.0)["speed"][-1] == 3.0  # of 2 and 4
    assert one.held(1.0)["east"][-1] == pytest.approx(5.0 + 3.0)
    assert one.held(3.0)["speed"][-1] == pytest.approx(7 / 3)
    assert one.held(1.0)["speed"][49] == 2.0  # before the outage it is the fixes'


def test_the_unpaired_test_is_of_pitch_against_fuzzy(result: dict[str, Any]) -> None:
    # given the errors of 70 trials: the first 35 with pitch against the last 35 with fuzzy, 31 and 36 of them
    for gait in GAITS:
        of_gait = result["sets"]["dissertation"][gait]
        for column, i in zip(outage.COLUMNS, (0, 1), strict=True):
            standard, adaptive = (np.array(of_gait["errors"][title][i]) for title in (PITCH, FUZZY))
            tests = of_gait["unpaired_t_tests"][column]
            for key, of in (("halves", (35, 35, 70)), ("31_and_36", (31, 31, 67))):
                expected = stats.ttest_ind(standard[: of[0]], adaptive[of[1] : of[2]])
                assert tests[key]["t"] == pytest.approx(expected.statistic, abs=0.01), key


def test_draws_in_which_fuzzy_is_worse_are_not_significantly_better() -> None:
    # given errors of 70 trials that are all larger by 10 m with fuzzy, and all smaller by 10 m/s
    errors = np.random.default_rng(1).normal(20, 1, (70, 2))
    tests = outage._unpaired(errors, errors + np.array([10, -10]))
    # then none of the draws, and each of them, is better, and so are all that differ significantly
    shares = [tests[c][key]["share"] for c in outage.COLUMNS for key in ("fuzzy_better", "significantly")]
    assert shares == [0, 0, 1, 1]


def test_unpaired_errors_have_one_variance_as_in_table_3_1() -> None:
    # 0, 2 and 3, 5, 10: means 1 and 6, variances 2 and 13, pooled (2 + 2 * 13) / 3; Welch's t would be -2.17
    test = unpaired(np.array([0.0, 2.0]), np.array([3.0, 5.0, 10.0]))
    assert test["t"] == pytest.approx(-5 / (28 / 3 * (1 / 2 + 1 / 3)) ** 0.5)
    assert test["df"] == 3
