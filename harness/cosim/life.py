"""What an FMU promises beyond a trial: it repeats itself after a reset, and from a state that was saved."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np

from harness.cosim.alone import Alone, Rows, outputs_of
from harness.cosim.fmu import Fault, FmuError, FmuInstance
from harness.cosim.layout import Array

MOST_STATE = 2**28  # bytes


class States:
    """Saves and restores the state of an instance."""

    def __init__(self, instance: FmuInstance) -> None:
        self._instance = instance
        second = instance.description.version == 2
        self._state, self._deserialize = (
            ("FMUstate", "DeSerializeFMUstate") if second else ("FMUState", "DeserializeFMUState")
        )
        offers = instance.description.fmpy.coSimulation
        self.are_offered: bool = offers.canGetAndSetFMUstate
        self.are_serialized: bool = self.are_offered and offers.canSerializeFMUstate

    def save(self) -> ctypes.c_void_p:
        """The present one."""
        state = ctypes.c_void_p()
        self._instance.request(f"Get{self._state}", ctypes.byref(state))
        return state

    def restore(self, state: ctypes.c_void_p) -> str:
        """Go back to it; the function that did it."""
        return self._instance.request(f"Set{self._state}", state)

    def copy(self, state: ctypes.c_void_p) -> ctypes.c_void_p:
        """A state from the bytes of another one.

        Raises:
            FmuError: it says that it has more bytes than any state of use.
        """
        size = ctypes.c_size_t()
        function = self._instance.request(f"Serialized{self._state}Size", state, ctypes.byref(size))
        if size.value > MOST_STATE:
            raise FmuError(
                f"{self._instance.label}: {function} says {size.value} bytes; expected at most {MOST_STATE}"
            )
        data, copied = (ctypes.c_char * max(1, size.value))(), ctypes.c_void_p()
        self._instance.request(f"Serialize{self._state}", state, data, size)
        self._instance.request(self._deserialize, data, size, ctypes.byref(copied))
        return copied

    def free(self, state: ctypes.c_void_p) -> None:
        """It is not used any more."""
        self._instance.request(f"Free{self._state}", ctypes.byref(state))


def live(alone: Alone, inputs: Mapping[str, Array], ticks: int) -> list[str]:
    """Initialize and step it; from a state that was saved, and after a reset, once more: the same bits.

    Returns:
        what it was seen to do, in words.

    Raises:
        FmuError: a call failed, an output is not finite, or it does not repeat itself.
    """
    instance, half = alone.instance, ticks // 2 // alone.every * alone.every
    states, done = States(instance), ["runs"]
    rows: Rows = np.zeros((ticks, len(alone.layout.block)), np.uint8)
    again = np.zeros_like(rows)
    instance.initialize({})
    alone.run(inputs, rows[:half])
    state = states.save() if states.are_offered else None
    alone.run(inputs, rows[half:], half)
    _check_finite(alone, rows)
    if state is not None:
        function = states.restore(state)
        alone.run(inputs, again[half:], half)
        _check_same(alone, rows, again, half, function)
        done.append("saves its state")
        if states.are_serialized:
            copied = states.copy(state)
            function = states.restore(copied)
            alone.run(inputs, again[half:], half)
            _check_same(alone, rows, again, half, f"{function} of a state that was serialized")
            states.free(copied)
            done.append("serializes it")
        states.free(state)
    function = instance.request("Reset")
    instance.initialize({})
    alone.run(inputs, again)
    _check_same(alone, rows, again, 0, function)
    return [*done, "resets"]


def _check_finite(alone: Alone, rows: Rows) -> None:
    instance = alone.instance
    for output, values in outputs_of(alone.layout, alone.name, rows).items():
        for tick in np.flatnonzero(~np.isfinite(values))[:1]:
            time, call = tick * alone.step, f'output "{output}"'
            raise FmuError(
                f"{instance.label}: {call} is {values[tick]} at t = {time:.10g} s; expected a finite number",
                Fault("not finite", alone.name, instance.description.path.name, call, time),
            )


def _check_same(alone: Alone, rows: Rows, again: Rows, first: int, after: str) -> None:
    """Are the rows from `first` on the same bits as before?"""
    for tick in first + np.flatnonzero((rows[first:] != again[first:]).any(axis=1))[:1]:
        old, new = (outputs_of(alone.layout, alone.name, table[tick : tick + 1]) for table in (rows, again))
        name = next((n for n in old if old[n].tobytes() != new[n].tobytes()), next(iter(old)))
        raise FmuError(
            f'{alone.instance.label}: does not repeat itself after {after}: output "{name}" is '
            f"{new[name].item()!r} at t = {tick * alone.step:.10g} s, and was {old[name].item()!r}; "
            "all that it keeps must be part of its state"
        )
