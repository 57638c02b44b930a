"""The hybrid extended Kalman filter: continuous dynamics, discrete corrections, UD factors (3.2).

The covariance is P = U D U^T with U unit upper triangular and D diagonal, so that it stays positive where
float32 makes a plain P indefinite: Thornton's prediction or Agee and Turner's, Bierman's correction (Bierman,
Factorization Methods for Discrete Sequential Estimation, 1977, III.4, V.3 and VI). All of it is straight-line
expressions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from models.kit import casadi as ca
from models.kit.declaration import SX
from models.kit.geometry import wrap

Row = int | Mapping[int, SX | float]  # of C in eq. 3.4: one state, or coefficients by state


TERMS = 4  # of a Lie series, at most


def propagate(state: SX, derivative: SX, time: float) -> tuple[SX, SX]:
    """Carry the state over `time` [s] by the Lie series of its dynamics, inputs held.

    The series x + f t + f' t^2/2 + ... ends by itself where the heading is no state, and is then exact; else
    it stops after `TERMS` and errs by the fifth power of the time, as Runge-Kutta of order 4 does. Its
    Jacobian is the transition matrix, with which P is carried over the step: P' = F P + P F^T integrated,
    instead of the continuous Jacobian that eq. 3.5 names.

    Args:
        state: (n, 1) symbols.
        derivative: (n, 1) dx/dt as expressions of them (eq. 3.7).

    Returns:
        the state after `time` (n, 1), and its derivative by the state (n, n).
    """
    term, factor, result = derivative, 1.0, state
    for k in range(1, TERMS + 1):
        factor *= time / k
        result = result + factor * term
        term = ca.jacobian(term, state) @ derivative
        if term.is_zero():
            break
    return result, ca.jacobian(result, state)


def travel(speed: SX, acceleration: SX, heading: SX, rate: SX, time: float) -> tuple[SX, SX]:
    """Way north and east [m] in `time` [s] at constant acceleration and turn rate (eq. B.5 integrated).

    The integral about the middle of the step, by powers of the turn: cheaper than the Lie series, which does
    not end where the heading is a state. What is dropped, speed rate^4 time^5/1920 + acceleration rate^3
    time^5/480, is a fifth to a sixteenth of what the series drops at order 4: below 1 micrometre in a tick of
    a dog that runs at 5 m/s, turns at 5 rad/s and is pushed at 20 m/s2.
    """
    half = 0.5 * time * rate
    along = (speed + 0.5 * time * acceleration) * (time * (1 - half**2 * (1 / 6)))
    across = acceleration * rate * (time**3 / 12)
    middle = heading + half
    cosine, sine = ca.cos(middle), ca.sin(middle)
    return along * cosine - across * sine, along * sine + across * cosine


@dataclass(frozen=True)
class Factors:
    """The covariance as U (n, n) unit upper triangular and D (n,), its states in an order of their own.

    With each state before those it depends on, the transition is upper triangular as well, and a prediction
    takes half the operations.

    Attributes:
        order: (n,) which state belongs to each row.
    """

    U: list[list[SX]]
    D: list[SX]
    order: tuple[int, ...]

    @classmethod
    def unpack(cls, packed: SX, order: int | Sequence[int]) -> Factors:
        """From n(n+1)/2 elements: D, then U above its diagonal, row by row; `order` may be n alone."""
        order = tuple(range(order)) if isinstance(order, int) else tuple(order)
        n = len(order)
        above = iter(packed[i] for i in range(n, packed.numel()))
        U = [[next(above) if j > i else ca.SX(float(i == j)) for j in range(n)] for i in range(n)]
        return cls(U, [packed[i] for i in range(n)], order)

    @classmethod
    def diagonal(cls, variances: Sequence[SX], order: Sequence[int] | None = None) -> Factors:
        """Uncorrelated; the variances are in the order of the states."""
        n = len(variances)
        order = tuple(range(n) if order is None else order)
        return cls(_identity(n), [ca.SX(variances[state]) for state in order], order)

    def pack(self) -> SX:
        """To n(n+1)/2 elements: D, then U above its diagonal, row by row."""
        n = len(self.D)
        return ca.vertcat(*self.D, *(self.U[i][j] for i in range(n) for j in range(i + 1, n)))

    def variance(self, state: int) -> SX:
        """P[state, state]."""
        i, n = self.order.index(state), len(self.D)
        return self.D[i] + sum(self.U[i][j] ** 2 * self.D[j] for j in range(i + 1, n))

    def predict(self, transition: SX, noise: Sequence[SX]) -> Factors:
        """P <- Phi P Phi^T + diag(noise) (eq. 3.5)."""
        n = len(self.D)
        phi = ca.densify(transition)[list(self.order), list(self.order)]
        noise = [noise[state] for state in self.order]
        left = phi @ ca.vertcat(*(ca.horzcat(*row) for row in self.U))
        rows = [[left[i, j] for j in range(n)] for i in range(n)]
        if not all(phi[i, j].is_zero() for i in range(n) for j in range(i)):
            return self._orthogonalized(rows, noise)
        D = list(self.D)
        for j in range(n):
            if not phi[j, j].is_one():  # U's diagonal is to be 1: the column's scale goes into D
                D[j] = D[j] * phi[j, j] ** 2
                inverse = 1 / phi[j, j]
                for i in range(j):
                    rows[i][j] = rows[i][j] * inverse
                rows[j][j] = ca.SX(1)
        factors = Factors(rows, D, self.order)
        for row, variance in zip(_identity(n), noise, strict=True):
            factors = factors._disturbed(row, variance)
        return factors

    def replaced(self, state: int, variance: SX) -> Factors:
        """Another state in this one's place, uncorrelated with the rest, whose covariance stays."""
        i = self.order.index(state)
        U = [list(row) for row in self.U]
        U[i] = _identity(len(self.D))[i]
        column = [U[k][i] if k < i else ca.SX(0) for k in range(len(self.D))]
        for k in range(i):
            U[k][i] = ca.SX(0)
        rest = Factors(U, list(self.D), self.order)._disturbed(column, self.D[i])
        return Factors(rest.U, [variance if k == i else d for k, d in enumerate(rest.D)], self.order)

    def _orthogonalized(self, left: list[list[SX]], noise: Sequence[SX]) -> Factors:
        """Of any matrix `left` with P = left D left^T + diag(noise), by Thornton's weighted Gram-Schmidt."""
        n = len(self.D)
        rows = [[*row, *identity] for row, identity in zip(left, _identity(n), strict=True)]
        weights = [*self.D, *noise]
        U, D = _identity(n), [ca.SX(0)] * n
        for j in reversed(range(n)):
            weighted = [w * x for w, x in zip(weights, rows[j], strict=True)]
            D[j] = _dot(weighted, rows[j])
            for i in range(j):
                U[i][j] = _dot(weighted, rows[i]) / D[j]
                rows[i] = [a - U[i][j] * b for a, b in zip(rows[i], rows[j], strict=True)]
        return Factors(U, D, self.order)

    def _disturbed(self, vector: Sequence[SX], variance: SX) -> Factors:
        """P <- P + variance v v^T for a vector in the factors' order, by Agee and Turner: adds positives."""
        U, D, vector = [list(r) for r in self.U], list(self.D), list(vector)
        last = max((j for j, x in enumerate(vector) if not ca.SX(x).is_zero()), default=0)
        for j in reversed(range(last + 1)):
            share = variance * vector[j]
            D[j] = self.D[j] + share * vector[j]
            if j > 0:
                gain = share / D[j]
                variance = variance * (self.D[j] / D[j])
                for i in range(j):
                    vector[i] = vector[i] - vector[j] * U[i][j]
                    U[i][j] = U[i][j] + gain * vector[i]
        return Factors(U, D, self.order)

    def correct(self, row: Row, variance: SX, innovation: SX, angle: bool = False) -> Correction:
        """One scalar measurement, sequentially (eq. 3.1-3.3), by Bierman.

        Args:
            row: what is measured: a state, or the coefficients of a sum of states.
            variance: of the measurement's noise, above 0.
            innovation: the measurement less what the states predict.
            angle: the innovation is one, and is wrapped into (-pi, pi].
        """
        n = len(self.D)
        coefficients = {row: 1.0} if isinstance(row, int) else row
        h = {self.order.index(state): c for state, c in coefficients.items()}
        f = [sum((c * self.U[i][j] for i, c in h.items()), ca.SX(0)) for j in range(n)]  # U^T h
        g = [d * x for d, x in zip(self.D, f, strict=True)]
        U, D = [list(row) for row in self.U], list(self.D)
        gain: list[SX] = [ca.SX(0)] * n
        alpha = variance
        for j in range(n):
            before, alpha = alpha, alpha + f[j] * g[j]
            D[j] = self.D[j] * (before / alpha)
            scale = f[j] / before
            for i in range(j):
                U[i][j] = self.U[i][j] - scale * gain[i]
                gain[i] = gain[i] + self.U[i][j] * g[j]
            gain[j] = g[j]
        innovation = wrap(innovation) if angle else innovation
        weighted = innovation / alpha
        increments = [gain[self.order.index(i)] * weighted for i in range(n)]
        return Correction(increments, Factors(U, D, self.order), innovation, alpha)


class Correction(NamedTuple):
    """What one scalar measurement does.

    Attributes:
        increments: (n,) what is to be added to the states, in their order.
        factors: the corrected covariance.
        innovation: the measurement less its prediction, wrapped if it is an angle.
        variance: the variance that the filter expects of the innovation.
    """

    increments: list[SX]
    factors: Factors
    innovation: SX
    variance: SX


class Measurement(NamedTuple):
    """One scalar of eq. 3.4, a pseudo-measurement too: `measured` is `row` times the states, and noise.

    Attributes:
        row: a state, or coefficients by state.
        variance: of the noise; `UNUSED` where the measurement says nothing.
        angle: it is an angle [rad], the same after a full turn.
    """

    row: Row
    measured: SX | float
    variance: SX
    angle: bool = False

    def innovation(self, x: Sequence[SX]) -> SX:
        """The measurement less what the states (n,) predict, not wrapped."""
        if isinstance(self.row, int):
            return self.measured - x[self.row]
        return self.measured - sum((c * x[state] for state, c in self.row.items()), ca.SX(0))


UNUSED = 1e30  # a variance that leaves states and covariance as they are, in float32 too


def correct(
    state: SX, factors: Factors, measurements: Sequence[Measurement]
) -> tuple[SX, Factors, list[Correction]]:
    """Measurement update by scalars in turn (eq. 3.1-3.4): the state (n, 1), the covariance, each step."""
    x = [state[i] for i in range(state.numel())]
    steps = []
    for measurement in measurements:
        row, _, variance, angle = measurement
        steps.append(factors.correct(row, variance, measurement.innovation(x), angle))
        factors = steps[-1].factors
        x = [value + increment for value, increment in zip(x, steps[-1].increments, strict=True)]  # eq. 3.2
    return ca.vertcat(*x), factors, steps


def _identity(n: int) -> list[list[SX]]:
    return [[ca.SX(float(i == j)) for j in range(n)] for i in range(n)]


def _dot(a: Sequence[SX], b: Sequence[SX]) -> SX:
    return sum((x * y for x, y in zip(a, b, strict=True)), ca.SX(0))
