"""The hybrid extended Kalman filter: continuous dynamics, discrete corrections, UD factors (3.2).

The covariance is P = U D U^T with U unit upper triangular and D diagonal, so that it stays positive where
float32 makes a plain P indefinite: Thornton's prediction, Bierman's correction (Bierman, Factorization
Methods for Discrete Sequential Estimation, 1977, V.3 and VI). All of it is straight-line expressions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from models.kit.declaration import SX


def propagate(state: SX, derivative: SX, time: float, order: int = 4) -> tuple[SX, SX]:
    """Carry the state over `time` [s] by the Lie series of its dynamics, inputs held.

    The series x + f t + f' t^2/2 + ... stops at `order` or where it ends by itself, and is then exact. Order
    4 errs by the fifth power of the time, as Runge-Kutta of order 4 does: in a tick of a dog that turns at 3
    rad/s by micrometres (24 times as much as Runge-Kutta, which is Simpson's rule there). Its Jacobian is the
    transition matrix, with which P is carried over the step: P' = F P + P F^T integrated, instead of the
    continuous Jacobian that eq. 3.5 names.

    Args:
        state: (n, 1) symbols.
        derivative: (n, 1) dx/dt as expressions of them (eq. 3.7).

    Returns:
        the state after `time` (n, 1), and its derivative by the state (n, n).
    """
    term, factor, result = derivative, 1.0, state
    for k in range(1, order + 1):
        factor *= time / k
        result = result + factor * term
        term = ca.jacobian(term, state) @ derivative
        if term.is_zero():
            break
    return result, ca.jacobian(result, state)


@dataclass(frozen=True)
class Factors:
    """The covariance as U (n, n) unit upper triangular and D (n,)."""

    U: list[list[SX]]
    D: list[SX]

    @classmethod
    def unpack(cls, packed: SX, n: int) -> Factors:
        """From n(n+1)/2 elements: D, then U above its diagonal, row by row."""
        above = iter(packed[i] for i in range(n, packed.numel()))
        U = [[next(above) if j > i else ca.SX(float(i == j)) for j in range(n)] for i in range(n)]
        return cls(U, [packed[i] for i in range(n)])

    @classmethod
    def diagonal(cls, variances: Sequence[SX]) -> Factors:
        """Uncorrelated."""
        n = len(variances)
        return cls(
            [[ca.SX(float(i == j)) for j in range(n)] for i in range(n)], [ca.SX(v) for v in variances]
        )

    def pack(self) -> SX:
        """To n(n+1)/2 elements: D, then U above its diagonal, row by row."""
        n = len(self.D)
        return ca.vertcat(*self.D, *(self.U[i][j] for i in range(n) for j in range(i + 1, n)))

    def variance(self, i: int) -> SX:
        """P[i, i]."""
        n = len(self.D)
        return self.D[i] + sum(self.U[i][j] ** 2 * self.D[j] for j in range(i + 1, n))

    def predict(self, transition: SX, noise: Sequence[SX]) -> Factors:
        """P <- Phi P Phi^T + diag(noise) (eq. 3.5), by Thornton's weighted Gram-Schmidt."""
        n = len(self.D)
        left = ca.densify(transition) @ ca.vertcat(*(ca.horzcat(*row) for row in self.U))
        rows = [[left[i, j] for j in range(n)] + [ca.SX(float(i == j)) for j in range(n)] for i in range(n)]
        weights = [*self.D, *noise]
        U: list[list[SX]] = [[ca.SX(float(i == j)) for j in range(n)] for i in range(n)]
        D: list[SX] = [ca.SX(0)] * n
        for j in reversed(range(n)):
            weighted = [w * x for w, x in zip(weights, rows[j], strict=True)]
            D[j] = _dot(weighted, rows[j])
            for i in range(j):
                U[i][j] = _dot(weighted, rows[i]) / D[j]
                rows[i] = [a - U[i][j] * b for a, b in zip(rows[i], rows[j], strict=True)]
        return Factors(U, D)

    def correct(self, component: int, variance: SX) -> tuple[list[SX], Factors]:
        """One scalar measurement of a state component, sequentially (eq. 3.1, 3.3), by Bierman.

        Returns:
            the gain (n,), and the corrected covariance.
        """
        n = len(self.D)
        f = self.U[component]  # U^T h for the unit vector h
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
        return [k / alpha for k in gain], Factors(U, D)


def _dot(a: Sequence[SX], b: Sequence[SX]) -> SX:
    return sum((x * y for x, y in zip(a, b, strict=True)), ca.SX(0))
