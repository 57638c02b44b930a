"""Units as scenarios state them: degrees in the place of radians."""

from __future__ import annotations

from models.kit.declaration import Variable
from models.kit.units import UNITS

ANGULAR = frozenset(unit for unit, exponents in UNITS.items() if exponents.get("rad") == 1)


def is_angular(variable: Variable) -> bool:
    """Do users write the quantity in degrees?"""
    return variable.unit in ANGULAR


def stated_unit(unit: str) -> str:
    """The unit in which users write a quantity; "" for a number without one."""
    if unit in ANGULAR:
        return unit.replace("rad", "deg")
    return "" if unit == "1" else unit
