"""Tuning by innovations: noise that is known is found again, and what cannot be judged is refused."""

from __future__ import annotations

import io
import json
import re
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from harness.main import run
from harness.recording.recording import RecordingError
from harness.recording.signals import SensorSignals
from harness.replay.comparison import HELD
from harness.replay.outage import Outage
from harness.replay.source import ReplaySource
from harness.studies.innovations import Innovations
from harness.tune import report
from harness.tune.fit import Fit
from harness.tune.judge import compare_errors, doubts, summary_of
from harness.tune.likelihood import Noise, Tuned
from harness.tune.tune import AFTER, BEFORE, CONSTANT, tune
from models.canine_tracker import CanineTracker
from models.errors import UsageError
from models.four_state import FourState
from models.kit.ekf import UNUSED
from models.kit.timing import TICK

POSITION, SPEED, ACCEL = 0.4, 0.08, 1.5  # m, m/s, m/s2 in a sample: the noise that is to be found


def signals(length: float, seed: int = 3) -> SensorSignals:
    """A straight walk whose noise is white, with fixes that state 3.5 m and 0.1 m/s."""
    rng = np.random.default_rng(seed)
    ticks = round(length / TICK)
    k = np.arange(ticks)
    speed = 3.0 + 1.5 * np.sin(0.4 * k * TICK)
    past = np.concatenate([speed[:1], speed[:-1]])
    north = np.cumsum(0.5 * (speed + past) * TICK)
    fix = np.isin(k % 25, (0, 7, 13, 19))
    zeros = np.zeros(ticks)

    def measured(truth: Any, noise: float) -> Any:
        """With white noise; between fixes the last one holds."""
        values = truth + rng.normal(0, noise, ticks)
        return values[np.maximum.accumulate(np.where(fix, k, 0))]

    gps_north, gps_east = measured(north, POSITION), measured(zeros, POSITION)
    gps_speed = measured(speed, SPEED)
    columns: dict[str, Any] = dict.fromkeys(SensorSignals.__dataclass_fields__, zeros)
    columns |= {
        "t": k * TICK, "gps_fix": fix, "reference_fix": fix,
        "accel_x": (speed - past) / TICK + 0.3 + rng.normal(0, ACCEL, ticks),
        "gps_north": gps_north, "gps_east": gps_east, "gps_speed": gps_speed,
        "gps_h_acc": zeros + 3.5, "gps_s_acc": zeros + 0.1,
        "reference_north": gps_north, "reference_east": gps_east, "reference_speed": gps_speed,
    }  # fmt: skip
    return SensorSignals(**{**columns, "origin_latitude": 0.0, "origin_longitude": 0.0})


def source(length: float) -> ReplaySource:
    whole = signals(length)

    def without(windows: Sequence[tuple[float, float]]) -> SensorSignals:
        used = whole.gps_fix.copy()
        for start, end in windows:
            used &= (whole.t < start) | (whole.t > end)
        return replace(whole, gps_fix=used)

    return ReplaySource("made", without)


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    return tune(source(70.0), FourState)


def test_noise_that_is_known_lies_in_the_intervals(result: dict[str, Any]) -> None:
    # eq. 3.16 adds sigma^2 * 0.04 a tick to the speed, which 1.5 m/s2 in a sample moves by 1.5 * 0.04
    truth = {"sigma_constant": ACCEL * 0.04**0.5, "position_sd": POSITION, "speed_sd": SPEED}
    noises = {noise["name"]: noise for noise in result["noises"]}
    for name, value in truth.items():
        low, high = noises[name]["interval"]
        assert low < value < high
        assert high < 2.5 * low or name == "speed_sd"
    # the bias does not move: the recording sets no lower limit to its walk
    assert noises["sigma_bias"]["interval"][0] == 0
    assert noises["sigma_bias"]["interval"][1] < 0.05


def test_the_second_half_finds_the_tuned_filter_consistent(result: dict[str, Any]) -> None:
    before, after = (result["judged"][name] for name in (BEFORE, AFTER))
    assert after["nis_bounds"][0] < after["nis"] < after["nis_bounds"][1]
    assert not before["nis_bounds"][0] < before["nis"] < before["nis_bounds"][1]
    assert after["log_likelihood_per_fix"] > before["log_likelihood_per_fix"] + 1
    assert result["fitted_on_s"][1] == result["judged_on_s"][0] == pytest.approx(40.0, abs=0.3)
    assert len(result["outages"]["starts_s"]) == len(
        result["outages"]["ways"][AFTER]["position_error_m"]["each"]
    )
    assert min(result["outages"]["starts_s"]) >= result["judged_on_s"][0]


def test_an_interval_ends_where_the_likelihood_has_fallen_by_half_the_chi_square(
    result: dict[str, Any],
) -> None:
    # twice the loss at 95 %, one degree of freedom: 3.84; the profile crosses it at both ends
    noise = next(n for n in result["noises"] if n["name"] == "position_sd")
    values, losses = np.array(noise["profile"]).T
    for end in noise["interval"]:
        assert np.interp(np.log(end), np.log(values), losses) == pytest.approx(3.84, abs=0.4)


def test_files_hold_what_a_scenario_takes(result: dict[str, Any], tmp_path: Path) -> None:
    report.report(result, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "tune.html", "tune.json", "tune.png", "tune.toml"
    ]  # fmt: skip
    assert json.loads((tmp_path / "tune.json").read_text())["noises"] == result["noises"]
    parameters = tomllib.loads((tmp_path / "tune.toml").read_text())["parameters"]
    assert parameters["four_state.fuzzy"] is False
    # 3.5 m times the scale is the deviation that was fitted, as is the floor
    floor, scale = (parameters[f"four_state.position_sd_{what}"] for what in ("floor", "scale"))
    assert floor == pytest.approx(3.5 * scale, rel=1e-4)
    assert "# the recording sets no lower limit to sigma_bias" in (tmp_path / "tune.toml").read_text()
    text = io.StringIO()
    report.show(result, Console(file=text, width=120))
    assert "position_sd [m]" in text.getvalue()
    assert "outages of 10 s there" in text.getvalue()


@pytest.mark.parametrize(("lag_1", "is_said"), [(0.05, False), (0.15, True), (-0.15, True)])
def test_intervals_over_correlated_innovations_are_said_to_be_too_narrow(
    result: dict[str, Any], lag_1: float, is_said: bool
) -> None:
    tuned = result["judged"][AFTER] | {"autocorrelation": [lag_1], "autocorrelation_bound": 0.1}
    text = io.StringIO()
    judged = {**result["judged"], AFTER: tuned}
    report.show(result | {"judged": judged}, Console(file=text, width=120))
    assert ("they are too narrow" in text.getvalue()) == is_said


def test_a_stated_accuracy_that_varies_has_a_scale_and_a_floor() -> None:
    whole = signals(20.0)
    varied = replace(whole, gps_h_acc=np.where(whole.t < 10, 0.02, 3.0))
    assert [n.name for n in Tuned(FourState, varied).noises][-3:] == [
        "position_sd_scale", "position_sd_floor", "speed_sd"
    ]  # fmt: skip


def test_a_deviation_above_the_stated_one_is_a_floor_that_leaves_the_scale() -> None:
    tuned = Tuned(FourState, signals(20.0))
    values = {noise.name: noise.start for noise in tuned.noises} | {"position_sd": 7.0}
    parameters = tuned.parameters(list(values.values()))
    assert (parameters["position_sd_floor"], parameters["position_sd_scale"]) == (7.0, 0.5)  # eq. 3.15


def test_a_noise_that_is_held_is_not_tuned() -> None:
    tuned = Tuned(FourState, signals(20.0), ["sigma_bias"])
    assert [noise.name for noise in tuned.noises] == ["sigma_constant", "position_sd", "speed_sd"]
    assert "sigma_bias" not in tuned.parameters([0.1, 0.2, 0.3])


def test_a_noise_that_does_not_exist_cannot_be_held() -> None:
    with pytest.raises(UsageError) as refusal:
        Tuned(FourState, signals(20.0), ["sigma_bia"])
    assert str(refusal.value) == (
        "hold sigma_bia: no such noise of four_state is tuned here; expected sigma_constant, sigma_bias, "
        'position_sd, speed_sd; did you mean "sigma_bias"?'
    )


def test_the_summary_has_the_shares_of_each_value() -> None:
    innovations = Innovations(np.arange(30.0), np.tile([1.0, 2.0], (30, 1)), np.tile([1.0, 4.0], (30, 1)))
    summary = summary_of(innovations)
    assert (summary["nis"], summary["nis_expected"]) == (pytest.approx(2.0), 2)
    assert summary["nis_by_value"] == pytest.approx([1.0, 1.0])
    # and where two of three fixes lack the second value, its share is of those that have it
    lacking = np.arange(30) % 3 > 0
    variances = np.column_stack([np.ones(30), np.where(lacking, UNUSED, 4.0)])
    summary = summary_of(Innovations(np.arange(30.0), np.tile([1.0, 2.0], (30, 1)), variances))
    assert summary["nis_by_value"] == pytest.approx([1.0, 1.0])
    assert summary["nis_expected"] == pytest.approx(4 / 3)


def test_a_recording_that_is_too_short_is_refused() -> None:
    with pytest.raises(RecordingError) as refusal:
        tune(source(25.0), FourState)
    assert str(refusal.value) == (
        "made: too short to tune by: 30 fixes in its first half after the first 10 s; "
        "expected at least 40 in each; record longer"
    )


def test_a_search_stays_in_the_declared_ranges() -> None:
    declared = {v.name: v for v in FourState.group("parameter")}
    tuned = Tuned(FourState, signals(20.0))
    for value in (1e-30, 1e30):
        for name, of in tuned.parameters([value] * len(tuned.noises)).items():
            declared[name].check(of, name)


def test_a_recording_whose_fixes_the_estimator_refuses_is_refused() -> None:
    # given accuracies in millimetres that are declared in metres
    whole = source(70.0)
    millimetres = replace(
        whole, signals=lambda w: replace(whole.signals(w), gps_h_acc=np.full(len(whole.signals(w).t), 3500.0))
    )
    with pytest.raises(
        RecordingError, match=r"0 fixes in its first half .* 280 of 280 fixes refused \(gps_h_acc of 3500 m,"
    ):
        tune(millimetres, FourState)


def test_a_second_half_at_rest_has_no_course_and_is_judged_by_the_other_values() -> None:
    # given white innovations of four values, of which no fix has the second
    values = np.random.default_rng(2).normal(0, 1, (200, 4))
    variances = np.ones((200, 4))
    variances[:, 1] = UNUSED
    summary = summary_of(Innovations(np.arange(200.0), values, variances))
    # then the others are as white as they are alone, and JSON can hold it
    alone = summary_of(Innovations(np.arange(200.0), values[:, [0, 2, 3]], np.ones((200, 3))))
    assert summary["autocorrelation"] == pytest.approx(alone["autocorrelation"])
    json.dumps(summary, allow_nan=False)


def test_an_estimator_that_does_not_exist_is_told_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["tune", str(tmp_path), "--estimator", "four_stat"]) == 2
    assert capsys.readouterr().err == (
        'canine: there is no estimator "four_stat"; did you mean "four_state"?\n'
    )


def outages(*positions: tuple[float, float]) -> list[Outage]:
    """Outages apart from each other, with errors of the position before and after, none of them of speed."""
    errors = [{HELD: (0.0, 0.0), "before": (a, 1.0), "tuned": (b, 1.0)} for a, b in positions]
    return [Outage(20.0 * i, 20.0 * i + 10, 0.0, one, {}, np.zeros(0)) for i, one in enumerate(errors)]


def test_errors_that_do_not_differ_have_no_p() -> None:
    # given a tuning that changes the error of the position by as much in each outage, and no speed
    # when
    result = compare_errors(outages((3, 2), (5, 4), (4, 3)), ["before"], "tuned")
    # then there is no t, and no NaN that JSON could not hold
    assert result["position_error_m_p"] == result["velocity_error_m_s_p"] == {"before": None}
    # but where they vary, by 1, 2 and 3, there is one: by hand t = 2 / (1 / sqrt(3)), of 2 degrees of freedom
    result = compare_errors(outages((3, 2), (5, 3), (4, 1)), ["before"], "tuned")
    assert result["position_error_m_p"] == {"before": pytest.approx(0.0742, abs=1e-4)}


def test_outages_that_overlap_an_earlier_one_are_not_tested() -> None:
    apart = outages((3, 2), (5, 3), (4, 1))
    overlapping = [replace(outage, start=outage.start + 5, end=outage.end + 5) for outage in apart]
    both = sorted([*apart, *overlapping], key=lambda outage: outage.start)
    result = compare_errors(both, ["before"], "tuned")
    assert result["apart"] == 3
    assert result["position_error_m_p"] == {"before": pytest.approx(0.0742, abs=1e-4)}
    assert len(result["ways"]["tuned"]["position_error_m"]["each"]) == 6


def shown(result: dict[str, Any]) -> str:
    text = io.StringIO()
    report.show(result, Console(file=text, width=160))
    return text.getvalue()


def test_what_tuning_switches_off_is_a_way_of_its_own(result: dict[str, Any]) -> None:
    # given an estimator that tunes its noise by fuzzy rules, which a tuning switches off
    assert result["ways"][BEFORE] == {}
    assert result["ways"][CONSTANT] == {"fuzzy": 0.0}
    # then it is judged without them, too, by innovations and by outages, and tested against
    assert list(result["judged"]) == list(result["nis"]) == [BEFORE, CONSTANT, AFTER]
    assert list(result["outages"]["ways"]) == [HELD, BEFORE, CONSTANT, AFTER]
    assert list(result["outages"]["position_error_m_p"]) == [BEFORE, CONSTANT]
    assert result["judged"][CONSTANT]["nis"] != result["judged"][BEFORE]["nis"]
    # and the constant that was not in force before stands in brackets
    in_force = {noise["name"]: noise["in_force_before"] for noise in result["noises"]}
    assert in_force == {"sigma_constant": False, "sigma_bias": True, "position_sd": True, "speed_sd": True}
    p = {"position_error_m_p": {BEFORE: 0.2, CONSTANT: 0.3}}
    text = shown({**result, "outages": {**result["outages"], **p}})
    assert re.search(r"sigma_constant \[m/s2\] +\(0\.1\)", text)
    assert "as declared, sigma_constant is not in force: fuzzy rules set sigma by the speed" in text
    assert f"position, {CONSTANT} against {AFTER}: p = 0.3 (paired" in text


def test_a_noise_that_the_estimator_learns_is_not_tuned() -> None:
    tuned = Tuned(CanineTracker, signals(20.0))
    assert [noise.name for noise in tuned.noises] == ["sigma_bias", "position_sd", "speed_sd"]
    assert (tuned.fixed, tuned.idle) == ({}, ())


def test_a_tuning_that_the_second_half_does_not_confirm_says_so(
    result: dict[str, Any], tmp_path: Path
) -> None:
    # given a NIS above its bounds, and one below, and a likelihood below the declared one's
    row = result["judged"][AFTER]
    low, high = row["nis_bounds"]
    assert doubts(result["judged"], AFTER) == result["doubts"] == []
    for nis, what in ((high + 1, "larger"), (low - 1, "smaller")):
        (line,) = doubts({**result["judged"], AFTER: {**row, "nis": nis}}, AFTER)
        # then the lines say so, by the numbers
        assert line == (
            f"the second half does not confirm the tuning: its NIS is {nis:.3g}, expected {low:.2f} to "
            f"{high:.2f}; the innovations are {what} there than it states"
        )
    unlikely = {**result["judged"], AFTER: {**row, "log_likelihood_per_fix": -1e3}}
    lines = doubts(unlikely, AFTER)
    ends = [line.rpartition(": ")[2] for line in lines]
    assert ends == [f"{name} is more likely there" for name in (BEFORE, CONSTANT)]
    # and so do the table and the file of parameters
    assert lines[0] in shown({**result, "doubts": lines})
    report.report({**result, "doubts": lines}, tmp_path)
    written = (tmp_path / "tune.toml").read_text()
    assert f"# {lines[0]}" in written
    assert tomllib.loads(written)["parameters"]


def likely(log_likelihood: float) -> Innovations:
    """One innovation of this log-likelihood, 40 at most: its variance gives 40, its value takes the rest."""
    variance = np.exp(-80.0) / (2 * np.pi)
    value = np.sqrt(2 * (40 - log_likelihood) * variance)
    return Innovations(np.zeros(1), np.full((1, 1), value), np.full((1, 1), variance))


class TwoHills:
    """A likelihood of two noises: a maximum of 0 where both are 1, one of 30 where the first is 1e-4."""

    block = FourState

    def innovations(self, parameters: dict[str, float], ticks: int | None = None) -> Innovations:
        first, second = (np.log10(parameters[name]) for name in ("sigma_a", "sigma_b"))
        log_likelihood = max(-0.2 * first**2, 30 - 20 * (first + 4) ** 2) - 20 * second**2
        return likely(log_likelihood)


class TwoNoises:
    noises: tuple[Noise, ...] = (Noise("sigma_a", "1", 1.0, 1.0), Noise("sigma_b", "1", 1.0, 1.0))

    def parameters(self, values: Sequence[float]) -> dict[str, float]:
        return dict(zip(("sigma_a", "sigma_b"), values, strict=True))


def test_a_maximum_that_a_profile_finds_is_taken() -> None:
    # given two maxima, of which the search from the declared noise finds the lower one
    fit = Fit(TwoHills(), TwoNoises(), 0.0, 1.0)  # type: ignore[arg-type]
    # then the profile, which walks over the higher one, leads there, and no value of it is below zero
    assert fit.noises[0].value == pytest.approx(1e-4, rel=0.05)
    assert fit.settled
    assert min(fit.noises[0].profile.values()) > -0.05
    assert 0 < fit.noises[0].low < 1e-4 < fit.noises[0].high < 1


def test_noise_without_a_likelihood_is_not_taken_for_a_good_one() -> None:
    class Broken(TwoHills):
        def innovations(self, parameters: dict[str, float], ticks: int | None = None) -> Innovations:
            if parameters["sigma_a"] < 0.5:
                return likely(float("nan"))
            return super().innovations(parameters, ticks)

    fit = Fit(Broken(), TwoNoises(), 0.0, 1.0)  # type: ignore[arg-type]
    assert 0.5 <= fit.noises[0].low < 1
    assert all(np.isfinite(loss) for loss in fit.noises[0].profile.values())


def test_one_noise_alone_can_be_tuned() -> None:
    class One(TwoNoises):
        noises = TwoNoises.noises[1:]

        def parameters(self, values: Sequence[float]) -> dict[str, float]:
            return {"sigma_a": 1.0, "sigma_b": values[0]}

    fit = Fit(TwoHills(), One(), 0.0, 1.0)  # type: ignore[arg-type]
    # twice the loss is 40 decades squared: 3.84 at 0.31 decades
    assert np.log10(fit.noises[0].high) == pytest.approx(0.31, abs=0.01)


def test_the_picture_labels_few_values_and_says_where_there_is_no_outage(result: dict[str, Any]) -> None:
    without = report.figure({**result, "outages": None})
    texts = [text.get_text() for axes in without.axes for text in axes.texts]
    assert texts == ["no outage of 10 s\ncan be judged here"]
    # by hand: a narrow axis has 1, 2, 5 times powers of ten, a broad one every second power
    assert report._ticks(0.04, 0.11) == pytest.approx([0.05, 0.1])
    assert report._ticks(1e-7, 1.0) == pytest.approx([1e-7, 1e-5, 1e-3, 1e-1])
    assert report._ticks(0.31, 0.39) == [0.31, 0.39]
    for axes in report.figure(result).axes[-len(result["noises"]) :]:
        assert 1 < len(axes.get_xticks()) <= 4
