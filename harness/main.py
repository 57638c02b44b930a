"""The entry of the `canine` command: takes charge of signals, then imports and runs the command.

Only modules of the standard library are imported before Ctrl-C is in hand.
"""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
import time
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

FAULT, USAGE = 1, 2
INTERRUPTED = 128 + signal.SIGINT
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # end a command with status 128 + their number
SAME_PRESS_S = 1.0  # s within which a second SIGINT is the first one again, passed on by a parent process
RETRY_S = 0.005  # s after which an interrupt that had to wait is tried again


class CtrlC:
    """Raises KeyboardInterrupt once, where it can be caught; a second Ctrl-C ends the process at once.

    One within SAME_PRESS_S of the first is taken for the first and ignored. SIGTERM and SIGHUP do the same;
    the exception's argument is the signal's number. A SIGHUP that is ignored already (nohup) stays so.

    An interrupt waits for the end of an import under way: libraries catch every exception there, or print it.
    One that is raised where Python drops exceptions (in a destructor or a callback from C) is raised again.
    """

    def __init__(self) -> None:
        self.pressed_at: float | None = None
        self.number: int = signal.SIGINT
        self.hook = sys.unraisablehook
        for number in ENDING:
            if number == signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._press)
        signal.signal(signal.SIGALRM, self._raise)
        sys.unraisablehook = self._dropped

    def ignore(self) -> None:
        """The command is done: it ends with its own status."""
        for number in (*ENDING, signal.SIGALRM):
            signal.signal(number, signal.SIG_IGN)

    @property
    def status(self) -> int:
        """The exit status of a command that a signal ended."""
        return 128 + self.number

    def _press(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if self.pressed_at is None:
            self.pressed_at, self.number = now, number
            self._raise(number, frame)
        elif now - self.pressed_at > SAME_PRESS_S:
            os._exit(self.status)

    def _raise(self, number: int, frame: FrameType | None) -> None:
        while frame is not None:
            if frame.f_code.co_filename.startswith("<frozen importlib"):
                signal.setitimer(signal.ITIMER_REAL, RETRY_S)
                return
            frame = frame.f_back
        raise KeyboardInterrupt(self.number)

    def _dropped(self, unraisable: sys.UnraisableHookArgs) -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, RETRY_S)
        else:
            self.hook(unraisable)


def run(arguments: Sequence[str]) -> int:
    """Run the command; its exit status. Errors that a user can cause are one line each.

    Raises:
        KeyboardInterrupt: the user ended it, and nothing was printed about that yet.
    """
    debug = "--debug" in arguments
    for before, argument in zip(("canine", *arguments), arguments, strict=False):
        if argument == "" or (argument.startswith("--") and argument.endswith("=")):
            option = argument[:-1] or (before if before.startswith("--") else "an argument")
            print(
                f"canine: {option} is empty; expected a value: is a variable of the shell unset?",
                file=sys.stderr,
            )
            return USAGE
    try:
        from harness.command_line import program_of

        program = program_of(arguments)
        status = program([a for a in arguments if a != "--debug"], prog_name="canine", standalone_mode=False)
        if status == INTERRUPTED:  # by typer, which drops the exception
            raise KeyboardInterrupt
        return status or 0
    except Exception as error:
        if hasattr(error, "show"):  # typer's own, of usage
            if [a for a in arguments if a != "--debug"]:
                from harness.usage import line_of

                print(f"canine: {line_of(error, program, arguments)}", file=sys.stderr)
            else:
                error.show()  # the help
            return USAGE
        from models.errors import CanineError, UsageError

        if debug or not isinstance(error, CanineError | OSError):
            raise
        text = str(error)
        if isinstance(error, OSError) and error.filename is not None:
            text = f"{error.filename}: {error.strerror}"
        for line in text.splitlines():
            print(f"canine: {line}", file=sys.stderr)
        return USAGE if isinstance(error, UsageError) else FAULT
    except SystemExit as end:
        return int(end.code or 0)


def main() -> None:
    """The console script: exits with the command's status."""
    ctrl_c = CtrlC()
    os.environ["MPLBACKEND"] = "agg"  # a notebook names one that may not be here: no import of matplotlib
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a name in letters that the terminal lacks
    gc.set_threshold(100_000, 20, 100)  # looking for garbage costs a tenth of the imports
    try:
        status = run(sys.argv[1:])
        ctrl_c.ignore()
        if ctrl_c.pressed_at is not None and status != ctrl_c.status:
            raise KeyboardInterrupt  # whoever caught it went on
    except KeyboardInterrupt:
        ctrl_c.ignore()
        from harness.interrupts import name_of

        print(f"canine: ended by {name_of(ctrl_c.number)}", file=sys.stderr)
        status = ctrl_c.status
    gc.freeze()  # all that is left ends with the process: Python need not search it for garbage again
    sys.exit(status)


if __name__ == "__main__":
    main()
