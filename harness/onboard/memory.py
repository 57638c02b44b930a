"""The onboard program's memory after a tick, by the names of its record."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import numpy.typing as npt

from codegen.firmware.bundle import recorded
from codegen.firmware.navigation import DEFAULT, Navigation
from models.kit.declaration import Type


class Memory:
    """The record of a tick by names: `controller.output.distance`."""

    def __init__(self, record: bytes, navigation: Navigation = DEFAULT) -> None:
        self._index, real = _layout(navigation)
        words = np.frombuffer(record, "<u4")
        self.values = np.where(real, words.view("<f4"), words.view("<i4").astype(np.float64))

    def __getitem__(self, name: str) -> float:
        return float(self.values[self._index[name]])


@cache
def _layout(navigation: Navigation) -> tuple[Mapping[str, int], npt.NDArray[np.bool_]]:
    """The words' places by name, and which of them are floats."""
    kinds = recorded(navigation)
    return {name: i for i, name in enumerate(kinds)}, np.array([k is Type.REAL for k in kinds.values()])
