"""Other programs reach a vest's radio by a serial device or a TCP port, where nothing waits for them."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from contextlib import closing
from functools import partial

import pytest

from harness.vest.port import Port
from harness.vest.pty_port import Pty
from harness.vest.radio_port import open_radio
from harness.vest.tcp_port import TcpPort
from models.errors import UsageError
from tests.harness.vest.devices import Connection, Device

ALL_BYTES = bytes(range(256))
PATIENCE = 20.0  # s


def read_until(port: Port, expected: bytes) -> None:
    """Read until all of these bytes have come."""
    heard, end = b"", time.monotonic() + PATIENCE
    while heard != expected:
        heard += port.read()
        assert expected.startswith(heard)
        assert time.monotonic() < end
        time.sleep(0.001)


def wait_for(condition: Callable[[], bool], port: Port) -> None:
    """Read, and drop it, until a condition holds."""
    end = time.monotonic() + PATIENCE
    while not condition():
        port.read()
        assert time.monotonic() < end
        time.sleep(0.001)


def test_all_bytes_go_through_a_pseudo_terminal_as_they_are() -> None:
    with closing(Pty()) as pty, Device(pty.address) as device:
        device.write(ALL_BYTES)
        read_until(pty, ALL_BYTES)
        pty.write(ALL_BYTES)
        read_until(device, ALL_BYTES)


def test_whoever_opens_the_device_later_gets_no_bytes_from_before() -> None:
    with closing(Pty()) as pty:
        assert not pty.is_open
        pty.write(b"before anybody came")
        with Device(pty.address) as device:
            assert pty.is_open
            pty.write(b"first")
            read_until(device, b"first")
            pty.write(b"not read")
            device.write(b"its last order")
        assert not pty.is_open
        pty.write(b"while nobody was there")
        assert pty.read() == b"its last order"
        with Device(pty.address) as device:
            pty.write(b"second")
            read_until(device, b"second")


def test_a_device_that_nobody_reads_holds_nobody_up() -> None:
    with closing(Pty()) as pty, Device(pty.address):
        for _ in range(1000):
            pty.write(bytes(1000))
    assert pty.address.startswith("/dev/")


def test_all_bytes_go_through_a_tcp_port_as_they_are() -> None:
    with closing(TcpPort()) as port, Connection(port.address) as laptop:
        laptop.write(ALL_BYTES)
        read_until(port, ALL_BYTES)
        port.write(ALL_BYTES)
        read_until(laptop, ALL_BYTES)


def test_a_second_client_is_turned_away_until_the_first_has_gone() -> None:
    with closing(TcpPort()) as port:
        with Connection(port.address) as first:
            wait_for(lambda: port.is_open, port)
            with Connection(port.address) as second:
                second.write(b"stranger")
                assert port.read() == b""
                assert second.is_hung_up()
            first.write(b"still here")
            read_until(port, b"still here")
        wait_for(lambda: not port.is_open, port)
        with Connection(port.address) as third:
            third.write(b"next")
            read_until(port, b"next")


def test_a_client_that_reads_nothing_holds_nobody_up() -> None:
    with closing(TcpPort()) as port, Connection(port.address):
        wait_for(lambda: port.is_open, port)
        for _ in range(1000):
            port.write(bytes(100_000))
    assert not port.is_open


def test_a_client_that_is_gone_is_noticed_by_what_is_sent_to_it_too() -> None:
    with closing(TcpPort()) as port:
        with Connection(port.address):
            wait_for(lambda: port.is_open, port)
        end = time.monotonic() + PATIENCE
        while port.is_open:
            port.write(bytes(1000))
            assert time.monotonic() < end


def test_a_port_that_is_closed_hangs_up() -> None:
    with closing(TcpPort()) as port, Connection(port.address) as laptop:
        wait_for(lambda: port.is_open, port)
        port.close()
        assert laptop.is_hung_up()


def test_a_peer_that_no_longer_answers_is_gone_after_some_seconds() -> None:
    with closing(TcpPort()) as port, Connection(port.address):
        wait_for(lambda: port.is_open, port)
        assert port._client
        option = partial(port._client.getsockopt, socket.IPPROTO_TCP)
        assert port._client.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        idle, each, probes = (option(getattr(socket, f"TCP_KEEP{name}")) for name in ("IDLE", "INTVL", "CNT"))
        assert idle + probes * each <= 5
        assert option(socket.TCP_USER_TIMEOUT) <= 5000  # ms


def test_a_port_that_is_taken_is_refused() -> None:
    with closing(TcpPort()) as port:
        number = int(port.address.rpartition(":")[2])
        with pytest.raises(UsageError, match=rf"--tcp {number}: 127.0.0.1 cannot be listened at: "):
            TcpPort(number)


def test_an_address_that_is_no_name_is_refused() -> None:
    with pytest.raises(UsageError, match=r"--tcp 0: a\.\.b cannot be listened at: "):
        TcpPort(0, "a..b")


@pytest.mark.parametrize("bind", ["0.0.0.0", "::", "192.0.2.1", "example.org"])
def test_beyond_this_machine_a_vest_needs_a_key(bind: str) -> None:
    with (
        pytest.raises(UsageError, match="expected --key FILE too"),
        open_radio(0, bind, is_signed=False),
    ):
        pass


@pytest.mark.parametrize(("bind", "signed"), [("127.0.0.1", False), ("localhost", False), ("0.0.0.0", True)])
def test_on_this_machine_or_with_a_key_it_may_listen(bind: str, signed: bool) -> None:
    with open_radio(0, bind, is_signed=signed) as port:
        assert port.address.startswith("tcp://")


def test_the_radio_is_a_serial_device_where_no_port_is_asked_for() -> None:
    with open_radio(None, "127.0.0.1", is_signed=False) as port:
        assert port.address.startswith("/dev/")
