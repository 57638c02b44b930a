"""The picture of a replay."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes

from harness.replay import plots
from harness.replay.plots import Track
from tests.harness.pictures import line, size

# a receiver that goes east at 1 m/s; a filter that stays at 2 m in two outages, and another that is right
TIME = np.arange(10.0)
GPS = Track(TIME, np.zeros(10), TIME)
OUTAGES = [np.array([2.0, 3.0, 4.0]), np.array([5.0, 6.0, 7.0])]
ESTIMATES = {
    "stays": [Track(at, np.zeros(3), np.full(3, 2.0)) for at in OUTAGES],
    "right": [Track(at, np.zeros(3), at) for at in OUTAGES],
}
ERRORS = {
    "stays": {"mean": 3.5, "median": 3.5, "p90": 4.7},
    "right": {"mean": 0.0, "median": 0.0, "p90": 0.0},
}
COUNTS = "left out: 3 outages: IMU samples missing (3)\ndropped: UBX frames with a wrong checksum (12)"


def curves(axes: Axes) -> list[list[list[float]]]:
    return [np.asarray(curve.get_xydata()).tolist() for curve in axes.lines]


def test_each_configuration_has_its_own_panels() -> None:
    figure = plots.replay_figure(GPS, ESTIMATES, ERRORS, on_map=[0], title="a drive")
    stays, right, stays_errors, right_errors = figure.axes
    # then the map shows the receiver's path and the outages chosen for it
    assert [stays.get_title(), right.get_title()] == ["stays", "right"]
    assert line(stays, "GPS").tolist() == [[t, 0] for t in TIME]
    assert line(stays, plots.SHOWN).tolist() == [[2, 0]] * 3
    assert line(right, plots.SHOWN).tolist() == [[2, 0], [3, 0], [4, 0]]
    assert line(stays, "estimate and GPS at an outage's end").tolist() == [[2, 0], [4, 0]]
    # and the errors of all outages are counted from their starts: 0, 1, 2 m and 3, 4, 5 m
    assert curves(stays_errors) == [[[0, 0], [1, 1], [2, 2]], [[0, 3], [1, 4], [2, 5]]]
    assert curves(right_errors) == [[[0, 0], [1, 0], [2, 0]]] * 2


def test_no_line_is_drawn_through_a_hole_of_the_fixes() -> None:
    # given no fix after that of 3 s up to that of 7 s, and an outage from 2 to 8 s
    fixes = Track(*(np.delete(part, [4, 5, 6]) for part in GPS))
    at = np.arange(2.0, 9.0)
    estimates = {"stays": [Track(at, np.zeros(7), np.full(7, 2.0))]}
    [above, below] = plots.replay_figure(fixes, estimates, {"stays": ERRORS["stays"]}, on_map=[0]).axes
    assert line(above, "GPS")[:, 0].tolist() == pytest.approx([0, 1, 2, 3, np.nan, 7, 8, 9], nan_ok=True)
    assert curves(below)[0] == pytest.approx(
        np.array([[0, 0], [1, 1], [2, np.nan], [3, np.nan], [4, np.nan], [5, 5], [6, 6]]), nan_ok=True
    )


def test_panels_can_be_compared_by_eye() -> None:
    figure = plots.replay_figure(GPS, ESTIMATES, ERRORS, on_map=[0], title="a drive")
    maps, errors = figure.axes[:2], figure.axes[2:]
    for row in (maps, errors):
        assert row[0].get_xlim() == row[1].get_xlim()
        assert row[0].get_ylim() == row[1].get_ylim()
        assert not any(axes.patches for axes in row)  # nothing shades them
    assert [axes.get_xlabel() for axes in figure.axes] == ["east [m]"] * 2 + [
        "time since the outage began [s]"
    ] * 2
    assert [maps[0].get_ylabel(), errors[0].get_ylabel()] == ["north [m]", "distance from GPS [m]"]
    assert errors[0].get_title() == "at the end of 2 outages:\nmean 3.50 m, median 3.50 m, p90 4.70 m"


def test_what_was_not_used_stands_on_the_picture() -> None:
    figure = plots.replay_figure(GPS, ESTIMATES, ERRORS, on_map=[0], title="a drive", not_used=COUNTS)
    assert figure.get_suptitle() == "a drive\n" + COUNTS


def test_a_long_list_of_causes_is_broken_into_lines_that_fit() -> None:
    long = "dropped: " + ", ".join(f"cause number {i} ({i})" for i in range(40))
    figure = plots.replay_figure(GPS, ESTIMATES, ERRORS, on_map=[0], title="a drive", not_used=long)
    title = figure.get_suptitle()
    assert max(map(len, title.splitlines())) <= plots.WRAP
    assert " ".join(title.split("\n")) == "a drive " + long


def test_the_picture_of_a_replay_has_its_size() -> None:
    picture = plots.replay_picture(GPS, ESTIMATES, ERRORS, on_map=[0, 1], title="a drive")
    assert size(picture) == (1260, 1350)
