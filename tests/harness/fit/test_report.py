"""The results of a fit: parameters for a scenario, the table, the picture."""

from __future__ import annotations

import io
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from rich.console import Console

from harness.fit.estimate import pool
from harness.fit.report import figure, fragment, show
from harness.fit.tracks import Trial, measure
from harness.trial.plan import interfaces_of_system, plan
from harness.trial.scenario import SHIPPED, load
from models.kit.units import DEG
from models.system import SYSTEMS
from tests.harness.command import canine
from tests.harness.fit.dogs import DOG, PLANT, SCHOOL, columns, commands, motion, write


def test_the_fragment_appended_to_a_scenario_gives_that_dog(tmp_path: Path) -> None:
    # given three trials, with one RIGHT among them that was obeyed
    dogs = [{**DOG, "cruise": v, "drift": d * DEG} for v, d in ((3.0, 1.0), (4.0, 2.0), (5.0, 3.0))]
    trials = [measure(motion(commands(SCHOOL[: 3 if i else 5]), dog), PLANT) for i, dog in enumerate(dogs)]
    result = pool(trials, PLANT.turned)
    # when it is appended to a shipped scenario
    written = tmp_path / "mine.toml"
    written.write_text((SHIPPED / "two_waypoint.toml").read_text() + fragment(result))
    values = plan(load(str(written)), interfaces_of_system(SYSTEMS["full"])).values["plant"]
    # then the plant has it in SI; the deviation of one value is left to the model
    assert values["cruise_speed"] == pytest.approx(4.0, rel=0.01)  # redrawing: 3.99
    assert values["drift"] == pytest.approx(2 * DEG, rel=1e-5)
    assert values["drift_deviation"] == pytest.approx(1 * DEG, rel=1e-5)
    assert values["left_turn_rate"] == pytest.approx(-80 * DEG, rel=1e-5)
    assert values["right_turn_rate"] == pytest.approx(50 * DEG, rel=1e-5)
    assert values["right_success"] == 1
    assert "right_turn_rate_deviation" not in values
    assert "# one value does not show canine.right_turn_rate_deviation: it stays" in written.read_text()


def test_the_fragment_names_what_the_trials_do_not_show_and_what_the_handler_decides() -> None:
    trials = [Trial("t", {"drift": d, "start_heading": d}) for d in (1 * DEG, 3 * DEG)]
    text = fragment(pool(trials, PLANT.turned))
    assert tomllib.loads(text)["parameters"] == {
        "canine.drift": pytest.approx(2), "canine.drift_deviation": pytest.approx(math.sqrt(2), rel=1e-5)
    }  # fmt: skip
    assert "# the trials do not show canine.cruise_speed: it stays as the model has it" in text
    assert '# "canine.start_heading_deviation" = 1.41421' in text
    assert "the start was 2 deg off the first waypoint on average" in text


def test_a_statistic_beyond_the_model_is_neither_written_nor_silent() -> None:
    # given trials of an animal that slows down when told to run
    result = pool([Trial("t", {"speeding_up": value, "cruise_speed": 4.0}) for value in (-0.2, -0.3)], 0.1)
    assert "canine.speeding_up" not in result["parameters"]
    assert any(note.startswith("canine.speeding_up is -0.25; expected") for note in result["notes"])
    # then the file says so
    lines = fragment(result | {"sources": []}).splitlines()
    assert (
        "# the trials' canine.speeding_up is beyond what the model takes: it stays as the model has it"
        in lines
    )
    assert not any(line.startswith('"canine.speeding_up" =') for line in lines)


def test_an_effect_of_a_day_beyond_the_model_is_neither_written_nor_called_not_shown() -> None:
    # given a day whose fit shows two effects, one of which is more than the model takes
    effects = {name: {"verdict": "shown"} for name in ("fatigue_slows", "habituation_gain")}
    effects["fatigue_delays"] = {"verdict": "not shown: the interval includes 0"}
    day = {"effects": effects, "parameters": {"canine.habituation_gain": 0.3}}
    lines = fragment(pool([Trial("t", {"drift": 0.1})], PLANT.turned) | {"day": day}).splitlines()
    # then
    assert lines[-3].endswith("what is not here was not shown:")
    assert lines[-2:] == [
        "# canine.fatigue_slows was shown, beyond what the model takes: it stays as the model has it",
        '# "canine.habituation_gain" = 0.3',
    ]


def test_round_off_is_written_as_zero() -> None:
    # given values that differ in their last digits: 4.1 m/s, no drift; and decelerations that do vary
    trials = [
        Trial("t", {"cruise_speed": 4.1 + d, "drift": d, "slowing_down": 2.9 + 1e7 * d, "start_heading": d})
        for d in (0.0, 2e-15, -2e-15)
    ]
    text = fragment(pool(trials, PLANT.turned))
    parameters = tomllib.loads(text)["parameters"]
    # then
    assert parameters["canine.cruise_speed"] == pytest.approx(4.1)
    assert parameters["canine.cruise_speed_deviation"] == 0.0
    assert parameters["canine.drift"] == 0.0
    assert parameters["canine.drift_deviation"] == 0.0
    assert '# "canine.start_heading_deviation" = 0.0' in text
    assert parameters["canine.slowing_down_deviation"] == pytest.approx(2e-8, rel=1e-3)


def test_the_printed_table_has_table_5_1_beside_it_in_80_columns() -> None:
    # given five dogs that differ in how they turn to the left
    dogs = [{**DOG, "left": rate * DEG} for rate in (-40, -60, -80, -100, -120)]
    trials = [measure(motion(commands(SCHOOL), dog), PLANT) for dog in dogs]
    result = {**pool(trials, PLANT.turned), "sources": ["estimator"]}
    console = Console(width=80, record=True, file=io.StringIO())
    show(result, console)
    lines = console.export_text().splitlines()
    # then sd^2 = 1000, t(0.975, 4) = 2.776, chi2(0.025, 4) = 0.4844, chi2(0.975, 4) = 11.143
    heading = "5 trials (estimator) n mean ± sd mean, 95 % sd, 95 % Table 5.1 n"
    assert lines[0].split() == heading.split()
    row = "left turn [deg/s] 5 -80.0 ± 31.6 -119.3..-40.7 18.9..90.9 -77.67 ± 41.13 26"
    assert lines[5].split() == row.split()
    row = "left success rate 5 1.00 0.57..1.00 0.64 45"  # Wilson: 5 / (5 + 1.96^2) = 0.57
    assert lines[8].split() == row.split()
    assert "left out, start heading: the log has no waypoint (5)" in lines


def bars(axes: Axes) -> list[Rectangle]:
    return [patch for patch in axes.patches if isinstance(patch, Rectangle)]


def peak(line: Line2D) -> float:
    """Where a curve is highest."""
    return float(np.asarray(line.get_xdata())[np.argmax(line.get_ydata())])


def test_the_picture_has_a_panel_for_each_statistic_and_one_for_the_responses() -> None:
    # given trials with spread, without (one dog's acceleration), and a statistic without a value
    trials = [measure(motion(commands(SCHOOL), {**DOG, "cruise": v}), PLANT) for v in (3.0, 3.5, 4.0, 5.0)]
    drawn = figure(pool(trials, PLANT.turned))
    # then
    speed, up, *_, start, responses = drawn.axes
    assert [axes.get_xlabel() for axes in drawn.axes][:2] == ["velocity [m/s]", "acceleration [m/s2]"]
    assert [axes.get_ylabel() for axes in drawn.axes] == ["trials"] * 7 + ["success rate [%]"]
    assert responses.get_xlabel() == "command"
    # and the curves have the area of the bars, which count trials
    assert sum(bar.get_height() for bar in bars(speed)) == 4
    fitted, published = speed.lines
    area = sum(bar.get_height() * bar.get_width() for bar in bars(speed))
    deviation = np.std([3.0, 3.5, 4.0, 5.0], ddof=1)
    top = area / (deviation * math.sqrt(2 * math.pi))
    assert np.max(np.asarray(fitted.get_ydata())) == pytest.approx(top, rel=1e-3)
    assert peak(fitted) == pytest.approx(3.875, abs=0.02)
    assert peak(published) == pytest.approx(4.86, abs=0.02)
    assert len(up.patches) == 1
    assert not up.lines
    assert not start.patches
    assert [bar.get_height() for bar in bars(up)] == [4]
    assert [bar.get_height() for bar in bars(responses)] == [100.0, 100.0]


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write(tmp_path / "t.mcap", columns())
    (tmp_path / "file").touch()
    status, _, error = canine(capsys, "fit", log, "--out", tmp_path / "file" / "x")
    assert status == 2
    assert error.splitlines()[-1] == (
        f"canine: --out {tmp_path}/file/x: the folder cannot be made (Not a directory); choose another folder"
    )
