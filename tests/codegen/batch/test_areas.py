"""Areas that a batch watches: which one a place is in, against Shapely; what a trial's plant enters."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely

from codegen.batch.areas import Areas
from codegen.batch.batch import Batch
from models.errors import ParameterError
from models.system import SYSTEMS

SQUARE = np.array([[10.0, 3.0], [30.0, 3.0], [30.0, 20.0], [10.0, 20.0]])
COURT = np.array([[14.0, 6.0], [14.0, 14.0], [24.0, 14.0], [24.0, 6.0]])


def rings_of(polygon: shapely.Polygon) -> list[Any]:
    return [np.array(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]


def star(rng: np.random.Generator) -> shapely.Polygon:
    """A polygon with many corners, reflex ones too, around a random place."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, 12))
    radii = rng.uniform(2, 15, 12)
    middle = rng.uniform(-30, 30, 2)
    return shapely.Polygon(middle + np.column_stack((radii * np.cos(angles), radii * np.sin(angles)))).buffer(
        0
    )


@pytest.mark.parametrize(("seed", "size"), [*((seed, 1.0) for seed in range(5)), (5, 40.0)])
def test_a_place_is_in_the_first_area_that_holds_it_as_shapely_says(seed: int, size: float) -> None:
    # given stars that overlap, one with a hole, and many places, some near an edge; a map of 3 km, too
    rng = np.random.default_rng(seed)
    shapes = [star(rng) for _ in range(4)]
    shapes = [shape for shape in shapes if shape.geom_type == "Polygon" and shape.area > 1]
    shapes.append(shapely.Polygon(SQUARE, [COURT]))
    shapes = [shapely.transform(shape, lambda corners: corners * size) for shape in shapes]
    near = np.concatenate(
        [shape.exterior.interpolate(t, normalized=True).coords for shape in shapes for t in rng.random(50)]
    )
    places = rng.uniform(-50 * size, 50 * size, (20_000, 2))
    places = np.concatenate([places, near + rng.normal(0, 1e-4, near.shape)])
    expected = np.zeros(len(places), int)
    for number, shape in reversed(list(enumerate(shapes, start=1))):
        expected[shapely.contains_xy(shape, *places.T)] = number
    # when
    areas = Areas([rings_of(shape) for shape in shapes])
    # then by the edges
    assert np.array_equal(areas.inside(*places.T), expected)
    # and by the grid, where it answers
    (north, east), (rows, columns) = areas.corner, areas.cells.shape
    row, column = np.floor((places - [north, east]) / areas.side).astype(int).T
    on_grid = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    cell = areas.cells[row[on_grid], column[on_grid]]
    answers = cell >= 0
    assert np.array_equal(cell[answers], expected[on_grid][answers])
    assert answers.mean() > 0.5
    assert not expected[~on_grid].any()


def test_an_area_without_three_corners_or_with_nan_is_refused() -> None:
    for ring in (SQUARE[:2], SQUARE[:, :1], np.full((3, 2), np.nan)):
        with pytest.raises(ParameterError, match=r"area 2: a ring has shape .*; expected"):
            Areas([[SQUARE], [ring]])


def test_no_area_holds_no_place() -> None:
    areas = Areas([])
    assert not areas.inside(np.zeros(3), np.zeros(3)).any()
    assert not areas.cells.any()


# Trials

PLACE = ("plant.position_north", "plant.position_east")
MISSION = {
    "start": 1.0, "waypoint_count": 2.0, "waypoint_north[1]": 35.73, "waypoint_north[2]": 35.73,
    "waypoint_east[2]": 35.73,
}  # fmt: skip
VALUES = {"controller": MISSION}
STOP = ("controller.status", (2, 3, 4))
SEEDS = np.arange(40, dtype=np.int32)
LONGEST = 500
AREAS = Areas([[np.array([[30.0, 8.0], [45.0, 8.0], [38.0, 30.0]])], [SQUARE, COURT]])
POST = np.array([[34.0, 20.0], [38.0, 20.0], [38.0, 24.0], [34.0, 24.0]])
WIDE = Areas([[POST - [0, 60]], [POST - [-1.5, 0]]])  # two posts, far apart in the east


@cache
def batch(watch: bool) -> Batch:
    return Batch(
        SYSTEMS["cts"], ["plant.start_north", "plant.start_east"], [*PLACE], STOP, PLACE if watch else None
    )


def run(last: int = LONGEST, areas: Areas | None = AREAS, start: Any = (0.0, 0.0)) -> Any:
    runner = batch(watch=areas is not None)
    return runner.run(VALUES, np.array([start]), SEEDS * 0, SEEDS, last, areas=areas)


@cache
def paths() -> Any:
    """(ticks, trials, 2) the place of each trial after each tick, from runs that end there."""
    return np.stack([run(tick, areas=None).values for tick in range(LONGEST + 1)])


@pytest.mark.parametrize(("areas", "some"), [(AREAS, {0, 1, 2}), (WIDE, {0, 2})], ids=["high", "wide"])
def test_the_first_area_on_a_trial_s_path_is_noted(areas: Areas, some: set[int]) -> None:
    # given areas on a map that is higher than wide, or wider than high
    inside = areas.inside(*np.moveaxis(paths(), -1, 0))
    first = (inside > 0).argmax(axis=0)
    expected = inside[first, np.arange(len(SEEDS))]
    # when
    entered = run(areas=areas).entered
    # then some enter none, and some each that lies on their way
    assert np.array_equal(entered, expected)
    assert set(entered) == some


def test_where_an_animal_would_have_run_on_at_its_trial_s_end_is_not_entered() -> None:
    # given trials that end as the dog runs home from its only waypoint
    values = {"controller": {**MISSION, "waypoint_count": 1.0}}
    moving = 0
    for seed in range(3):
        one = np.zeros((1, 2)), [0], [seed]
        ended = int(batch(watch=False).run(values, *one, LONGEST).ticks[0])
        path = [batch(watch=False).run(values, *one, tick).values[0] for tick in range(ended + 1)]
        moving += int(np.linalg.norm(path[-1] - path[-2]) > 0.1)
        # and ground all about, but for a lane of 2 mm along the path; the tick that is undone leaves it
        lane = shapely.LineString(path).buffer(0.001, quad_segs=1)
        ground = shapely.box(*lane.buffer(5).bounds) - lane
        areas = Areas([rings_of(part) for part in shapely.get_parts(ground)])
        # when
        trial = batch(watch=True).run(values, *one, LONGEST, areas=areas)
        # then
        assert trial.ticks == ended
        assert trial.entered == 0, f"seed {seed}"
    assert moving


def test_no_tick_is_left_out_those_in_lanes_and_those_taken_alone() -> None:
    # given a trial's path with an area of some centimetres about its place after one tick, tick by tick
    results = paths()[:, 7]
    moving = [t for t in range(1, LONGEST) if np.linalg.norm(results[t] - results[t - 1]) > 0.06]
    assert len(moving) > 150
    for tick in moving:
        spot = Areas([[results[tick] + 0.02 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])]])
        trial = batch(watch=True).run(VALUES, np.zeros((1, 2)), [0], [7], LONGEST, areas=spot)
        # then it is entered
        assert trial.entered is not None
        assert trial.entered[0] == 1, f"tick {tick}"


def test_a_wall_thinner_than_a_tick_s_way_is_entered_though_no_tick_ends_in_it() -> None:
    # given walls of a centimetre across a trial's path, each between the places after two ticks, and a court
    # whose walls are as thin about the farther place
    results = paths()[:, 7]
    moving = [t for t in range(1, LONGEST) if np.linalg.norm(results[t] - results[t - 1]) > 0.1]
    assert len(moving) > 100
    for tick in moving[::5]:
        before, after = results[tick - 1], results[tick]
        way = (after - before) / np.linalg.norm(after - before)
        middle, aside = (before + after) / 2, np.array([-way[1], way[0]])
        wall = [middle + a * way * 0.005 + b * aside * 5 for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        corners = [a * way + b * aside for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        court = [[after + r * corner for corner in corners] for r in (0.04, 0.03)]
        for rings in ([np.array(wall)], [np.array(ring) for ring in court]):
            areas = Areas([rings])
            assert not areas.inside(*after)
            trial = batch(watch=True).run(VALUES, np.zeros((1, 2)), [0], [7], tick, areas=areas)
            # then
            assert trial.entered is not None
            assert trial.entered[0] == 1, f"tick {tick}"
            # and a trial that ends a tick earlier has not entered it
            trial = batch(watch=True).run(VALUES, np.zeros((1, 2)), [0], [7], tick - 1, areas=areas)
            assert trial.entered is not None
            assert trial.entered[0] == 0, f"tick {tick}"


def test_a_stride_longer_than_cells_answer_for_is_held_against_all_edges() -> None:
    # given walls across the strides of a dog of 15 m/s, each where its stride of 0.6 m begins
    values = {**VALUES, "plant": {"cruise_speed": 15.0, "speeding_up": 75.0}}
    runner = batch(watch=False)
    path = [runner.run(values, np.zeros((1, 2)), [0], [7], tick).values[0] for tick in range(100)]
    fast = [t for t in range(1, 100) if 0.55 < np.linalg.norm(path[t] - path[t - 1]) < 0.63]
    assert len(fast) > 30
    for tick in fast:
        before, after = path[tick - 1], path[tick]
        way = (after - before) / np.linalg.norm(after - before)
        aside = 3 * np.array([-way[1], way[0]])
        wall = [before + a * way + b * aside for a, b in ((0.01, -1), (0.02, -1), (0.02, 1), (0.01, 1))]
        # and a post aside, so that the wall lies now here, now there in a cell
        post = POST - POST.mean(axis=0) + before - [30 + 0.1 * (tick % 5), 30]
        areas = Areas([[np.array(wall)], [post]])
        # when, then
        trial = batch(watch=True).run(values, np.zeros((1, 2)), [0], [7], tick, areas=areas)
        assert trial.entered == 1, f"tick {tick}"


@pytest.mark.parametrize("speed", [4.86, 30.0])
def test_what_a_path_enters_is_what_shapely_says_of_its_lines(speed: float) -> None:
    # given thin triangles all about, and a dog that may run farther in a tick than a cell is wide
    rng = np.random.default_rng(5)
    middles = rng.uniform(-10, 60, (150, 1, 2))
    triangles = [shapely.Polygon(triangle) for triangle in middles + rng.normal(0, 0.5, (150, 3, 2))]
    areas = Areas([rings_of(triangle) for triangle in triangles])
    values = {**VALUES, "plant": {"cruise_speed": speed, "speeding_up": 5 * speed}}
    runs = (batch(watch=False).run(values, np.zeros((1, 2)), SEEDS * 0, SEEDS, t) for t in range(300))
    paths = np.stack([result.values for result in runs], axis=1)
    expected = []
    for path in paths:
        lines = shapely.linestrings(np.stack((path[:-1], path[1:]), axis=1))
        crossed = np.array([shapely.intersects(lines, triangle) for triangle in triangles])
        first = crossed.any(axis=0).argmax()
        expected.append(crossed[:, first].argmax() + 1 if crossed.any() else 0)
    # when
    trial = batch(watch=True).run(values, np.zeros((1, 2)), SEEDS * 0, SEEDS, 299, areas=areas)
    # then
    assert trial.entered is not None
    assert trial.entered.tolist() == expected
    assert len(set(expected)) > 5


def test_an_area_about_the_start_is_entered_at_once() -> None:
    assert set(run(last=0, start=(12.0, 10.0)).entered) == {2}
    assert set(run(last=0, start=(10.1, 10.0)).entered) == {2}
    assert set(run(last=0, start=(9.9, 10.0)).entered) == {0}
    assert set(run(last=0, start=(18.0, 10.0)).entered) == {0}  # in the court


def test_watching_changes_no_trial() -> None:
    plain, watched = run(areas=None), run()
    assert plain.ticks.tobytes() == watched.ticks.tobytes()
    assert plain.values.tobytes() == watched.values.tobytes()
    assert plain.entered is None


def test_a_batch_that_watches_nothing_has_no_word_of_areas_in_its_c() -> None:
    assert "area" not in batch(watch=False).sources()["batch.c"]
    assert "areas" in batch(watch=True).sources()["batch.c"]


def test_results_do_not_depend_on_how_many_trials_run_together() -> None:
    whole = run().entered
    for k in (0, 17, 39):
        alone = batch(watch=True).run(VALUES, np.zeros((1, 2)), [0], [k], LONGEST, areas=AREAS)
        assert alone.entered is not None
        assert alone.entered[0] == whole[k]


def test_areas_without_what_to_watch_and_the_reverse_are_refused() -> None:
    for watch, areas in ((True, None), (False, AREAS)):
        with pytest.raises(ParameterError, match="cts: expected areas and what to watch, or neither"):
            batch(watch).run(VALUES, np.zeros((1, 2)), [0], [1], 1, areas=areas)
    with pytest.raises(ParameterError, match='plant canine has no state "north"'):
        Batch(SYSTEMS["cts"], watch=("plant.north", "plant.east"))
