"""NEES, NIS, whiteness and coverage: in the filter's own world as theory says, elsewhere as it comes out."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from harness.report.figures import charts_of
from harness.studies import consistency
from harness.studies.consistency import ALONE, OWN, TOGETHER, Trial, judge
from harness.studies.innovations import Innovations
from harness.studies.study import Options, run_study
from models.errors import UsageError
from models.system import ESTIMATORS

RIGHT, TEXT = "four_state, sigma 0.2", "four_state, sigma 0.1 (D.7)"


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    return run_study("consistency", Options(seeds=30, set="ideal"))


def test_a_filter_in_its_own_world_is_consistent(result: dict[str, Any]) -> None:
    row = result["worlds"][OWN][RIGHT]
    assert row["nis"] == pytest.approx(3.0, abs=0.15)  # 30 trials of 120 fixes: 3 standard errors
    assert row["nees"] == pytest.approx(4.0, abs=3 * np.sqrt(8 / 30))
    assert max(abs(r) for r in row["autocorrelation"]) < 3 * row["autocorrelation_bound"]
    # what 1 and 2 deviations are to hold: 68.3 and 95.4 % of 30 trials, by 3 standard errors
    for key in ("position_within", "speed_within"):
        one, two = row[key]
        assert (one["expected"], two["expected"]) == pytest.approx((0.6827, 0.9545), abs=1e-4)
        assert one["share"] == pytest.approx(0.683, abs=0.26)
        assert two["share"] > 0.85


def test_with_the_text_s_process_noise_it_says_more_than_it_knows(result: dict[str, Any]) -> None:
    row = result["worlds"][OWN][TEXT]
    assert row["nis"] > 1.3 * 3
    assert row["position_within"][0]["share"] < result["worlds"][OWN][RIGHT]["position_within"][0]["share"]
    assert row["autocorrelation"][0] > 2 * row["autocorrelation_bound"]


def test_every_estimator_is_judged_in_a_set(result: dict[str, Any]) -> None:
    assert list(result["worlds"]) == [OWN, "ideal"]
    assert list(result["worlds"]["ideal"]) == list(TOGETHER)
    assert set(ESTIMATORS) - {"four_state"} <= set(TOGETHER)
    assert all(row["fixes"] > 30 * 80 for row in result["worlds"]["ideal"].values())


def test_coverage_counts_errors_inside_the_ellipse() -> None:
    # given errors of position 0, 1.5 and 3 m north, with a covariance of 1 m2: the ellipses of 1 and 2
    # deviations hold 68.3 and 95.4 %, which in two dimensions are 1.515 and 2.486 m
    def trial(north: float) -> Trial:
        errors = np.array([0.0, 0.0, north, 0.0])
        innovations = Innovations(np.arange(20.0), np.ones((20, 3)), np.ones((20, 3)))
        return Trial(innovations, (errors, errors), (np.eye(4), np.eye(4)), True, 0.5)

    row = judge([trial(0.0), trial(1.51), trial(1.52), trial(2.48), trial(2.49)])
    assert [within["share"] for within in row["position_within"]] == pytest.approx([0.4, 0.8])
    assert row["nis"] == pytest.approx(3.0)
    assert row["nees"] == pytest.approx((1.51**2 + 1.52**2 + 2.48**2 + 2.49**2) / 5)
    assert (row["states"], row["bias_error_per_sd"]) == (4, 0.5)
    # and of the 5 * 20 fixes with three values each, 95 % of correlations are within 1.96 / sqrt(300)
    assert row["autocorrelation_bound"] == pytest.approx(1.96 / 300**0.5, rel=1e-4)


def test_innovations_are_judged_once_the_filter_has_settled() -> None:
    # given a trial of 50 s whose last 10 s have no fixes, at 4 Hz: 120 fixes from 10 s on
    for trial in consistency.OwnWorld().run(1).values():
        assert trial.innovations.time.min() == pytest.approx(10.0, abs=0.25)
        assert trial.innovations.time.min() >= 10.0
        assert len(trial.innovations.time) == pytest.approx(120, abs=2)


def test_where_the_second_state_is_not_the_bias_alone_nees_leaves_it_out() -> None:
    # given an error of 10 deviations in that state, and of 1 m north
    errors = np.array([0.0, 10.0, 1.0, 0.0])
    innovations = Innovations(np.arange(20.0), np.ones((20, 3)), np.ones((20, 3)))
    rows = [
        judge([Trial(innovations, (errors, errors), (np.eye(4), np.eye(4)), has_bias, 0.5)])
        for has_bias in (True, False)
    ]
    assert [(row["nees"], row["states"]) for row in rows] == [(101.0, 4), (1.0, 3)]


def test_tables_and_picture_have_each_world(result: dict[str, Any]) -> None:
    text = io.StringIO()
    consistency.show(result, Console(file=text, width=160))
    assert all(f"world: {world}" in text.getvalue() for world in result["worlds"])
    assert all(name in text.getvalue() for name in (*ALONE, *TOGETHER))
    (figure,) = consistency.draw(result).values()
    assert len(figure.axes) == 4
    assert all(chart["marks"] for grid in charts_of(figure) for chart in grid)


def test_a_set_that_does_not_exist_is_refused() -> None:
    with pytest.raises(UsageError, match=r'there is no set "idael"; did you mean "ideal"\?'):
        run_study("consistency", Options(seeds=2, set="idael"))
