"""A simulated board on its three lines, with a clock of its own: only what comes out of it is known."""

from __future__ import annotations

import socket
from contextlib import ExitStack, suppress

from codegen.firmware.bundle import recorded
from codegen.firmware.key import Key
from codegen.firmware.navigation import Navigation
from harness.addresses import LOCALHOST
from harness.onboard.processors import Received, Reply
from harness.onboard.processors.stm32f405 import Board, Playing, open_board
from harness.vest.tcp_port import READ
from models.kit.link import Values

QUIET = Playing(0, vibrate_left=False, vibrate_right=False)


class BoardOnLines:
    """A board's program with its own clock. What it remembers is not known: its record is 0.

    It answers a tick while the next one is waited for: a `Reply` is what it has sent by now, and plays now.

    Args:
        owned: is closed with it, the board too.
    """

    def __init__(self, board: Board, navigation: Navigation, owned: ExitStack) -> None:
        self.image, self._board, self._owned = board.image, board, owned
        self.start = bytes(4 * len(recorded(navigation)))
        self._lines: dict[str, socket.socket] = {}
        for source, port in board.ports.items():
            line = owned.enter_context(socket.create_connection((LOCALHOST, port)))
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            line.setblocking(False)
            self._lines[source] = line
        self._played = QUIET

    def reset(self, session: int) -> None:
        """Press its reset button; the board draws the number of its session itself.

        Raises:
            ProcessorError: it has ended.
        """
        self._board.reset()
        self._played = QUIET

    def tick(self, received: Received) -> Reply:
        """Send the bytes of a tick on the lines.

        Raises:
            ProcessorError: the board has ended.
        """
        for source, line in self._lines.items():
            if data := getattr(received, source):
                with suppress(BlockingIOError, ConnectionError):  # the board, asked below, tells why
                    line.send(data)
        sent = b""
        with suppress(BlockingIOError, ConnectionError):
            sent = self._lines["radio"].recv(READ)
        playing = self._board.playing()
        if playing == self._played or playing == self._board.playing():  # else it changes at this moment
            self._played = playing
        played = self._played
        return Reply(self.start, sent, played.tone_hz, played.vibrate_left, played.vibrate_right)

    def stack(self) -> int | None:
        """Unknown."""
        return None

    def close(self) -> None:
        """End it."""
        self._owned.close()


def open_stm32f405(target: str, values: Values, navigation: Navigation, key: Key | None) -> BoardOnLines:
    """An STM32F405 with a program of these parameters and this key.

    Raises:
        CompileError: the compiler refuses the program.
        ProcessorError: QEMU is missing, or cannot be started.
    """
    with ExitStack() as stack:
        board = stack.enter_context(open_board(values, navigation, key=key))
        return BoardOnLines(board, navigation, stack.pop_all())
