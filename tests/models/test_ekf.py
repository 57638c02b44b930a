"""The EKF kit against dense textbook matrices, fine integration in long double, and finite differences."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.kit.ekf import UNUSED, Factors, Measurement, correct, propagate
from models.kit.elementary import lower

Array = np.ndarray[Any, Any]
Flow = Callable[[Array, Array], Array]  # dx/dt of state and inputs

T = 0.04  # s, one tick
long = np.longdouble
LONG_DOUBLE_IS_WIDER = np.finfo(long).nmant >= 63


def four_states(x: Any, u: Any, like: Any) -> list[Any]:
    """Eq. 3.10-3.12: x = (V, b, N, E), u = (specific force without gravity, heading)."""
    return [u[0] - x[1], 0, x[0] * like.cos(u[1]), x[0] * like.sin(u[1])]


def six_states(x: Any, u: Any, like: Any) -> list[Any]:
    """Eq. B.2-B.5: x = (V, b_a, psi, b_g, N, E), u = (specific force, yaw rate)."""
    return [u[0] - x[1], 0, u[1] - x[3], 0, x[0] * like.cos(x[2]), x[0] * like.sin(x[2])]


DYNAMICS = {4: four_states, 6: six_states}


def traced(n: int, time: float = T) -> Any:
    """(state, inputs) -> (state after `time`, transition), as blocks compute it (no libm)."""
    x, u = ca.SX.sym("x", n), ca.SX.sym("u", 2)
    after, transition = propagate(x, ca.vertcat(*DYNAMICS[n](x, u, ca)), time)
    both = lower(ca.horzcat(after, ca.densify(transition)), "double")
    return ca.Function("propagate", [x, u], [both[:, 0], both[:, 1:]])


STEP = {n: traced(n) for n in DYNAMICS}


def integrate(n: int, x: Any, u: Any, time: float = T, steps: int = 20) -> Array:
    """Runge-Kutta of order 4 in long double, `steps` steps; independent of CasADi."""
    x, u, h = np.array(x, dtype=long), np.array(u, dtype=long), long(time) / steps

    def f(x: Array) -> Array:
        return np.array(DYNAMICS[n](x, u, np), dtype=long)

    for _ in range(steps):
        k1 = f(x)
        k2 = f(x + h / 2 * k1)
        k3 = f(x + h / 2 * k2)
        k4 = f(x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.asarray(x)


def flow_derivative(n: int, x: Any, u: Any) -> Array:
    """d(state after T)/d(state) by central differences of the fine integration in long double."""
    h = long(1e-5 if LONG_DOUBLE_IS_WIDER else 1e-4)
    columns = []
    for i in range(n):
        e = np.zeros(n, dtype=long)
        e[i] = h
        columns.append((integrate(n, x + e, u, steps=8) - integrate(n, x - e, u, steps=8)) / (2 * h))
    return np.array(columns).T.astype(float)


def truncation(x: Any, u: Any) -> float:
    """Bound of T^5/5! times the fifth derivative of V cos psi's integral, for the six states."""
    rate, acceleration = abs(u[1] - x[3]), abs(u[0] - x[1])
    speed = abs(x[0]) + acceleration * T
    return float(T**5 / 120 * (speed * rate**4 + 4 * acceleration * rate**3))


def evaluate(n: int, x: Any, u: Any) -> tuple[Array, Array]:
    after, transition = STEP[n](x, u)
    return np.array(after).ravel(), np.array(transition)


speeds, biases = st.floats(-50, 50), st.floats(-5, 5)
places, angles = st.floats(-1e3, 1e3), st.floats(-7, 7)
forces, rates = st.floats(-200, 200), st.floats(-5.3, 5.3)
QUARTERS = [math.radians(d) for d in range(-360, 361, 90)]


@settings(max_examples=60, deadline=None)
@given(st.tuples(speeds, biases, places, places), st.tuples(forces, angles))
def test_four_states_are_carried_exactly(x: tuple[float, ...], u: tuple[float, ...]) -> None:
    """Heading and force are held, so V is linear in time, N and E quadratic: the series ends by itself."""
    after, _ = evaluate(4, x, u)
    assert after == pytest.approx(integrate(4, x, u, steps=1).astype(float), rel=1e-14, abs=1e-13)


@settings(max_examples=60, deadline=None)
@given(st.tuples(speeds, biases, angles, st.floats(-1, 1), places, places), st.tuples(forces, rates))
def test_six_states_are_carried_to_order_four(x: tuple[float, ...], u: tuple[float, ...]) -> None:
    after, _ = evaluate(6, x, u)
    error = np.abs(after - integrate(6, x, u).astype(float))
    assert error[:4].max() <= 1e-13
    assert error[4:].max() <= truncation(x, u) + 1e-12


def test_order_four_errs_24_times_as_much_as_runge_kutta_and_both_by_micrometres() -> None:
    """Heading is linear in time, so RK4 is Simpson's rule: T^5/2880 where the series drops T^5/120."""
    rng = np.random.default_rng(2)
    ours, theirs = [], []
    for _ in range(300):
        x = rng.uniform([-10, -1, -4, -0.1, 0, 0], [10, 1, 4, 0.1, 1, 1])
        u = rng.uniform([-30, -3], [30, 3])
        exact = integrate(6, x, u).astype(float)
        ours.append(np.abs(evaluate(6, x, u)[0] - exact).max())
        theirs.append(np.abs(integrate(6, x, u, steps=1).astype(float) - exact).max())
    assert max(ours) < 4e-6
    assert np.mean(ours) / np.mean(theirs) == pytest.approx(24, rel=0.05)


def test_the_error_of_order_four_falls_with_the_fifth_power_of_the_step() -> None:
    x, u = [4.0, 0.3, 0.7, 0.05, 0.0, 0.0], [10.0, 3.0]
    errors = []
    for time in (0.4, 0.2, 0.1):
        after = np.array(traced(6, time)(x, u)[0]).ravel()
        errors.append(np.abs(after - integrate(6, x, u, time, 400).astype(float)).max())
    assert errors[0] / errors[1] == pytest.approx(32, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(32, rel=0.3)


@pytest.mark.parametrize("heading", QUARTERS)
@pytest.mark.parametrize("n", DYNAMICS)
def test_the_transition_is_the_derivative_at_every_quarter_turn(n: int, heading: float) -> None:
    x = np.array([3.0, 0.2, 5.0, -6.0] if n == 4 else [3.0, 0.2, heading, 0.01, 5.0, -6.0])
    u = [1.5, heading] if n == 4 else [1.5, 0.8]
    _, transition = evaluate(n, x, u)
    assert transition == pytest.approx(flow_derivative(n, x, u), rel=1e-8, abs=2e-8)


@settings(max_examples=40, deadline=None)
@given(st.tuples(speeds, biases, places, places), st.tuples(forces, angles))
def test_the_transition_of_four_states_is_the_derivative(x: tuple[float, ...], u: tuple[float, ...]) -> None:
    _, transition = evaluate(4, x, u)
    assert transition == pytest.approx(flow_derivative(4, np.array(x), u), abs=1e-8)


@settings(max_examples=40, deadline=None)
@given(st.tuples(speeds, biases, angles, st.floats(-1, 1), places, places), st.tuples(forces, rates))
def test_the_transition_of_six_states_is_the_derivative(x: tuple[float, ...], u: tuple[float, ...]) -> None:
    """Up to the truncated term of the series, derived once."""
    _, transition = evaluate(6, x, u)
    speed, rate = abs(x[0]) + abs(u[0] - x[1]) * T, abs(u[1] - x[3])
    acceleration = abs(u[0] - x[1])
    dropped = (
        T**5
        / 120
        * (speed * (rate**4 + 4 * rate**3) + acceleration * (4 * rate**3 + 12 * rate**2) + 5 * rate**4)
    )
    assert np.abs(transition - flow_derivative(6, np.array(x), u)).max() <= dropped + 1e-8


def test_the_transition_holds_the_continuous_jacobian() -> None:
    """Its first order is I + F T with F of eq. B.6 (and of eq. 3.12 in the order of eq. 3.9)."""
    psi, v, small = 0.6, 3.0, 1e-6
    f6 = np.zeros((6, 6))
    f6[0, 1] = f6[2, 3] = -1
    f6[4, 0], f6[5, 0] = math.cos(psi), math.sin(psi)
    f6[4, 2], f6[5, 2] = -v * math.sin(psi), v * math.cos(psi)
    transition = np.array(traced(6, small)([v, 0, psi, 0, 0, 0], [0, 0])[1])
    assert (transition - np.eye(6)) / small == pytest.approx(f6, abs=1e-5)
    f4 = np.zeros((4, 4))
    f4[0, 1], f4[2, 0], f4[3, 0] = -1, math.cos(psi), math.sin(psi)
    transition = np.array(traced(4, small)([v, 0, 0, 0], [0, psi])[1])
    assert (transition - np.eye(4)) / small == pytest.approx(f4, abs=1e-5)


# The factored covariance


def elements(n: int) -> int:
    return n * (n + 1) // 2


def dense(packed: Any, n: int) -> Array:
    """P = U D U^T from the packed factors, by the documented order: D, then U above its diagonal by rows."""
    packed = np.array(packed, dtype=float).ravel()
    U = np.eye(n)
    U[np.triu_indices(n, 1)] = packed[n:]
    return U @ np.diag(packed[:n]) @ U.T


def any_factors(rng: np.random.Generator, n: int) -> Array:
    return np.concatenate([10.0 ** rng.uniform(-6, 3, n), rng.normal(0, 2, elements(n) - n)])


def predictor(n: int) -> Any:
    packed, phi, q = ca.SX.sym("p", elements(n)), ca.SX.sym("phi", n, n), ca.SX.sym("q", n)
    noise = [q[i] for i in range(n)]
    return ca.Function("predict", [packed, phi, q], [Factors.unpack(packed, n).predict(phi, noise).pack()])


def corrector(n: int, component: int) -> Any:
    packed, r = ca.SX.sym("p", elements(n)), ca.SX.sym("r")
    gain, factors, *_ = Factors.unpack(packed, n).correct(component, r, ca.SX(1))
    return ca.Function("correct", [packed, r], [ca.vertcat(*gain), factors.pack()])


SIZES = (1, 2, 4, 6, 7)
PREDICT = {n: predictor(n) for n in SIZES}
CORRECT = {(n, i): corrector(n, i) for n in SIZES for i in range(n)}


@pytest.mark.parametrize("n", SIZES)
def test_pack_undoes_unpack(n: int) -> None:
    packed = ca.SX.sym("p", elements(n))
    again = ca.Function("again", [packed], [Factors.unpack(packed, n).pack()])
    values = np.arange(1.0, elements(n) + 1)
    assert np.array(again(values)).ravel().tolist() == values.tolist()


def test_unpack_takes_d_and_then_u_by_rows() -> None:
    factors = Factors.unpack(ca.SX(ca.DM([1, 2, 3, 12, 13, 23])), 3)
    assert [float(d) for d in factors.D] == [1, 2, 3]
    assert [[float(x) for x in row] for row in factors.U] == [[1, 12, 13], [0, 1, 23], [0, 0, 1]]


@pytest.mark.parametrize("n", SIZES)
def test_variance_is_the_diagonal_of_the_covariance(n: int) -> None:
    packed = ca.SX.sym("p", elements(n))
    factors = Factors.unpack(packed, n)
    f = ca.Function("variances", [packed], [ca.vertcat(*(factors.variance(i) for i in range(n)))])
    values = any_factors(np.random.default_rng(n), n)
    assert np.array(f(values)).ravel() == pytest.approx(np.diag(dense(values, n)), rel=1e-13)


def test_diagonal_has_no_correlation() -> None:
    packed = np.array(ca.DM(ca.evalf(Factors.diagonal([ca.SX(2), ca.SX(3), ca.SX(5)]).pack()))).ravel()
    assert packed.tolist() == [2, 3, 5, 0, 0, 0]


@settings(max_examples=80, deadline=None)
@given(st.sampled_from(SIZES), st.integers(0, 2**32 - 1))
def test_predict_is_phi_p_phi_transposed_plus_q(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    packed, phi, q = any_factors(rng, n), rng.normal(0, 1, (n, n)) + np.eye(n), 10.0 ** rng.uniform(-6, 2, n)
    expected = phi @ dense(packed, n) @ phi.T + np.diag(q)
    result = np.array(PREDICT[n](packed, phi, q)).ravel()
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((dense(result, n) - expected) / scale).max() < 1e-10
    assert (result[:n] > 0).all()


ORDER = (2, 3, 0, 1)  # of four states of which each depends on those behind it in it


def triangular(
    rng: np.random.Generator, n: int, order: tuple[int, ...], diagonal: tuple[float, ...]
) -> Array:
    """A transition in the order of the states that is upper triangular in `order`."""
    place = np.argsort(order)
    return (np.diag(diagonal) + np.triu(rng.normal(0, 1, (n, n)), 1))[np.ix_(place, place)]


@pytest.mark.parametrize("diagonal", [(1, 1, 1, 1), (1, 1, 0.94, 1), (0.5, 2, 0.9, 0.1)])
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_predict_of_a_triangular_transition_is_the_same(diagonal: tuple[float, ...], seed: int) -> None:
    # given factors in an order of their own, and a transition without what is structurally zero in it
    rng = np.random.default_rng(seed)
    values, phi = any_factors(rng, 4), triangular(rng, 4, ORDER, diagonal)
    q = 10.0 ** rng.uniform(-6, 2, 4)
    packed, noise = ca.SX.sym("p", 10), ca.SX.sym("q", 4)
    factors = Factors.unpack(packed, ORDER).predict(ca.SX(ca.DM(phi)), [noise[i] for i in range(4)])
    predict = ca.Function("predict", [packed, noise], [factors.pack()])
    # when it predicts, then it is Phi P Phi^T + Q
    place = np.argsort(ORDER)
    expected = phi @ dense(values, 4)[np.ix_(place, place)] @ phi.T + np.diag(q)
    result = np.array(predict(values, q)).ravel()
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((dense(result, 4)[np.ix_(place, place)] - expected) / scale).max() < 1e-10
    assert (result[:4] > 0).all()
    # and takes about half the operations of an arbitrary one
    assert predict.n_instructions() < 0.6 * PREDICT[4].n_instructions()


@pytest.mark.parametrize("state", range(4))
def test_another_order_of_the_factors_changes_only_the_packing(state: int) -> None:
    # given the same covariance in two orders
    rng = np.random.default_rng(state)
    P = dense(any_factors(rng, 4), 4)
    permuted = P[np.ix_(ORDER, ORDER)]
    D, U = np.zeros(4), np.eye(4)
    rest = permuted.copy()
    for j in reversed(range(4)):  # U D U^T of it, column by column from the last
        D[j] = rest[j, j]
        U[:j, j] = rest[:j, j] / D[j]
        rest -= D[j] * np.outer(U[:, j], U[:, j])
    values = np.concatenate([D, U[np.triu_indices(4, 1)]])
    factors = Factors.unpack(ca.SX(ca.DM(values)), ORDER)
    # when one state is measured, then the variance, the gain and the covariance are the textbook's
    assert float(ca.evalf(factors.variance(state))) == pytest.approx(P[state, state], rel=1e-9)
    gain, corrected, *_ = factors.correct(state, ca.SX(0.7), ca.SX(1))
    L = P[:, state] / (P[state, state] + 0.7)
    assert [float(ca.evalf(k)) for k in gain] == pytest.approx(L.tolist(), rel=1e-6)
    result = np.array(ca.DM(ca.evalf(corrected.pack()))).ravel()
    expected = P - np.outer(L, P[state])
    place = np.argsort(ORDER)
    scale = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    assert np.abs((dense(result, 4)[np.ix_(place, place)] - expected) / scale).max() < 1e-8


@settings(max_examples=80, deadline=None)
@given(st.sampled_from(list(CORRECT)), st.integers(0, 2**32 - 1))
def test_correct_is_the_textbook_measurement_update(key: tuple[int, int], seed: int) -> None:
    """Eq. 3.1 and 3.3 for a single measured component."""
    n, component = key
    rng = np.random.default_rng(seed)
    packed, r = any_factors(rng, n), 10.0 ** rng.uniform(-3, 3)
    P = dense(packed, n)
    C = np.eye(n)[[component]]
    L = P @ C.T / (C @ P @ C.T + r)
    expected = (np.eye(n) - L @ C) @ P
    gain, result = (np.array(a).ravel() for a in CORRECT[key](packed, r))
    deviation = np.sqrt(np.diag(P))
    assert np.abs((gain - L.ravel()) * deviation[component] / deviation).max() < 1e-11
    assert np.abs((dense(result, n) - expected) / np.outer(deviation, deviation)).max() < 1e-11
    assert (result[:n] > 0).all()


@pytest.mark.parametrize("seed", range(5))
def test_sequential_corrections_equal_one_joint_correction(seed: int) -> None:
    """Eq. 3.1-3.3 with C = [V, N, E] of eq. 3.14 and the diagonal R of eq. 3.15."""
    rng = np.random.default_rng(seed)
    packed, x = any_factors(rng, 4), rng.normal(0, 10, 4)
    components, y, R = [0, 2, 3], rng.normal(0, 10, 3), np.array([0.01, 3.06, 3.06])
    P, C = dense(packed, 4), np.eye(4)[components]
    L = P @ C.T @ np.linalg.inv(C @ P @ C.T + np.diag(R))
    expected_x, expected_P = x + L @ (y - C @ x), (np.eye(4) - L @ C) @ P
    for component, measured, r in zip(components, y, R, strict=True):
        gain, result = CORRECT[4, component](packed, r)
        x = x + np.array(gain).ravel() * (measured - x[component])
        packed = np.array(result).ravel()
    assert x == pytest.approx(expected_x, rel=1e-8, abs=1e-8)
    scale = np.sqrt(np.outer(np.diag(expected_P), np.diag(expected_P)))
    assert np.abs((dense(packed, 4) - expected_P) / scale).max() < 1e-7


# Any observation row, angles, pseudo-measurements


def value(expression: Any) -> Array:
    return np.array(ca.DM(ca.evalf(ca.densify(ca.SX(expression))))).ravel()


@settings(max_examples=60, deadline=None)
@given(st.sampled_from((2, 4, 6, 7)), st.integers(0, 2**32 - 1))
def test_a_sum_of_states_is_corrected_as_the_textbook_does(n: int, seed: int) -> None:
    # given an observation row with some coefficients
    rng = np.random.default_rng(seed)
    packed, r, innovation = any_factors(rng, n), 10.0 ** rng.uniform(-3, 3), rng.normal()
    measured = rng.choice(n, size=rng.integers(1, n + 1), replace=False)
    row = {int(i): float(rng.normal()) for i in measured}
    order = tuple(int(i) for i in rng.permutation(n))
    place = np.argsort(order)
    P, c = dense(packed, n)[np.ix_(place, place)], np.zeros(n)
    c[list(row)] = list(row.values())
    # when it is measured, then eq. 3.1-3.3 hold, and the innovation's variance is C P C^T + R
    step = Factors.unpack(ca.SX(ca.DM(packed)), order).correct(row, ca.SX(r), ca.SX(innovation))
    S = c @ P @ c + r
    L = P @ c / S
    deviation = np.sqrt(np.diag(P))
    increments = value(ca.vertcat(*step.increments))
    assert np.abs((increments - L * innovation) / deviation).max() < 1e-9 * abs(innovation)
    assert value(step.variance)[0] == pytest.approx(S, rel=1e-10)
    assert value(step.innovation)[0] == innovation
    result = dense(value(step.factors.pack()), n)[np.ix_(place, place)]
    assert np.abs((result - P + np.outer(L, c @ P)) / np.outer(deviation, deviation)).max() < 1e-9


@pytest.mark.parametrize(
    ("innovation", "wrapped"),
    [(0.3, 0.3), (3.5, 3.5 - 2 * math.pi), (-6.0, 2 * math.pi - 6.0), (13.0, 13.0 - 4 * math.pi)],
)
def test_the_innovation_of_an_angle_is_the_shorter_way_round(innovation: float, wrapped: float) -> None:
    factors = Factors.diagonal([ca.SX(2.0), ca.SX(1.0)])
    as_angle = factors.correct(0, ca.SX(2.0), ca.SX(innovation), angle=True)
    assert value(as_angle.innovation)[0] == pytest.approx(wrapped, abs=1e-12)
    assert value(ca.vertcat(*as_angle.increments)) == pytest.approx([wrapped / 2, 0])
    as_length = factors.correct(0, ca.SX(2.0), ca.SX(innovation))
    assert value(as_length.increments[0])[0] == pytest.approx(innovation / 2)


def test_measurements_are_taken_in_turn_each_with_what_the_last_one_left() -> None:
    """Against one joint correction: a sum, an angle, and a speed of zero that nobody measured."""
    rng = np.random.default_rng(3)
    packed, x = any_factors(rng, 4), np.array([0.4, -0.2, 3.0, 5.0])
    P, R = dense(packed, 4), np.diag([0.5, 0.2, 1e-4])
    C = np.array([[1, 2, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0]], dtype=float)
    measurements = [
        Measurement({0: 1, 1: 2}, 0.3, ca.SX(0.5)),
        Measurement(2, -3.1, ca.SX(0.2), angle=True),
        Measurement(0, 0, ca.SX(1e-4)),
    ]
    after, factors, steps = correct(ca.SX(ca.DM(x)), Factors.unpack(ca.SX(ca.DM(packed)), 4), measurements)
    innovation = np.array([0.3, 2 * math.pi - 3.1, 0]) - C @ x
    S = C @ P @ C.T + R
    gain = P @ C.T @ np.linalg.inv(S)
    assert value(after) == pytest.approx(x + gain @ innovation, rel=1e-8)
    deviation = np.sqrt(np.diag(P))
    result = dense(value(factors.pack()), 4)
    assert np.abs((result - P + gain @ C @ P) / np.outer(deviation, deviation)).max() < 1e-8
    # the squares of the innovations in turn, over their variances, sum to the joint NIS
    nis = sum(value(s.innovation)[0] ** 2 / value(s.variance)[0] for s in steps)
    assert nis == pytest.approx(innovation @ np.linalg.solve(S, innovation), rel=1e-8)


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_an_unused_measurement_changes_nothing_in_either_precision(kind: str) -> None:
    rng = np.random.default_rng(4)
    x, packed = ca.SX.sym("x", 4), ca.SX.sym("p", 10)
    after, factors, _ = correct(
        x, Factors.unpack(packed, 4), [Measurement({1: 1, 2: -3}, 700.0, ca.SX(UNUSED))]
    )
    changed = ca.Function("changed", [x, packed], [ca.vertcat(after, factors.pack())])
    for _ in range(20):
        given_x = rng.normal(0, 10, 4).astype(kind)
        given_p = any_factors(rng, 4).astype(kind)
        result = np.array(changed(given_x, given_p)).ravel().astype(kind)
        assert np.array_equal(result, np.concatenate([given_x, given_p]))


# The covariance over a step (CHOICES.md 2)


def lyapunov(P: Array, heading: float, q_b: float, steps: int) -> Array:
    """P' = F P + P F^T + diag(0, q_b, 0, 0) over T, by Runge-Kutta of order 4 in long double."""
    F = np.zeros((4, 4), dtype=long)
    F[0, 1], F[2, 0], F[3, 0] = -1, np.cos(long(heading)), np.sin(long(heading))
    Q = np.diag(np.array([0, q_b, 0, 0], dtype=long))
    P, h = P.astype(long), long(T) / steps

    def f(P: Array) -> Array:
        return F @ P + P @ F.T + Q

    for _ in range(steps):
        k1 = f(P)
        k2 = f(P + h / 2 * k1)
        k3 = f(P + h / 2 * k2)
        k4 = f(P + h * k3)
        P = P + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return P


@pytest.mark.parametrize("heading", [0.0, 0.7, math.pi / 2, 2.9, -1.8])
def test_the_transition_carries_p_as_its_differential_equation_does(heading: float) -> None:
    packed = any_factors(np.random.default_rng(7), 4)
    P = dense(packed, 4)
    _, transition = evaluate(4, [3.0, 0.1, 0.0, 0.0], [0.5, heading])
    fine = lyapunov(P, heading, 0, 50).astype(float)
    scale = np.sqrt(np.outer(np.diag(fine), np.diag(fine)))
    assert np.abs((transition @ P @ transition.T - fine) / scale).max() < 1e-13
    once = lyapunov(P, heading, 0, 1).astype(float)
    assert np.abs((once - fine) / scale).max() < 1e-13  # RK4 too: P is of degree 4 in time


@pytest.mark.skipif(not LONG_DOUBLE_IS_WIDER, reason="the term is at double's rounding")
def test_with_noise_on_the_bias_runge_kutta_misses_t5_qb_over_20() -> None:
    """CHOICES.md 2: the only term of P that one RK4 step lacks, in N and E along the heading."""
    heading, q_b = 0.6, 1e3
    P = np.diag([0.1, 1.0, 0.01, 0.01])
    missing = (lyapunov(P, heading, q_b, 60) - lyapunov(P, heading, q_b, 1)).astype(float)
    c, s = math.cos(heading), math.sin(heading)
    expected = np.zeros((4, 4))
    expected[2:, 2:] = T**5 * q_b / 20 * np.array([[c * c, c * s], [c * s, s * s]])
    assert missing == pytest.approx(expected, rel=1e-6, abs=1e-15)
