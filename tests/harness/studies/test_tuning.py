"""Random set-ups: what is drawn, how a share is judged, what holds in a few of them (3.3)."""

from __future__ import annotations

import io
import math
from typing import Any

import pytest
from rich.console import Console

from harness.report.figures import charts_of
from harness.studies import tuning
from harness.studies.published import FUZZY, NO_PITCH, PITCH
from harness.studies.study import Options, run_study
from harness.studies.tuning import FACTORS, draw_setup


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tuning, "TRIALS", 12)
        return run_study("tuning", Options(seeds=14))


def answer(result: dict[str, Any], second: str) -> dict[str, Any]:
    (answer,) = (answer for answer in result["questions"] if answer["second"] == second)
    assert answer["first"] == {FUZZY: PITCH, PITCH: NO_PITCH}[second]
    return dict(answer)


def test_setups_are_drawn_within_their_ranges_the_same_for_the_same_seed() -> None:
    setups = [draw_setup(seed) for seed in range(1, 200)]
    assert draw_setup(7) == setups[6]
    for name, factor in FACTORS.items():
        values = [setup[name] for setup in setups]
        scale = math.pi / 180 if factor.unit == "deg" else 1
        slack = 1e-4 * max(abs(factor.low), factor.high) * scale  # of the rounding to five digits
        assert factor.low * scale - slack <= min(values)
        assert max(values) <= factor.high * scale + slack
        assert len(set(values)) > 150
    # half of the draws of a logarithmic range lie below its geometric mean: 1 of 0.1 to 10
    below = sum(setup["estimator.initial_bias_variance"] < 1 for setup in setups)
    assert 75 < below < 125


def test_no_two_setups_share_a_trial() -> None:
    seeds = [seed for number in (1, 2, 3, 500) for seed in tuning.trial_seeds(number)]
    assert len(set(seeds)) == len(seeds) == 4 * tuning.TRIALS


def test_a_p_that_rounds_to_0_is_significant_and_none_is_not() -> None:
    rows = [{"p": {"a, b": p}} for p in (0.0, 0.04, 0.06, None)]
    assert tuning._significant(rows, "a", "b").tolist() == [True, True, False, False]


def test_pitch_helps_in_nearly_every_setup_and_most_where_pitch_wanders(result: dict[str, Any]) -> None:
    pitch = answer(result, PITCH)
    assert pitch["better"]["share"] > 0.8
    assert pitch["rank_correlation"]["plant.pitch_wander"] < -0.5


def test_fuzzy_loses_where_the_dog_is_fast(result: dict[str, Any]) -> None:
    fuzzy = answer(result, FUZZY)
    assert fuzzy["better"]["share"] < 0.5
    assert fuzzy["rank_correlation"]["walk.speed"] > 0.3


def test_a_share_counts_the_setups_whose_mean_error_is_smaller(result: dict[str, Any]) -> None:
    rows = result["rows"]
    smaller = sum(row["mean_error"][FUZZY][0] < row["mean_error"][PITCH][0] for row in rows)
    assert answer(result, FUZZY)["better"]["share"] == smaller / len(rows)


def test_the_nearest_setup_is_the_one_whose_worst_mean_is_least_off(result: dict[str, Any]) -> None:
    text = {"accelerometer and heading": (340.4, 39.6), NO_PITCH: (21.5, 5.1), PITCH: (11.6, 2.8)}
    off = [
        max(
            max(ours / theirs, theirs / ours)
            for title, published in text.items()
            for ours, theirs in zip(row["mean_error"][title], published, strict=True)
        )
        for row in result["rows"]
    ]
    assert result["nearest"][0]["off_by"] == pytest.approx(min(off), abs=1e-3)
    assert result["nearest"][0]["setup"] == off.index(min(off)) + 1


def test_table_and_picture_state_the_shares(result: dict[str, Any]) -> None:
    text = io.StringIO()
    tuning.show(result, Console(file=text, width=200))
    assert "fuzzy against pitch" in text.getvalue()
    (figure,) = tuning.draw(result).values()
    assert all(chart["marks"] for grid in charts_of(figure) for chart in grid)
    assert len(figure.axes) == 4


def test_set_ups_that_are_significantly_better_and_worse_are_told_apart() -> None:
    # given errors of a to b: half, by chance too; twice, three times, and one and a half times by chance
    pairs = [(2.0, 1.0, 0.01), (2.0, 1.0, 0.6), (1.0, 2.0, 0.02), (1.0, 3.0, 0.04), (1.0, 1.5, 0.3)]
    rows = [{"mean_error": {"a": [a, 0.0], "b": [b, 0.0]}, "p": {"a, b": p}} for a, b, p in pairs]
    answer = tuning._answer("a", "b", [draw_setup(seed) for seed in range(1, 6)], rows)
    # then
    shares = [answer[key]["share"] for key in ("better", "significantly_better", "significantly_worse")]
    assert shares == [0.4, 0.2, 0.4]
    assert answer["median_ratio"] == 1.5


def test_the_legend_covers_no_point(result: dict[str, Any]) -> None:
    (figure,) = tuning.draw(result).values()
    assert [axes.get_legend() for axes in figure.axes] == [None] * 4
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["significant", "not significant"]
