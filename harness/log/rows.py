"""Rows as JSON: the signals of all components, spelled column by column for a whole batch of ticks.

Reals have the fewest digits that read back to the same bits. JSON has neither NaN nor infinities: they are
the strings "NaN", "Infinity" and "-Infinity", as in protobuf's JSON.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt
import orjson

from harness.log.channel import Array, Channel

INTEGER_LIMIT = 2.0**63  # what fits into 64 bits is smaller in magnitude


class Rows:
    """Spells the rows of some components."""

    def __init__(self, channels: Sequence[Channel]) -> None:
        self._channels = channels
        kinds = np.array([kind for channel in channels for kind in channel.types], dtype=object)
        self._columns = [_Columns(np.flatnonzero(kinds == kind), spell) for kind, spell in _SPELL.items()]
        self._frame = _frame([channel.names for channel in channels])
        self._pieces: list[bytes] = []

    def encode(self, values: Mapping[str, Array]) -> list[bytes]:
        """The messages of the first tick, one for each component, then those of the second, and so on.

        `values`: by component (ticks, signals).
        """
        table = np.concatenate([values[channel.component].T for channel in self._channels])
        ticks, width = table.shape[1], len(self._frame)
        if len(self._pieces) != ticks * width:
            self._pieces = self._frame * ticks
        for columns in self._columns:
            for place, texts in columns.encode(table):
                self._pieces[2 * place + 1 :: width] = texts
        return b"".join(self._pieces).split(_END)[:-1]


_END = b"\n"  # of a message: JSON escapes it in names


def _frame(names: Sequence[Sequence[str]]) -> list[bytes]:
    """The messages of a tick in pieces; every second one is a gap for a value."""
    pieces = [b""]
    for signals in names:
        pieces[-1] += b"{"
        for i, name in enumerate(signals):
            pieces[-1] += b"," * bool(i) + json.dumps(name).encode() + b":"
            pieces += [b"", b""]
        pieces[-1] += b"}" + _END
    return pieces


class _Columns:
    """Spells the columns of one type.

    Most inputs repeat an output, and many signals hold their value. A column that came before, in this batch
    or in the last one, is not spelled again.
    """

    def __init__(self, places: npt.NDArray[np.intp], spell: Callable[[Array], list[bytes]]) -> None:
        self._places, self._spell = places, spell
        self._texts: dict[bytes, list[bytes]] = {}

    def encode(self, table: Array) -> Iterable[tuple[int, list[bytes]]]:
        """Places in the table (columns, ticks), and the texts for each."""
        if not len(self._places):
            return ()
        columns = table[self._places]
        ticks = columns.shape[1]
        keys = columns.view(f"V{columns.itemsize * ticks}").ravel().tolist()
        last, self._texts = self._texts, {}
        new: dict[bytes, int] = {}
        for i, key in enumerate(keys):
            if key in last:
                self._texts[key] = last[key]
            elif key not in new:
                new[key] = i
        if new:
            texts = self._spell(columns[list(new.values())].ravel())
            for i, key in enumerate(new):
                self._texts[key] = texts[i * ticks : (i + 1) * ticks]
        return zip(self._places.tolist(), map(self._texts.__getitem__, keys), strict=True)


def _texts(values: npt.NDArray[np.generic]) -> list[bytes]:
    """The values of an array (n,) as JSON."""
    return orjson.dumps(values, option=orjson.OPT_SERIALIZE_NUMPY)[1:-1].split(b",")


def _reals(values: Array) -> list[bytes]:
    texts = _texts(values)
    for i in np.flatnonzero(~np.isfinite(values)).tolist():
        texts[i] = _not_finite(values[i])
    return texts


def _integers(values: Array) -> list[bytes]:
    fit = np.abs(values) < INTEGER_LIMIT
    texts = _texts(np.where(fit, values, 0.0).astype(np.int64))
    for i in np.flatnonzero(~fit).tolist():
        value = float(values[i])
        texts[i] = b"%d" % int(value) if math.isfinite(value) else _not_finite(value)
    return texts


def _booleans(values: Array) -> list[bytes]:
    return _texts(values != 0)


def _not_finite(value: float) -> bytes:
    return b'"NaN"' if math.isnan(value) else b'"Infinity"' if value > 0 else b'"-Infinity"'


_SPELL: dict[str, Callable[[Array], list[bytes]]] = {
    "Real": _reals,
    "Integer": _integers,
    "Boolean": _booleans,
}
