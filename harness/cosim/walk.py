"""Ticks one after the other: the calls of each, and its row.

`Walk` makes the calls from Python and is the reference. `NativeWalk` has a small C loop (`walk.c`) make them,
with the same rows. It needs all of them to be functions of C; a link that converts and a stand-in for an FMU
are Python.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from codegen.cache import stored
from codegen.toolchains.compiler import FLAGS, CompileError, build_library, compiler_version, this_platform
from harness.cosim.calls import Calls
from harness.cosim.fmu import Call, Function
from harness.cosim.layout import Layout, Slot, copy

ROWS = 100  # there is room for
PATIENCE = 0.02  # s of C calls after which Ctrl-C should have its turn


class Pause(IntEnum):
    """Why a walk comes back: all its ticks are done, or the last row's tick needs attention."""

    NONE = 0
    FAILED = 1
    NOT_FINITE = 2
    CHANGED = 3  # the output that is watched, also on the first tick; the plants have not advanced
    ENDED = 4


class Walk:
    """Ticks in Python.

    Args:
        watched: the place of an output, a change of which is reported.

    Attributes:
        rows: (ROWS, bytes) copies of the block.
        hold: within it Ctrl-C waits; FMUs call Python back when they log.
    """

    def __init__(self, calls: Calls, layout: Layout, step: float, watched: tuple[Slot, int] | None) -> None:
        self.calls, self.step = calls, step
        self.rows = np.zeros((ROWS, len(layout.block)), dtype=np.uint8)
        self._done = ctypes.c_long(0)
        self.hold: AbstractContextManager[object] = nullcontext()
        self.reals = layout.reals()
        slot, index = watched or (None, 0)
        start = slot.offset + index * slot.size if slot else 0
        self.watched = layout.block[start : start + (slot.size if slot else 0)]
        self._before: bytes | None = None if watched else b""
        block, size = ctypes.c_void_p(layout.block.ctypes.data), ctypes.c_size_t(len(layout.block))
        self._saves = [(ctypes.c_void_p(row.ctypes.data), block, size) for row in self.rows]

    @property
    def done(self) -> int:
        """How many rows are finished."""
        return self._done.value

    def clear(self) -> None:
        """Make room for rows."""
        self._done.value = 0

    @np.errstate(invalid="ignore")  # the test for finite values multiplies those that are not
    def run(self, tick: int, end: int, last: int) -> Pause:
        """Ticks from `tick` up to `end`, at most as many as there is room for rows.

        Args:
            last: the last tick of the run, after which nothing advances.

        Raises:
            FmuError: a call failed.
        """
        calls = self.calls
        answer, advance, fail = calls.answer, calls.advance, calls.fail
        now, ended, none_ended = calls.time, calls.ended, bytes(len(calls.ended))
        tests: list[tuple[Any, Any]] = [(reals.dot, np.zeros_like(reals)) for reals in self.reals]
        for moment in range(tick, end):
            now.value = moment * self.step
            with self.hold:
                for function, arguments in answer:
                    if status := function(*arguments):
                        fail(status, arguments)
            copy(*self._saves[self.done])
            self._done.value += 1
            for dot, zeros in tests:
                if dot(zeros) != 0.0:  # 0 for all finite numbers, NaN otherwise
                    return Pause.NOT_FINITE
            if self._before != b"" and self._before != (value := self.watched.tobytes()):
                self._before = value
                return Pause.CHANGED
            if ended.raw != none_ended:
                return Pause.ENDED
            if moment < last:
                with self.hold:
                    for function, arguments in advance:
                        if status := function(*arguments):
                            fail(status, arguments)
        return Pause.NONE


class _Call(ctypes.Structure):
    _fields_ = [
        ("kind", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("to", ctypes.c_void_p),
        ("from_", ctypes.c_void_p),
        ("count", ctypes.c_size_t),
        ("values", ctypes.c_void_p),
        ("event", ctypes.c_void_p),
        ("ended", ctypes.c_void_p),
        ("early", ctypes.c_void_p),
        ("reached", ctypes.c_void_p),
    ]


class _Walk(ctypes.Structure):
    _fields_ = [
        ("answer", ctypes.POINTER(_Call)),
        ("advance", ctypes.POINTER(_Call)),
        ("answers", ctypes.c_size_t),
        ("advances", ctypes.c_size_t),
        ("time", ctypes.c_void_p),
        ("step", ctypes.c_double),
        ("block", ctypes.c_void_p),
        ("size", ctypes.c_size_t),
        ("rows", ctypes.c_void_p),
        ("done", ctypes.c_void_p),
        ("doubles", ctypes.c_void_p),
        ("singles", ctypes.c_void_p),
        ("double_count", ctypes.c_size_t),
        ("single_count", ctypes.c_size_t),
        ("watched", ctypes.c_void_p),
        ("before", ctypes.c_void_p),
        ("watched_size", ctypes.c_size_t),
        ("is_known", ctypes.c_int),
        ("ended", ctypes.c_void_p),
        ("ended_count", ctypes.c_size_t),
        ("is_answer", ctypes.c_int),
        ("failed", ctypes.c_size_t),
        ("status", ctypes.c_int),
    ]


_KINDS = {
    (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p): 1,
    (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_size_t): 2,
    (ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int): 3,
    (ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_bool, *[ctypes.c_void_p] * 4): 4,
}


def _prepared(call: Call) -> _Call | None:
    """The call for C; None if it is not a C function that the loop knows."""
    function, arguments = call
    values = [argument.value or 0 for argument in arguments if hasattr(argument, "value")]
    if function is copy:
        to, source, count = values
        return _Call(0, None, to, source, count)
    kind = _KINDS.get(tuple(type(argument) for argument in arguments))
    if kind is None or not isinstance(function, Function):
        return None
    address = ctypes.cast(function, ctypes.c_void_p)
    if kind in (1, 2):
        return _Call(kind, address, *values[:4])
    return _Call(kind, address, values[0], None, 0, None, *values[4:])


class NativeWalk(Walk):
    """Ticks in C. Made by `walk_of`."""

    def __init__(
        self,
        calls: Calls,
        layout: Layout,
        step: float,
        watched: tuple[Slot, int] | None,
        *,
        library: ctypes.CDLL,
        prepared: tuple[Sequence[_Call], Sequence[_Call]],
    ) -> None:
        super().__init__(calls, layout, step, watched)
        self._run = library.run
        self._run.argtypes = [ctypes.c_void_p, *[ctypes.c_long] * 3]
        answer, advance = ((_Call * len(part))(*part) for part in prepared)
        of_type = {reals.dtype.name: reals for reals in self.reals}
        doubles, singles = of_type.get("float64", np.zeros(0)), of_type.get("float32", np.zeros(0))
        self._last = np.zeros_like(self.watched)
        self._walk = _Walk(
            answer=answer,
            advance=advance,
            answers=len(answer),
            advances=len(advance),
            time=ctypes.addressof(calls.time),
            step=step,
            block=layout.block.ctypes.data,
            size=len(layout.block),
            rows=self.rows.ctypes.data,
            done=ctypes.addressof(self._done),
            doubles=doubles.ctypes.data,
            singles=singles.ctypes.data,
            double_count=len(doubles),
            single_count=len(singles),
            watched=self.watched.ctypes.data,
            before=self._last.ctypes.data,
            watched_size=len(self.watched),
            ended=ctypes.addressof(calls.ended),
            ended_count=len(calls.ended),
        )
        self._few = 1  # ticks at a time, so that Ctrl-C is heard between slow steps

    def run(self, tick: int, end: int, last: int) -> Pause:
        """As `Walk.run`."""
        walk = self._walk
        while tick < end:
            some = min(end, tick + self._few)
            started = time.perf_counter()
            with self.hold:
                pause = Pause(self._run(ctypes.byref(walk), tick, some, last))
            if pause is Pause.FAILED:
                calls = self.calls.answer if walk.is_answer else self.calls.advance
                self.calls.fail(walk.status, calls[walk.failed][1])
            if pause is not Pause.NONE:
                return pause
            tick = some
            elapsed = time.perf_counter() - started
            self._few = max(1, self._few // 2) if elapsed > PATIENCE else min(ROWS, 2 * self._few)
        return Pause.NONE


def walk_of(calls: Calls, layout: Layout, step: float, watched: tuple[Slot, int] | None) -> Walk:
    """The fastest walk that these calls allow."""
    answer, advance = map(_prepared, calls.answer), map(_prepared, calls.advance)
    prepared = ([c for c in answer if c], [c for c in advance if c])
    whole = len(prepared[0]) == len(calls.answer) and len(prepared[1]) == len(calls.advance)
    library = _library() if whole else None
    if library is None:
        return Walk(calls, layout, step, watched)
    return NativeWalk(calls, layout, step, watched, library=library, prepared=prepared)


@cache
def _library() -> ctypes.CDLL | None:
    """The C loop, compiled once for each user; None if this machine cannot compile it."""
    source = Path(__file__).with_name("walk.c")
    asked = (source.read_bytes(), compiler_version(), this_platform(), FLAGS)
    try:
        path = stored(
            "cosim/walk.so",
            asked,
            lambda path: build_library(source.parent, [source.name], path, what=source.stem, flags=FLAGS),
        )
        return ctypes.CDLL(str(path))
    except (CompileError, OSError):
        return None
