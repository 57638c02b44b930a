"""The vest's end of the radio, where other programs reach it: a serial device, or a TCP port."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

from harness.addresses import LOCALHOST, is_local
from harness.vest.pty_port import Pty
from harness.vest.tcp_port import TcpPort
from models.errors import UsageError


@contextmanager
def open_radio(tcp: int | None, bind: str, *, is_signed: bool) -> Iterator[Pty | TcpPort]:
    """A port that another program can open.

    Args:
        tcp: number of a TCP port, 0 for a free one; None for a pseudo-terminal.
        bind: the address at which a TCP port is.
        is_signed: the vest has a key.

    Raises:
        UsageError: the port cannot be had, is not asked for, or all the network could command the vest.
    """
    if tcp is None:
        if bind != LOCALHOST:
            raise UsageError(f"--bind {bind}: is where --tcp listens; expected --tcp PORT too")
        with closing(Pty()) as pty:
            yield pty
        return
    if not is_signed and not is_local(bind):
        raise UsageError(
            f"--bind {bind}: whoever reaches it commands the vest; expected --key FILE too "
            "(`canine keygen` makes one), or an address of this machine, such as 127.0.0.1"
        )
    with closing(TcpPort(tcp, bind)) as port:
        yield port
