"""Browsers at a station with a real vest in the same process, through real sockets."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from http.client import HTTPConnection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.responses import Response
from starlette.websockets import WebSocket
from websockets.exceptions import ConnectionClosed, ConnectionClosedError, InvalidStatus
from websockets.frames import Frame, Opcode
from websockets.sync.client import connect

from codegen.firmware.key import Key
from harness.log.log import read_log
from harness.station import server
from harness.station.draft import Draft
from harness.station.guard import Guard
from harness.station.server import BURST, HEADERS, WAITING, Outbox, Rate
from harness.station.shown import News
from models.commands import Command, Status
from models.errors import UsageError
from tests.browser import OpenPage
from tests.harness.station.browser import Browser, Served, served, simulated, unheard
from tests.harness.station.rig import Hands
from tests.harness.station.slow import SlowWatcher


@pytest.fixture(scope="module")
def silent(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with unheard(tmp_path_factory.mktemp("silent")) as running:
        yield running


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Served]:
    with simulated(tmp_path / "out") as running:
        yield running


def test_a_mission_is_uploaded_started_stopped_and_aborted_through_a_socket(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with simulated(out) as station, station.browser() as browser:
        browser.begin()
        assert browser.state["on_board"]["mission"]["waypoints"] == browser.hello["scenario"]["waypoints"]
        browser.until(lambda: station.vest.state.command is Command.FORWARD)
        browser.do("stop")
        browser.until(lambda: browser.state["stop_latched"] and station.vest.state.command is Command.STOP)
        browser.until(lambda: browser.state["telemetry"]["command"] == Command.STOP)
        browser.do("note", text="she sits")
        browser.do("clear_stop")
        browser.until(lambda: station.vest.state.command is Command.FORWARD)
        browser.do("abort")
        browser.until(lambda: browser.state["link"] in ("loaded", "ready"))
        assert not browser.errors
    log = read_log(out / "trial.mcap")
    assert not log.broken
    assert {Status.RUNNING, Status.STOPPED} <= set(log["controller.status"])
    assert Command.STOP in log["controller.override"]
    assert log.route is not None
    assert len(log.route.places) == 3


def test_a_tab_that_dies_stops_the_vest_and_the_screen_of_another_says_why(station: Served) -> None:
    with station.browser() as commander, station.browser() as watcher:
        commander.begin()
        watcher.dead = True  # it has nothing to keep alive
        watcher.until(lambda: watcher.state["telemetry"] is not None)  # its first state may be older
        watcher.until(lambda: watcher.state["telemetry"]["status"] == Status.STOPPED)
        assert any("the heartbeat to the vest ends" in text for text in watcher.events)
        assert any("the radio link was lost (rule 9)" in alarm["text"] for alarm in watcher.state["alarms"])
        assert watcher.state["commander"] == commander.hello["you"]
        assert not watcher.state["commander_alive"]


def test_a_socket_that_closes_while_left_is_held_lets_go(station: Served) -> None:
    with station.browser() as watcher:
        with station.browser() as commander:
            commander.do("take")
            commander.until(lambda: commander.state["link"] != "disconnected")
            end = time.monotonic() + 30
            while station.vest.state.command is not Command.LEFT:
                assert time.monotonic() < end
                commander.do("hold", command="LEFT")
                time.sleep(0.05)
        watcher.until(lambda: station.vest.state.command is not Command.LEFT, 5)
        watcher.until(lambda: watcher.state["commander"] is None)
        assert watcher.state["holding"] is None


def test_a_second_commander_is_refused_until_the_first_hands_over(station: Served) -> None:
    with station.browser() as first, station.browser() as second:
        first.do("take")
        first.until(lambda: first.state["commander"] == first.hello["you"])
        second.do("take")
        second.until(lambda: bool(second.errors))
        assert "operator 1 commands" in second.errors[0]
        first.do("hand_over")
        first.until(lambda: first.state["offered"])
        second.do("take")
        second.until(lambda: second.state["commander"] == second.hello["you"])


def test_a_vest_that_begins_anew_is_told_with_what_to_do(station: Served) -> None:
    with station.browser() as browser:
        browser.begin()
        station.vest.reset()
        browser.until(lambda: browser.state["link"] == "connected" and browser.state["on_board"] is None)
        browser.until(lambda: any("the vest has begun anew" in text for text in browser.events))
        assert {"mission"} <= {reason["bit"] for reason in browser.state["missing"]}


def test_who_comes_later_gets_what_was(station: Served) -> None:
    with station.browser() as first:
        first.begin()
        first.until(lambda: len(first.events) > 3)
        with station.browser() as second:
            assert second.hello["you"] == first.hello["you"] + 1
            columns = second.history["columns"]
            assert len(columns["time"]) == len(columns["latitude"]) > 0
            assert columns["latitude"][0] == pytest.approx(32.6062, abs=1e-3)
            assert {event["text"] for event in second.history["events"]} >= {"the trial has begun"}
            assert second.state["draft"] == first.state["draft"]


def test_a_watcher_that_reads_nothing_harms_nobody(station: Served) -> None:
    with (
        station.browser() as commander,
        connect(f"ws://{station.address}/ws", max_queue=1, close_timeout=0.1) as idle,
    ):
        commander.begin()
        begun = commander.state["time"]
        commander.until(lambda: commander.state["time"] > begun + 10)
        assert idle.protocol is not None
        assert not commander.errors


class Talkative:
    """Shows a state of some kB each time that it is looked at."""

    count = 0

    def join(self, operator: int) -> list[bytes]:
        return []

    def leave(self, operator: int) -> None:
        pass

    def order(self, operator: int, order: dict[str, Any]) -> tuple[()]:
        return ()

    def poll(self) -> News:
        self.count += 1
        return News(json.dumps({"is": "state", "time": self.count, "filler": "x" * 4000}).encode())


def test_a_watcher_that_took_nothing_for_a_while_sees_what_is_and_not_what_was() -> None:
    shown = Talkative()
    with served(shown) as station:
        watcher = SlowWatcher(station.address, 1_000_000)
        until_count(shown, 400)
        times: list[float] = []

        def note(state: dict[str, Any]) -> float:
            times.append(state["time"])
            return 0.0

        watcher.run(lambda: bool(times) and times[-1] >= 400, note)
    assert times[-1] >= 400
    assert len(times) < 50, "the states from before were left out"


def until_count(shown: Talkative, count: int) -> None:
    end = time.monotonic() + 60
    while shown.count < count:
        assert time.monotonic() < end
        time.sleep(0.01)


def test_an_outbox_holds_the_last_state_and_a_bounded_number_of_others() -> None:
    async def fill() -> list[bytes]:
        outbox = Outbox()
        for i in range(3 * WAITING):
            outbox.put(b"%d" % i)
            outbox.show(b"state %d" % i)
        return await outbox.take()

    messages = asyncio.run(fill())
    assert messages[-1] == b"state %d" % (3 * WAITING - 1)
    assert messages[1:-1] == [b"%d" % i for i in range(2 * WAITING, 3 * WAITING)]
    assert json.loads(messages[0])["text"].startswith(f"{2 * WAITING} messages were left out")


def test_a_browser_that_takes_nothing_for_long_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    async def never(text: str) -> None:
        await asyncio.Event().wait()

    async def send() -> None:
        outbox = Outbox()
        outbox.put(b"x")
        await asyncio.wait_for(server._send(SimpleNamespace(send_text=never), outbox), 10)  # type: ignore[arg-type]

    monkeypatch.setattr(server, "SEND_S", 0.05)
    asyncio.run(send())


def test_a_large_file_has_the_more_time_the_more_has_come(monkeypatch: pytest.MonkeyPatch) -> None:
    async def parts() -> AsyncIterator[bytes]:
        yield b"x" * 40_000
        await asyncio.sleep(0.2)  # longer than it would have without these
        yield b"x"

    monkeypatch.setattr(server, "BODY_S", 0.1)
    request: Any = SimpleNamespace(stream=parts)
    monkeypatch.setattr(server, "LEAST_RATE", 1000)
    assert len(asyncio.run(server._body(request, "map", 50_000))) == 40_001
    monkeypatch.setattr(server, "LEAST_RATE", 1_000_000_000)
    with pytest.raises(UsageError, match=r"the map did not come within 0\.1 s: the link is too slow"):
        asyncio.run(server._body(request, "map", 50_000))


def test_who_was_silent_for_long_may_send_no_more_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    hands = Hands()
    monkeypatch.setattr(server, "time", SimpleNamespace(monotonic=hands))
    rate = Rate()
    hands.now += 1000
    assert [rate.allows() for _ in range(BURST + 1)] == [True] * BURST + [False]


@pytest.mark.parametrize("message", ["{", "[]", "7", '{"do": 1}', '{"do": "sit"}', "[" * 60_000, b"\xff"])
def test_nonsense_is_answered_and_changes_nothing(silent: Served, message: str | bytes) -> None:
    with silent.browser() as browser:
        browser.socket.send(message)
        browser.until(lambda: bool(browser.errors))
        assert "expected" in browser.errors[0]
        browser.do("take")
        browser.until(lambda: browser.state["commander"] == browser.hello["you"])


def test_a_message_that_is_too_large_and_too_many_messages_close_the_socket(silent: Served) -> None:
    with silent.browser() as browser:
        browser.socket.send(json.dumps({"do": "note", "text": "x" * 70_000}))
        with pytest.raises(ConnectionClosedError) as large:
            browser.until(lambda: False, 5)
        assert large.value.rcvd is not None
        assert large.value.rcvd.code == 1009
    with silent.browser() as browser:
        with pytest.raises(ConnectionClosedError) as many:
            _shout(browser)
        assert many.value.rcvd is not None
        assert many.value.rcvd.code == 1008


@pytest.mark.parametrize("kind", [Opcode.PING, Opcode.PONG, Opcode.TEXT, Opcode.CONT])
def test_a_flood_of_empty_frames_closes_the_socket_and_holds_up_nobody(silent: Served, kind: Opcode) -> None:
    frame = Frame(kind, b"", fin=kind is not Opcode.CONT).serialize(mask=True)
    begin = Frame(Opcode.TEXT, b"", fin=False).serialize(mask=True) if kind is Opcode.CONT else b""
    with silent.browser() as watcher, silent.browser() as browser:
        # when all of them come at once
        browser.socket.socket.sendall(begin + 20_000 * frame)
        # then the socket is closed, with the reason
        with pytest.raises(ConnectionClosed) as many:
            browser.until(lambda: False, 10)
        assert many.value.rcvd is not None
        assert (many.value.rcvd.code, many.value.rcvd.reason) == (1008, "more than 50 messages a second")
        # and the station goes on
        begun = watcher.state["time"]
        watcher.until(lambda: watcher.state["time"] > begun + 0.5 and len(watcher.state["operators"]) == 1)


def test_a_socket_that_is_turned_out_is_turned_out_once(
    silent: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    turned_out: list[str] = []
    turn_out = server._Socket._turn_out

    def counted(socket: server._Socket, why: str) -> None:
        turned_out.append(why)
        turn_out(socket, why)

    monkeypatch.setattr(server._Socket, "_turn_out", counted)
    with silent.browser() as browser:
        browser.socket.socket.sendall(20_000 * Frame(Opcode.PING, b"").serialize(mask=True))
        with pytest.raises(ConnectionClosed):
            browser.until(lambda: False, 10)
        with suppress(OSError):
            while browser.socket.socket.recv(65536):  # until the station closes
                pass
    assert len(turned_out) == 1


@pytest.mark.parametrize("fault", [RuntimeError("websocket.close was sent"), OSError("is gone")])
def test_a_socket_that_is_gone_before_a_full_station_refuses_it_is_no_fault(
    monkeypatch: pytest.MonkeyPatch, fault: Exception
) -> None:
    refused: list[str] = []

    async def receive() -> dict[str, Any]:
        return {"type": "websocket.connect"}

    async def send(message: Any) -> None:
        if message["type"] == "websocket.close":
            refused.append(message["reason"])
            raise fault

    monkeypatch.setattr(server, "MOST_OPERATORS", 0)
    station = server.Station(Talkative(), Guard.of("127.0.0.1"))
    headers = [(b"host", b"127.0.0.1"), (b"origin", b"http://127.0.0.1")]
    scope = {"type": "websocket", "headers": headers, "subprotocols": ["canine"]}
    asyncio.run(station._socket(WebSocket(scope, receive, send)))
    assert refused == ["0 browsers are connected, the most there may be"]


def _shout(browser: Browser) -> None:
    for _ in range(400):
        browser.do("alive")
    browser.until(lambda: False, 5)


@pytest.mark.parametrize(
    "options",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
    ],
)
def test_a_page_from_elsewhere_cannot_connect(silent: Served, options: dict[str, object]) -> None:
    with pytest.raises(InvalidStatus) as refused, silent.browser(**options):
        pass
    assert refused.value.response.status_code == 403


def test_elsewhere_a_token_is_needed_for_all_that_changes_something(tmp_path: Path) -> None:
    with unheard(tmp_path, guard=Guard("0.0.0.0", "right-token")) as open_to_all:
        for names in (["canine"], ["canine", "token.wrong"]):
            with (
                pytest.raises(InvalidStatus) as refused,
                open_to_all.browser(subprotocols=names),
            ):
                pass
            assert refused.value.response.status_code == 403
        with open_to_all.browser(subprotocols=["canine", "token.right-token"]) as browser:
            assert browser.socket.subprotocol == "canine"
        assert request(open_to_all, "POST", "/import?name=a.csv", b"latitude,longitude\n1,2\n")[0] == 403
        csv = b"latitude,longitude\n1,2\n"
        status, _, _ = request(open_to_all, "POST", "/import?name=a.csv", csv, {"X-Token": "right-token"})
        assert status == 200


def test_a_page_without_the_token_says_which_address_to_take(tmp_path: Path, open_page: OpenPage) -> None:
    with unheard(tmp_path, guard=Guard("0.0.0.0", "right-token")) as open_to_all:
        page = open_page(f"http://{open_to_all.address}/#token=wrong").page
        page.locator("#warnings").get_by_text("take the whole address that it printed").wait_for()
        assert "the station refuses this page" in page.inner_text("#who")


def request(
    station: Served, method: str, path: str, body: bytes | None = None, headers: dict[str, str] | None = None
) -> tuple[int, dict[str, str], bytes]:
    connection = HTTPConnection(station.address, timeout=30)
    connection.request(method, path, body, headers or {})
    response = connection.getresponse()
    content = response.read()
    connection.close()
    return response.status, {name.lower(): value for name, value in response.getheaders()}, content


def test_missions_are_imported_and_exported_and_names_are_no_paths(silent: Served) -> None:
    csv = b"kind,latitude,longitude\nhome,32.6,-85.4\nwaypoint,32.601,-85.4\n"
    status, headers, content = request(silent, "POST", "/import?name=../../etc/a.csv", csv)
    assert status == 200
    mission = json.loads(content)
    assert mission["waypoints"] == [[32.601, -85.4]]
    assert {name: headers[name] for name in HEADERS} == HEADERS
    body = json.dumps({"mission": mission}).encode()
    status, headers, gpx = request(silent, "POST", "/export?to=gpx", body)
    assert status == 200
    assert headers["content-disposition"] == 'attachment; filename="mission.gpx"'
    assert request(silent, "POST", "/import?name=b.gpx", gpx)[2] == content
    for path, data in (
        ("/import?name=a.exe", csv),
        ("/export?to=../a", body),
        ("/export?to=gpx", b"{"),
        ("/import?name=a.csv", b"x" * (2**20 + 1)),
    ):
        status, _, answer = request(silent, "POST", path, data)
        assert status == 400, path
        assert json.loads(answer)["error"]


def test_a_file_that_is_cut_or_comes_too_slowly_is_told_and_its_connection_given_back(
    silent: Served, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(server, "BODY_S", 0.3)
    answers, answered = [], server._error

    def note(text: str) -> Response:
        answers.append(text)
        return answered(text)

    monkeypatch.setattr(server, "_error", note)
    host, _, port = silent.address.rpartition(":")
    head = f"POST /import?name=a.csv HTTP/1.1\r\nHost: {silent.address}\r\nContent-Length: 9"
    begun = f"{head}\r\n\r\nlat".encode()
    with socket.create_connection((host, int(port)), timeout=30) as slow:
        slow.sendall(begun)
        answer = b"".join(iter(lambda: slow.recv(65536), b""))  # up to the end: the connection is closed
    assert answer.startswith(b"HTTP/1.1 400 ")
    assert b"the file did not come within 0.3 s: the link is too slow" in answer
    with socket.create_connection((host, int(port))) as cut:
        cut.sendall(begun)
    end = time.monotonic() + 60
    while not any("was cut" in text for text in answers):
        assert time.monotonic() < end
        time.sleep(0.01)
    assert request(silent, "GET", "/")[0] == 200
    assert capfd.readouterr().err == ""


def test_files_are_read_one_at_a_time_and_never_on_the_loop(
    silent: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    inside, most = 0, 0

    def slowly(name: str, data: bytes) -> Draft:
        nonlocal inside, most
        with pytest.raises(RuntimeError):
            asyncio.get_running_loop()
        inside += 1
        most = max(most, inside)
        time.sleep(0.4)
        inside -= 1
        return Draft()

    monkeypatch.setattr(server, "read", slowly)
    monkeypatch.setattr(server, "HEAD_S", 1.0)  # which the last answer takes longer than
    with ThreadPoolExecutor(3) as pool:
        answers = list(pool.map(lambda _: request(silent, "POST", "/import?name=a.csv", b"x")[0], range(3)))
    assert answers == [200] * 3
    assert most == 1


@pytest.mark.parametrize("before", [b"", b"GET /x HTTP/1.1\r\nHost: localhost\r\n\r\n"])
def test_a_connection_that_never_asks_is_closed_and_a_browsers_stays(
    silent: Served, monkeypatch: pytest.MonkeyPatch, before: bytes
) -> None:
    monkeypatch.setattr(server, "HEAD_S", 1.0)
    host, _, port = silent.address.rpartition(":")
    with silent.browser() as browser, socket.create_connection((host, int(port)), timeout=0.05) as idle:
        idle.sendall(before + b"GET / HTTP/1.1\r\nX: ")
        begun = browser.state["time"]
        end = time.monotonic() + 30
        while _is_open(idle):
            assert time.monotonic() < end, "it is kept"
        browser.until(lambda: browser.state["time"] > begun + 1.5)


def test_a_flood_of_connections_that_never_ask_keeps_no_page_out(silent: Served) -> None:
    host, _, port = silent.address.rpartition(":")
    with silent.browser() as browser, ExitStack() as flood:
        begun = browser.state["time"]
        for _ in range(200):  # more than may be open
            flood.enter_context(socket.create_connection((host, int(port)))).sendall(b"GET / HTTP/1.1\r\nX: ")
        assert request(silent, "GET", "/")[0] == 200
        with silent.browser():
            browser.until(lambda: browser.state["time"] > begun + 0.5)


def _is_open(idle: socket.socket) -> bool:
    """Is it, after another byte of its head?"""
    try:
        idle.sendall(b"x")
        return idle.recv(65536) != b""
    except TimeoutError:
        return True
    except ConnectionError:
        return False


@pytest.mark.parametrize(
    "path",
    ["/static/../session.py", "/static/%2e%2e/session.py", "/parts/..%2f..%2fstation/session.py", "/x"],
)
def test_nothing_but_the_page_and_its_parts_is_served(silent: Served, path: str) -> None:
    status, headers, _ = request(silent, "GET", path)
    assert status == 404
    assert headers["content-security-policy"] == HEADERS["content-security-policy"]


def test_another_host_gets_nothing(silent: Served) -> None:
    status, _, content = request(silent, "GET", "/parts/canine.js", headers={"Host": "evil.example"})
    assert status == 403
    assert b"Host" in content
    upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
    upgrade |= {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Origin": "http://evil.example"}
    assert request(silent, "GET", "/ws", headers=upgrade | {"Host": "evil.example"})[0] == 403, (
        "DNS rebinding"
    )


def test_the_key_is_never_shown(tmp_path: Path) -> None:
    key = Key(bytes(range(100, 116)))
    with unheard(tmp_path, key) as station, station.browser() as browser:
        shown = json.dumps([browser.hello, browser.history, browser.state])
        assert not browser.hello["insecure"]
    for content in (shown.encode(), (tmp_path / "trial.mcap").read_bytes()):
        assert key.data not in content
        assert key.data.hex().encode() not in content.lower()
