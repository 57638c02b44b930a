"""Viewers are sent what a log is given, by the protocol of Foxglove's SDK."""

import json
import socket
import struct
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from harness.log.channel import Channel
from harness.log.live import Pace, Viewers
from harness.log.writer import LogWriter
from harness.station.sink import Sink
from models.errors import UsageError
from tests.harness.command import canine

HEAD = struct.Struct("<BIQ")  # of a message: 1, subscription, log time
SHORT = 'system = "cts"\nduration = 0.4\nwaypoints = [[30.0, 0.0]]\n'


class Viewer:
    """What a viewer does: it reads which topics there are, and asks for some."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.topics: dict[str, int] = {}
        self.messages: list[tuple[str, int, bytes]] = []

    def ask(self, *topics: str) -> None:
        """Ask for topics, once they are there."""
        while not self.topics.keys() >= set(topics):
            self._receive()
        wanted = [{"id": self.topics[topic], "channelId": self.topics[topic]} for topic in topics]
        self.connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def read(self, count: int) -> list[tuple[str, int, bytes]]:
        """So many messages: topic, log time in ns, content."""
        while len(self.messages) < count:
            self._receive()
        return self.messages

    def _receive(self) -> None:
        received = self.connection.recv(timeout=60)
        if isinstance(received, bytes):
            _, number, moment = HEAD.unpack_from(received)
            names = {channel: topic for topic, channel in self.topics.items()}
            self.messages.append((names[number], moment, received[HEAD.size :]))
            return
        said: dict[str, Any] = json.loads(received)
        self.topics |= {channel["topic"]: channel["id"] for channel in said.get("channels", [])}


@contextmanager
def viewer_at(port: int) -> Iterator[Viewer]:
    address = f"ws://127.0.0.1:{port}"
    with connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")], open_timeout=60) as connection:
        yield Viewer(connection)


def channel(component: str, *names: str) -> Channel:
    blank = ("",) * len(names)
    return Channel(component, component, names, blank, ("Real",) * len(names), blank)


def writer(path: Path, viewers: Viewers) -> LogWriter:
    return LogWriter(
        path,
        [channel("plant", "north", "east", "heading")],
        origin=(32.6, -85.5),
        metadata={},
        attachments={},
        viewers=viewers,
    )


def rows(*norths: float) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
    return {"plant": np.array([[north, 0.0, 0.0] for north in norths])}


def test_a_viewer_is_sent_the_messages_of_the_log(tmp_path: Path) -> None:
    # given a viewer of the plant and of the map
    with (
        Viewers(0) as viewers,
        writer(tmp_path / "a.mcap", viewers) as log,
        viewer_at(viewers.port) as viewer,
    ):
        viewer.ask("/plant", "/map/truth")
        viewers.wait()
        while len(subscribed(viewers)) < 2:
            time.sleep(0.01)
        # when ticks are logged
        log.write_rows(np.array([0.0, 0.04]), rows(0.0, 1.5))
        log.write_rows(np.array([0.08, 0.2]), rows(2.5, 3.5))
        got = viewer.read(6)
    # then they are those in the file, with their times
    with (tmp_path / "a.mcap").open("rb") as file:
        messages = make_reader(file).iter_messages(topics=["/plant", "/map/truth"])
        written = [(topic.topic, message.log_time, message.data) for _, topic, message in messages]
    assert sorted(got) == sorted(written)


def subscribed(viewers: Viewers) -> list[Any]:
    return [own for own in viewers._channels.values() if own.has_sinks()]


def test_a_viewer_that_comes_late_has_the_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("harness.log.live.AGAIN_S", 0.0)
    # given a log in which the scene was drawn, and ticks since
    with Viewers(0) as viewers, writer(tmp_path / "a.mcap", viewers) as log:
        log.write_rows(np.array([0.0, 0.04]), rows(0.0, 1.5))
        # when a viewer asks for the scene
        with viewer_at(viewers.port) as viewer:
            viewer.ask("/3d/scene")
            viewers.wait()
            log.write_rows(np.array([0.08]), rows(2.5))
            [(topic, moment, _)] = viewer.read(1)
    assert (topic, moment) == ("/3d/scene", 0)


def test_a_scene_that_was_drawn_anew_is_the_one_that_late_viewers_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a log whose route became known under way: its scene was drawn twice
    monkeypatch.setattr("harness.log.live.AGAIN_S", 0.0)
    with Viewers(0) as viewers, writer(tmp_path / "a.mcap", viewers) as log:
        log.write_rows(np.array([0.0, 0.04]), rows(0.0, 1.5))
        log.settle((32.6, -85.5), {"controller.waypoint_count": "1"})
        log.write_rows(np.array([0.08]), rows(2.0))
        # when
        with viewer_at(viewers.port) as viewer:
            viewer.ask("/3d/scene")
            viewers.wait()
            log.write_rows(np.array([0.12]), rows(2.5))
            [(topic, _, _)] = viewer.read(1)
    assert topic == "/3d/scene"


def test_a_paced_log_waits_until_a_messages_time_has_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a clock that only sleep moves on
    clock = [100.0]
    monkeypatch.setattr("harness.log.live.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("harness.log.live.time.sleep", lambda s: clock.__setitem__(0, clock[0] + s))
    with Viewers(0, pace=Pace()) as viewers, writer(tmp_path / "a.mcap", viewers) as log:
        log.write_rows(np.array([0.0, 0.04]), rows(0.0, 1.5))
        assert clock[0] == pytest.approx(100.04)
        log.write_rows(np.array([0.08, 3.0]), rows(2.5, 3.5))
        assert clock[0] == pytest.approx(103.0)


def test_a_port_that_is_taken_is_refused() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(UsageError, match=rf"--foxglove {port}: cannot listen on 127.0.0.1:{port}"):
            Viewers(port)


def test_without_the_extra_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(UsageError, match=r"needs foxglove-sdk.*guided-canine\[foxglove\]"):
        Viewers(0)


def test_a_trial_begins_when_a_viewer_asks_and_leaves_the_same_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a viewer that connects as soon as it can
    (tmp_path / "short.toml").write_text(SHORT)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    got: list[tuple[str, int, bytes]] = []

    def view() -> None:
        while True:
            try:
                with viewer_at(port) as viewer:
                    viewer.ask("/plant")
                    got.extend(viewer.read(5))
                    return
            except (OSError, WebSocketException):  # it is not there, or has no time; it waits
                time.sleep(0.05)

    thread = threading.Thread(target=view, daemon=True)
    thread.start()
    # when a trial of 0.4 s runs for it, and once more without
    status, _, errors = canine(
        capsys, "run", tmp_path / "short.toml", "--foxglove", port, "--out", tmp_path / "a"
    )
    canine(capsys, "run", tmp_path / "short.toml", "--out", tmp_path / "b")
    thread.join(60)
    # then it was shown from its first ticks on, and the log is the same
    assert status == 0
    assert f"ws://localhost:{port}" in errors
    assert [moment for _, moment, _ in got[:3]] == [0, 40_000_000, 80_000_000]
    assert (tmp_path / "a" / "trial.mcap").read_bytes() == (tmp_path / "b" / "trial.mcap").read_bytes()


def test_viewers_are_not_shown_many_trials(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, errors = canine(capsys, "run", "--seeds", "1:2", "--foxglove", 0)
    assert status == 2
    assert "viewers are shown one trial" in errors


def test_a_station_shows_what_it_logs(tmp_path: Path) -> None:
    # given a viewer of a station that has heard nothing yet
    with Viewers(0) as viewers:
        sink = Sink(tmp_path, {}, viewers=viewers)
        with viewer_at(viewers.port) as viewer:
            viewer.ask("/radio/received")
            viewers.wait()
            # when bytes come by radio
            sink.receive(0.5, b"\x01\xff")
            sink.step(2.0)
            [(topic, moment, message)] = viewer.read(1)
        sink.close()
    assert (topic, moment, json.loads(message)) == ("/radio/received", 500_000_000, {"bytes": "01ff"})


def test_a_log_that_is_shown_again_is_not_sent_to_viewers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.mcap").write_bytes(b"")
    status, _, errors = canine(capsys, "station", "--replay", tmp_path / "a.mcap", "--foxglove", 0)
    assert status == 2
    assert "a log is opened in the viewer" in errors
