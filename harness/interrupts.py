"""Work that Ctrl-C does not cut in two."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = [s for s in (signal.SIGINT, getattr(signal, "SIGALRM", None)) if s]  # SIGALRM: see main.CtrlC


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back: its KeyboardInterrupt is raised at the end of the block, not within.

    The handler itself runs at once, so that a second Ctrl-C can still end the process. A mask of signals
    would not do: any other thread of the process takes the signal, and Python interrupts the main thread.
    Only the main thread is ever interrupted, so other threads hold nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = {number: h for number in SIGNALS if callable(h := signal.getsignal(number))}
    is_held = True
    interrupts: list[KeyboardInterrupt] = []

    def hold(number: int, frame: FrameType | None) -> None:
        try:
            handlers[signal.Signals(number)](number, frame)
        except KeyboardInterrupt as interrupt:
            if not is_held:
                raise
            interrupts.append(interrupt)

    try:
        for number in handlers:
            signal.signal(number, hold)
        yield
    finally:
        is_held = False  # from here on `hold` is as good as the handler
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if interrupts:
            raise interrupts[0]
