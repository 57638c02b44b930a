"""The fuzzy tuner: the accelerometer's process noise from the speed (3.3, eq. 3.18-3.21)."""

from __future__ import annotations

from models.kit import casadi as ca
from models.kit.declaration import SX
from models.kit.geometry import clip, where

RUNS_FROM = 3.0  # m/s: a faster animal runs to some degree
STEP = 0.2  # m/s2, the grid of eq. 3.21
MEDIUM = 14  # grid points under mu_M: 0.2, 0.4, .. 2.8 (eq. 3.20)
HIGH = 1485  # grid points from 3.0 on under mu_H; the one at 300 lies outside its strict bound
RAMP = 5  # of these, those before mu_H is 1


def memberships_walking(speed: SX) -> tuple[SX, SX]:
    """Firing strengths of stopped and walking for a speed from 0 to 3 [m/s] (eq. 3.19)."""
    slow = speed < 0.5
    return where(slow, 1.0 - 2.0 * speed, 0.0), where(slow, 2.0 * speed, 1.0)


def memberships_running(speed: SX) -> tuple[SX, SX]:
    """Firing strengths of walking and running for a speed from 3 [m/s] on (eq. 3.19)."""
    slow = speed < 4.0
    return where(slow, 4.0 - speed, 0.0), where(slow, speed - RUNS_FROM, 1.0)


def noise_walking(speed: SX) -> SX:
    """sigma_Ax [m/s2] for a speed between -3 and 3 [m/s]: rules 3.18 joined; the third does not fire."""
    stopped, walking = memberships_walking(ca.fabs(speed))
    return defuzzify(stopped, walking, ca.SX(0))


def noise_running(speed: SX) -> SX:
    """sigma_Ax [m/s2] for any other speed [m/s]: rules 3.18 joined; the first does not fire."""
    walking, running = memberships_running(ca.fabs(speed))
    return defuzzify(ca.SX(0), walking, running)


def defuzzify(low: SX, medium: SX, high: SX) -> SX:
    """Centroid of the clipped output memberships [m/s2]: eq. 3.21 summed in closed form.

    mu_L has one grid point, x = 0. mu_M falls by 1/14 from point to point: clipped at w, the n = floor(14 w)
    lowest keep their value and the others are w. mu_H rises by 0.2 over five points and is 1 from there on.
    """
    n = ca.floor(MEDIUM * medium)
    m = clip(ca.floor(RAMP * high), 0, RAMP - 1)
    # points of mu_M counted from its top end: x = 3 - 0.2 j with mu = j/14, j = 1 .. 14
    kept_sum, kept_moment = _sums(n)
    all_sum, _ = _sums(ca.SX(MEDIUM))
    medium_area = kept_sum * (1 / MEDIUM) + (MEDIUM - n) * medium
    medium_moment = (3.0 * kept_sum - STEP * kept_moment) * (1 / MEDIUM) + medium * (
        3.0 * (MEDIUM - n) - STEP * (all_sum - kept_sum)
    )
    # points of mu_H: x = 3 + 0.2 k with mu = 0.2 k up to 1, k = 0 .. 1484
    ramp_sum, ramp_moment = _sums(m)
    high_all, _ = _sums(ca.SX(HIGH - 1))
    high_area = STEP * ramp_sum + (HIGH - 1 - m) * high
    high_moment = STEP * (3.0 * ramp_sum + STEP * ramp_moment) + high * (
        3.0 * (HIGH - 1 - m) + STEP * (high_all - ramp_sum)
    )
    return (medium_moment + high_moment) / (low + medium_area + high_area)


def _sums(n: SX) -> tuple[SX, SX]:
    """1 + 2 + .. + n, and 1 + 4 + .. + n^2."""
    twice = n * (n + 1)
    return 0.5 * twice, twice * (2 * n + 1) * (1 / 6)
