"""Pictures hold what the log says, where and in the colour that a reader expects."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.patches import Circle

from harness.drawing import MAGENTA
from harness.log.log import Channel, Log
from harness.trial import plots
from tests.harness.pictures import line, size

COMMANDS = [1, 1, 1, 2, 2, 4, 4, 0, 0, 5, 5, 1, 1, 3, 3]
TICKS = len(COMMANDS)


def channel(component: str, *names: str) -> Channel:
    blank = ("",) * len(names)
    return Channel(component, component, names, blank, ("Real",) * len(names), blank)


def trial(*, sensors: bool = True) -> Log:
    """A walk north-east at 1 m a tick of 1 s, with one of every command, a waypoint and a turn failure."""
    steps = np.arange(TICKS, dtype=float)
    deviation, anomaly = np.linspace(-1, 1, TICKS), (steps == 7) * 2
    controller = [COMMANDS, [1] * 14 + [2], steps >= 10, deviation, anomaly, 0 * steps]
    channels = [
        channel("plant", "north", "east", "speed"),
        channel(
            "controller", "command", "status", "waypoint", "deviation", "anomaly", "directional_commands"
        ),
    ]
    values = {"plant": np.column_stack([steps, 2 * steps, steps]), "controller": np.column_stack(controller)}
    if sensors:
        channels += [
            channel("sensors", "gps_fix", "gps_north", "gps_east", "gps_speed"),
            channel("estimator", "north", "east", "speed"),
        ]
        values["sensors"] = np.column_stack([steps % 5 == 0, steps + 0.5, 2 * steps, steps])
        values["estimator"] = np.column_stack([steps + 0.1, 2 * steps, steps])
    parameters = {
        "waypoint_count": "2", "waypoint_north[1]": "10.0", "waypoint_east[1]": "20.0",
        "waypoint_north[2]": "0.0", "waypoint_east[2]": "30.0", "home_north": "0.0", "home_east": "1.0",
        "capture_radius": "7.0",
        "moving_deviation": "0.8552113334772214", "stop_deviation": "0.3490658503988659",
    }  # fmt: skip
    metadata = {
        "scenario": {"name": "three", "seed": "1"},
        "parameters": {f"controller.{name}": value for name, value in parameters.items()},
    }
    return Log(Path("trial.mcap"), tuple(channels), metadata, {}, steps, values)


def segments(axes: Axes, label: str) -> tuple[str, list[list[list[float]]]]:
    """Colour and pieces of the collection with this label."""
    [pieces] = [c for c in axes.collections if isinstance(c, LineCollection) and c.get_label() == label]
    return to_hex(np.atleast_2d(pieces.get_colors())[0]), [
        np.asarray(s).tolist() for s in pieces.get_segments()
    ]


def test_the_same_log_gives_the_same_png() -> None:
    png = plots.trial_png(trial())
    assert size(png) == (14 * 150, 7.6 * 150)
    assert png == plots.trial_png(trial())


def test_the_path_is_coloured_by_command() -> None:
    axes, *_ = plots.trial_figure(trial()).axes
    # forward on ticks 0-2 and 11-12, each drawn on to where the next command begins; (east, north)
    assert segments(axes, "FORWARD") == (
        "#00a06d",
        [[[0, 0], [2, 1], [4, 2], [6, 3]], [[22, 11], [24, 12], [26, 13]]],
    )
    assert segments(axes, "STOP") == ("#d62f1f", [[[6, 3], [8, 4], [10, 5]]])
    assert segments(axes, "NONE") == ("#0072b2", [[[14, 7], [16, 8], [18, 9]]])
    assert segments(axes, "RECALL") == ("#111111", [[[26, 13], [28, 14]]])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("east [m]", "north [m]")
    assert axes.get_aspect() == 1.0


def test_directional_commands_are_triangles_where_they_were_given() -> None:
    axes, *_ = plots.trial_figure(trial()).axes
    lines = [line for line in axes.lines if line.get_marker() in ("<", ">")]
    triangles = {line.get_marker(): np.asarray(line.get_xydata()).tolist() for line in lines}
    assert triangles == {"<": [[10, 5]], ">": [[18, 9]]}


def test_waypoints_have_circles_of_the_capture_radius() -> None:
    axes, *_ = plots.trial_figure(trial()).axes
    circles = [(p.center, p.radius) for p in axes.patches if isinstance(p, Circle)]
    assert circles == [((20.0, 10.0), 7.0), ((30.0, 0.0), 7.0), ((1.0, 0.0), 7.0)]
    assert [text.get_text() for text in axes.texts] == ["1", "2", "home"]
    # and they are within view
    assert axes.get_xlim()[0] < -6
    assert axes.get_xlim()[1] > 37


def test_over_time_there_are_speed_deviation_and_commands() -> None:
    _, speed, deviation, commands = plots.trial_figure(trial()).axes
    assert [axes.get_ylabel() for axes in (speed, deviation, commands)] == [
        "speed [m/s]",
        "deviation [deg]",
        "controller output",
    ]
    assert commands.get_xlabel() == "time [s]"
    # GPS on the fixes alone, at ticks 0, 5 and 10
    assert line(speed, "GPS").tolist() == [[0, 0], [5, 5], [10, 10]]
    assert len(line(speed, "truth")) == len(line(speed, "estimate")) == TICKS
    # deviation from rad, thresholds of 49 and 20 degrees
    assert line(deviation, "h")[-1] == pytest.approx([14, 57.29578])
    assert line(deviation, "h' = 49 deg")[:, 1] == pytest.approx([49, 49])
    assert line(deviation, "h'' = 20 deg")[:, 1] == pytest.approx([20, 20])
    # commands by name, the anomaly on its tick, the waypoint when it was counted
    assert [t.get_text() for t in commands.get_yticklabels()] == [
        "none", "forward", "stop", "recall", "left", "right",
    ]  # fmt: skip
    assert segments(commands, "LEFT")[1] == [[[5, 4], [7, 4]]]
    assert line(commands, "turn failure")[:, 0].tolist() == [7]
    reached = [mark for mark in speed.lines if mark.get_color() == MAGENTA]
    assert [np.asarray(mark.get_xdata())[0] for mark in reached] == [10]


def test_a_trial_without_sensors_is_drawn_without_an_estimate() -> None:
    axes, *_ = plots.trial_figure(trial(sensors=False)).axes
    assert "estimate" not in [text.get_label() for text in axes.lines]
    assert size(plots.trial_png(trial(sensors=False))) == (2100, 1140)


def test_a_deviation_that_wraps_round_leaves_a_gap() -> None:
    log = trial()
    log.values["controller"][:, 3] = [3.1] * 7 + [-3.1] * 8
    deviation = plots.trial_figure(log).axes[2]
    assert np.flatnonzero(np.isnan(line(deviation, "h")[:, 1])).tolist() == [7]


def test_a_log_of_one_tick_without_a_route_can_be_drawn() -> None:
    log = trial()
    values = {name: rows[:1] for name, rows in log.values.items()}
    short = Log(log.path, log.channels, {}, {}, log.time[:1], values)
    assert size(plots.trial_png(short)) == (2100, 1140)
