"""A trial in the browser while it runs: what is shown when, its end, by a signal too, and who may come in."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from harness.log.channel import Channel
from harness.log.live import Pace
from harness.log.log import read_log
from harness.station.desk import OrderError
from harness.station.live import Live
from tests.browser import OpenPage
from tests.harness.command import canine

CHANNEL = Channel("plant", "Pedestrian", ("north", "east"), ("m", "m"), ("Real", "Real"), ("", ""))


class Clock(Pace):
    """Trial time as the test says; nobody waits."""

    now = 0.0

    def keep(self, moment: float) -> None:
        """It goes on at once."""


def watched() -> tuple[Live, Clock]:
    """A trial of 4 ticks, a second each, with a browser; its time has not come."""
    clock = Clock()
    live = Live("walk, seed 1", clock)
    live.join(1)
    live.begin([CHANNEL], (32.6, -85.5), {"scenario": {"name": "walk", "seed": "1", "toml": ""}})
    live.take(np.array([0.0, 1.0, 2.0, 3.0]), {"plant": np.arange(8.0).reshape(4, 2)})
    return live, clock


def rows(live: Live, ticks: int, signals: int) -> dict[str, Any]:
    """What a browser is given that has so much."""
    (message,) = live.order(1, {"do": "rows", "ticks": ticks, "signals": signals})
    data: dict[str, Any] = json.loads(message)["data"]
    return data


def test_rows_are_shown_when_their_time_has_come() -> None:
    live, clock = watched()
    assert rows(live, 0, 0)["time"] == [0]
    clock.now = 2.5
    data = rows(live, 0, 0)
    assert data["time"] == [0, 1, 2]
    assert data["signals"]["plant.north"] == [0, 2, 4]


def test_a_browser_is_given_what_it_lacks_or_all_if_it_lacks_a_signal() -> None:
    live, clock = watched()
    clock.now = 9.0
    everything = rows(live, 0, 0)
    later = rows(live, 3, len(everything["signals"]))
    assert (later["from"], later["time"], later["signals"]["plant.east"]) == (3, [3], [7])
    assert rows(live, 3, 1)["from"] == 0


def test_nothing_else_can_be_ordered() -> None:
    live, _ = watched()
    for order in ({"do": "stop"}, {"do": "rows"}, {"do": "rows", "ticks": "1", "signals": 2}):
        with pytest.raises(OrderError, match="a trial runs: nothing can be ordered but"):
            live.order(1, order)


def test_before_the_first_row_there_is_nothing_and_at_the_end_the_page_of_the_trial() -> None:
    live = Live("walk", Clock())
    assert live.order(1, {"do": "rows", "ticks": 0, "signals": 0}) == []
    state = live.poll().state
    assert state is not None
    assert json.loads(state) == {"is": "state", "ticks": 0}
    assert b"live.html" not in live.page()
    assert b"connect-src 'self'" in live.page()
    live.finish(b"<p>the trial</p>")  # nobody watches: it does not wait
    assert live.page() == b"<p>the trial</p>"


def test_the_pace_is_the_clocks_times_the_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    # given a clock that only sleep moves on, and twice its speed
    clock = [50.0]
    monkeypatch.setattr("harness.log.live.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("harness.log.live.time.sleep", lambda s: clock.__setitem__(0, clock[0] + s))
    pace = Pace(2.0)
    assert pace.now == 0
    pace.keep(1.0)  # the first moment is at once
    assert clock[0] == 50
    pace.keep(4.0)
    assert clock[0] == pytest.approx(51.5)
    assert pace.now == pytest.approx(4)


@contextmanager
def running(folder: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A `canine run --live` in a process of its own, and its address."""
    command = [sys.executable, "-m", "harness.main", "run", *arguments, "--live", "--no-browser"]
    with subprocess.Popen(
        [*command, "--out", str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr
        try:
            note = process.stderr.readline()
            found = re.fullmatch(r"note: the trial begins when a browser opens (http://\S+/)\n", note)
            assert found, note + process.stderr.read()
            yield process, found[1]
        finally:
            if process.poll() is None:
                process.kill()


def socket(address: str, origin: str | None = None) -> ClientConnection:
    return connect(
        address.replace("http", "ws") + "ws",
        subprotocols=[Subprotocol("canine")],
        origin=None if origin is None else Origin(origin),
    )


def test_the_page_grows_and_is_the_trials_page_at_the_end(
    tmp_path: Path, open_page: OpenPage, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a trial of 22 s at ten times the clock's speed, with faults
    with running(tmp_path / "live", "faulty", "--speed", "10", "--json") as (process, address):
        visit = open_page(address)
        visit.page.get_by_text("The trial runs:").wait_for()
        assert visit.page.get_by_role("heading", level=1).inner_text() == "faulty, seed 1"
        # then there are events on the way, and the cursor stays at the end
        visit.page.locator("#events td", has_text="begins").first.wait_for()
        shown = visit.page.locator(".playback output").inner_text().split(" of ")
        assert shown[0] == shown[1]
        # and then it is the trial's page
        visit.page.locator(".outcome.success").wait_for()
        assert visit.page.locator(".sentence").inner_text().startswith("Success after 22 s")
        out, err = process.communicate(timeout=60)
        assert process.returncode == 0, err
    assert visit.errors == []
    assert {url.removesuffix("/ws") for url in visit.requests if url.startswith("http")} == {address}
    # the summary is printed, and the log has the bytes of a run that nobody watched
    assert json.loads(out)["outcome"] == "success"
    assert canine(capsys, "run", "faulty", "--out", tmp_path / "alone")[0] == 0
    logs = [(tmp_path / name / "trial.mcap").read_bytes() for name in ("live", "alone")]
    assert logs[0] == logs[1]


def test_a_signal_ends_the_trial_and_keeps_its_log(tmp_path: Path) -> None:
    with running(tmp_path, "three_waypoint") as (process, address), socket(address) as browser:
        # given three seconds of it
        while json.loads(browser.recv(timeout=30)).get("ticks", 0) < 75:
            pass
        process.terminate()
        _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGTERM
    assert f"the log up to there is {tmp_path / 'trial.mcap'}" in err
    assert len(read_log(tmp_path / "trial.mcap").time) >= 75


def test_a_signal_ends_the_wait_for_a_browser(tmp_path: Path) -> None:
    with running(tmp_path, "three_waypoint") as (process, _):
        process.terminate()
        _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGTERM
    assert "nothing was logged" in err


def test_a_page_of_another_site_is_refused(tmp_path: Path) -> None:
    with running(tmp_path, "three_waypoint") as (_, address):
        with pytest.raises(InvalidStatus, match="403"):
            socket(address, "http://evil.example")
        with socket(address) as browser:
            assert json.loads(browser.recv(timeout=30)) == {"is": "hello", "title": "three_waypoint, seed 1"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--live", "--seeds", "1:3"], "--live and --seeds 1:3: the browser is shown one trial"),
        (["--speed", "2"], "--speed 2: expected with --live or --foxglove; else nothing waits for the clock"),
        (["--no-browser"], "--no-browser: expected with --live"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = canine(capsys, "run", *arguments)
    assert (status, err) == (2, f"canine: {message}\n")
