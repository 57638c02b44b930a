"""A network that can be lost: a way to a TCP port, on which bytes stay where they are while it is cut.

Nothing is closed and nobody is told, as when a laptop leaves the reach of its Wi-Fi. What was on its way
comes late, once the network is back.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

LOCAL = "127.0.0.1"
READ = 65_536  # bytes at once


class Network:
    """Carries the bytes of connections to a port, both ways, unless it is cut; `network_to` makes one.

    Attributes:
        address: `host:port`, at which it is reached.
    """

    def __init__(self, port: int, server: socket.socket, owned: ExitStack) -> None:
        self._port, self._server, self._owned = port, server, owned
        self._carries = threading.Event()
        self._carries.set()
        self.address = f"{LOCAL}:{server.getsockname()[1]}"

    def cut(self) -> None:
        """Bytes stay where they are from now on."""
        self._carries.clear()

    def restore(self) -> None:
        """They go on."""
        self._carries.set()

    def serve(self) -> None:
        """Let connections in, until the server is shut down."""
        with suppress(OSError):
            while True:
                self._start(self._join, self._own(self._server.accept()[0]))

    def _own(self, end: socket.socket) -> socket.socket:
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._owned.callback(_hang_up, end)
        return end

    @staticmethod
    def _start(work: Callable[..., None], *ends: socket.socket) -> None:
        threading.Thread(target=work, args=ends, daemon=True).start()

    def _join(self, near: socket.socket) -> None:
        """Connect on to the port, and carry both ways."""
        self._carries.wait()
        try:
            far = self._own(socket.create_connection((LOCAL, self._port)))
        except OSError:  # nobody listens there any more
            _hang_up(near)
            return
        self._start(self._carry, near, far)
        self._carry(far, near)

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(READ):
                self._carries.wait()
                sink.sendall(data)
        with suppress(OSError):
            sink.shutdown(socket.SHUT_WR)


def _hang_up(end: socket.socket) -> None:
    """Close it, and wake who waits at it."""
    with suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)
    end.close()


@contextmanager
def network_to(port: int) -> Iterator[Network]:
    """A network before a port of this machine."""
    with ExitStack() as owned:
        server = socket.create_server((LOCAL, 0))
        network = Network(port, server, owned)
        owned.callback(network.restore)
        owned.callback(_hang_up, server)
        threading.Thread(target=network.serve, daemon=True).start()
        yield network
