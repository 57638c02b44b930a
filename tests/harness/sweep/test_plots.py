"""The picture of a sweep: its trend line, and what it shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from decimal import Decimal
from itertools import product

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.legend import Legend
from matplotlib.patches import Rectangle

from harness.cosim.fmu import Fault
from harness.log.channel import Array
from harness.sweep.chunks import FmuFailure
from harness.sweep.plots import sweep_figure, trend
from harness.sweep.recommend import recommend
from harness.sweep.table import Point

X = np.arange(15.0, 91.0)
CRASH = Fault("crash", "plant", "dog.fmu", "fmi2DoStep", 1.0)


def test_the_trend_is_a_polynomial_of_degree_4_cut_at_100_percent() -> None:
    # given rates on such a polynomial
    on_it = 0.5 + 1e-7 * (X - 20) * (X - 40) * (X - 60) * (X - 80)
    fitted = trend(X, on_it)
    assert fitted is not None
    assert fitted[1] == pytest.approx(1.0)
    # when rates rise to 100 %, it is numpy's, cut where it would be more
    rate = np.minimum(1.0, 1 - 0.14 * np.exp(-(X - 15) / 4))
    fitted = trend(X, rate)
    assert fitted is not None
    line, r_squared = fitted
    other = np.minimum(1.0, np.polyval(np.polyfit(X, rate, 4), X))
    assert other.max() == 1.0
    assert line(X) == pytest.approx(other, abs=1e-9)
    assert r_squared == pytest.approx(1 - np.sum((rate - other) ** 2) / np.sum((rate - rate.mean()) ** 2))


def test_equal_rates_and_few_rates_have_no_trend() -> None:
    assert trend(X, np.ones(76)) is None
    equal = np.full(76, 0.997)
    assert equal.mean() != 0.997  # in floating point
    assert trend(X, equal) is None
    assert trend(X[:5], X[:5] / 100) is None


def labels(axes: Sequence[tuple[str, str, list[Decimal]]]) -> list[tuple[str, list[Decimal]]]:
    """Columns with their units, as pictures show them."""
    return [(f"{name} [{unit}]" if unit else name, values) for name, unit, values in axes]


def entries(legend: Legend | None) -> list[str]:
    """The texts of a legend."""
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


def points(written: Sequence[tuple[int, ...]], *, types: bool) -> list[Point]:
    """Points whose success rate rises from 40 % on; those of the first value never succeed."""
    table = []
    for place in written:
        n = 0 if place[0] == 0 else 40 + place[0]
        by_type = {"left_90": (n // 4, 50), "right_90": (n - n // 4, 50)} if types else {}
        values = tuple(Decimal(v) for v in place)
        table.append(Point(values, 100, n, 500 * n, 500 * 500 * n + n, n, 0, {}, by_type))
    return table


def test_the_curves_show_rate_trend_types_time_and_ranges() -> None:
    # given a sweep whose first point has no time
    table = points([(k,) for k in range(30)], types=True)
    ticks = np.array([[500] * p.successes + [0] * (100 - p.successes) for p in table], dtype=np.uint16)
    values = [Decimal(k) for k in range(30)]
    # when
    figure = sweep_figure(
        [("drift [deg/s]", values)], table, recommend([("x", "deg/s", values)], table, ticks), "title"
    )
    # then
    success, time = figure.axes
    labels = success.get_legend_handles_labels()[1]
    assert labels[:2] == ["95 % interval (Wilson)", "success rate"]
    assert {"left 90", "right 90", "best for success"} <= set(labels)
    assert any(label.startswith("trend (degree 4)") for label in labels)
    rate = next(line for line in success.lines if line.get_label() == "success rate")
    assert np.asarray(rate.get_ydata())[[0, 1, 29]].tolist() == [0.0, 0.41, 0.69]
    mean = np.asarray(time.lines[0].get_ydata(), dtype=float)
    assert np.isnan(mean[0])
    assert mean[1:] == pytest.approx(np.full(29, 20.0))
    assert time.get_xlabel() == "drift [deg/s]"
    # and the front is the last point alone: the most successes, in the same time
    for axes, value in ((success, 0.69), (time, 20.0)):
        ring = next(line for line in axes.lines if line.get_label() == "Pareto front")
        assert ring.get_xydata() == pytest.approx(np.array([[29.0, value]]))
        assert "Pareto front" in axes.get_legend_handles_labels()[1]


def test_the_curves_shade_all_values_that_the_text_names() -> None:
    # given values 2 and 3, and 7 apart from them, that are best in time
    table = points([(k,) for k in range(1, 9)], types=False)
    values = [Decimal(k) for k in range(1, 9)]
    ticks = np.array([[500] * 100 for _ in values], dtype=np.uint16)
    result = recommend([("x", "m", values)], table, ticks)
    result["time"] = {**result["time"], "points": [2, 3, 7], "range": {"x": [2, 3]}, "flat": False}
    # when
    time = sweep_figure([("x [m]", values)], table, result, "title").axes[1]
    # then two stretches are shaded, with one entry in the legend
    shaded = [patch for patch in time.patches if isinstance(patch, Rectangle)]
    assert [(p.get_x(), p.get_x() + p.get_width()) for p in shaded] == [(1.5, 3.5), (6.5, 7.5)]
    assert entries(time.get_legend()).count("shortest time") == 1


def test_points_whose_trials_an_fmu_ended_are_marked() -> None:
    # given one point at which it did, where nothing succeeded, and one at which it did not
    table = points([(0,), (1,)], types=False)
    table[0] = replace(table[0], fmu_failures=[FmuFailure(0, CRASH, "it crashed")])
    values = [Decimal(0), Decimal(1)]
    ticks = np.array([[0] * 100, [500] * 41 + [0] * 59], dtype=np.uint16)
    # when
    varied = [("x [m]", values)]
    figure = sweep_figure(varied, table, recommend([("x", "m", values)], table, ticks), "title")
    # then
    mark = next(line for line in figure.axes[0].lines if str(line.get_label()).startswith("trials ended"))
    assert np.asarray(mark.get_xydata()).tolist() == [[0.0, 0.0]]


def test_the_panel_of_times_says_where_nothing_succeeded() -> None:
    table, values = points([(0,)], types=False), [Decimal(0)]
    ticks = np.zeros((1, 100), dtype=np.uint16)
    time = sweep_figure([("x", values)], table, recommend([("x", "", values)], table, ticks), "t").axes[1]
    assert [text.get_text() for text in time.texts] == ["no trial succeeded"]


def test_the_maps_have_the_first_parameter_to_the_right() -> None:
    # given three values of one parameter, two of another
    places = list(product(range(3), range(2)))
    table = points(places, types=False)
    ticks = np.array([[500] * p.successes + [0] * (100 - p.successes) for p in table], dtype=np.uint16)
    axes = [("a", "", [Decimal(k) for k in range(3)]), ("b", "m", [Decimal(k) for k in range(2)])]
    # when
    figure = sweep_figure(labels(axes), table, recommend(axes, table, ticks), "title")
    # then
    success = figure.axes[0]
    field = np.asarray(success.collections[0].get_array())
    assert field == pytest.approx(np.array([[0, 41, 42], [0, 41, 42]]))
    assert (success.get_xlabel(), success.get_ylabel()) == ("a", "b [m]")
    masked = figure.axes[1].collections[0].get_array()
    assert isinstance(masked, np.ma.MaskedArray)
    time = masked.filled(np.nan)
    assert np.isnan(time[:, 0]).all()
    # and each value of so few has its tick
    assert [text.get_text() for text in success.get_xticklabels()] == ["0", "1", "2"]
    assert [text.get_text() for text in success.get_yticklabels()] == ["0", "1"]
    # 41 and 42 in 100 are not shown to differ, nor are times, but that none succeed at 0 is
    assert entries(figure.legends[0]) == [
        "best for success", "fastest of the best for success", "did best", "Pareto front"
    ]  # fmt: skip
    # and none succeeded at 0, so there is no time
    assert entries(figure.legends[1])[-1] == "fewer than 30 successes"
    # and the colours have names, units, and all rates as a scale
    assert [axes.get_ylabel() for axes in figure.axes[2:]] == [
        "success rate [%]", "mean time of successful trials [s]"
    ]  # fmt: skip
    assert success.collections[0].get_clim() == (0, 100)
    # the borders of the 2 x 2 cells from 0.5 to 2.5 and from -0.5 to 1.5, in 8 pieces of length 1
    for outline in success.collections[1:3]:
        assert isinstance(outline, LineCollection)
        pieces = np.array(outline.get_segments())
        assert len(pieces) == 8
        assert np.hypot(*(pieces[:, 1] - pieces[:, 0]).T) == pytest.approx(np.ones(8))
        assert (pieces[..., 0].min(), pieces[..., 0].max()) == (0.5, 2.5)
        assert (pieces[..., 1].min(), pieces[..., 1].max()) == (-0.5, 1.5)
    # the front has both points with the most successes
    for panel in figure.axes[:2]:
        rings = next(line for line in panel.lines if line.get_label() == "Pareto front")
        assert rings.get_xydata() == pytest.approx(np.array([[2.0, 0.0], [2.0, 1.0]]))


@pytest.mark.parametrize(("successes", "shown"), [(29, False), (30, True)])
def test_the_map_of_times_shows_no_time_of_too_few_successes(successes: int, shown: bool) -> None:
    places = list(product(range(1, 4), range(2)))
    table = points(places, types=False)
    table[3] = replace(table[3], successes=successes)
    ticks = np.array([[500] * p.successes + [0] * (100 - p.successes) for p in table], dtype=np.uint16)
    axes = [("a", "", [Decimal(k) for k in range(1, 4)]), ("b", "m", [Decimal(k) for k in range(2)])]
    times = sweep_figure(labels(axes), table, recommend(axes, table, ticks), "title").axes[1]
    field = np.ma.asarray(times.collections[0].get_array(), dtype=np.float64)
    time: Array = np.ma.filled(field, np.nan)
    assert np.isfinite(time[1, 1]) == shown  # the point (2, 1)
    assert np.isfinite(np.delete(time.ravel(), 4)).all()


def test_a_map_of_flat_results_has_no_outline() -> None:
    places = list(product(range(1, 4), range(2)))
    table = points(places, types=False)
    ticks = np.array([[500] * p.successes + [0] * (100 - p.successes) for p in table], dtype=np.uint16)
    axes = [("a", "", [Decimal(k) for k in range(1, 4)]), ("b", "m", [Decimal(k) for k in range(2)])]
    figure = sweep_figure(labels(axes), table, recommend(axes, table, ticks), "title")
    success, time = figure.axes[:2]
    both = zip((success, time), figure.legends, ("best for success", "shortest time"), strict=True)
    for panel, legend, best_for in both:
        assert entries(legend) == [
            f"{best_for}: no optimum shown",
            "fastest of the best for success: no optimum shown",
            "Pareto front",
        ]  # fmt: skip
        assert len(panel.collections) == 1  # the map
