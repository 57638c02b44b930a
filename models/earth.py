"""Constants of the earth."""

from __future__ import annotations

GRAVITY = 9.81  # m/s2 (eq. 3.10)
SEMI_MAJOR_AXIS, ECCENTRICITY_SQUARED = 6_378_137.0, 6.694_379_990_14e-3  # m, 1: WGS 84
