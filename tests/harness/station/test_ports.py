"""What carries the radio's bytes, and what is said where it cannot."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from harness.station.ports import PortError, TcpPort, open_port
from models.errors import UsageError

UNTIL_LOST = (socket.TCP_USER_TIMEOUT, socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT)


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def name_of(listener: socket.socket) -> str:
    return f"tcp://127.0.0.1:{listener.getsockname()[1]}"


def until(read: Callable[[], bytes], size: int) -> bytes:
    data, end = b"", time.monotonic() + 30
    while len(data) < size:
        assert time.monotonic() < end
        data += read()
    return data


def test_a_tcp_port_carries_bytes_both_ways_and_never_waits(listener: socket.socket) -> None:
    port = open_port(name_of(listener))
    vest, _ = listener.accept()
    with vest:
        assert port.read() == b""
        port.write(b"\x00\xff")
        assert vest.recv(10) == b"\x00\xff"
        vest.sendall(b"\xa5\x5a")
        assert until(port.read, 2) == b"\xa5\x5a"
    port.close()


def test_a_peer_that_does_not_even_acknowledge_is_given_up_within_seconds(listener: socket.socket) -> None:
    port = open_port(name_of(listener))
    assert isinstance(port, TcpPort)
    options = [port._socket.getsockopt(socket.IPPROTO_TCP, option) for option in UNTIL_LOST]
    assert port._socket.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
    assert options == [5000, 2, 1, 3]
    port.close()


def test_a_vest_that_takes_nothing_loses_bytes_and_holds_nobody_up(listener: socket.socket) -> None:
    port = open_port(name_of(listener))
    vest, _ = listener.accept()
    with vest:
        for _ in range(2000):
            port.write(bytes(65536))
    port.close()


def test_a_flood_comes_in_small_pieces_and_whole(listener: socket.socket) -> None:
    port = open_port(name_of(listener))
    vest, _ = listener.accept()
    sent = bytes(range(256)) * 64
    sizes = []

    def read() -> bytes:
        data = port.read()
        sizes.append(len(data))
        return data

    with vest:
        vest.sendall(sent)
        assert until(read, len(sent)) == sent
    assert max(sizes) <= 4096
    port.close()


def test_a_connection_that_the_other_end_closes_is_told(listener: socket.socket) -> None:
    port = open_port(name_of(listener))
    vest, _ = listener.accept()
    vest.close()
    with pytest.raises(PortError, match=r"tcp://127.0.0.1:\d+: the other end closed"):
        until(port.read, 1)
    port.close()


def test_a_serial_port_carries_every_byte_value_unchanged() -> None:
    ours, theirs = os.openpty()
    port = open_port(os.ttyname(theirs))
    everything = bytes(range(256))
    os.write(ours, everything)
    assert until(port.read, 256) == everything
    port.write(everything)
    assert until(lambda: os.read(ours, 256), 256) == everything
    port.close()
    os.close(theirs)
    os.close(ours)


def test_a_serial_port_that_takes_nothing_loses_bytes_and_holds_nobody_up() -> None:
    ours, theirs = os.openpty()
    port = open_port(os.ttyname(theirs))
    for _ in range(2000):
        port.write(bytes(1000))
    port.close()
    os.close(theirs)
    os.close(ours)


def test_a_serial_port_that_is_pulled_is_told() -> None:
    ours, theirs = os.openpty()
    port = open_port(os.ttyname(theirs))
    os.close(theirs)
    os.close(ours)
    with pytest.raises(PortError, match="is gone"):
        until(port.read, 1)
    port.close()


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("/dev/ttyNONE7", "there is no such device; expected tcp://host:port, or a serial device"),
        ("tcp://localhost", "expected tcp://host:port with a port of 1 to 65535"),
        ("tcp://localhost:99999", "expected tcp://host:port"),
        ("tcp://localhost:7700/x", "expected tcp://host:port"),
        ("udp://localhost:7700", "expected tcp://host:port"),
        ("tcp://127.0.0.1:1", "cannot be reached"),
        ("tcp://no.such.host.invalid:1", "cannot be reached"),
    ],
)
def test_a_port_that_cannot_be_opened_is_named_with_what_is_expected(name: str, says: str) -> None:
    with pytest.raises(UsageError) as refused:
        open_port(name)
    assert name in str(refused.value)
    assert says in str(refused.value)


def test_what_is_no_serial_device_is_told_without_numbers(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("")
    for name in (str(tmp_path / "x"), "/dev/null"):
        with pytest.raises(UsageError, match=f"^--port {name}: is no serial device$"):
            open_port(name)
    with pytest.raises(UsageError, match="cannot be opened"):
        open_port(str(tmp_path))
