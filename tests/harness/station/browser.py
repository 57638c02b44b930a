"""A station that serves a simulated vest, and what a browser is to it: a WebSocket."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import uvicorn
from websockets.sync.client import ClientConnection, connect

from codegen.firmware.key import Key
from harness.station.guard import Guard
from harness.station.mission_files import load
from harness.station.opening import Request, opened, vest_parameters
from harness.station.server import listening, serve
from harness.station.session import About, Session
from harness.station.shown import Shown
from harness.station.sink import Sink
from harness.trial.scenario import Scenario

LONGEST_S = 60.0
T = TypeVar("T")


class Browser:
    """A tab; it shows that it lives while it waits, unless it is `dead`.

    Attributes:
        state: the last that was shown.
        events, errors: texts so far.
    """

    def __init__(self, socket: ClientConnection) -> None:
        self.socket, self.dead = socket, False
        self.hello: dict[str, Any] = {}
        self.history: dict[str, Any] = {}
        self.state: dict[str, Any] = {}
        self.events: list[str] = []
        self.errors: list[str] = []
        self._alive_at = 0.0
        self.until(lambda: bool(self.state))

    def do(self, name: str, **content: Any) -> None:
        self.socket.send(json.dumps({"do": name, **content}))

    def until(self, is_so: Callable[[], bool], longest: float = LONGEST_S) -> None:
        """Take what comes until something is so."""
        end = time.monotonic() + longest
        while not is_so():
            assert time.monotonic() < end, (self.state, self.events[-5:], self.errors)
            if not self.dead and time.monotonic() - self._alive_at > 0.1:
                self._alive_at = time.monotonic()
                self.do("alive")
            try:
                self._take(json.loads(self.socket.recv(timeout=0.05)))
            except TimeoutError:
                continue

    def _take(self, message: dict[str, Any]) -> None:
        match message["is"]:
            case "state":
                self.state = message
            case "event":
                self.events.append(message["text"])
            case "error":
                self.errors.append(message["text"])
            case "hello":
                self.hello = message
            case "history":
                self.history = message

    def load(self) -> None:
        """Command, and have the scenario's own mission on board."""
        self.do("take")
        self.do("draft", mission=self.hello["scenario"])
        self.until(lambda: self.state["draft_id"] is not None)
        self.until(lambda: self.state["link"] != "disconnected")
        self.do("upload")
        self.until(lambda: self.state["link"] == "ready")

    def begin(self) -> None:
        """Have the mission under way."""
        self.load()
        self.do("start")
        self.until(lambda: self.state["link"] == "running")


class Served:
    """A station that is served in a thread."""

    def __init__(self, address: str, shown: Shown, vest: Any = None) -> None:
        self.address, self.shown, self.vest = address, shown, vest

    @contextmanager
    def browser(self, **options: Any) -> Iterator[Browser]:
        with self.tab(Browser, **options) as browser:
            yield browser

    @contextmanager
    def tab(self, kind: Callable[[ClientConnection], T], **options: Any) -> Iterator[T]:
        """A browser of a kind; options are those of its socket."""
        usual: Any = {"subprotocols": ["canine"], "origin": f"http://{self.address}", "close_timeout": 0.5}
        with connect(f"ws://{self.address}/ws", **(usual | options)) as socket:
            yield kind(socket)


@contextmanager
def served(shown: Shown, guard: Guard | None = None) -> Iterator[Served]:
    """Serve a session or a playback on a free port."""
    guard = guard or Guard.of("127.0.0.1")
    with listening("127.0.0.1", 0) as listener:
        servers: list[uvicorn.Server] = []
        ready = threading.Event()

        def begin(server: uvicorn.Server) -> None:
            servers.append(server)
            ready.set()

        thread = threading.Thread(target=lambda: asyncio.run(serve(shown, guard, listener, begin)))
        thread.start()
        try:
            assert ready.wait(LONGEST_S)
            yield Served(f"127.0.0.1:{listener.getsockname()[1]}", shown)
        finally:
            for server in servers:
                server.should_exit = True
            thread.join(LONGEST_S)
            assert not thread.is_alive()


@contextmanager
def simulated(folder: Path, speed: float = 5.0, scenario: str | Path = "three_waypoint") -> Iterator[Served]:
    """A station with a simulated vest."""
    request = Request(simulate=str(scenario), speed=speed, out=folder)
    with opened(request, lambda text: None) as session, served(session) as station:
        station.vest = vest_of(session)
        yield station


@contextmanager
def by_radio(folder: Path, radio: str, mission: str | Path = "three_waypoint") -> Iterator[Served]:
    """A station at a vest's radio, with a mission on screen."""
    with opened(Request(port=radio, out=folder), lambda text: None) as session:
        session.conduct.draft = load(str(mission))
        with served(session) as station:
            yield station


class Silence:
    """A port at which nothing comes."""

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> None:
        pass

    def close(self) -> None:
        pass


@contextmanager
def unheard(folder: Path, key: Key | None = None, guard: Guard | None = None) -> Iterator[Served]:
    """A station whose vest is silent."""
    about = About("nothing", vest_parameters(Scenario("nothing")))
    session = Session(Silence(), key, Sink(folder, {"parameters": about.parameters}), about)
    try:
        with served(session, guard) as station:
            yield station
    finally:
        session.close()


def vest_of(session: Session) -> Any:
    """The simulated vest, which knows what the animal hears."""
    port: Any = session._port
    return port._vest
