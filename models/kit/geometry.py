"""Angles, ranges, choices and counts, as the equations of several blocks use them."""

from __future__ import annotations

import math
from collections.abc import Set
from enum import IntEnum
from functools import reduce

from models.errors import DeclarationError
from models.kit import casadi as ca
from models.kit.declaration import SX

COUNT_MAX = 2e9  # fits an int32; at 25 Hz it takes two and a half years
SHORT_COUNT_MAX = 30_000  # fits an int16; at 25 Hz it takes 20 minutes
LONGEST = 1e3  # s: the longest time that is compared with such a count of ticks


def wrap(angle: SX) -> SX:
    """The same direction in (-pi, pi] [rad]."""
    return angle + 2.0 * math.pi * ca.floor(0.5 - angle * (0.5 / math.pi))


def clip(value: SX, low: SX | float, high: SX | float) -> SX:
    """The nearest value in [low, high]."""
    value = ca.if_else(value < low, low, value)
    return ca.if_else(value > high, high, value)


def at_least(value: SX, low: SX | float) -> SX:
    """The value, or `low` if that is larger."""
    return ca.if_else(value > low, value, low)


def at_most(value: SX, high: SX | float) -> SX:
    """The value, or `high` if that is smaller."""
    return ca.if_else(value < high, value, high)


def counted(count: SX, more: SX | float = 1, most: float = COUNT_MAX) -> SX:
    """The count and `more`, up to `most`: a counter that stops is safer than one that overflows."""
    return ca.if_else(count < most, count + more, count)


def where(condition: SX, yes: SX | float, no: SX | float) -> SX:
    """`yes` where the condition holds, else `no`."""
    return ca.if_else(condition, yes, no)


def element(vector: SX, index: SX) -> SX:
    """vector[index], index from 0; the first where the index is out of range."""
    value = vector[0]
    for i in range(1, vector.numel()):
        value = where(index == i, vector[i], value)
    return value


def all_of(*conditions: SX) -> SX:
    """Do all hold?"""
    open_ones = [c for c in map(ca.SX, conditions) if not c.is_one()]
    return reduce(ca.logic_and, open_ones) if open_ones else ca.SX(1)


def any_of(*conditions: SX) -> SX:
    """Does any hold?"""
    return reduce(ca.logic_or, conditions)


def one_of(value: SX, members: Set[IntEnum]) -> SX:
    """Is the value among these members, which are the first or the last of their enumeration?

    Raises:
        DeclarationError: they are neither, so that one comparison would not tell.
    """
    least, greatest = min(members), max(members)
    return value <= greatest if _are_first(members) else value >= least


def none_of(value: SX, members: Set[IntEnum]) -> SX:
    """Is the value of an enumeration outside of these members, which are its first or its last?

    Raises:
        DeclarationError: as `one_of`.
    """
    least, greatest = min(members), max(members)
    return value > greatest if _are_first(members) else value < least


def _are_first(members: Set[IntEnum]) -> bool:
    """Are the members the first of their enumeration? Else they are the last."""
    ordered = sorted(type(min(members)))
    if members == set(ordered[: len(members)]):
        return True
    if members == set(ordered[-len(members) :]):
        return False
    names = ", ".join(member.name for member in sorted(members))
    raise DeclarationError(f"{names} are neither the first nor the last of {type(ordered[0]).__name__}")
