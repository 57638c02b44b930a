"""Descriptions of FMUs that need no FMU."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.cosim.fmu import Access, FmuDescription, Quantity, Refused, Unit
from models.kit.declaration import Type

REAL = Access("Real", np.float64)
METRE, SECOND_INVERSE = (0, 1, 0, 0, 0, 0, 0, 0), (0, 1, -1, 0, 0, 0, 0, 0)
KILOGRAM = (1, 0, 0, 0, 0, 0, 0, 0)
UNITS = {
    unit.name: unit
    for unit in (
        Unit("m", METRE),
        Unit("m/s", SECOND_INVERSE),
        Unit("m.s-1", SECOND_INVERSE),
        Unit("km/h", SECOND_INVERSE, 1 / 3.6),
        Unit("kg", KILOGRAM),
    )
}


def quantity(
    name: str, causality: str = "output", type: Type = Type.REAL, unit: str | None = None, *,
    start: float | None = 0.0, access: Access = REAL,
) -> Quantity:  # fmt: skip
    return Quantity(name, 0, type, access, causality, unit, "", start, None, None)


def fmu(
    name: str,
    *quantities: Quantity,
    refused: dict[str, Refused] | None = None,
    feedthrough: bool = True,
    step: float | None = None,
    fixed: bool = False,
) -> FmuDescription:
    return FmuDescription(
        path=Path(f"{name}.fmu"),
        model=name,
        version=2,
        quantities={q.name: q for q in quantities},
        refused=refused or {},
        units=UNITS,
        feedthrough=feedthrough,
        step=step,
        fixed=fixed,
    )
