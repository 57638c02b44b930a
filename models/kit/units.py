"""The units in which signals and parameters are stated: all of them SI, without factors.

Each unit is its exponents of the SI base units kg, m, s, A, K, mol, cd and of rad.
"""

from __future__ import annotations

import math

UNITS: dict[str, dict[str, int]] = {
    "1": {},
    "m": {"m": 1},
    "s": {"s": 1},
    "s2": {"s": 2},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad2/s2": {"rad": 2, "s": -2},
    "Hz": {"s": -1},
    "T": {"kg": 1, "s": -2, "A": -1},
}

DEG = math.pi / 180  # rad, in which declarations state angles
