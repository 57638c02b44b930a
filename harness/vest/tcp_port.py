"""A TCP port as one end of a line: one program at a time connects to it."""

from __future__ import annotations

import socket
from contextlib import suppress

from harness.addresses import LOCALHOST
from models.errors import UsageError

READ = 65_536  # bytes at once
# a peer that does not even acknowledge is gone after 5 s
KEPT_ALIVE = {"TCP_KEEPIDLE": 2, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 3, "TCP_USER_TIMEOUT": 5000}


def as_radio(connection: socket.socket) -> None:
    """Have a connection carry a radio's bytes: at once, without waiting, and only while its peer answers."""
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name in KEPT_ALIVE.keys() & set(dir(socket)):  # not every system has all
        connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), KEPT_ALIVE[name])


class TcpPort:
    """A server for one client; further ones are turned away until it has gone.

    Args:
        port: 0 for one that is free.
        bind: the address that it listens at.

    Attributes:
        address: `tcp://host:port`.

    Raises:
        UsageError: it cannot listen there.
    """

    def __init__(self, port: int = 0, bind: str = LOCALHOST) -> None:
        try:
            family, *_, place = socket.getaddrinfo(bind, port, type=socket.SOCK_STREAM)[0]
            self._server = socket.create_server(place[:2], family=family)
        except (OSError, UnicodeError) as reason:
            why = getattr(reason, "strerror", None) or reason
            raise UsageError(f"--tcp {port}: {bind} cannot be listened at: {why}") from None
        self._server.setblocking(False)
        self._client: socket.socket | None = None
        host, number = self._server.getsockname()[:2]
        self.address = f"tcp://[{host}]:{number}" if ":" in host else f"tcp://{host}:{number}"

    @property
    def is_open(self) -> bool:
        """Is a client connected?"""
        return self._client is not None

    def read(self) -> bytes:
        """As `Port.read`; a client that waits is let in first."""
        self._accept()
        if self._client is None:
            return b""
        try:
            if data := self._client.recv(READ):
                return data
        except BlockingIOError:
            return b""
        except OSError:  # reset, or silent for too long
            pass
        self._leave()
        return b""

    def write(self, data: bytes) -> None:
        """As `Port.write`."""
        if self._client is None:
            return
        try:
            self._client.send(data)
        except BlockingIOError:
            pass
        except OSError:
            self._leave()

    def close(self) -> None:
        """Hang up, and listen no more."""
        self._leave()
        self._server.close()

    def _accept(self) -> None:
        with suppress(OSError):  # nobody waits, or no longer
            while True:
                client, _ = self._server.accept()
                if self._client is not None:
                    client.close()
                    continue
                as_radio(client)
                self._client = client

    def _leave(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
