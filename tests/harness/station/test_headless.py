"""A mission without a browser, and what its log shows again and gives to the other commands."""

from __future__ import annotations

import json
import math
import shutil
import socket
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.log.log import read_log
from harness.station import conduct, mission_files
from harness.station.desk import OrderError
from harness.station.draft import Draft
from harness.station.headless import Headless, HeadlessError
from harness.station.opening import Request, opened
from harness.station.playback import Playback
from harness.trial.scenario import SHIPPED
from models.commands import Command, Status
from tests.harness.command import canine
from tests.harness.station.browser import served, vest_of
from tests.harness.station.rig import Hands

SPEED = 8
LEAD = ("station", "--simulate", "three_waypoint", "--headless", "--mission", "three_waypoint")


@pytest.fixture(scope="module")
def led(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a mission that a script led to its end."""
    from harness import main  # noqa: PLC0415

    out = tmp_path_factory.mktemp("led")
    assert main.run([*LEAD, "--speed", str(SPEED), "--start", "--out", str(out), "--json"]) == 0
    return out


def test_a_script_leads_a_mission_to_its_end(led: Path) -> None:
    summary = json.loads((led / "summary.json").read_text())
    assert summary["outcome"] == "success"
    assert summary["waypoints_reached"] == 2
    assert summary["time_s"] > summary["started_s"] > 0
    assert summary["seed"] == 1
    assert (led / "trial.html").stat().st_size > 100_000


def test_its_log_is_whole_and_tells_what_the_vest_remembers(led: Path) -> None:
    log = read_log(led / "trial.mcap")
    assert not log.broken
    assert log["controller.status"][-1] == Status.SUCCESS
    assert log["telemetry.waypoint"][-1] == 2
    assert not np.isnan(log["estimator.north"][log["telemetry.flags"].astype(int) & 8 > 0]).any()
    assert np.hypot(log["estimator.north"], log["estimator.east"])[-1] < 7, "it is home"
    assert log.parameter("controller.guarded") == 1, "the safety rules hold, whatever the scenario's reading"
    assert set(np.unique(log["controller.command"])) >= {Command.FORWARD, Command.STOP, Command.RECALL}


def test_other_commands_read_its_log(led: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = led / "trial.mcap"
    assert canine(capsys, "export", log, "--to", "csv", "--out", tmp_path / "csv")[0] == 0
    header = (tmp_path / "csv" / "estimator.csv").read_text().splitlines()[0]
    assert header == "time,north,east,speed,heading,north_sd,east_sd,speed_sd,valid"
    assert canine(capsys, "compare", log, led)[0] == 0
    status, printed, _ = canine(capsys, "fit", log, "--out", tmp_path / "fit", "--json")
    assert status == 0
    assert json.loads(printed)
    status, _, error = canine(capsys, "run", log)
    assert status == 2
    assert "expected the log of a trial that `canine run` wrote" in error


def test_without_start_the_mission_is_on_board_and_waits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, _ = canine(capsys, *LEAD, "--speed", 10, "--out", tmp_path)
    assert status == 0
    log = read_log(tmp_path / "trial.mcap")
    assert log["telemetry.mission_id"][-1] > 0
    assert not log["controller.start"].any()


def test_streets_and_poles_of_the_simulated_dog_are_shown_and_not_given_to_the_vest(tmp_path: Path) -> None:
    # given a dog in a street to the east, and a pole 20 m north of the origin, in degrees
    scenario = tmp_path / "lane.toml"
    scenario.write_text(
        "waypoints = [[0, 30]]\norigin = { latitude = 60.0, longitude = 10.0 }\n"
        "[[street]]\nfrom = [0, 0]\nto = [0, 30]\nhalf_width = 2\n[[pole]]\nat = [20, 0]\n"
    )
    # when a station simulates it, and its log is played
    with opened(Request(simulate=str(scenario), out=tmp_path / "out"), lambda text: None) as session:
        live = json.loads(session.join(1)[0])
        assert not any("street" in name for name in session.about.parameters), "the vest has no street"
    path = tmp_path / "out" / "trial.mcap"
    played = json.loads(Playback(path).join(1)[0])
    # then both show the street's outline, to its round ends, and the pole
    for hello in (live, played):
        [outline], [pole] = hello["world"]["streets"], hello["world"]["poles"]
        metres = [((lat - 60) * 111_412, (lon - 10) * 55_800) for lat, lon in [*outline, pole]]
        north, east = zip(*metres, strict=True)
        assert (min(north), max(north)) == pytest.approx((-2, 20), abs=0.01)
        assert (min(east), max(east)) == pytest.approx((-2, 32), abs=0.01)
    # and so does the page of the log
    assert read_log(path).ground


def test_a_station_that_ends_aborts_what_is_under_way(tmp_path: Path) -> None:
    with opened(Request(simulate="three_waypoint", speed=5.0, out=tmp_path), lambda text: None) as session:
        headless = Headless(session)
        headless.lead(session.about.mission, start=False)
        headless._wait(lambda: session.conduct.state(session.now) is conduct.LinkState.READY, 60)
        headless._order("start")
        headless._wait(lambda: session.conduct.is_under_way, 60)
        vest = vest_of(session)
        session.close()
        end = time.monotonic() + 30
        while vest.state.command is not Command.STOP:
            assert time.monotonic() < end
            time.sleep(0.01)


def test_a_vest_that_is_not_heard_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from harness.station import headless  # noqa: PLC0415

    monkeypatch.setattr(headless, "HEARD_S", 0.3)
    request = Request(simulate="three_waypoint", out=tmp_path)
    with opened(request, lambda text: None) as session:
        session._port = None
        session._reopen = None
        with pytest.raises(
            HeadlessError, match=r"the vest was not heard within 0.3 s: the vest is not heard"
        ):
            Headless(session).lead(session.about.mission, start=True)


def test_a_mission_for_elsewhere_is_told_at_once(tmp_path: Path) -> None:
    # given a mission some thousand kilometres from the animal
    scenario = tmp_path / "far.toml"
    scenario.write_text("waypoints = [[0, 30]]\norigin = { latitude = 60.0, longitude = 10.0 }\n")
    request = Request(simulate="three_waypoint", speed=10.0, out=tmp_path / "out")
    with opened(request, lambda text: None) as session:
        with pytest.raises(HeadlessError) as caught:
            Headless(session).lead(mission_files.load(str(scenario)), start=True)
        # then nobody waits for what no time mends
        assert str(caught.value) == (
            "the vest cannot lead this mission: home or a waypoint is beyond the controller's range"
        )


def test_what_is_no_mission_is_refused_before_anything_is_sent(tmp_path: Path) -> None:
    with (
        opened(Request(simulate="three_waypoint", speed=10.0, out=tmp_path), lambda text: None) as session,
        pytest.raises(OrderError, match="the mission has no home"),
    ):
        Headless(session).lead(Draft(), start=True)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "got none of --port, --simulate, --replay; expected one of"),
        (("--port", "x", "--simulate", "y"), "got --port and --simulate; expected one of"),
        (("--simulate", "three_waypoint", "--start"), "--start: only with --headless"),
        (("--simulate", "three_waypoint", "--headless"), "--headless: expected --mission FILE"),
        (("--port", "/dev/ttyNONE", "--speed", "3"), "--speed and --seed are of a simulated vest"),
        (("--replay", ".", "--mission", "x.gpx"), "--mission x.gpx: a log holds its own mission"),
        (("--port", "/dev/ttyNONE", "--no-browser"), "there is no such device"),
        (("--simulate", "three_waypont", "--no-browser"), "three_waypoint"),
        (("--simulate", "three_waypoint", "--speed", "1000", "--no-browser"), "expected 0.05 to 100"),
        (("--simulate", "three_waypoint", "--mission", "nothing.gpx", "--no-browser"), "there is no file"),
    ],
)
def test_wrong_usage_is_one_line_with_what_is_expected(
    arguments: tuple[str, ...],
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    status, _, error = canine(capsys, "station", *arguments)
    assert status == 2, error
    assert says in error
    assert error.count("canine:") == 1
    assert list(tmp_path.iterdir()) == [], "nothing is left behind"


def test_an_address_that_is_in_use_leaves_an_earlier_log_as_it_was(
    led: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shutil.copytree(led, tmp_path / "out")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
        arguments = ("station", "--simulate", "three_waypoint", "--no-browser", "--http-port", number)
        for out in (folder, tmp_path / "new" / "one"):
            status, _, error = canine(capsys, *arguments, "--out", out)
            assert status == 2
            assert "cannot be listened on" in error
    assert (folder / "trial.mcap").read_bytes() == (led / "trial.mcap").read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


def test_a_real_vests_log_is_never_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "trial.mcap").write_bytes(b"precious")
    status, _, error = canine(capsys, "station", "--port", "/dev/null", "--out", tmp_path, "--no-browser")
    assert status == 2
    assert "is never written over; choose another folder" in error
    assert (tmp_path / "trial.mcap").read_bytes() == b"precious"


def test_a_station_that_is_not_opened_changes_nothing_of_an_earlier_ones_files(
    led: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("station", "--headless", "--mission", "three_waypoint", "--out", tmp_path)
    shutil.copytree(led, tmp_path, dirs_exist_ok=True)
    (tmp_path / "summary.json").write_text("the earlier one's")
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for source in (("--port", "/dev/null"), ("--simulate", "three_waypoint", "--speed", 1000)):
        assert canine(capsys, *arguments, *source)[0] == 2
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == files


# the log, played ------------------------------------------------------------------------------------------


def shown(playback: Playback) -> dict[str, Any]:
    state = playback.poll().state
    assert state is not None
    content: dict[str, Any] = json.loads(state)
    return content


def test_a_log_is_played_from_any_time_at_any_speed_and_paused(led: Path) -> None:
    hands = Hands()
    playback = Playback(led / "trial.mcap", hands)
    hello, history = (json.loads(message) for message in playback.join(1))
    until = hello["replay"]["until"]
    assert hello["source"] == "replay of trial.mcap"
    last = history["columns"]["time"][-1]
    log = read_log(led / "trial.mcap")
    told = log.time[1:][np.diff(log["telemetry.time"]) > 0]  # rows that repeat no other
    assert told[-1] - 1e-6 <= last <= until + 1e-6
    assert "the trial has succeeded" in {event["text"] for event in history["events"]}
    first = shown(playback)
    assert first["telemetry"], "it begins where the vest was heard"
    assert first["link"] != "disconnected"
    playback.order(1, {"do": "seek", "time": 10.0})
    hands.now += 0.1
    state = shown(playback)
    assert state["time"] == pytest.approx(10, abs=1.5)
    assert state["link"] == "running"
    assert state["replay"] == {"time": 10.0, "playing": False, "speed": 1.0}
    playback.order(1, {"do": "play", "speed": 4})
    hands.now += 2
    assert shown(playback)["replay"]["time"] == pytest.approx(18.0)
    playback.order(1, {"do": "pause"})
    hands.now += 5
    assert shown(playback)["replay"]["time"] == pytest.approx(18.0)
    assert playback.poll().state is None, "nothing is new"
    playback.order(1, {"do": "play", "speed": 100})
    hands.now += 5
    end = shown(playback)
    assert end["replay"]["time"] == until
    assert not end["replay"]["playing"]
    assert end["telemetry"]["status"] == Status.SUCCESS


@pytest.mark.parametrize(
    "order",
    [
        {"do": "stop"},
        {"do": "start"},
        {"do": "seek"},
        {"do": "seek", "time": "x"},
        {"do": "play", "speed": 0},
    ],
)
def test_nothing_can_be_ordered_of_a_log(led: Path, order: dict[str, Any]) -> None:
    with pytest.raises(OrderError, match=r"expected a number|nothing can be ordered"):
        Playback(led / "trial.mcap").order(1, order)


def test_nan_is_no_time_to_seek(led: Path) -> None:
    with pytest.raises(OrderError):
        Playback(led / "trial.mcap").order(1, {"do": "seek", "time": math.nan})


def test_a_log_is_played_to_a_browser(led: Path) -> None:
    with served(Playback(led / "trial.mcap")) as station, station.browser() as browser:
        browser.do("seek", time=5.0)
        browser.until(lambda: browser.state["replay"]["time"] == 5.0)
        browser.do("stop")
        browser.until(lambda: bool(browser.errors))
        assert "nothing can be ordered but seek, play and pause" in browser.errors[0]


def test_the_log_of_a_trial_with_the_firmware_on_board_is_played(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = tmp_path / "short.toml"
    scenario.write_text((SHIPPED / "three_waypoint.toml").read_text().replace("300.0", "10.0"))
    assert canine(capsys, "run", scenario, "--onboard", "pil:host", "--out", tmp_path)[0] == 0
    playback = Playback(tmp_path / "trial.mcap", Hands())
    _, history = (json.loads(message) for message in playback.join(1))
    assert len(history["columns"]["latitude"]) > 20
    playback.order(1, {"do": "seek", "time": 8.0})
    state = shown(playback)
    assert (state["link"], state["link_quality"], state["draft_id"]) == ("running", None, None)
    assert state["place"] == pytest.approx([32.6, -85.5], abs=0.1)
    assert state["on_board"]["id"] == state["telemetry"]["mission_id"]


def test_a_log_without_telemetry_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert canine(capsys, "run", "two_waypoint", "--out", tmp_path)[0] == 0
    status, _, error = canine(capsys, "station", "--replay", tmp_path, "--no-browser")
    assert status == 1
    assert "has no telemetry; expected one of `canine station` or `canine run --onboard`" in error
