"""The page and its pictures."""

from __future__ import annotations

from pathlib import Path

from codegen.templating import environment
from harness.drawing import house_style, png_of
from harness.files import write_whole
from harness.sweep.table import wilson
from harness.verification.pictures import (
    example_figure,
    three_field_figure,
    three_figure,
    two_field_figure,
    two_figure,
)
from harness.verification.published import FIELD
from harness.verification.runs import SAME_TURNS, Example, Size, find_example, simulate
from harness.verification.tables import (
    aim_table,
    cause_table,
    distance_table,
    dog_table,
    drawn_table,
    field_table,
    guarded_table,
    late_table,
    likelihood_table,
    recommendation_table,
    route_table,
    seconds,
    statements,
    time_table,
)
from models.readings import PUBLISHED

RESULTS = Path(__file__).parents[1] / "results"
PAGE = "verification.md"
TEMPLATES = environment(Path(__file__).parent / "templates")
FULL = Size()
SCREEN_DPI = 96  # pictures for a page, not for print


@house_style()
def write(folder: Path = RESULTS, size: Size = FULL) -> None:
    """Write the page and its pictures.

    Raises:
        FileError: they cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    example = find_example(size.seeds)
    pictures = {
        "verification_two.png": two_figure(size),
        "verification_three.png": three_figure(size),
        "verification_two_field.png": two_field_figure(size),
        "verification_three_field.png": three_field_figure(size),
        "verification_trial.png": example_figure(example),
    }
    for name, figure in pictures.items():
        write_whole(folder / name, png_of(figure, SCREEN_DPI))
    write_whole(folder / PAGE, page(size, example).encode())


def page(size: Size, example: Example) -> str:
    """The page's text."""
    dogs = (simulate("two", "49:49", size.rate, settings=settings).at(49) for settings in ((), SAME_TURNS))
    failures = [point.trials - point.successes for point in dogs]
    low, high = (simulate("three", "15:65", size.ranked).at(threshold) for threshold in (40, 65))
    livelock = [p for p in simulate("three", "15:65", size.curve, "literal").table if p.written[0] < 20]
    return TEMPLATES.get_template("verification.md.jinja").render(
        size=size,
        failures=failures[0],
        same_turns=failures[1],
        example=example,
        statements=statements(size),
        field=field_table(size),
        times=time_table(size),
        causes=cause_table(size),
        late=late_table(size),
        dogs={reading: dog_table(size, reading) for reading in PUBLISHED},
        likelihoods=likelihood_table(size),
        drawn=drawn_table(size),
        aims=aim_table(size),
        distances=distance_table(size),
        routes=route_table(size),
        guarded=guarded_table(size),
        recommendations=recommendation_table(size),
        three_times={r: seconds(simulate("three", "37:49:12", size.rate, r).at(49)) for r in PUBLISHED},
        gain=100 * (high.success_rate - low.success_rate),
        cost=(high.mean_time or 0.0) - (low.mean_time or 0.0),
        open_interval=tuple(100 * end for end in FIELD[4].interval),
        wilson=100 * wilson(FIELD[0].successes, FIELD[0].trials)[1],
        livelock=max(p.mean_time or 0.0 for p in livelock),
    )
