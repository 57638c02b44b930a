"""The heading through an outage, with a magnetometer and without (Appendix C)."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from harness.report.figures import charts_of
from harness.studies import heading
from harness.studies.study import Options, run_study
from models.errors import UsageError


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    return run_study("heading", Options(seeds=16, set="dissertation"))


def error(result: dict[str, Any], carrier: str, title: str) -> float:
    mean: float = result["carriers"][carrier]["heading_error_deg"][title]["mean"]
    return mean


@pytest.mark.parametrize("carrier", ["pedestrian", "canine, set dissertation"])
def test_a_magnetometer_improves_the_heading(result: dict[str, Any], carrier: str) -> None:
    assert error(result, carrier, heading.WITH) < error(result, carrier, heading.WITHOUT)
    change = result["carriers"][carrier]["improvement_percent"]["of_means"]
    ratio = error(result, carrier, heading.WITH) / error(result, carrier, heading.WITHOUT)
    assert change == pytest.approx(100 - 100 * ratio)


def test_the_walker_s_magnetometer_is_believed_and_improves_more_than_the_dog_s(
    result: dict[str, Any],
) -> None:
    walker, dog = (
        result["carriers"][carrier]["improvement_percent"]["of_means"]
        for carrier in ("pedestrian", "canine, set dissertation")
    )
    assert walker > 2 * dog  # 0.1 rad against 10 rad (C.9); the text has 10.2 and 6.3 %
    assert [result["published"][c]["improvement_percent"] for c in ("pedestrian", "canine")] == [10.2, 6.3]


def test_the_scale_factor_turns_too_little_and_explains_the_drift(result: dict[str, Any]) -> None:
    # given SF_g = 0.9 (C.2) and turns of 90 deg, an outage of some 21 s has about three: 9 deg each
    assert 4 < error(result, "pedestrian", heading.WITHOUT) < 30
    assert error(result, "pedestrian", heading.SIX) < 5


def test_differences_are_taken_the_short_way_round() -> None:
    assert heading._wrapped(np.array([3.5 * np.pi, -np.pi])) == pytest.approx([-0.5 * np.pi, -np.pi])


def test_table_and_picture_show_both_carriers(result: dict[str, Any]) -> None:
    text = io.StringIO()
    heading.show(result, Console(file=text, width=200))
    assert "pedestrian" in text.getvalue()
    assert "10.2" in text.getvalue()
    (figure,) = heading.draw(result).values()
    assert all(chart["marks"] for grid in charts_of(figure) for chart in grid)
    assert [axes.get_title().split(":")[0] for axes in figure.axes] == [
        f"{carrier}, {title}"
        for carrier in ("pedestrian", "canine, set dissertation")
        for title in (heading.WITHOUT, heading.WITH)
    ]


def test_an_unknown_set_is_refused() -> None:
    with pytest.raises(UsageError, match='there is no set "measure"; did you mean "measured"'):
        run_study("heading", Options(set="measure"))
