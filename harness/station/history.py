"""What was: columns over time for who joins late, thinned so that they stay small."""

from __future__ import annotations

from collections.abc import Mapping

MOST_ROWS = 2048  # more than a screen has pixels; a slow link takes seconds for more
DIGITS = 7  # after the point: of a degree, as the radio sends it


class History:
    """Rows of named numbers; beyond MOST_ROWS each second one is left out, of the next ones too."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._rows: list[tuple[float, ...]] = []
        self._stride = self._count = 0

    def add(self, row: Mapping[str, float]) -> None:
        """A row; it may be left out."""
        if self._count % (1 << self._stride) == 0:
            self._rows.append(tuple(round(row[name], DIGITS) for name in self._names))
            if len(self._rows) > MOST_ROWS:
                self._rows, self._stride = self._rows[::2], self._stride + 1
        self._count += 1

    def columns(self) -> dict[str, list[float]]:
        """Each name's numbers, in order of time."""
        columns = zip(*self._rows, strict=True) if self._rows else [()] * len(self._names)
        return {name: list(column) for name, column in zip(self._names, columns, strict=True)}
