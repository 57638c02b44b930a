"""A browser behind a slow link: it watches, and takes some kB a second of what the station tells."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable
from typing import Any

from websockets.client import ClientProtocol
from websockets.frames import Frame, Opcode
from websockets.typing import Origin, Subprotocol
from websockets.uri import parse_uri

from harness.station.guard import SUBPROTOCOL

BUFFER = 4096  # bytes that the receiver's own system takes ahead
PIECE_S = 0.1


class SlowWatcher:
    """A WebSocket that is read at a rate of bytes a second.

    Attributes:
        states, events, bytes: that came.
        left_out: messages that the station says it left out.
        oldest: s of the clock between the state's time and `now` when it came, at most (see `run`).
        ended: why it was hung up on; "" while it was not.
    """

    def __init__(self, address: str, rate: int) -> None:
        self._rate = rate
        self.states = self.events = self.bytes = self.left_out = 0
        self.oldest = 0.0
        self.ended = ""
        host, _, port = address.rpartition(":")
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        self._socket.connect((host, int(port)))
        self._protocol = ClientProtocol(
            parse_uri(f"ws://{address}/ws"),
            origin=Origin(f"http://{address}"),
            subprotocols=[Subprotocol(SUBPROTOCOL)],
        )
        self._protocol.send_request(self._protocol.connect())
        self._send()

    def _send(self) -> None:
        for data in self._protocol.data_to_send():
            self._socket.sendall(data)

    def run(self, is_over: Callable[[], bool], age: Callable[[dict[str, Any]], float]) -> None:
        """Watch until it is over; `age` tells how old a state is, s."""
        with self._socket:
            while not is_over():
                time.sleep(PIECE_S)
                try:
                    data = self._socket.recv(round(self._rate * PIECE_S))
                except OSError as reason:
                    self.ended = str(reason)
                    return
                if not data:
                    self.ended = "closed by the station"
                    return
                self.bytes += len(data)
                self._protocol.receive_data(data)
                self._send()  # answers to pings
                for event in self._protocol.events_received():
                    if isinstance(event, Frame) and event.opcode is Opcode.TEXT:
                        self._take(json.loads(bytes(event.data)), age)

    def _take(self, message: dict[str, Any], age: Callable[[dict[str, Any]], float]) -> None:
        match message["is"]:
            case "state":
                self.states += 1
                self.oldest = max(self.oldest, age(message))
            case "event":
                self.events += 1
            case "error":
                self.left_out += int(message["text"].split()[0])
