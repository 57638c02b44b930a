"""The page on streets: its maps, its numbers, and the committed page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from harness.trial.scenario import Street, load
from harness.verification import streets
from harness.verification.page import RESULTS
from harness.verification.runs import Size
from harness.verification.streets import CROSSING, EARLY, PAGE, STAR, Layout


def lines(page: str, *first: str) -> list[str]:
    """The tables' lines that begin with these cells."""
    return [line for line in page.splitlines() if line.startswith(f"| {' | '.join(first)}")]


def ends(some: tuple[Street, ...]) -> list[tuple[float, ...]]:
    return [tuple(round(x, 3) + 0.0 for x in (*each.start, *each.end, each.half_width)) for each in some]


@pytest.mark.parametrize(("layout", "name"), [(CROSSING, "crossing"), (STAR, "star")])
def test_the_maps_are_those_of_the_scenarios_that_come_with_the_project(layout: Layout, name: str) -> None:
    assert ends(layout.streets(load("right_90"), 1.0)) == ends(load(name).streets)


def test_a_street_goes_in_the_direction_of_the_turn_2_5_m_before_the_waypoint() -> None:
    # given 31.71 m to the north, then as far to the north-west
    first, second = EARLY.streets(load("left_45"), 1.5)
    # then
    assert (first.start, first.end, first.half_width) == ((0, 0), (63.42, 0), 1.5)
    assert second.start == pytest.approx((29.21 - 22.4224, 22.4224), abs=1e-3)
    assert second.end == pytest.approx((29.21 + 22.4224, -22.4224), abs=1e-3)


def test_the_committed_page_has_what_a_run_gives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given a page of a single dog and width, and of a single scenario
    monkeypatch.setattr(streets, "DOGS", {"default": ()})
    monkeypatch.setattr(streets, "HALF_WIDTHS", (1.0,))
    monkeypatch.setattr(streets, "SHIPPED", ("crossing",))
    # when
    streets.write(tmp_path, Size())
    # then its rows are those of the whole page
    page, committed = (tmp_path / PAGE).read_text(), (RESULTS / PAGE).read_text()
    for first in (("default", "1 m"), ("`crossing`",)):
        (row,) = lines(page, *first)
        assert lines(committed, *first) == [row]
    # and so is the text before and between its tables
    for begin, end in (
        ("# Streets", "The map decides."),
        ("The default dog begins", "Ours has"),
        ("The field's", "| "),
    ):
        assert (
            page[page.index(begin) :].partition(end)[0]
            == committed[committed.index(begin) :].partition(end)[0]
        )


def test_a_wall_costs_the_turn_and_not_the_straight_way() -> None:
    # given right_90 with a crossing too narrow for where the dog stops, and with a wide one
    narrow, wide = (streets.rates("default", width, CROSSING, 200)[0] for width in (1.0, 2.5))
    assert narrow < 0.1
    assert wide > 0.9
    # and two_waypoint in a street of its own
    straight = replace(load("two_waypoint"), streets=(Street((0.0, 0.0), (50.0, 0.0), 1.0),))
    assert streets.point_of(straight, 200).success_rate > 0.99
