"""The fuzzy tuner against the sum over 1501 points that eq. 3.21 prints, and against scikit-fuzzy."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np
import pytest
import skfuzzy
from hypothesis import given, settings
from hypothesis import strategies as st

from models.fuzzy import RUNS_FROM, memberships_running, memberships_walking, noise_running, noise_walking
from models.kit.elementary import Precision, lower

speed = ca.SX.sym("speed")


def traced(expression: Any, precision: Precision = "double") -> Any:
    return ca.Function("f", [speed], [lower(expression, precision)])


def by_speed(walking: Any, running: Any) -> Any:
    """The expression for any speed of those for either side of 3 m/s."""
    return ca.if_else(ca.fabs(speed) < RUNS_FROM, walking, running)


PROCESS_NOISE = by_speed(noise_walking(speed), noise_running(speed))
SIGMA = traced(PROCESS_NOISE)
STRENGTHS = traced(
    by_speed(
        ca.vertcat(*memberships_walking(ca.fabs(speed)), 0),
        ca.vertcat(0, *memberships_running(ca.fabs(speed))),
    )
)

# The printed functions, on the grid 0, 0.2, .. 300.0 as exact fifths (0.2 * 15 is above 3.0 in doubles).
GRID = [Fraction(i, 5) for i in range(1501)]


def mu_s(x: float) -> float:
    return (0.5 - x) / 0.5 if 0 <= x < 0.5 else 0.0


def mu_w(x: float) -> float:
    if 0 <= x < 0.5:
        return x / 0.5
    if 0.5 <= x < 3.0:
        return 1.0
    return 4.0 - x if 3.0 <= x < 4.0 else 0.0


def mu_r(x: float) -> float:
    if x < 3.0:
        return 0.0
    return x - 3.0 if x < 4.0 else 1.0


def mu_l(x: Fraction) -> float:
    return float((Fraction(1, 5) - x) * 5) if 0 <= x < Fraction(1, 5) else 0.0


def mu_m(x: Fraction) -> float:
    return float((3 - x) / Fraction(14, 5)) if Fraction(1, 5) <= x < 3 else 0.0


def mu_h(x: Fraction) -> float:
    if 0 <= x < 3:
        return 0.0
    if 3 <= x < 4:
        return float(x - 3)
    return 1.0 if 4 <= x < 300 else 0.0


X = np.array([float(x) for x in GRID])
OUTPUTS = np.array([[mu(x) for x in GRID] for mu in (mu_l, mu_m, mu_h)])


def composite(v: float) -> np.ndarray[Any, Any]:
    """Rules 3.18: each output's membership clipped at its rule's firing strength, joined."""
    strengths = np.array([mu_s(v), mu_w(v), mu_r(v)])
    return np.asarray(np.minimum(OUTPUTS, strengths[:, None]).max(axis=0))


def printed(v: float) -> float:
    """Eq. 3.21 with abs(V)."""
    mu = composite(abs(v)).astype(np.longdouble)
    return float((X * mu).sum() / mu.sum())


CORNERS = [0.0, 0.25, 0.5, 3.0, 3.2, 3.4, 3.6, 3.8, 4.0]
AROUND = [c + d for c in CORNERS for d in (-1e-3, -1e-9, -1e-15, 0.0, 1e-15, 1e-9, 1e-3)]


def assert_is_the_printed_sum(v: float) -> None:
    assert float(SIGMA(v)) == pytest.approx(printed(v), rel=1e-12, abs=1e-15), v


@pytest.mark.parametrize("sign", [1, -1])
def test_the_closed_form_is_the_printed_sum_on_a_fine_grid(sign: int) -> None:
    for v in np.linspace(0, 6, 1201):
        assert_is_the_printed_sum(sign * float(v))


def test_the_closed_form_is_the_printed_sum_around_every_corner() -> None:
    for v in [*AROUND, *(j / 28 for j in range(15)), *(4 - j / 14 for j in range(15)), 50.0, 1e3]:
        assert_is_the_printed_sum(v)


@settings(max_examples=200, deadline=None)
@given(st.floats(-50, 50))
def test_the_closed_form_is_the_printed_sum_at_any_speed(v: float) -> None:
    assert_is_the_printed_sum(v)


@pytest.mark.parametrize(
    ("v", "sigma"),
    [
        (0.0, 0.0), (0.1, 1.081), (0.25, 1.133), (0.5, 1.0667), (1.0, 1.0667), (2.999, 1.0667), (3.0, 1.0667),
        (3.1, 144.38), (3.5, 150.47), (4.0, 151.70), (4.86, 151.70), (40.0, 151.70),
    ],
)  # fmt: skip
def test_sigma_takes_the_values_of_choice_6(v: float, sigma: float) -> None:
    """CHOICES.md 6."""
    digits = 5e-3 if sigma > 100 else 5e-4 if sigma in (1.081, 1.133) else 5e-5
    assert float(SIGMA(v)) == pytest.approx(sigma, abs=digits)
    assert float(SIGMA(-v)) == float(SIGMA(v))


@settings(max_examples=100, deadline=None)
@given(st.floats(0, 20))
def test_firing_strengths_are_the_printed_memberships(v: float) -> None:
    strengths = np.array(STRENGTHS(v)).ravel()
    assert strengths == pytest.approx([mu_s(v), mu_w(v), mu_r(v)], abs=1e-15)


def test_sigma_in_float_differs_from_double_by_rounding() -> None:
    single = traced(PROCESS_NOISE, "float")
    for v in np.linspace(0, 6, 601):
        assert float(single(v)) == pytest.approx(float(SIGMA(v)), rel=1e-5)


TRAPEZOIDS: list[tuple[Callable[..., Any], list[float]]] = [
    (skfuzzy.trimf, [0, 0, 0.5]),
    (skfuzzy.trapmf, [0, 0.5, 3, 4]),
    (skfuzzy.trapmf, [3, 4, 1e3, 1e3]),
]


@pytest.mark.parametrize("v", [0.05, 0.25, 0.4, 1.0, 3.02, 3.1, 3.5, 3.9, 4.0, 4.86])
def test_the_closed_form_agrees_with_scikit_fuzzy(v: float) -> None:
    """The same rules by an independent library, whose centroid is that of the polygon through the points.

    On an even grid that is the printed sum, if a point of membership 0 stands before x = 0 (the sum counts
    mu_L(0) in full, the polygon would count half of it).
    """
    fine = np.array([0.0, v])
    strengths = [float(mf(fine, corners)[1]) for mf, corners in TRAPEZOIDS]
    mu = np.max([np.fmin(s, output) for s, output in zip(strengths, OUTPUTS, strict=True)], axis=0)
    assert mu == pytest.approx(composite(v), abs=1e-12)
    polygon = skfuzzy.defuzz(np.concatenate([[-0.2], X]), np.concatenate([[0.0], mu]), "centroid")
    assert polygon == pytest.approx(float(SIGMA(v)), rel=1e-9)
