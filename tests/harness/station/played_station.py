"""A station that a test plays: it serves the page, says what the test says, and notes what the page sends."""

from __future__ import annotations

import json
import math
import mimetypes
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from harness.report.inline import PARTS
from harness.station.history import History
from harness.station.shown import TRACK, welcome
from models.commands import Command, Status
from models.modes import Anomaly, Mode

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route, WebSocketRoute

STATIC = PARTS.parents[1] / "station" / "static"
URL = "http://station.test/"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self' ws:; base-uri 'none'; form-action 'none'"
)
HOME = [32.6062, -85.4877]
MISSION: dict[str, Any] = {
    "home": HOME,
    "waypoints": [[32.60652, -85.4877], [32.60652, -85.48732]],
    "fence": [],
}
OTHER: dict[str, Any] = {"home": HOME, "waypoints": [[32.60652, -85.4877], [32.6064, -85.4872]], "fence": []}
ME = 1
STEP = 100  # ms
THRESHOLDS = {
    "moving_deviation": math.radians(37), "stop_deviation": math.radians(20), "capture_radius": 4.0,
}  # fmt: skip
GREETING, HISTORY = (
    json.loads(message)
    for message in welcome(
        ME,
        {f"controller.{name}": repr(value) for name, value in THRESHOLDS.items()},
        History(TRACK),
        (),
        commander=None,
        insecure=False,
        replay=None,
        source="a test",
        scenario=MISSION,
        world=None,
    )
)
HELLO: dict[str, Any] = GREETING | {"limits": GREETING["limits"] | {"silent_s": 120}}
TELEMETRY: dict[str, Any] = {
    "time": 0.0, "speed": 2.0, "heading": 0.2, "position_sd": 0.8, "distance": 25.3, "deviation": -0.3,
    "directional_commands": 1, "command": Command.FORWARD, "mode": Mode.FORWARD, "status": Status.RUNNING,
    "waypoint": 1, "anomaly": Anomaly.NONE, "last_anomaly": Anomaly.NONE, "issues_left": 5,
    "vibration_left": 12.0, "tone_left": 6553.5, "gps_frames": 1, "imu_frames": 1, "battery": 3.91,
    "temperature": 21.5, "gps_errors": 0, "imu_errors": 0, "rejected_fixes": 0, "link_errors": 0,
    "link_forged": 0, "link_replayed": 0,
}  # fmt: skip
STATE: dict[str, Any] = {
    "is": "state", "time": 1.0, "link": "connected", "telemetry": TELEMETRY, "place": HOME, "missing": [],
    "refusal": None, "draft": None, "draft_id": 0, "on_board": None, "stop_latched": False, "holding": None,
    "starting": False, "uploading": False, "aborting": False, "commander": ME, "commander_alive": True,
    "offered": False, "operators": [ME], "alarms": [],
    "link_quality": {
        "lost": 3, "late": 0, "errors": 1, "forged": 0, "round_trip_s": 0.24, "age_s": 0.1, "sessions": 1,
    },
}  # fmt: skip
READY = {"link": "ready", "draft": MISSION, "on_board": {"id": 6874, "mission": MISSION}}
RUNNING = {**READY, "link": "running"}


@dataclass
class PlayedStation:
    """The other end of the page.

    Attributes:
        sent: what the page sent by its socket, in order, without `seen`.
        seen: by the last of these: the time of the state that it answers.
        posts: path, query and body of what it sent otherwise.
        answers: by path, status and body of the answer.
        connections: so many times it has connected.
    """

    hello: dict[str, Any] = field(default_factory=lambda: HELLO)
    sent: list[dict[str, Any]] = field(default_factory=list)
    seen: float | None = None
    posts: list[tuple[str, str, bytes]] = field(default_factory=list)
    answers: dict[str, tuple[int, bytes]] = field(default_factory=dict)
    connections: int = 0
    time: float = 0.0
    _state: dict[str, Any] = field(default_factory=dict)
    _socket: WebSocketRoute | None = None
    _page: Page | None = None

    def prepare(self, page: Page) -> None:
        """Takes the place of the network."""
        self._page = page
        page.route("**/*", self._serve)
        page.route_web_socket("**/ws", self._connect)

    def _serve(self, route: Route) -> None:
        address = urlsplit(route.request.url)
        if route.request.method == "POST":
            self.posts.append((address.path, address.query, route.request.post_data_buffer or b""))
            status, body = self.answers[address.path]
            return route.fulfill(status=status, body=body)
        folder, _, name = address.path.lstrip("/").partition("/")
        path = {"": STATIC / "index.html", "static": STATIC / name, "parts": PARTS / name}[folder]
        kind = mimetypes.guess_type(path.name)[0] or "text/plain"
        return route.fulfill(
            body=Path(path).read_bytes(), headers={"Content-Type": kind, "Content-Security-Policy": POLICY}
        )

    def _connect(self, socket: WebSocketRoute) -> None:
        self._socket = socket
        self.connections += 1
        self._state = {}
        socket.on_message(self._take)
        self.say(self.hello)
        self.say(HISTORY)

    def _take(self, text: str | bytes) -> None:
        message = json.loads(text)
        self.seen = message.pop("seen")
        self.sent.append(message)

    def say(self, message: dict[str, Any]) -> None:
        """A message to the page."""
        assert self._socket
        self._socket.send(json.dumps(message))

    def state(self, **changes: Any) -> None:
        """The next state, 0.2 s after the last one; the page has drawn it."""
        assert self._page
        self.time = round(self.time + 0.2, 1)
        self._state = {**STATE, "time": self.time, **changes}
        self.say(self._state)
        self._page.locator(f'body[data-drawn="{self.time:g}"]').wait_for()

    def wait(self, milliseconds: int) -> None:
        """Time passes, in which the station goes on to speak."""
        assert self._page
        for _ in range(0, milliseconds, STEP):
            self._page.wait_for_timeout(STEP)
            if self._state:
                self.say(self._state)

    def cut(self) -> None:
        """The connection ends."""
        assert self._socket
        self._socket.close()

    def orders(self, *kinds: str) -> list[dict[str, Any]]:
        """What the page sent of these kinds."""
        return [message for message in self.sent if message["do"] in kinds]

    def await_order(self, kind: str, is_right: Callable[[dict[str, Any]], bool] = lambda _: True) -> Any:
        """The first such order, within 10 s."""
        assert self._page
        for _ in range(0, 10_000, STEP):
            found = [message for message in self.orders(kind) if is_right(message)]
            if found:
                return found[0]
            self.wait(STEP)
        raise AssertionError(f"the page sent no such {kind}, but {self.sent[-10:]}")
