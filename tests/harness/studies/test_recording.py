"""All estimators on a recording: the study's groups, halves and innovations."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from harness.recording.recording import RecordingError
from harness.replay.comparison import CONFIGURATIONS, HELD, MEAN, compare
from harness.replay.source import open_source
from harness.replay.windows import NOT_VALID
from harness.report.figures import charts_of
from harness.studies import recording
from harness.studies.study import Options, run_study
from models.errors import UsageError
from models.four_state import FourState
from models.kit.model import Model
from models.system import ESTIMATORS
from tests.harness.replay.logs import TICK_S, walk, write

STOPS_S, ENDS_S = 50.0, 70.0


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk north at 2 m/s from 4 to 50 s, then 20 s at rest; fixes with some noise, no magnetometer."""
    signals = walk(ENDS_S)
    time = np.arange(len(signals["gps_north"])) * TICK_S
    noise = np.random.default_rng(5).normal(0, 0.2, len(time))
    signals["gps_north"] = np.minimum(signals["gps_north"], 2 * (STOPS_S - 4)) + noise
    signals["gps_speed"] = np.where(time < STOPS_S, signals["gps_speed"], 0.0)
    for name in ("gyro_x", "gyro_y", "gyro_z", "accel_y", "roll_meas"):
        signals[name] = np.zeros(len(time))
    signals["accel_z"] = np.full(len(time), -9.80665)
    return write(tmp_path_factory.mktemp("walk") / "trial.mcap", signals)


@pytest.fixture(scope="module")
def result(path: Path) -> dict[str, Any]:
    return run_study("recording", Options(recording=path))


def test_outages_that_end_at_rest_and_the_halves_are_told_apart(result: dict[str, Any]) -> None:
    # given outages of 10 s, one every 5 s from 15 s on (10 s after the first moving fix), up to 65 s
    ends = [outage["end_s"] for outage in result["outages"]]
    assert ends == [25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0]
    assert [outage["standing"] for outage in result["outages"]] == [end >= 50.0 for end in ends]
    # then five end in motion, of which three do not overlap: 15, 25 and 35 s
    assert result["moving"]["configurations"][HELD]["n"] == 5
    assert result["standing"]["configurations"][HELD]["n"] == 4
    assert result["separate"] == {"all": 5, "moving": 3}
    # and the middle is between 15 and 65 s: those that end by 40 s, those that start from then on
    assert result["middle_s"] == 40.0
    first, second = (result["halves"][half] for half in ("first", "second"))
    assert first["moving"]["configurations"][HELD]["n"] == 4
    assert second["moving"] is None
    assert second["standing"]["configurations"][HELD]["n"] == 4
    assert second["separate"] == 2  # from 40 and from 50 s on


def test_every_configuration_without_a_magnetometer_is_judged(result: dict[str, Any]) -> None:
    blind = [name for name in ESTIMATORS if name != "seven_state"]
    labels = [label for name in blind for label in CONFIGURATIONS.get(name, {name: {}})]
    assert list(result["configurations"]) == [HELD, MEAN, *labels]
    assert list(result["innovations"]) == labels
    assert "seven_state: left out, since the recording has no magnetometer" in result["notes"]
    # at 2 m/s held up to the stop at 50 s, ten seconds of rest are 20 m too far
    errors = {o["end_s"]: o["errors"][HELD]["position_error_m"] for o in result["outages"]}
    assert errors[55.0] == pytest.approx(10.0, abs=1.0)
    assert errors[45.0] < 1.0


def test_nis_is_that_of_the_python_models_innovations(path: Path) -> None:
    # given the model over the walk
    source = open_source(path)
    signals = source.signals([])
    model = Model(FourState, {"use_pitch": 1, "fuzzy": 0})
    model.initialize()
    nis = []
    for tick in range(len(signals.t)):
        for name in FourState.flat_names("input"):
            model[name] = float(getattr(signals, name)[tick])
        model.step()
        if model["accepted"] > 0:
            pairs = [(model[f"innovation[{i}]"], model[f"innovation_variance[{i}]"]) for i in (1, 2, 3)]
            nis.append((signals.t[tick], sum(y * y / s for y, s in pairs)))
    # then
    row = recording.nis_of(source, compare("four_state").configurations[1], 40.0)
    times, values = np.array(nis).T
    assert row["accepted"] == len(nis) > 300
    assert row["all"]["nis"] == pytest.approx(values.mean(), rel=1e-12)
    assert row["second"]["nis"] == pytest.approx(values[times >= 40.0].mean(), rel=1e-12)
    assert row["all"]["expected"] == 3


def test_a_course_that_a_fix_at_rest_does_not_give_is_not_expected(path: Path) -> None:
    row = recording.nis_of(open_source(path), compare("six_state").configurations[0], 55.0)
    assert row["second"]["expected"] == 3  # speed, north, east
    assert 3.5 < row["first"]["expected"] < 4


def test_tables_and_picture_hold_all_of_it(result: dict[str, Any]) -> None:
    text = io.StringIO()
    recording.show(result, Console(file=text, width=200))
    for words in (
        "5 outages,",
        "standing still at the end",
        "fuzzy, floor, cap",
        "halves, at 40 s",
        "4 and 4 outages; p of the 2",
    ):
        assert words in text.getvalue()
    (figure,) = recording.draw(result).values()
    assert all(chart["marks"] for grid in charts_of(figure) for chart in grid)
    positions, speeds, nis = figure.axes
    assert [label.get_text() for label in positions.get_yticklabels()] == list(result["configurations"])
    assert len(speeds.lines) == 3 * len(result["configurations"])  # moving, mean, standing
    assert nis.get_xscale() == "log"
    json.dumps(result, allow_nan=False)


def test_the_study_needs_a_recording() -> None:
    with pytest.raises(UsageError, match="expected a recording, as in `canine study recording"):
        run_study("recording")


def test_estimators_that_refuse_every_fix_are_not_judged(tmp_path: Path) -> None:
    # given accuracies in millimetres that are declared in metres
    signals = walk(40)
    signals["gps_h_acc"] = np.full(len(signals["gps_fix"]), 1750.0)
    log = write(tmp_path / "trial.mcap", signals)
    # then
    with pytest.raises(RecordingError, match=r"none is valid at the start of any of 3 outages; .* refused"):
        run_study("recording", Options(recording=log))


def test_outages_that_an_estimator_is_not_valid_at_are_counted(tmp_path: Path) -> None:
    # given accuracies that no filter takes from 30 s on: at 46 s the last good fix is 16 s old
    signals = walk(70)
    signals["gps_h_acc"][round(30 / TICK_S) :] = 2000
    log = write(tmp_path / "trial.mcap", signals)
    result = run_study("recording", Options(recording=log))
    # then the outages from 45 s on are judged no more
    assert [outage["start_s"] for outage in result["outages"]] == [15, 20, 25, 30, 35, 40]
    assert result["left_out"] == {NOT_VALID: 3}
    assert "canine_tracker: not valid at the start of 3 of 9 outages" in result["notes"]


def test_the_legend_says_of_which_outages_the_mean_is(result: dict[str, Any]) -> None:
    (figure,) = recording.draw(result).values()
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "mean of those moving" in texts
    assert "mean" not in texts
