"""The pieces that pictures share."""

import pytest

from harness.drawing import LONGEST, UNKNOWN, add_scale_bar, drawable, new_figure, round_below


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("patrol", "patrol"),
        ("Zürich-犬", f"Zürich-{UNKNOWN}"),
        ("a\nb\tc\x1b", "a b c"),
        ("5 $ to 6 $", r"5 \$ to 6 \$"),
        ("w" * LONGEST, "w" * LONGEST),
        ("w" * (LONGEST + 1), "w" * (LONGEST - 1) + "…"),
    ],
)
def test_a_name_is_drawn_in_one_short_line_of_the_font_s_characters(name: str, text: str) -> None:
    assert drawable(name) == text


@pytest.mark.parametrize(
    ("value", "length"),
    [(0.99, 0.5), (1, 1), (1.99, 1), (2, 2), (4.9, 2), (5, 5), (9.9, 5), (10, 10), (2600, 2000)],
)
def test_a_round_length_is_the_greatest_below(value: float, length: float) -> None:
    assert round_below(value) == pytest.approx(length)


@pytest.mark.parametrize(("width", "text"), [(10, "2 m"), (100, "20 m"), (4000, "1 km"), (25_000, "5 km")])
def test_a_scale_bar_says_how_long_it_is(width: float, text: str) -> None:
    axes = new_figure(4, 4).add_subplot()
    axes.set_xlim(-width / 2, width / 2)
    assert add_scale_bar(axes).txt_label.get_text() == text
