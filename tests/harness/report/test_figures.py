"""Figures of matplotlib as charts: every kind of artist keeps its numbers, names and looks."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from rich.console import Console

from harness.drawing import ESTIMATES, GPS, TRUTH
from harness.report.charts import charts_page
from harness.report.figures import MOST_POINTS, charts_of, legend_of, title_of
from harness.terminal import new_table, print_table
from tests.browser import DESK, TABLET, OpenPage

MOST_BYTES = 120_000  # of the page without its data: it has no maps
FIRST, SECOND = ESTIMATES[:2]


def only(figure: Figure) -> dict[str, Any]:
    """A figure's one chart."""
    ((chart,),) = charts_of(figure)
    return chart


def marks(figure: Figure) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = only(figure)["marks"]
    return found


def test_a_line_has_its_numbers_and_looks_and_gaps_are_null() -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0, 1, 2], [1.5, np.nan, 1 / 3], "--", color=FIRST, linewidth=1.2, label="speed")
    (mark,) = marks(figure)
    assert (mark["kind"], mark["name"], mark["colour"]) == ("line", "speed", "series-1")
    assert (mark["width"], mark["dash"], mark["sign"]) == (1.2, [6, 4], "")
    assert (mark["x"], mark["y"]) == ([0, 1, 2], [1.5, None, 0.333333])


def test_points_bars_bands_levels_and_texts_are_what_they_were_drawn_as() -> None:
    # given one of each
    figure = Figure()
    axes = figure.subplots()
    axes.scatter([1, 2], [3, 4], facecolors="none", edgecolors=SECOND, label="hollow")
    axes.barh(1.0, 5.0, height=0.5, color=GPS)
    axes.axvspan(2, 3, color="#123456")
    axes.axhline(7.0, color=TRUTH)
    axes.text(1, 2, "here")
    axes.text(0.5, 0.5, "nothing", transform=axes.transAxes)
    found = {mark["kind"]: mark for mark in marks(figure) if mark["kind"] != "box"}
    bar, span = sorted((m for m in marks(figure) if m["kind"] == "box"), key=lambda m: m["y"] is None)
    # then
    assert (found["line"]["sign"], found["line"]["hollow"], found["line"]["x"]) == ("o", True, [1, 2])
    assert (bar["x"], bar["y"], bar["colour"]) == ([0, 5], [0.75, 1.25], "gps")
    assert (span["x"], span["y"], span["colour"]) == ([2, 3], None, "#123456")
    assert (found["level"]["x"], found["level"]["y"]) == (None, 7)
    assert (found["text"]["text"], found["text"]["x"]) == ("here", 1)
    assert found["words"]["text"] == "nothing"


def test_error_bars_are_lines_between_their_ends() -> None:
    figure = Figure()
    figure.subplots().errorbar([10], [2], xerr=[[3], [4]], fmt="o", color=FIRST, capsize=3, label="share")
    lines = [mark for mark in marks(figure) if mark["kind"] == "line" and len(mark["x"]) == 2]
    assert [(mark["x"], mark["y"]) for mark in lines] == [([7, 14], [2, 2])]


def test_axes_keep_ranges_logarithms_names_and_their_turn() -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0.1, 100], [0, 1])
    axes.set(xscale="log", xlim=(0.1, 100), ylim=(3, -1), xlabel="sigma [m/s2]")
    axes.set_yticks([0, 1], ["six\nstates", "four"])
    chart = only(figure)
    assert chart["x"] == {
        "label": "sigma [m/s2]",
        "range": [0.1, 100],
        "turned": False,
        "log": True,
        "whole": False,
        "names": None,
    }
    assert (chart["y"]["range"], chart["y"]["turned"]) == ([-1, 3], True)
    assert chart["y"]["names"] == [[0, "six states"], [1, "four"]]


def test_names_that_are_their_numbers_are_numbers() -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.set_xlim(0.01, 1)
    axes.set_xticks([0.05, 0.5], ["0.05", "0.5"])
    assert only(figure)["x"]["names"] is None


def test_a_mark_without_a_name_has_what_the_legends_say_of_its_colour_and_its_style() -> None:
    # given colours that one legend explains, and styles that another one does, in black
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color=FIRST, linestyle="--")
    axes.plot([0, 1], [0, 2], color=FIRST)
    axes.legend(handles=[Line2D([], [], color=FIRST, label="h' = 37 deg")])
    styles = [Line2D([], [], color=TRUTH, linestyle=style, label=style) for style in ("-", "--")]
    figure.legend(handles=styles, labels=["simulated", "exact relay"])
    assert [mark["name"] for mark in marks(figure)] == ["h' = 37 deg, exact relay", "h' = 37 deg, simulated"]
    assert [entry["label"] for entry in legend_of(figure)] == ["simulated", "exact relay"]


def test_a_long_line_is_thinned_and_keeps_its_spike() -> None:
    figure = Figure()
    values = np.zeros(10 * MOST_POINTS)
    values[12345] = 9.0
    figure.subplots().plot(np.arange(len(values)), values)
    (mark,) = marks(figure)
    assert mark["thinned"]
    assert len(mark["x"]) <= MOST_POINTS
    assert mark["x"][mark["y"].index(9)] == 12345


def test_an_artist_that_no_chart_draws_is_an_error() -> None:
    figure = Figure()
    figure.subplots().fill_between([0, 1], [0, 0], [1, 1])
    with pytest.raises(TypeError, match="a chart draws no FillBetweenPolyCollection; expected lines"):
        charts_of(figure)


def test_grids_of_subfigures_are_apart_and_places_are_those_of_the_grid() -> None:
    figure = Figure()
    above, below = figure.subfigures(2, 1, squeeze=False)[:, 0]
    above.subplot_mosaic([["map", "speed"], ["map", "bias"]])
    below.subplots(1, 3)
    figure.suptitle("both")
    first, second = charts_of(figure)
    assert [chart["place"] for chart in first] == [[0, 1, 0, 0], [0, 0, 1, 1], [1, 1, 1, 1]]
    assert [chart["place"] for chart in second] == [[0, 0, place, place] for place in range(3)]
    assert title_of(figure) == "both"


def show(console: Console) -> None:
    """A table with a heading of two lines, and words that look like marks of a style."""
    table = new_table()
    table.add_column("way")
    table.add_column("error [m]\nmean".replace("[", r"\["), justify="right")
    table.add_row("<b>held</b>", "1.25")
    print_table(table, console)
    console.print("95 % [see] below", markup=False)


def study_page(folder: Path, figures: Mapping[str, Figure] | None = None) -> str:
    """The address of a page with two charts: a line over time on the left, named bars on the right."""
    if figures is None:
        figure = Figure(figsize=(12, 4))
        left, right = figure.subplots(1, 2)
        left.plot([0, 1, 2], [10, 20, 40], color=FIRST, label="fuzzy")
        left.set(xlabel="time [s]", ylabel="error [m]", ylim=(0, 50))
        right.barh([0, 1], [3, 5], color=SECOND)
        right.set_yticks([0, 1], ["held", "ours"])
        right.set_xlabel("mean [m]")
        figures = {"one": figure}
    page = folder / "study.html"
    page.write_bytes(charts_page("Study: a </script> test", "what it shows", figures, show))
    return page.as_uri()


def test_the_page_is_small_and_has_the_tables_as_text(tmp_path: Path) -> None:
    study_page(tmp_path)
    text = (tmp_path / "study.html").read_text()
    data = re.search(r'id="data">(.*?)</script>', text)
    assert data
    assert json.loads(data[1])["figures"][0]["grids"][0][0]["marks"][0]["y"] == [10, 20, 40]
    assert len(text) - len(data[1]) < MOST_BYTES
    assert "&lt;b&gt;held&lt;/b&gt;" in text
    assert '<th scope="col" class="right">error [m]\nmean</th>' in text
    assert "95 % [see] below" in text
    assert "Study: a &lt;/script&gt; test" in text


def test_a_place_that_is_pointed_at_tells_its_numbers(tmp_path: Path, open_page: OpenPage) -> None:
    # given the line's last but one point, and a bar
    visit = open_page(study_page(tmp_path))
    page = visit.page
    boxes = [page.locator(".u-over").nth(i).bounding_box() for i in range(2)]
    tips = page.locator(".tip:not([hidden])")
    assert tips.count() == 0
    line, bars = boxes
    assert line
    assert bars
    # when the mouse is near it (x from -0.1 to 2.1 by matplotlib's margins, y from 0 to 50)
    page.mouse.move(line["x"] + line["width"] * 1.1 / 2.2, line["y"] + line["height"] * (1 - 20 / 50) + 4)
    assert tips.inner_text() == "fuzzy\ntime 1 s\nerror 20 m"
    # then away from all, nothing is told; and in a bar its own
    page.mouse.move(line["x"] + 5, line["y"] + 5)
    assert tips.count() == 0
    page.mouse.move(bars["x"] + bars["width"] * 0.3, bars["y"] + bars["height"] * 0.25)
    assert tips.inner_text() == "mean 5 m\ny ours"
    # and keys go from point to point, and to the next line
    page.locator(".chart-body").first.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    assert tips.first.inner_text() == "fuzzy\ntime 1 s\nerror 20 m"
    assert visit.errors == []
    assert len(visit.requests) == 1


def test_a_chart_zooms_by_dragging_and_shows_all_by_a_double_click(
    tmp_path: Path, open_page: OpenPage
) -> None:
    page = open_page(study_page(tmp_path)).page
    box = page.locator(".u-over").first.bounding_box()
    assert box

    def at(right: float, down: float) -> tuple[float, float]:
        return box["x"] + right * box["width"], box["y"] + down * box["height"]

    def told() -> str:
        page.mouse.move(*at(0.5, 0.5), steps=2)
        return (
            page.locator(".tip:not([hidden])").inner_text()
            if page.locator(".tip:not([hidden])").count()
            else ""
        )

    before = told()
    page.mouse.move(*at(0.8, 0.05))
    page.mouse.down()
    page.mouse.move(*at(0.99, 0.4), steps=5)
    page.mouse.up()
    # then only the last point is left, in the upper part
    page.locator(".chart-body").first.focus()
    assert told() != before
    page.mouse.dblclick(*at(0.5, 0.5))
    assert told() == before


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESK, TABLET])
def test_the_page_keeps_nobody_out(
    tmp_path: Path, open_page: OpenPage, size: tuple[int, int], theme: str
) -> None:
    visit = open_page(study_page(tmp_path), size, theme)
    assert visit.harm() == []
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= size[0]
    assert visit.errors == []


DRAWN = """const draw = CanvasRenderingContext2D.prototype.fillText;
window.drawn = [];
CanvasRenderingContext2D.prototype.fillText = function (text, ...place) {
  drawn.push(text);
  return draw.call(this, text, ...place);
};"""


def numbers_across(figure: Figure, folder: Path, open_page: OpenPage, width: int = 1366) -> set[str]:
    """The numbers at the lower axis of a figure's page; the other one has none."""
    figure.axes[0].set_yticks([1], ["one"])
    page = folder / "page.html"
    page.write_bytes(charts_page("axes", "", {"axes": figure}, lambda console: None))
    visit = open_page(page.as_uri(), (width, 768), prepare=lambda opened: opened.add_init_script(DRAWN))
    return set(visit.page.evaluate("drawn")) - {"", "one"}


def test_a_logarithmic_axis_across_has_numbers_within_a_decade(tmp_path: Path, open_page: OpenPage) -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0.3, 2], [0, 0])
    axes.set(xscale="log", xlim=(0.3, 2))
    assert {"0.3", "0.5", "1", "2"} <= numbers_across(figure, tmp_path, open_page)


def test_a_logarithmic_axis_of_many_decades_leaves_numbers_out(tmp_path: Path, open_page: OpenPage) -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([1e-9, 1e9], [0, 0])
    axes.set(xscale="log", xlim=(1e-9, 1e9))
    drawn = numbers_across(figure, tmp_path, open_page, width=400)
    assert 4 <= len(drawn) <= 10
    assert all(float(text) == pytest.approx(10.0 ** round(np.log10(float(text)))) for text in drawn)


def test_counts_have_whole_numbers_alone(tmp_path: Path, open_page: OpenPage) -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([1, 4], [1, 4])
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlim=(0.5, 4.5))
    assert numbers_across(figure, tmp_path, open_page) == {"1", "2", "3", "4"}


def test_a_figure_with_the_title_of_its_page_does_not_say_it_twice(tmp_path: Path) -> None:
    figure = Figure()
    figure.suptitle("axes")
    figure.subplots().plot([0, 1], [0, 1])
    assert b'"figures":[{"title":"",' in charts_page("axes", "", {"axes": figure}, lambda console: None)
    assert b'"figures":[{"title":"axes",' in charts_page("all", "", {"axes": figure}, lambda console: None)
