"""Ports: what carries the radio's bytes. None of them waits: what cannot pass now is lost, as on the air."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from harness.vest.tcp_port import as_radio
from models.errors import CanineError, UsageError, printable

BAUD = 57600  # of the radio's serial line, as the firmware's ports set it
MOST_READ = 4096  # bytes at a look: more, from a peer that floods, would hold up the station's loop
CONNECT_S = 10.0
HIGHEST_PORT = 65535


class PortError(CanineError):
    """A port that was open has failed."""


class Port(Protocol):
    """The laptop's end of the radio."""

    def read(self) -> bytes:
        """The bytes that have come; none if none have. Raises PortError if no more can come."""

    def write(self, data: bytes) -> None:
        """Send bytes. Raises PortError if none can be sent."""

    def close(self) -> None:
        """Let go of it."""


class SerialPort:
    """A radio at a serial port, or a pseudo-terminal.

    Raises:
        UsageError: it cannot be opened.
    """

    def __init__(self, device: str, baud: int = BAUD) -> None:
        import serial  # noqa: PLC0415 - an optional extra

        self._device, self._failures = device, (serial.SerialException, OSError)
        try:
            self._port: Any = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
        except (serial.SerialException, OSError, ValueError) as reason:
            is_other = getattr(reason.__context__, "args", ())[:1] == (errno.ENOTTY,)
            why = "is no serial device" if is_other else f"cannot be opened ({_reason(reason)})"
            raise UsageError(f"--port {printable(device)}: {why}") from None

    def read(self) -> bytes:
        """As `Port`."""
        try:
            data: bytes = self._port.read(MOST_READ)
        except self._failures as reason:
            raise PortError(f"port {self._device}: is gone ({_reason(reason)})") from None
        return data

    def write(self, data: bytes) -> None:
        """As `Port`."""
        try:
            with suppress(BlockingIOError, InterruptedError):
                os.write(self._port.fileno(), data)  # its own `write` tries again until all is taken
        except self._failures as reason:
            raise PortError(f"port {self._device}: is gone ({_reason(reason)})") from None

    def close(self) -> None:
        """As `Port`."""
        self._port.close()


class TcpPort:
    """A radio, or a vest, behind a TCP connection.

    Raises:
        UsageError: nobody answers there.
    """

    def __init__(self, host: str, number: int) -> None:
        self._name = f"tcp://{host}:{number}"
        try:
            self._socket = socket.create_connection((host, number), timeout=CONNECT_S)
        except (OSError, UnicodeError) as reason:
            raise UsageError(
                f"--port {printable(self._name)}: cannot be reached ({_reason(reason)}); does the vest run?"
            ) from None
        as_radio(self._socket)  # a peer that is lost is told within 5 s, and the port opened again

    def read(self) -> bytes:
        """As `Port`."""
        try:
            data = self._socket.recv(MOST_READ)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError as reason:
            raise PortError(f"port {self._name}: the connection broke ({_reason(reason)})") from None
        if not data:
            raise PortError(f"port {self._name}: the other end closed the connection")
        return data

    def write(self, data: bytes) -> None:
        """As `Port`."""
        try:
            with suppress(BlockingIOError, InterruptedError):
                self._socket.send(data)
        except OSError as reason:
            raise PortError(f"port {self._name}: the connection broke ({_reason(reason)})") from None

    def close(self) -> None:
        """As `Port`."""
        self._socket.close()


def open_port(name: str, note: Callable[[str], None] = lambda text: None) -> Port:
    """The port of a name: `tcp://host:port`, or the path of a serial device.

    Args:
        note: is told what the user should know.

    Raises:
        UsageError: there is no such port, it cannot be opened, or nobody answers.
    """
    if "://" not in name:
        if not Path(name).exists():
            there = ", ".join(_serial_devices()) or "none"
            raise UsageError(
                f"--port {printable(name)}: there is no such device; expected tcp://host:port, or a serial "
                f"device (there are: {there})"
            )
        return SerialPort(name)
    parts, number = urlsplit(name), None
    with suppress(ValueError):
        number = parts.port
    if parts.scheme != "tcp" or not parts.hostname or not number or parts.path or parts.query:
        raise UsageError(
            f"--port {printable(name)}: expected tcp://host:port with a port of 1 to {HIGHEST_PORT}"
        )
    note(f"{name}: TCP is not protected; only the vest's key is (rule 11)")
    return TcpPort(parts.hostname, number)


def _serial_devices() -> list[str]:
    from serial.tools import list_ports  # noqa: PLC0415 - an optional extra

    return sorted(port.device for port in list_ports.comports())


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)
