"""Ticks one after the other: the calls of each, and its row.

`Walk` makes the calls from Python and is the reference. `NativeWalk` has a small C loop (`walk.c`) make them,
with the same bits. It needs all of them to be functions of C or what `layout` makes; a stand-in for an FMU
is Python.
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
import numpy.typing as npt

from codegen.cache import stored
from codegen.toolchains.compiler import FLAGS, CompileError, build_library, compiler_version, this_platform
from harness.cosim.calls import Calls, Numbered, OwnTime, Turn
from harness.cosim.fmu import Call, Function, Steps
from harness.cosim.layout import Cast, Conversion, Layout, Replacement, copy
from harness.cosim.recorder import Recorder

MANY = 100  # ticks at once, at most
PATIENCE = 0.02  # s of C calls after which Ctrl-C should have its turn
Watched = tuple[npt.NDArray[Any], frozenset[int]]


class Pause(IntEnum):
    """Why a walk comes back: all its ticks are done, or the last row's tick is the last of the run."""

    NONE = 0
    FAILED = 1
    NOT_FINITE = 2
    STOPPED = 3  # the stop condition holds


class NotNativeError(Exception):
    """The loop in C cannot make these calls; the text says why."""


class Walk:
    """Ticks in Python.

    Args:
        recorder: gets the rows, and where the walk is.
        guard: restores how sums are rounded behind each call.
        watched: an output, (1,), where it lies, and the values with which it ends the run.

    Attributes:
        hold: within it Ctrl-C waits; FMUs call Python back when they log.
    """

    def __init__(
        self,
        calls: Calls,
        layout: Layout,
        step: float,
        recorder: Recorder,
        watched: Watched,
        *,
        guard: Guard | None = None,
    ) -> None:
        self.calls, self.step, self.recorder, self.guard = calls, step, recorder, guard
        self.hold: AbstractContextManager[object] = nullcontext()
        self.reals = layout.reals()
        self.watched, self.stops = watched
        block, size = ctypes.c_void_p(layout.block.ctypes.data), ctypes.c_size_t(len(layout.block))
        self._saves = [(ctypes.c_void_p(row.ctypes.data), block, size) for row in recorder.rows]
        calls.clock.position = recorder.position

    @np.errstate(invalid="ignore", over="ignore")  # values that are not finite are reported, not warned of
    def run(self, tick: int, end: int, last: int) -> Pause:
        """Ticks from `tick` up to `end`, each with a row.

        Args:
            last: the last tick of the run, after which nothing advances.

        Raises:
            FmuError: a call failed.
        """
        calls, position, saves = self.calls, self.recorder.position, self._saves
        answer, advance = calls.numbered()
        watched, stops, clock = self.watched.item, self.stops, calls.clock
        tests: list[tuple[Any, Any]] = [(reals.dot, np.zeros_like(reals)) for reals in self.reals]
        for moment in range(tick, end):
            position.tick = moment
            clock.set(moment * self.step)
            with self.hold:
                self._carry_out(answer)
            copy(*saves[moment % len(saves)])
            position.rows = moment + 1
            for dot, zeros in tests:
                if dot(zeros) != 0.0:  # 0 for all finite numbers, NaN otherwise
                    return Pause.NOT_FINITE
            if stops and watched() in stops:
                return Pause.STOPPED
            if moment < last:
                with self.hold:
                    self._carry_out(advance)
        return Pause.NONE

    def _carry_out(self, numbered: Sequence[Numbered]) -> None:
        calls, position, guard = self.calls, self.recorder.position, self.guard
        due = calls.due(numbered, position.tick)
        for position.call, (function, arguments) in due:
            status = function(*arguments)
            if guard is not None and guard():
                position.restored, position.restorer = position.restored + 1, position.call
            if status:
                calls.fail(status, calls.tick[position.call])
        position.call = -1


class _Conversion(ctypes.Structure):
    _fields_ = [
        ("from_type", ctypes.c_int),
        ("to_type", ctypes.c_int),
        ("from_", ctypes.c_void_p),
        ("to", ctypes.c_void_p),
        ("factor", ctypes.c_double),
        ("offset", ctypes.c_double),
        ("low", ctypes.c_double),
        ("high", ctypes.c_double),
        ("is_boolean", ctypes.c_int),
        ("table", ctypes.c_void_p),
        ("entries", ctypes.c_size_t),
    ]


class _Call(ctypes.Structure):
    _fields_ = [
        ("kind", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("to", ctypes.c_void_p),
        ("from_", ctypes.c_void_p),
        ("count", ctypes.c_size_t),
        ("values", ctypes.c_void_p),
        ("step", ctypes.c_double),
        ("event", ctypes.c_void_p),
        ("ended", ctypes.c_void_p),
        ("early", ctypes.c_void_p),
        ("reached", ctypes.c_void_p),
    ]


class _Turn(ctypes.Structure):
    _fields_ = [
        ("every", ctypes.c_int64),
        ("phase", ctypes.c_int64),
        ("stalls", ctypes.c_void_p),
        ("count", ctypes.c_size_t),
        ("call", _Call),
    ]


class _List(ctypes.Structure):
    _fields_ = [("calls", ctypes.POINTER(_Call)), ("count", ctypes.c_size_t)]


class _Walk(ctypes.Structure):
    _fields_ = [
        ("answer", _List),
        ("advance", _List),
        ("start", ctypes.c_double),
        ("step", ctypes.c_double),
        ("block", ctypes.c_void_p),
        ("size", ctypes.c_size_t),
        ("position", ctypes.c_void_p),
        ("rows", ctypes.c_void_p),
        ("room", ctypes.c_int64),
        ("doubles", ctypes.c_void_p),
        ("singles", ctypes.c_void_p),
        ("double_count", ctypes.c_size_t),
        ("single_count", ctypes.c_size_t),
        ("watched", ctypes.c_void_p),
        ("watched_type", ctypes.c_int),
        ("stops", ctypes.c_void_p),
        ("stop_count", ctypes.c_size_t),
        ("is_guarded", ctypes.c_int),
        ("mode", ctypes.c_uint32),
        ("status", ctypes.c_int),
    ]


_COPY, _CAST, _CONVERT, _REPLACE, _ACCESS2, _ACCESS3, _STEP2, _STEP3, _STEPS, _TURN = range(10)  # `enum kind`
_KINDS = {
    (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p): _ACCESS2,
    (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_size_t): _ACCESS3,
    (ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int): _STEP2,
    (ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_bool, *[ctypes.c_void_p] * 4): _STEP3,
}
_TYPES = ("float64", "float32", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")


class Native:
    """The loop in C, and a tick's calls prepared for it.

    Raises:
        NotNativeError: it cannot make these calls, or cannot be compiled here.
    """

    def __init__(self, calls: Calls) -> None:
        self._keep: list[Any] = []  # what C holds addresses of
        self.answer = self._list(calls, calls.answer, 0)
        self.advance = self._list(calls, calls.advance, len(calls.answer))
        library = _library()
        if isinstance(library, str):
            raise NotNativeError(library)
        self.run = library.run
        self.run.argtypes = [ctypes.c_void_p, *[ctypes.c_int64] * 3]

    def _list(self, calls: Calls, part: Sequence[Call], before: int) -> _List:
        prepared = [self._prepared(call) for call in part]
        python = [calls.whose(call)[0] for call, c in zip(part, prepared, strict=True) if c is None]
        if python:
            raise NotNativeError(f"Python answers for {', '.join(dict.fromkeys(python))}")
        array = (_Call * len(part))(*filter(None, prepared))
        for place, turn in calls.turns.items():
            if before <= place < before + len(part):
                array[place - before] = self._in_turn(array[place - before], turn)
        self._keep.append(array)
        return _List(array, len(part))

    def _in_turn(self, call: _Call, turn: Turn) -> _Call:
        """The call, made only when it is due."""
        stalls = np.array(turn.stalls, dtype=np.int64)
        prepared = _Turn(turn.every, turn.phase, stalls.ctypes.data, len(stalls), call)
        self._keep += [stalls, prepared]
        return _Call(_TURN, from_=ctypes.addressof(prepared))

    def _prepared(self, call: Call) -> _Call | None:
        """The call for C; None if the loop there does not know it."""
        function, arguments = call
        if isinstance(function, OwnTime):
            return self._prepared(function.step)  # its turn knows its time
        if isinstance(function, Steps):
            one = self._prepared(function.step)
            if one is not None and function.count > 1:
                one.kind, one.count = _STEPS, function.count
            return one
        if isinstance(function, Cast):
            conversions = _conversions(function)
            self._keep.append(conversions)
            kind = _CAST
            if isinstance(function, Conversion):
                kind = _CONVERT
            elif isinstance(function, Replacement):
                kind = _REPLACE
                for conversion, table in zip(conversions, function.tables, strict=True):
                    pairs = np.array([*table.items()], dtype=np.int64)
                    self._keep.append(pairs)
                    conversion.table, conversion.entries = pairs.ctypes.data, len(pairs)
            return _Call(kind, from_=ctypes.addressof(conversions), count=len(conversions))
        values = [argument.value or 0 for argument in arguments if hasattr(argument, "value")]
        if function is copy:
            to, source, count = values
            return _Call(_COPY, to=to, from_=source, count=count)
        kind = _KINDS.get(tuple(type(argument) for argument in arguments), -1)
        if kind == -1 or not isinstance(function, Function):
            return None
        address = ctypes.cast(function, ctypes.c_void_p)
        if kind in (_ACCESS2, _ACCESS3):
            return _Call(kind, address, *values[:4])
        instance, _, step, _, *answers = values
        return _Call(kind, address, instance, None, 0, None, step, *answers)


def _conversions(cast: Cast) -> ctypes.Array[_Conversion]:
    """A conversion for each value."""
    count, source, target = len(cast.picked), cast.source, cast.target
    types = (_TYPES.index(source.dtype.name), _TYPES.index(target.dtype.name))
    places = (
        (source.ctypes.data + cast.picked * source.itemsize).tolist(),
        (target.ctypes.data + np.arange(count) * target.itemsize).tolist(),
    )
    scales, bounds = ([1.0] * count, [0.0] * count), (0.0, 0.0)
    if isinstance(cast, Conversion):
        scales, bounds = (cast.factor.tolist(), cast.offset.tolist()), cast.bounds
    rows = zip(*places, *scales, strict=True)
    return (_Conversion * count)(*(_Conversion(*types, *row, *bounds, cast.is_boolean) for row in rows))


class NativeWalk(Walk):
    """Ticks in C."""

    def __init__(
        self,
        calls: Calls,
        layout: Layout,
        step: float,
        recorder: Recorder,
        watched: Watched,
        *,
        native: Native,
        guard: Guard | None = None,
    ) -> None:
        super().__init__(calls, layout, step, recorder, watched, guard=guard)
        self._native = native
        of_type = {reals.dtype.name: reals for reals in self.reals}
        doubles, singles = of_type.get("float64", np.zeros(0)), of_type.get("float32", np.zeros(0))
        self._stops = np.array(sorted(self.stops), dtype=np.float64)
        self._walk = _Walk(
            answer=native.answer,
            advance=native.advance,
            start=calls.clock.start,
            step=step,
            block=layout.block.ctypes.data,
            size=len(layout.block),
            position=ctypes.addressof(recorder.position),
            rows=recorder.rows.ctypes.data,
            room=recorder.room,
            doubles=doubles.ctypes.data,
            singles=singles.ctypes.data,
            double_count=len(doubles),
            single_count=len(singles),
            watched=self.watched.ctypes.data,
            watched_type=_TYPES.index(self.watched.dtype.name),
            stops=self._stops.ctypes.data,
            stop_count=len(self._stops),
            is_guarded=guard is not None,
            mode=0 if guard is None else guard.mode,
        )
        self._few = 1  # ticks at a time, so that Ctrl-C is heard between slow steps

    def run(self, tick: int, end: int, last: int) -> Pause:
        """As `Walk.run`."""
        while tick < end:
            some = min(end, tick + self._few)
            started = time.perf_counter()
            with self.hold:
                pause = Pause(self._native.run(ctypes.byref(self._walk), tick, some, last))
            self.calls.clock.set(self.recorder.position.time)
            if pause is Pause.FAILED:
                self.calls.fail(self._walk.status, self.calls.tick[self.recorder.position.call])
            if pause is not Pause.NONE:
                return pause
            tick = some
            elapsed = time.perf_counter() - started
            self._few = max(1, self._few // 2) if elapsed > PATIENCE else min(MANY, 2 * self._few)
        return Pause.NONE


class Guard:
    """How sums are rounded, and whether the smallest become 0, as it is now; a call of it restores that.

    A copy of this process that an FMU has made by fork ends when it calls it.

    Raises:
        NotNativeError: the functions that do it cannot be compiled here.
    """

    def __init__(self) -> None:
        library = _library()
        if isinstance(library, str):
            raise NotNativeError(library)
        library.floating_mode.restype = ctypes.c_uint32
        library.restore_mode.argtypes = [ctypes.c_uint32]
        self._restore = library.restore_mode
        self.mode: int = library.floating_mode()
        library.end_copies()

    def __call__(self) -> bool:
        """Restore it; had it been changed?"""
        return bool(self._restore(self.mode))


@cache
def _library() -> ctypes.CDLL | str:
    """The C loop, compiled once for each user; why not, if this machine cannot compile it."""
    source = Path(__file__).with_name("walk.c")
    try:
        asked = (source.read_bytes(), compiler_version(), this_platform(), FLAGS)
        path = stored(
            "cosim/walk.so",
            asked,
            lambda path: build_library(source.parent, [source.name], path, what=source.stem, flags=FLAGS),
        )
        return ctypes.CDLL(str(path))
    except (CompileError, OSError) as reason:
        return " ".join(str(reason).split())
