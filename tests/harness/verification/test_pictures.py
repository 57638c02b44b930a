"""The page's pictures: axes with names and units, one name for h', and a word for all that is drawn."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from harness.terminal import DEVIATION_THRESHOLD
from harness.verification.pictures import (
    FIELD_LABEL,
    IGNORED,
    INTERVAL_LABEL,
    example_figure,
    three_field_figure,
    three_figure,
    two_field_figure,
    two_figure,
)
from harness.verification.published import FIELD
from harness.verification.runs import Size, find_example

SMALL = Size(curve=40, rate=400, ranked=100, long=40, seeds=60)
FIGURES = [two_figure, three_figure, two_field_figure, three_field_figure]
README_WIDTH, SCREEN_DPI = 830, 96  # pixels


def legend_of(figure: Figure, panel: int) -> list[str]:
    legend = figure.axes[panel].get_legend()
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("draw", FIGURES)
def test_axes_say_what_they_are_and_h_is_called_the_same_on_each(draw: Callable[[Size], Figure]) -> None:
    figure = draw(SMALL)
    abscissas = {axes.get_xlabel() for axes in figure.axes} - {"", "type of trial (turn and its angle [deg])"}
    assert abscissas == {f"{DEVIATION_THRESHOLD} [deg]"}
    ordinates = {axes.get_ylabel() for axes in figure.axes} - {""}
    assert ordinates <= {"success rate", "mean time of successful trials [s]"}


@pytest.mark.parametrize("draw", FIGURES)
def test_text_can_be_read_at_the_width_of_a_page_and_does_not_overlap(
    draw: Callable[[Size], Figure],
) -> None:
    figure = draw(SMALL)
    figure.draw_without_rendering()
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    shrunk = min(1.0, README_WIDTH / (figure.get_figwidth() * SCREEN_DPI))
    assert min(float(text.get_fontsize()) for text in texts) * SCREEN_DPI / 72 * shrunk > 9
    counts = [text for text in texts if "/" in text.get_text()]
    boxes = [text.get_window_extent(renderer) for text in counts]
    assert not any(a.overlaps(b) for a, b in pairwise(boxes))


@pytest.mark.parametrize("draw", [two_figure, three_figure])
def test_both_panels_of_a_curve_say_what_the_bands_are(draw: Callable[[Size], Figure]) -> None:
    figure = draw(SMALL)
    assert [INTERVAL_LABEL in legend_of(figure, panel) for panel in (0, 1)] == [True, True]


def test_the_dissertation_s_statements_follow_its_name() -> None:
    entries = legend_of(two_figure(SMALL), 0)
    assert entries.index("dissertation:") == len(entries) - 5
    assert all("ours" not in entry for entry in entries[-4:])


@pytest.mark.parametrize(
    ("draw", "waypoints", "thresholds"),
    [
        (three_figure, "three", (37, 49)),
        (two_field_figure, "two", (23, 30, 37)),
        (three_field_figure, "three", (37, 49)),
    ],
)
def test_field_rates_have_one_entry_and_their_counts_beside_them(
    draw: Callable[[Size], Figure], waypoints: str, thresholds: tuple[int, ...]
) -> None:
    figure = draw(SMALL)
    counts = [
        f"{field.successes}/{field.trials}"
        for field in FIELD
        if field.waypoints == waypoints and field.threshold in thresholds
    ]
    assert [text.get_text() for text in figure.axes[0].texts] == counts
    assert legend_of(figure, 0).count(FIELD_LABEL) == 1


def test_the_ignored_command_is_a_band_with_a_name() -> None:
    example = find_example(SMALL.seeds)
    figure = example_figure(example)
    for axes in figure.axes[1:]:
        [band] = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
        assert to_hex(band.get_facecolor()) == IGNORED["facecolor"].lower()
        ends = np.array([band.get_x(), band.get_x() + band.get_width()])
        assert ends == pytest.approx([example.commanded, example.silenced])
    assert figure.legends[0].get_texts()[-1].get_text() == "right command ignored"
    assert "right_90, seed" in figure.get_suptitle()
