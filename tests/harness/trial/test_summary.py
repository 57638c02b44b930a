"""A summary's numbers are those that its log's rows give by hand."""

import io
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from harness.files import FileError
from harness.log.channel import Channel
from harness.log.log import Log
from harness.trial.plots import trial_figure
from harness.trial.summary import in_a_sentence, show, summarize, words, write_summary
from models.commands import Command


def little(
    *,
    status: list[float],
    anomaly: list[float] | None = None,
    estimate: list[tuple[float, float]] | None = None,
    broken: str = "",
) -> Log:
    """A dog that stands on the origin; ticks of 0.5 s."""
    ticks = len(status)

    def channel(component: str, *names: str) -> Channel:
        blank = ("",) * len(names)
        return Channel(component, component, names, blank, ("Real",) * len(names), blank)

    channels = [
        channel("plant", "north", "east"),
        channel("controller", "status", "waypoint", "directional_commands", "anomaly"),
    ]
    values = {
        "plant": np.zeros((ticks, 2)),
        "controller": np.column_stack(
            [status, np.minimum(np.arange(ticks), 2), np.arange(ticks) * 3, anomaly or [0.0] * ticks]
        ),
    }
    if estimate:
        channels.append(channel("estimator", "north", "east"))
        values["estimator"] = np.array(estimate)
    metadata = {"scenario": {"name": "<three>", "seed": "7"}, "parameters": {"canine.seed": "7"}}
    time = np.arange(ticks, dtype=np.float64) * 0.5
    return Log(Path("out/trial.mcap"), tuple(channels), metadata, {}, time, values, broken=broken)


@pytest.mark.parametrize(
    ("stands_from", "words"),
    [
        (20, "its time was over, and it had stood for 10 s at 3.0 m north, -4.0 m east, last told FORWARD"),
        (0, "its time was over, and it had stood for 20 s at 3.0 m north, -4.0 m east, last told FORWARD"),
        (21, None),  # for 9.5 s
    ],
)
def test_an_animal_that_stood_when_its_time_was_over_is_told(stands_from: int, words: str | None) -> None:
    # given 41 ticks of 0.5 s, of which it moves on the first ones, and is told FORWARD throughout
    log = little(status=[1] * 41)
    names, blank = ("north", "east", "speed"), ("",) * 3
    plant = Channel("plant", "plant", names, blank, ("Real",) * 3, blank)
    told = Channel("controller", "controller", ("status", "command"), ("",) * 2, ("Real",) * 2, ("",) * 2)
    speed = np.where(np.arange(41) < stands_from + (stands_from > 0), 2.0, 0.0)
    values = {
        "plant": np.column_stack([np.full(41, 3.0), np.full(41, -4.0), speed]),
        "controller": np.tile([1.0, float(Command.FORWARD)], (41, 1)),
    }
    # then
    assert summarize(replace(log, channels=(plant, told), values=values))["stopped_by"] == words


def test_the_summary_of_a_trial_is_that_derived_by_hand() -> None:
    # given a trial that succeeds on its fourth tick, with estimates off by 0, 5, 1, 2 and 2 m
    log = little(
        status=[1, 1, 1, 2, 2],
        anomaly=[0, 2, 2, 5, 0],
        estimate=[(0, 0), (3, 4), (0, -1), (-2, 0), (0, 2)],
    )
    # then its mean error is 10 m / 5
    assert summarize(log, 40.5) == {
        "scenario": "<three>",
        "seed": 7,
        "estimator": None,
        "outcome": "success",
        "stopped_by": None,
        "time_s": 1.5,
        "waypoints_reached": 2,
        "directional_commands": 12,
        "anomalies": {"TURN_FAILURE": 2, "TRIAL_FAILURE": 1},
        "position_error_m": {"mean": 2.0, "max": 5.0, "final": 2.0},
        "ticks": 5,
        "faults": [],
        "real_time_factor": 40.5,
        "log": "trial.mcap",
        "notes": [],
    }


@pytest.mark.parametrize(
    ("last", "anomaly", "words"),
    [
        (4, [6, 2, 9, 0], "the budget of stimuli was spent (rule 3)"),
        (4, [6, 2, 6, 0], "the radio link was lost (rule 9)"),
        (4, [6, 2, 0, 2], "the operator"),
        (4, [6, 2, 7, 0], "the operator"),  # the estimate became invalid on the same tick
        (4, [6, 2, 13, 0], "the animal was outside the fence (rule 7)"),
        (3, [6, 2, 5, 0], "another directional command was needed, after MAXTURN of them"),
    ],
)
def test_what_ended_the_trial_is_said_in_words(last: int, anomaly: list[float], words: str) -> None:
    # given a controller that stops, or fails, on the third tick
    log = little(status=[1, 1, last, last], anomaly=anomaly)
    summary = summarize(log, notes=["a note & more"])
    # then summary, table and picture say why
    assert summary["stopped_by"] == words
    console = Console(file=io.StringIO(), width=100)
    show(summary, console)
    assert words in console.file.getvalue()  # type: ignore[attr-defined]
    figure = trial_figure(log)
    assert words in "".join(text.get_text() for text in (figure._suptitle, *figure.texts) if text)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("status", "broken", "outcome", "time"),
    [
        ([1, 1, 2], "", "success", 1.0),
        ([1, 3, 3], "", "failed", 0.5),
        ([4, 4, 4], "", "stopped", 0.0),
        ([2, 1, 2], "", "success", 1.0),  # the status it ended with, not an earlier trial's
        ([1, 1, 1], "", "timeout", 1.0),
        ([0, 0, 0], "", "timeout", 1.0),
        ([1, 1, 1], "killed", "stopped", 1.0),
        ([1, 2, 2], "killed", "success", 0.5),
    ],
)
def test_the_outcome_follows_from_the_last_status(
    status: list[float], broken: str, outcome: str, time: float
) -> None:
    summary = summarize(little(status=status, broken=broken))
    assert (summary["outcome"], summary["time_s"]) == (outcome, time)


def test_without_an_estimator_there_is_no_position_error() -> None:
    summary = summarize(little(status=[1, 2]))
    assert summary["position_error_m"] is None
    assert summary["real_time_factor"] is None


def test_the_position_error_is_over_the_ticks_with_an_estimate() -> None:
    # given one that is NaN on the last tick, which ends a run, and one that always is
    log = little(status=[1, 2], estimate=[(1, 1), (0, math.nan)])
    never = little(status=[1, 2], estimate=[(math.nan, 0), (0, math.nan)])
    # then
    error = summarize(log)["position_error_m"]
    assert error == {"mean": math.sqrt(2), "max": math.sqrt(2), "final": math.sqrt(2)}
    assert summarize(never)["position_error_m"] is None
    assert words(summarize(never))["position error"] == "no estimate, or no truth to compare it with"


def test_a_run_without_a_controller_is_summarized() -> None:
    log = little(status=[1, 1])
    log = Log(log.path, log.channels[:1], {}, {}, log.time, log.values)
    summary = summarize(log)
    assert (summary["outcome"], summary["waypoints_reached"], summary["anomalies"]) == ("timeout", 0, {})


def test_an_unnamed_anomaly_keeps_its_code() -> None:
    assert summarize(little(status=[1, 1], anomaly=[0, 77]))["anomalies"] == {"77": 1}


def test_a_summary_that_cannot_be_written_leaves_the_earlier_one(tmp_path: Path) -> None:
    path = tmp_path / "summary.json"
    summary = summarize(little(status=[1, 2]))
    write_summary(summary, path)
    assert json.loads(path.read_text()) == summary
    # when a second one cannot be made, then the first stays and nothing lies beside it
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_summary({**summary, "time_s": math.inf}, path)
    assert json.loads(path.read_text()) == summary
    assert list(tmp_path.iterdir()) == [path]


def test_a_summary_into_a_folder_that_does_not_exist_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"no/summary.json: cannot be written \(No such file or directory\)"):
        write_summary(summarize(little(status=[2])), tmp_path / "no" / "summary.json")


def test_the_table_shows_every_key_in_words() -> None:
    console = Console(width=100, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    show(summarize(little(status=[1, 3], anomaly=[0, 5], estimate=[(0, 0), (3, 4)])), console)
    rows = [" ".join(line.split()) for line in console.export_text().splitlines()]
    assert rows == [
        "scenario <three>",
        "seed 7",
        "outcome failed",
        "ended by another directional command was needed, after MAXTURN of them",
        "time 0.50 s",
        "waypoints reached 1",
        "directional commands 3",
        "anomalies trial failure 1",
        "position error mean 2.50 m, max 5.00 m, final 5.00 m",
        "ticks 2",
        "times real time not measured",
        "log trial.mcap",
    ]


@pytest.mark.parametrize(
    ("roles", "swaps", "words"),
    [
        ({"estimator": "four_state"}, {}, None),
        ({"estimator": "four_state", "ahrs": "canine_ahrs"}, {}, "four_state with canine_ahrs"),
        ({"estimator": "canine_tracker"}, {}, "canine_tracker"),
        ({"estimator": "kalman"}, {"estimator": "estimator.fmu"}, "kalman from an FMU"),
        ({"controller": "cmec"}, {}, None),
    ],
)
def test_another_estimator_than_the_default_is_named(
    roles: dict[str, str], swaps: dict[str, str], words: str | None
) -> None:
    log = little(status=[1, 2])
    log = replace(log, metadata={**log.metadata, "roles": roles, "swaps": swaps})
    # then the table has a row for it, and the picture's title has its name
    console = Console(width=100, record=True, file=io.StringIO())
    show(summary := summarize(log), console)
    rows = [" ".join(line.split()) for line in console.export_text().splitlines()]
    assert [row for row in rows if row.startswith("estimator")] == ([f"estimator {words}"] if words else [])
    by = f", {words}" if words else ""
    assert trial_figure(log).get_suptitle() == f"<three>, seed 7{by}: success after 0.5 s"
    assert summary["estimator"] == (words or roles.get("estimator"))


@pytest.mark.parametrize(
    ("status", "anomaly", "sentence"),
    [
        ([1, 1, 2, 2], [0] * 4, "Success after 1 s. 2 waypoints reached, with 9 directional commands."),
        (
            [1, 4, 4, 4],
            [0, 6, 0, 0],
            "Stopped after 0.5 s: the radio link was lost (rule 9). "
            "2 waypoints reached, with 9 directional commands.",
        ),
        ([1], [0], "Timeout after 0 s. No waypoints reached, with no directional commands."),
        ([1, 1], [0, 0], "Timeout after 0.5 s. 1 waypoint reached, with 3 directional commands."),
    ],
)
def test_the_outcome_is_a_sentence_with_its_reason(
    status: list[float], anomaly: list[float], sentence: str
) -> None:
    assert in_a_sentence(summarize(little(status=status, anomaly=anomaly))) == sentence


def test_rule_5_the_estimators_counts_are_among_the_anomalies() -> None:
    # given an estimator that rejects two fixes, begins anew, and doubts its heading for a while
    log = little(status=[1, 1, 1, 1], anomaly=[0, 2, 0, 0])
    names = ("rejected_fixes", "jumps", "recoveries", "heading_ok")
    rows = np.array([[5, 0, 0, 1], [6, 0, 0, 1], [7, 0, 1, 0], [7, 0, 1, 1]], dtype=float)
    blank = ("",) * 4
    channel = Channel("estimator", "estimator", names, blank, ("Integer",) * 4, blank)
    log = Log(log.path, (*log.channels, channel), {}, {}, log.time, log.values | {"estimator": rows})
    assert summarize(log)["anomalies"] == {
        "TURN_FAILURE": 1, "REJECTED_FIX": 2, "RECOVERY": 1, "CONTRADICTED_HEADING": 1,
    }  # fmt: skip
