"""The pages of sweeps and matrices have each point's numbers, and each trial by its seed."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest

from harness.sweep import matrix, sweep
from harness.trial.scenario import parse
from tests.browser import OpenPage

TRIALS = 12


def data_of(page: Path) -> dict[str, Any]:
    [text] = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page.read_text())
    found: dict[str, Any] = json.loads(text)
    return found


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sweep")
    sweep.run(sweep.plan_sweep("two", thresholds="20:50:15", trials=TRIALS, seed=5), folder)
    return folder


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("matrix")
    planned = matrix.plan_matrix(
        ["cmec", "quarter_turn"], ["canine", "pedestrian"], ["left_90"], trials=TRIALS, system="cts"
    )
    matrix.run(planned, folder)
    return folder


def test_a_sweeps_points_have_the_tables_numbers(swept: Path) -> None:
    data = data_of(swept / "sweep.html")
    rows = list(csv.DictReader((swept / "sweep.csv").open()))
    assert data["axis"] == {"label": "deviation threshold h' [deg]", "values": [20, 35, 50]}
    for point, row in zip(data["points"], rows, strict=True):
        assert point["rate"] == pytest.approx(float(row["success_rate"]), abs=1e-6)
        assert point["low"] == pytest.approx(float(row["ci_low"]), abs=1e-6)
        assert point["time"] == pytest.approx(float(row["mean_time_s"]), abs=1e-6)
        # and the trials behind it give these numbers again
        times = [ticks * data["tick"] for ticks in point["ticks"] if ticks]
        assert len(point["ticks"]) == TRIALS
        assert len(times) == int(row["successes"])
        assert sum(times) / len(times) == pytest.approx(point["time"])


def test_a_trial_is_told_by_its_scenario(swept: Path) -> None:
    # given the second point's trial with seed 7
    point = data_of(swept / "sweep.html")["points"][1]
    [(before, after)] = point["scenarios"]
    scenario = parse(before + str(point["seed"] + 2) + after, "it")
    # then its scenario states what the sweep ran
    assert (scenario.seed, scenario.system, scenario.reading) == (7, "cts", "calibrated")
    assert [v for name, v in scenario.parameters.items() if name.endswith(".moving_deviation")] == [35]


def test_a_matrix_has_a_table_for_each_scenario(compared: Path) -> None:
    data = data_of(compared / "matrix.html")
    rows = list(csv.DictReader((compared / "matrix.csv").open()))
    [grid] = data["grids"]
    assert (grid["title"], grid["rows"], grid["columns"]) == (
        "left_90", ["cmec", "quarter_turn"], ["canine", "pedestrian"]
    )  # fmt: skip
    for i, controller in enumerate(grid["rows"]):
        for j, plant in enumerate(grid["columns"]):
            point = data["points"][grid["cells"][i][j]]
            [row] = [r for r in rows if (r["controller"], r["plant"]) == (controller, plant)]
            assert point["label"] == f"{controller}, {plant}, left_90"
            assert point["rate"] == pytest.approx(float(row["success_rate"]), abs=1e-6)
            assert point["options"] == f" --controller {controller} --plant {plant}"


def test_a_point_shows_its_numbers_and_trials(swept: Path, open_page: OpenPage) -> None:
    page = swept / "sweep.html"
    visit = open_page(page.as_uri())
    # when the mouse is over the first point of the first chart
    box = visit.page.locator(".u-over").first.bounding_box()
    assert box is not None
    visit.page.mouse.move(box["x"] + 4, box["y"] + 40)
    point = data_of(page)["points"][0]
    assert visit.page.locator("#point h2").inner_text() == "deviation threshold h' [deg] 20"
    assert f"{TRIALS}" in visit.page.locator("#point table").inner_text()
    # then its trials are listed by seed, and one of them can be run again
    trials = visit.page.get_by_label("trials by seed")
    assert trials.locator("option").count() == TRIALS
    trials.select_option(index=3)
    text = visit.page.locator("#point pre").inner_text()
    assert "seed = 8" in text
    assert "canine run trial.toml" in text
    visit.page.get_by_label("which trials").select_option("0")
    assert trials.locator("option").count() == point["ticks"].count(0)
    assert (visit.errors, visit.requests) == ([], [page.as_uri()])
    assert visit.harm() == []


def test_a_cell_of_a_matrix_is_chosen_by_keys(compared: Path, open_page: OpenPage) -> None:
    visit = open_page((compared / "matrix.html").as_uri(), theme="dark")
    visit.page.get_by_title("quarter_turn, pedestrian, left_90").focus()
    assert visit.page.locator("#point h2").inner_text() == "quarter_turn, pedestrian, left_90"
    assert visit.page.locator("button[aria-pressed=true]").count() == 1
    assert visit.errors == []
    assert visit.harm() == []


def test_two_parameters_make_a_table(tmp_path: Path) -> None:
    planned = sweep.plan_sweep("two", thresholds="20:50:30", vary=["canine.drift=0:2:1"], trials=2)
    sweep.run(planned, tmp_path)
    data = data_of(tmp_path / "sweep.html")
    assert data["axis"] is None
    [grid] = data["grids"]
    assert (grid["rows"], grid["columns"]) == (["20", "50"], ["0", "1", "2"])
    assert grid["cells"] == [[0, 1, 2], [3, 4, 5]]
    assert data["points"][4]["label"].startswith("deviation threshold h' [deg] 50, canine.drift")
