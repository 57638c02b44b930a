"""The page of a trial has the log's numbers and words, and answers in a browser."""

import json
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.log.log import Log
from harness.trial.page import trial_data, write_page
from harness.trial.summary import summarize
from tests.browser import DESK, TABLET, OpenPage, Visit
from tests.harness.trial.logs import COMMANDS, TICKS, trial, with_signal, without_signal

TURN_FAILURE = "the animal did not turn as far as told in time (turn failure)"
VOID = {"meta", "img", "br"}
MOST_BYTES = 250_000  # of the page without its data


class Page(HTMLParser):
    """Checks that elements nest, and keeps text, sources and the data."""

    def __init__(self, log: Log, folder: Path, **more: Any) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text, self.json = "", ""
        self.sources: list[str] = []
        self.path = folder / "trial.html"
        write_page(log, summarize(log, **more), self.path)
        self.feed(self.path.read_text())
        self.close()
        assert self.open == []
        self.data: dict[str, Any] = json.loads(self.json)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append("data" if ("id", "data") in attrs else tag)
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]
        assert not [name for name, _ in attrs if name.startswith("on") or name == "style"]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() in (tag, "data")
        self.text += " "

    def handle_data(self, data: str) -> None:
        if self.open[-1:] == ["data"]:
            self.json += data
        elif self.open[-1:] not in (["script"], ["style"]):
            self.text += data


def test_the_data_are_the_logs_numbers(tmp_path: Path) -> None:
    # given a trial whose estimate is 0.1 m too far north
    log = trial()
    data = Page(log, tmp_path).data
    # then signals are there at every tick, in SI units
    assert data["time"] == log.time.tolist()
    for name in ("plant.north", "plant.speed", "estimator.east", "controller.deviation", "plant.heading"):
        assert data["signals"][name] == pytest.approx(log[name].tolist(), abs=1e-5)
    assert data["signals"]["error.north"] == pytest.approx([0.1] * TICKS, abs=1e-5)
    assert data["signals"]["controller.command"] == COMMANDS
    # and of the fixes what came, at 0, 5 and 10 s
    fixes = data["signals"]["fix.north"]
    assert {row: north for row, north in enumerate(fixes) if north is not None} == {0: 0.5, 5: 5.5, 10: 10.5}
    # and the mission
    assert data["route"] == {
        "waypoints": [[10, 20], [0, 30]], "home": [0, 1], "radius": 7, "fence": []
    }  # fmt: skip
    assert data["thinned"] is None


def test_what_disturbed_the_trial_are_bands_and_anomalies_are_marks(tmp_path: Path) -> None:
    page = Page(trial(), tmp_path)
    bands = {(band["kind"], band["from"], band["until"]) for band in page.data["bands"]}
    assert {("order", 3, 5), ("lost", 6, 9)} <= bands
    marks = [(mark["time"], mark["kind"], mark["text"]) for mark in page.data["marks"]]
    assert (7, "anomaly", TURN_FAILURE) in marks
    assert (10, "waypoint", "waypoint 1 reached") in marks
    assert "lost radio: 0:06.00 to 0:09.00" in page.text


def test_panels_have_their_thresholds_and_the_errors_their_deviations(tmp_path: Path) -> None:
    log = trial()
    panels = {panel["title"]: panel for panel in Page(log, tmp_path).data["panels"]}
    levels = [level["value"] for level in panels["deviation from the target"]["levels"]]
    assert levels == pytest.approx([0.8552, -0.8552, 0.3491, -0.3491], abs=1e-4)  # h' and h'', 49 and 20 deg
    assert [line["signal"] for line in panels["speed"]["series"]] == [
        "fix.speed", "estimator.speed", "plant.speed"
    ]  # fmt: skip
    assert "distance to the target" not in panels  # this controller tells none


def test_the_events_are_in_their_order_and_words(tmp_path: Path) -> None:
    page = Page(trial(), tmp_path)
    at = page.data["events"]
    assert at == sorted(at)
    words = ("command RECALL", "lost radio begins", "the trial has succeeded")
    for text in ("0:07.00", TURN_FAILURE, *words):
        assert text in page.text
    assert page.text.index("lost radio begins") < page.text.index(TURN_FAILURE)


def test_a_trial_whose_time_was_over_says_so_at_its_end(tmp_path: Path) -> None:
    running = Page(with_signal(trial(), "controller.status", np.ones(TICKS)), tmp_path)
    assert running.data["events"][-1] == running.data["time"][-1]
    assert "the time was over" in running.text
    assert "the time was over" not in Page(trial(), tmp_path).text


def test_only_a_log_with_what_it_ran_runs_again(tmp_path: Path) -> None:
    assert "Running the log again" not in Page(trial(), tmp_path).text
    assert "Running the log again" in Page(replace(trial(), attachments={"a.ssp": b""}), tmp_path).text


def test_the_page_refers_to_no_other_file(tmp_path: Path) -> None:
    log = replace(trial(), broken="the file ends early")
    page = Page(log, tmp_path, notes=["so < far"])
    assert page.sources == []
    for text in ("three, seed 1", "Success", "the file ends early", "so < far", "controller.home_north"):
        assert text in page.text


def test_names_and_notes_are_text_whatever_they_hold(tmp_path: Path, open_page: OpenPage) -> None:
    # given a scenario, a note and a fault that look like elements
    evil = "</script><script>document.title = 'owned'</script><img src=x onerror=alert(1)>"
    log = trial()
    log = replace(log, metadata=log.metadata | {"scenario": {"name": evil, "seed": "1"}})
    page = Page(log, tmp_path, notes=[evil])
    assert evil in page.text
    # when a browser opens the page, then they are read and not run
    visit = open_page(page.path.as_uri())
    assert visit.page.title() == f"{evil}, seed 1"
    assert visit.errors == []


def test_parameters_that_differ_are_in_the_units_of_scenarios(tmp_path: Path) -> None:
    # given a CMEC with a threshold of 37 deg, and one with the default of 49 deg of the calibrated reading
    log = trial()
    roles = {"controller": "cmec"}
    stated = {
        "controller.moving_deviation": "0.6457718232379019",
        "controller.stop_deviation": "0.3490658503988659",
    }
    log = replace(log, metadata=log.metadata | {"roles": roles, "parameters": stated})
    text = " ".join(Page(log, tmp_path).text.split())
    assert "cmec.moving_deviation 37 49 deg" in text
    assert "cmec.stop_deviation" not in text


def test_streets_and_poles_are_on_the_map_and_in_its_legend(tmp_path: Path, open_page: OpenPage) -> None:
    # given a trial in a street of 20 m to the north, beside a pole
    log, street = trial(), {"street_count": 1, "street_end_north[1]": 20, "street_half_width[1]": 2}
    street |= {"street_north[1]": 0, "street_east[1]": 0, "street_end_east[1]": 0}
    poles = {"pole_count": 1, "pole_north[1]": 5, "pole_east[1]": 9}
    parameters = {f"plant.{name}": str(value) for name, value in (street | poles).items()}
    inside = replace(log, metadata=log.metadata | {"parameters": log.metadata["parameters"] | parameters})
    for one, count in ((inside, 1), (log, 0)):
        page = open_page(Page(one, tmp_path).path.as_uri()).page
        assert page.locator("#map path.street").count() == count
        assert page.locator("#map [title=pole]").count() == count
        legend = page.locator("#legend").inner_text()
        assert ("street" in legend, "\u25b2 pole" in legend) == (count > 0, count > 0)


@pytest.mark.parametrize("lacking", ["plant", "controller", "estimator", "sensors"])
def test_a_log_without_a_component_has_a_page(lacking: str, tmp_path: Path, open_page: OpenPage) -> None:
    log = trial()
    log = replace(log, channels=tuple(c for c in log.channels if c.component != lacking))
    page = Page(log, tmp_path)
    assert not [name for name in page.data["signals"] if name.startswith(f"{lacking}.")]
    visit = open_page(page.path.as_uri())
    assert visit.errors == []
    assert visit.page.locator(".plot").count() == len(page.data["panels"]) > 0


def test_values_that_are_not_finite_leave_gaps(tmp_path: Path, open_page: OpenPage) -> None:
    # given a track with holes, one of them where an anomaly was reported
    north = np.arange(TICKS, dtype=float)
    north[[0, 7]], north[1] = np.nan, np.inf
    page = Page(with_signal(trial(), "plant.north", north), tmp_path)
    assert page.data["signals"]["plant.north"][:3] == [None, None, 2]
    assert open_page(page.path.as_uri()).errors == []


def long_log() -> Log:
    """An hour of 25 Hz with one spike of speed, one tick long, and a command that lasts one tick."""
    ticks = 90_000
    log = trial()
    time = np.arange(ticks, dtype=np.float64) * 0.04
    values = {name: np.repeat(rows[:1], ticks, axis=0) for name, rows in log.values.items()}
    log = replace(log, time=time, values=values)
    speed, command = np.sin(time), np.ones(ticks)
    speed[55_555], command[44_444] = 99.0, 4
    return with_signal(with_signal(log, "plant.speed", speed), "controller.command", command)


def test_a_long_log_is_thinned_and_keeps_its_spikes(tmp_path: Path) -> None:
    log = long_log()
    page = Page(log, tmp_path)
    speeds = dict(zip(page.data["time"], page.data["signals"]["plant.speed"], strict=True))
    assert len(speeds) < 12_000
    assert speeds[2222.2] == 99
    commands = dict(zip(page.data["time"], page.data["signals"]["controller.command"], strict=True))
    assert (commands[1777.76], commands[1777.8]) == (4, 1)
    # and in every stretch the least and greatest speed are those of the log
    shown = np.array(list(speeds.values()))
    assert (shown.min(), shown[shown < 99].max()) == pytest.approx((-1, 1), abs=1e-3)
    assert page.data["thinned"] == {"shown": len(speeds), "ticks": 90_000}
    assert f"Drawn are {len(speeds)} of 90000 ticks" in page.text


def test_the_page_is_small(tmp_path: Path) -> None:
    # given a log of one tick, so that no table has more than a row or two
    log = trial()
    log = replace(log, time=log.time[:1], values={name: rows[:1] for name, rows in log.values.items()})
    page = Page(replace(log, metadata={}), tmp_path)
    assert len(page.path.read_bytes()) - len(page.json) < MOST_BYTES


@pytest.fixture
def visit(tmp_path: Path, open_page: OpenPage) -> Iterator[Visit]:
    """The page of the trial in a browser; at the end nothing has been asked for, and nothing was wrong."""
    page = Page(trial(), tmp_path)
    visit = open_page(page.path.as_uri())
    yield visit
    assert visit.errors == []
    assert visit.requests == [page.path.as_uri()]


def cursors(visit: Visit) -> list[float]:
    found: list[float] = visit.page.evaluate(
        "[...document.querySelectorAll('.time-cursor')].map((cursor) => parseFloat(cursor.style.left))"
    )
    return found


def arrow(visit: Visit) -> str:
    """Where the animal's arrow stands on the map."""
    place = visit.page.evaluate("document.querySelectorAll('.animal')[1].parentElement.style.transform")
    return str(place)


def test_one_cursor_goes_over_all_plots_and_the_map(visit: Visit) -> None:
    # when time is moved to the anomaly at 7 of 14 s
    start = arrow(visit)
    visit.page.get_by_role("button", name="0:07.00").first.click()
    # then the cursors of all panels and the strip stand in the middle, the readings are of that row
    assert set(cursors(visit)) == {50}
    assert len(cursors(visit)) == visit.page.locator(".plot").count() + 1
    assert (
        visit.page.locator(".plot", has_text="speed [m/s]").first.inner_text().split("\n")[-1]
        == "truth 7.00 m/s"
    )
    assert arrow(visit) != start
    assert "no command" in visit.page.locator("#cue").inner_text()
    assert TURN_FAILURE in visit.page.locator("tr.now").inner_text()


def test_the_mouse_moves_the_cursor_and_drags_a_zoom(visit: Visit) -> None:
    box = visit.page.locator(".u-over").first.bounding_box()
    assert box is not None

    def at(share: float) -> tuple[float, float]:
        return box["x"] + share * box["width"], box["y"] + 30

    visit.page.mouse.move(*at(0.5))
    assert cursors(visit)[0] == pytest.approx(50, abs=0.5)
    # when a quarter is marked, then it is all that is shown; a double click shows all again
    visit.page.mouse.move(*at(0.5))
    visit.page.mouse.down()
    visit.page.mouse.move(*at(0.75), steps=4)
    visit.page.mouse.up()
    left = visit.page.locator(".strip-block").first.get_attribute("title")
    assert left is not None
    assert "LEFT" in left or "NONE" in left
    visit.page.mouse.dblclick(*at(0.5))
    assert "FORWARD from 0:00.00" in str(visit.page.locator(".strip-block").first.get_attribute("title"))


def test_playback_moves_the_animal(visit: Visit) -> None:
    start = arrow(visit)
    visit.page.get_by_label("speed of playback").select_option("50")
    visit.page.get_by_role("button", name="Play").click()
    # at 50 times real time the trial of 14 s is over at once
    visit.page.get_by_text("0:14.00 of 0:14.00").wait_for()
    visit.page.get_by_role("button", name="Play").wait_for()
    assert arrow(visit) != start


@pytest.mark.parametrize(
    ("keys", "time"),
    [
        (["ArrowRight", "ArrowRight"], "0:02.00"),
        (["End"], "0:14.00"),
        (["End", "ArrowLeft"], "0:13.00"),
        (["End", "Home"], "0:00.00"),
        (["Shift+ArrowRight"], "0:01.00"),
    ],
)
def test_keys_move_the_cursor(visit: Visit, keys: list[str], time: str) -> None:
    for key in keys:
        visit.page.keyboard.press(key)
    assert visit.page.locator(".playback output").inner_text() == f"{time} of 0:14.00"


def test_space_plays_and_pauses(visit: Visit) -> None:
    visit.page.keyboard.press(" ")
    visit.page.get_by_role("button", name="Pause").wait_for()
    visit.page.keyboard.press(" ")
    visit.page.get_by_role("button", name="Play").wait_for()


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESK, TABLET])
def test_the_page_keeps_nobody_out(
    tmp_path: Path, open_page: OpenPage, size: tuple[int, int], theme: str
) -> None:
    page = Page(trial(), tmp_path)
    visit = open_page(page.path.as_uri(), size, theme)
    assert visit.harm() == []
    # and nothing sticks out to the side
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= size[0]


def test_the_theme_changes_by_its_switch(visit: Visit) -> None:
    colour = "getComputedStyle(document.body).backgroundColor"
    assert visit.page.evaluate(colour) == "rgb(255, 255, 255)"
    visit.page.get_by_role("button", name="Dark").click()
    assert visit.page.evaluate(colour) == "rgb(16, 21, 27)"


def test_a_signal_that_is_no_number_at_all_draws_nothing(tmp_path: Path) -> None:
    data = trial_data(with_signal(trial(), "plant.speed", np.nan))
    assert set(map(str, data["signals"]["plant.speed"])) == {"nan"}
    assert "plant.speed" not in trial_data(without_signal(trial(), "plant.speed"))["signals"]


def test_a_log_of_other_signals_has_a_panel_for_each(tmp_path: Path) -> None:
    # given a log of a tank alone
    tank = replace(trial().channels[0], component="tank", names=("level", "flow", "valve", "lid"))
    log = trial()
    log = replace(log, channels=(tank,), values={"tank": log.values["plant"]}, metadata={})
    page = Page(log, tmp_path)
    assert [panel["title"] for panel in page.data["panels"]] == [
        "tank.level", "tank.flow", "tank.valve", "tank.lid"
    ]  # fmt: skip
    assert page.data["tracks"] == page.data["strips"] == []


def test_a_track_of_the_estimate_alone_has_the_commands_colours(tmp_path: Path, open_page: OpenPage) -> None:
    # given a log without the true animal, as a station writes it
    log = trial()
    log = replace(log, channels=tuple(c for c in log.channels if c.component not in ("plant", "sensors")))
    page = Page(log, tmp_path)
    assert [(track["label"], track["class"]) for track in page.data["tracks"]] == [("estimate", "")]
    visit = open_page(page.path.as_uri())
    colour = "getComputedStyle(document.querySelector('path.track.command-FORWARD')).stroke"
    assert visit.page.evaluate(colour) == "rgb(0, 127, 86)"
    # and nobody says what the dog feels, for the log does not
    assert "feels" not in visit.page.inner_text("#cue")
