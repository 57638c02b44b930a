"""Work that Ctrl-C does not cut in two, and calls of C that call Python back.

The handler of a signal runs at once, so that a second Ctrl-C can still end the process; its KeyboardInterrupt
waits. A mask of signals would not do: any other thread of the process takes the signal, and Python interrupts
the main thread.

C that calls Python back is called with interrupts held: a signal that arrives in C is handled where the next
callback begins, and what is raised there is dropped.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType

Handler = Callable[[int, FrameType | None], object]
# those that end a command, and SIGALRM, with which main.CtrlC tries again
SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGALRM") if hasattr(signal, name)
]


class Hold:
    """As a context manager: a KeyboardInterrupt is raised at the end of the block, not within."""

    def __init__(self, handlers: dict[int, Handler]) -> None:
        self._handlers = handlers
        self._is_held = False
        self._interrupts: list[KeyboardInterrupt] = []

    def handle(self, number: int, frame: FrameType | None) -> None:
        """In the place of the signal's own handler."""
        try:
            self._handlers[number](number, frame)
        except KeyboardInterrupt as interrupt:
            if not self._is_held:
                raise
            self._interrupts.append(interrupt)

    def __enter__(self) -> None:
        self._is_held = True

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._is_held = False
        if self._interrupts:
            raise self._interrupts.pop()


@contextmanager
def holdable_interrupts() -> Iterator[Hold]:
    """What holds Ctrl-C back, as often as it is entered within this block.

    Only the main thread is ever interrupted, so in other threads it does nothing.
    """
    is_main = threading.current_thread() is threading.main_thread()
    handlers: dict[int, Handler] = {
        number: handler for number in SIGNALS if is_main and callable(handler := signal.getsignal(number))
    }
    hold = Hold(handlers)
    try:
        for number in handlers:
            signal.signal(number, hold.handle)
        yield hold
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


@contextmanager
def held_interrupts() -> Iterator[None]:
    """Hold Ctrl-C back until the end of the block."""
    with holdable_interrupts() as hold, hold:
        yield


def name_of(number: int) -> str:
    """What a user calls a signal."""
    return "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
