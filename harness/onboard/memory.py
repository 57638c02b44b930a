"""The onboard program's memory after a tick, by the names of its record."""

from __future__ import annotations

import numpy as np

from codegen.firmware.bundle import recorded
from models.kit.declaration import Type


class Memory:
    """The record of a tick by names: `controller.output.distance`."""

    _kinds = recorded()
    _index = {name: i for i, name in enumerate(_kinds)}
    _real = np.array([kind is Type.REAL for kind in _kinds.values()])

    def __init__(self, record: bytes) -> None:
        words = np.frombuffer(record, "<u4")
        self.values = np.where(self._real, words.view("<f4"), words.view("<i4").astype(np.float64))

    def __getitem__(self, name: str) -> float:
        return float(self.values[self._index[name]])
