"""Pictures hold what the log says, where and in the colour that a reader expects."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.patches import Circle, Rectangle
from matplotlib.path import Path as MplPath
from matplotlib.text import Text
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

from harness.drawing import ESTIMATE, FAULTS, LOST_RADIO, MAGENTA, ORDER, OUTAGE, png_of
from harness.log.log import Log
from harness.trial import plots
from models.commands import Command
from tests.harness.pictures import line, size
from tests.harness.trial.logs import TICKS, channel, trial, with_signal, without_signal

WIDTH, HEIGHT = 11 * 150, 7.4 * 150  # pixels


def segments(axes: Axes, label: str) -> tuple[str, list[list[list[float]]]]:
    """Colour and pieces of the collection with this label."""
    [pieces] = [c for c in axes.collections if isinstance(c, LineCollection) and c.get_label() == label]
    return to_hex(np.atleast_2d(pieces.get_colors())[0]), [
        np.asarray(s).tolist() for s in pieces.get_segments()
    ]


def names(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts if text.get_text()]


def bands(axes: Axes, face: str) -> list[tuple[float, float]]:
    """From and until of the bands of a colour over time."""
    spans = [
        p for p in axes.patches if isinstance(p, Rectangle) and to_hex(p.get_facecolor()) == face.lower()
    ]
    return [(span.get_x(), span.get_x() + span.get_width()) for span in spans]


def crossed(axes: Axes) -> list[str]:
    """The names of places that a path on the map runs through, as the renderer places both."""
    canvas = axes.figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    lines = [line.get_xydata() for line in axes.lines if line.get_label() == "estimate"]
    for pieces in axes.collections:
        if isinstance(pieces, LineCollection) and pieces.get_label() in Command.__members__:
            lines += pieces.get_segments()
    paths = [MplPath(axes.transData.transform(np.asarray(line))) for line in lines]
    return [
        text.get_text()
        for text in axes.texts
        if text.get_text()
        and any(path.intersects_bbox(Text.get_window_extent(text, renderer), filled=False) for path in paths)
    ]


def test_the_same_log_gives_the_same_png() -> None:
    png = plots.trial_png(trial())
    assert size(png) == (WIDTH, HEIGHT)
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
    assert names(axes) == ["1", "2", "home"]
    # and they are within view
    assert axes.get_xlim()[0] < -6
    assert axes.get_xlim()[1] > 37


def test_over_time_there_are_speed_deviation_and_commands() -> None:
    _, speed, deviation, commands = plots.trial_figure(trial()).axes
    assert [axes.get_ylabel() for axes in (speed, deviation, commands)] == [
        "speed [m/s]",
        "deviation h [deg]",
        "command",
    ]
    assert commands.get_xlabel() == "time [s]"
    # GPS on the fixes alone, at ticks 0, 5 and 10
    assert line(speed, "GPS fix").tolist() == [[0, 0], [5, 5], [10, 10]]
    assert len(line(speed, "truth")) == len(line(speed, "estimate")) == TICKS
    # deviation from rad, thresholds of 49 and 20 degrees
    assert line(deviation, "h")[-1] == pytest.approx([14, 57.29578])
    assert line(deviation, "deviation threshold h' = 49 deg")[:, 1] == pytest.approx([49, 49])
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
    assert size(plots.trial_png(trial(sensors=False))) == (WIDTH, HEIGHT)


def test_a_deviation_that_wraps_round_leaves_a_gap() -> None:
    log = trial()
    log.values["controller"][:, 3] = [3.1] * 7 + [-3.1] * 8
    deviation = plots.trial_figure(log).axes[2]
    assert np.flatnonzero(np.isnan(line(deviation, "h")[:, 1])).tolist() == [7]


def test_a_log_of_one_tick_without_a_route_can_be_drawn() -> None:
    log = trial()
    values = {name: rows[:1] for name, rows in log.values.items()}
    short = Log(log.path, log.channels, {}, {}, log.time[:1], values)
    assert size(plots.trial_png(short)) == (WIDTH, HEIGHT)


# what disturbed the trial


def test_outages_orders_and_lost_radio_are_bands_with_a_legend() -> None:
    figure = plots.trial_figure(without_fix(trial(), at=5))
    for axes in figure.axes[1:]:
        assert bands(axes, OUTAGE["facecolor"]) == [(5, 10)]
        assert bands(axes, ORDER["facecolor"]) == [(3, 5)]
        assert bands(axes, LOST_RADIO["facecolor"]) == [(6, 9)]
    (legend,) = figure.legends
    shown = [text.get_text() for text in legend.get_texts()]
    assert shown[-3:] == ["GPS outage", "operator's order", "lost radio"]


def test_faults_are_bands_under_their_words() -> None:
    # given one that lasts to the end, one within a tick, and one behind the end
    log = trial()
    fault = '[[fault]]\nsignal = "a.b"\nkind = "{}"\nat = {}\n'.format
    toml = fault("off", 9.5) + fault("stuck", 3.2) + "until = 3.4\n" + fault("nan", 20.0)
    log.metadata["scenario"]["toml"] = toml
    # when
    figure = plots.trial_figure(log)
    # then
    assert [text.get_text() for text in figure.legends[0].get_texts()][-2:] == ["off of a.b", "stuck of a.b"]
    for axes in figure.axes[1:]:
        first, second, *_ = FAULTS
        assert bands(axes, first["facecolor"]) == [(9.5, 14)]
        assert bands(axes, second["facecolor"]) == [(3.2, 3.4)]
    assert plots.trial_png(log)


def test_long_names_of_faults_leave_the_legend_within_the_picture() -> None:
    log = trial()
    fault = '[[fault]]\nsignal = "controller.{0} -> plant.{0}"\nkind = "off"\nat = 1\n'.format
    log.metadata["scenario"]["toml"] = "".join(fault(f"a_rather_long_name_{k}") for k in range(6))
    # when
    figure = plots.trial_figure(log)
    # then
    legend = figure.legends[0].get_window_extent()
    assert len(figure.legends) == 1
    assert legend.x0 >= 0
    assert legend.x1 <= figure.bbox.x1


def without_fix(log: Log, at: int) -> Log:
    log.values["sensors"][at, 0] = 0
    return log


def test_bands_lie_under_the_path_too() -> None:
    axes, *_ = plots.trial_figure(without_fix(trial(), at=5)).axes
    trails = {
        str(c.get_label()): c
        for c in axes.collections
        if isinstance(c, LineCollection) and c.get_label() in plots.BANDS
    }
    # (east, north) of ticks 5 to 10, 3 to 5 and 6 to 9
    ends = {
        label: [segment[[0, -1]].tolist() for segment in trail.get_segments()]
        for label, trail in trails.items()
    }
    assert ends == {
        "GPS outage": [[[10, 5], [20, 10]]],
        "operator's order": [[[6, 3], [10, 5]]],
        "lost radio": [[[12, 6], [18, 9]]],
    }
    # the later are narrower, so that the earlier show beside them
    widths = [np.atleast_1d(trail.get_linewidth())[0] for trail in trails.values()]
    assert widths == sorted(widths, reverse=True)
    assert all(trail.get_zorder() < 2 for trail in trails.values())


def test_an_undisturbed_trial_has_no_band_and_no_entry() -> None:
    log = with_signal(with_signal(trial(), "controller.override", 0), "controller.link_ok", 1)
    figure = plots.trial_figure(log)
    assert all(not isinstance(patch, Rectangle) for axes in figure.axes for patch in axes.patches)
    assert not set(plots.BANDS) & {text.get_text() for text in figure.legends[0].get_texts()}


def test_an_order_is_drawn_round_the_command_that_it_asks_for() -> None:
    commands = plots.trial_figure(trial()).axes[3]
    assert segments(commands, "operator's order") == (ORDER["edgecolor"].lower(), [[[3, 2], [5, 2]]])


def test_an_order_of_one_tick_is_still_a_line() -> None:
    log = with_signal(trial(), "controller.override", np.arange(TICKS) == TICKS - 1)
    axes = plots.trial_figure(log).axes[1]
    assert bands(axes, ORDER["facecolor"]) == [(14, 14)]
    assert all(p.get_linewidth() > 0.5 for p in axes.patches if isinstance(p, Rectangle))


# the path


def test_the_start_is_an_arrow_that_looks_where_the_dog_looks() -> None:
    axes, *_ = plots.trial_figure(with_signal(trial(), "plant.heading", np.radians(120))).axes
    [arrow] = [mark for mark in axes.lines if mark.get_label() == "start"]
    assert np.asarray(arrow.get_xydata()).tolist() == [[0, 0]]
    marker = arrow._marker  # type: ignore[attr-defined]
    tip = marker.get_transform().transform(marker.get_path().vertices)[plots.ARROW.index((0, 1))]
    assert np.degrees(np.arctan2(*tip)) == pytest.approx(120)  # from north to east


def test_a_plant_without_a_heading_starts_at_a_dot() -> None:
    axes, *_ = plots.trial_figure(without_signal(trial(), "plant.heading")).axes
    [dot] = [mark for mark in axes.lines if mark.get_label() == "start"]
    assert dot.get_marker() == "o"


def test_the_estimate_lies_under_the_truth() -> None:
    path, speed, *_ = plots.trial_figure(trial()).axes
    level = {line.get_label(): line.get_zorder() for line in (*speed.lines, *path.collections, *path.lines)}
    assert level["estimate"] < level["GPS fix"] < min(level["truth"], level["FORWARD"], level["STOP"])


def test_an_estimate_that_runs_away_leaves_the_panels_with_a_note() -> None:
    # given a path over 28 m, and an estimate that jumps 5 km to the south and 60 m/s
    log = trial()
    log.values["estimator"][9] = [-5000.0, 18.0, 60.0]
    # when
    path, speed, *_ = plots.trial_figure(log).axes
    # then the truth has the panels, and notes say what is beyond
    assert "the estimate leaves the map: up to 5009 m off" in names(path)
    assert path.get_ylim()[1] - path.get_ylim()[0] < 150
    assert "the estimate leaves the panel: 60 m/s" in names(speed)
    assert speed.get_ylim()[1] < 32
    # and nothing of the estimate is left out of the data
    assert line(path, "estimate")[9].tolist() == [18, -5000]


def test_an_estimate_that_is_somewhat_off_is_in_the_panels_without_a_note() -> None:
    log = trial()
    log.values["estimator"][9] = [-10.0, 18.0, 20.0]
    path, speed, *_ = plots.trial_figure(log).axes
    assert (names(path), names(speed)) == (["1", "2", "home"], [])
    assert path.get_ylim()[0] < -10
    assert speed.get_ylim()[1] > 20


def test_many_changes_of_the_command_do_not_fill_the_panel() -> None:
    steps = [
        next(drawn.get_linewidth() for drawn in plots.trial_figure(log).axes[3].lines)
        for log in (trial(), longer(trial(), 100))
    ]
    assert steps[0] == 1
    assert steps[1] < 0.3


def test_anomalies_are_marked_on_the_path_by_the_marker_that_they_have_over_time() -> None:
    path, _, _, commands = plots.trial_figure(trial()).axes
    assert line(path, "turn failure").tolist() == [[14, 7]]
    markers = [mark.get_marker() for axes in (path, commands) for mark in axes.lines
               if mark.get_label() == "turn failure"]  # fmt: skip
    assert len(markers) == 2
    assert markers[0] == markers[1]


@pytest.mark.parametrize("count", [1, 16])
@pytest.mark.parametrize("reach", [3.0, 40.0, 5000.0])
def test_no_path_runs_through_a_name(count: int, reach: float) -> None:
    # given waypoints round a circle, each left by a path towards where its name would stand first
    turn = 2 * np.pi * np.arange(count) / count
    north, east = reach * np.cos(turn), reach * np.sin(turn)
    out = 0.15 * reach
    legs = [
        [(n, e), (n + out, e + out), (n, e), (n, e + out), (n, e)] for n, e in zip(north, east, strict=True)
    ]
    corners = np.array([(0.0, 0.0), *(corner for leg in legs for corner in leg), (0.0, 0.0)])
    time = np.arange(len(corners), dtype=float)
    controller = np.column_stack([1 + 0 * time, 1 + 0 * time])
    parameters = {"controller.waypoint_count": str(count), "controller.home_north": "0",
                  "controller.home_east": "0", "controller.capture_radius": "7"}  # fmt: skip
    for i in range(count):
        parameters |= {f"controller.waypoint_north[{i + 1}]": str(north[i]),
                       f"controller.waypoint_east[{i + 1}]": str(east[i])}  # fmt: skip
    log = Log(
        Path("trial.mcap"), (channel("plant", "north", "east"), channel("controller", "command", "status")),
        {"parameters": parameters}, {}, time, {"plant": corners, "controller": controller},
    )  # fmt: skip
    # when
    axes, *_ = plots.trial_figure(log).axes
    # then each name is there, within the map, off the path and off the others
    assert names(axes) == [*map(str, range(1, count + 1)), "home"]
    assert crossed(axes) == []
    boxes = [Text.get_window_extent(text) for text in axes.texts if text.get_text()]
    assert all(axes.bbox.contains(*box.min) and axes.bbox.contains(*box.max) for box in boxes)
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_the_scale_bar_is_a_round_length_and_covers_nothing() -> None:
    axes, *_ = plots.trial_figure(trial()).axes
    [bar] = [artist for artist in axes.artists if isinstance(artist, AnchoredSizeBar)]
    assert bar.txt_label.get_text() == "10 m"
    [stroke] = bar.size_bar.get_children()
    left, right = axes.transData.transform([(0, 0), (10, 0)])[:, 0]
    assert stroke.get_window_extent().width == pytest.approx(right - left, abs=3)
    assert bar.get_window_extent().y0 >= axes.bbox.y1


def test_a_map_has_one_scale_and_plain_numbers() -> None:
    log = with_signal(trial(), "plant.north", 99_000 + np.arange(TICKS))
    figure = plots.trial_figure(log)
    axes = figure.axes[0]
    east, north = axes.transData.transform([(1, 0), (0, 1)]) - axes.transData.transform((0, 0))
    assert east[0] == pytest.approx(north[1])
    assert [tick.get_text() for tick in axes.get_yticklabels() if "+" in tick.get_text()] == []
    assert axes.yaxis.get_offset_text().get_text() == ""


# unusual trials


def test_a_plant_that_never_moves_is_no_magnified_point() -> None:
    log = with_signal(
        with_signal(with_signal(trial(sensors=False), "plant.north", 0), "plant.east", 0), "plant.speed", 0
    )
    axes, *_ = plots.trial_figure(Log(log.path, log.channels, {}, {}, log.time, log.values)).axes
    for low, high in (axes.get_xlim(), axes.get_ylim()):
        assert high - low >= 10
        assert low < 0 < high


@pytest.mark.parametrize(
    "name",
    [
        "Zürich-犬",
        "犬" * 300,
        "a name of many words " * 30,
        "W" * 300,
        "x^$ $",
        r"\$\frac",
        "lines\nand\tand \x1b",
    ],
    ids=["foreign", "long and wide", "long words", "long and no blank", "maths", "TeX", "control characters"],
)
def test_a_title_fits_whatever_the_name_is(name: str, recwarn: pytest.WarningsRecorder) -> None:
    log = trial()
    log.metadata["scenario"]["name"] = name
    figure = plots.trial_figure(log)
    assert size(png_of(figure)) == (WIDTH, HEIGHT)
    title = figure.get_suptitle()
    assert title.endswith(", seed 1: success after 14.0 s")
    [text] = [text for text in figure.texts if text.get_text() == title]
    extent = text.get_window_extent()
    assert extent.x0 >= 0
    assert extent.x1 <= WIDTH
    assert extent.height < 60  # one line
    assert [str(warning.message) for warning in recwarn] == []


def test_many_disobediences_get_smaller_marks() -> None:
    log = with_signal(trial(), "controller.anomaly", 2)
    sizes = [
        next(
            m.get_markersize()
            for m in plots.trial_figure(log).axes[0].lines
            if m.get_label() == "turn failure"
        )
        for log in (trial(), longer(log, 40))
    ]
    assert sizes[1] < sizes[0]


def longer(log: Log, times: int) -> Log:
    """The log's rows over and over."""
    values = {name: np.tile(rows, (times, 1)) for name, rows in log.values.items()}
    return Log(log.path, log.channels, log.metadata, {}, np.arange(TICKS * times, dtype=float), values)


def test_legends_stay_within_the_picture_and_off_each_other() -> None:
    # given thresholds with many digits, all anomalies, and all that can disturb a trial
    log = with_signal(without_fix(trial(), at=5), "controller.anomaly", np.arange(TICKS) % 9)
    limits = ("moving_deviation", "stop_deviation", "stopped_speed")
    log.metadata["parameters"] |= {f"controller.{name}": "0.8123456" for name in limits}
    # when
    figure = plots.trial_figure(log)
    # then
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes[1:])]
    boxes = [legend.get_window_extent() for legend in legends if legend is not None]
    assert len(boxes) == 4
    assert all(box.x0 >= 0 and box.x1 <= WIDTH and box.y0 >= 0 and box.y1 <= HEIGHT for box in boxes)
    others = [axes.bbox for axes in figure.axes]
    assert not any(box.overlaps(other) for box in boxes for other in others)
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_text_is_as_large_as_the_page_s_at_readme_width() -> None:
    figure = plots.trial_figure(trial())
    shrunk = 830 / WIDTH  # pixels of a README on GitHub over those of the picture
    texts = [text for text in figure.findobj(Text) if text.get_text()]
    pixels = [float(text.get_fontsize()) * 150 / 72 * shrunk for text in texts]
    assert min(pixels) >= 10


# colours


# Machado, Oliveira and Fernandes 2009, severity 1.0, on linear RGB
BLINDNESS = {
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)


def lab(color: str, blindness: str) -> np.ndarray:
    """CIELAB of a colour as the colour-blind see it."""
    rgb = np.array(to_rgb(color))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(BLINDNESS[blindness]) @ linear, 0, 1)
    x, y, z = np.cbrt(np.maximum(TO_XYZ @ seen / [0.95047, 1.0, 1.08883], 0.008856))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("blindness", BLINDNESS)
def test_colours_that_share_a_shape_keep_apart_for_the_colour_blind(blindness: str) -> None:
    shaded = [band["facecolor"] for band in (OUTAGE, ORDER, LOST_RADIO, *FAULTS)]
    trails = [*(color for color, _ in plots.TRAILS.values()), plots.FAULT_TRAIL[0]]
    solid = [
        plots.COLOURS[code] for code in Command if code not in plots.DASHES and code is not Command.RIGHT
    ]
    for colours, least in ((shaded, 7), (trails, 10), ([*solid, ESTIMATE], 15)):
        seen = [lab(color, blindness) for color in colours]
        distances = [np.linalg.norm(a - b) for i, a in enumerate(seen) for b in seen[:i]]
        assert min(distances) > least, (colours, distances)
