"""Angles and ranges, as the equations of several blocks use them."""

from __future__ import annotations

import math
from functools import reduce

import casadi as ca

from models.kit.declaration import SX


def wrap(angle: SX) -> SX:
    """The same direction in (-pi, pi] [rad]."""
    return angle + 2.0 * math.pi * ca.floor(0.5 - angle / (2.0 * math.pi))


def clip(value: SX, low: SX | float, high: SX | float) -> SX:
    """The nearest value in [low, high]."""
    value = ca.if_else(value < low, low, value)
    return ca.if_else(value > high, high, value)


def either(condition: SX, yes: SX | float, no: SX | float) -> SX:
    """`yes` where the condition holds, else `no`."""
    return ca.if_else(condition, yes, no)


def every(*conditions: SX) -> SX:
    """Do all hold?"""
    return reduce(ca.logic_and, conditions)


def some(*conditions: SX) -> SX:
    """Does any hold?"""
    return reduce(ca.logic_or, conditions)
