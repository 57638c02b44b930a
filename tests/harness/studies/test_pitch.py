"""The Canine Motion Simulator's incline: where the bias goes with pitch and without (D.6)."""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from rich.console import Console

from harness.report.figures import charts_of
from harness.studies import pitch
from harness.studies.study import Options, run_study
from harness.studies.tracking import Trial


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    return run_study("pitch", Options(seeds=12))


def bias(result: dict[str, Any], title: str, when: str) -> float:
    mean: float = result["configurations"][title][f"bias_m_s2_{when}"]["mean"]
    return mean


def test_without_pitch_the_bias_takes_up_gravity(result: dict[str, Any]) -> None:
    # 0.1 + 9.81 sin 10 deg: 9.81 * 0.17365 = 1.7035
    assert result["asymptote_m_s2"] == pytest.approx(1.8035, abs=1e-4)
    assert bias(result, pitch.NO_PITCH_QUICK, "at_end") == pytest.approx(1.80, abs=0.1)
    assert bias(result, pitch.NO_PITCH_QUICK, "later") == pytest.approx(1.80, abs=0.1)


def test_with_the_text_s_q_the_bias_is_on_its_way_within_the_profile(result: dict[str, Any]) -> None:
    at_end, later = (bias(result, pitch.NO_PITCH, when) for when in ("at_end", "later"))
    assert 1.2 < at_end < 1.5
    assert at_end < later < 1.8


def test_with_pitch_the_bias_stays_near_the_true_one(result: dict[str, Any]) -> None:
    assert bias(result, pitch.PITCH, "at_end") == pytest.approx(0.1, abs=0.1)
    assert bias(result, pitch.PITCH, "later") == pytest.approx(0.1, abs=0.1)


def test_the_sample_is_the_profile_of_the_text(result: dict[str, Any]) -> None:
    # north from rest at 1 m/s2 for 3 s: 4.5 m; then 1 s of turning, and 15 s at 2 m/s to the east
    truth = result["sample"]["truth"]
    time = np.array(result["sample"]["time_s"])
    assert np.interp(3.0, time, truth["speed"]) == pytest.approx(3.0)
    assert truth["speed"][-1] == pytest.approx(2.0)
    assert np.interp(3.0, time, truth["north"]) == pytest.approx(4.5, abs=0.01)
    assert truth["east"][-1] - np.interp(4.0, time, truth["east"]) == pytest.approx(30.0, abs=0.01)


def test_the_table_names_each_configuration_and_the_picture_has_three_panels(result: dict[str, Any]) -> None:
    text = io.StringIO()
    pitch.show(result, Console(file=text, width=200))
    assert all(title in text.getvalue() for title in pitch.CONFIGURATIONS)
    (figure,) = pitch.draw(result).values()
    assert all(chart["marks"] for grid in charts_of(figure) for chart in grid)
    assert len(figure.axes) == 3
    assert figure.get_suptitle() == "The Canine Motion Simulator up an incline of 10 deg (D.6), seed 1"


def test_the_speed_is_judged_over_the_last_five_seconds_of_the_profile() -> None:
    # given a speed error that grows by 0.1 m/s in a second, to 1.9 m/s at 19 s, and a bias that is the time
    time = np.arange(1501) * 0.04
    one = SimpleNamespace(
        estimates={"pitch": {"accel_bias": time}},
        position_error=lambda estimate: 2 * estimate["accel_bias"],
        speed_error=lambda estimate: 0.1 * estimate["accel_bias"],
    )
    # then its mean is that at 16.48 s, in the middle of the ticks from 14 to 18.96 s
    row = pitch._measured(cast("Trial", one))["pitch"]
    assert row == pytest.approx(
        {
            "bias_m_s2_at_end": 19.0, "bias_m_s2_later": 60.0, "position_error_m_at_end": 38.0,
            "speed_error_m_s_last_5_s": 1.648,
        }
    )  # fmt: skip
