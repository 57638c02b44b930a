"""What an estimator says about itself: its innovations, what it expects of them, and its covariance.

A filter that knows its noise has innovations that are white and as large as it states (3.2). The normalized
innovation squared (NIS) of a fix is then chi-square distributed, with as many degrees of freedom as the fix
has values, and the normalized estimation error squared (NEES) with as many as there are states (Bar-Shalom,
Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 5.4).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

from models.estimator import Estimator
from models.kit.ekf import UNUSED
from models.kit.timing import TICK

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Innovations:
    """The innovations of accepted fixes.

    Attributes:
        time: of each fix (f,) s.
        values: (f, m), one after the other as the filter takes them; their units are the measurements'.
        variances: what the filter expects of them (f, m).
    """

    time: Array
    values: Array
    variances: Array

    @property
    def used(self) -> npt.NDArray[np.bool_]:
        """Which of the values the fix had (f, m): at rest, for one, it has no course."""
        return np.asarray(self.variances < UNUSED / 2)

    @property
    def freedom(self) -> float:
        """Values of a fix on average, which NIS is expected to be."""
        return float(self.used.sum(axis=1).mean())

    @property
    def whitened(self) -> Array:
        """Each by its stated deviation (f, m): independent and normal in a filter that knows its noise.

        It is 0 where the fix lacks the value.
        """
        return np.where(self.used, self.values / np.sqrt(self.variances), 0.0)

    @property
    def nis(self) -> Array:
        """The normalized innovation squared of each fix (f,), `freedom` on average."""
        return np.asarray((self.whitened**2).sum(axis=1))

    @property
    def log_likelihood(self) -> Array:
        """Of each fix (f,): the logarithm of the density that the filter gave it beforehand."""
        logarithms = np.where(self.used, np.log(2 * np.pi * self.variances), 0.0)
        return np.asarray(-0.5 * (self.nis + logarithms.sum(axis=1)))

    def between(self, start: float, end: float) -> Innovations:
        """Those with start <= time < end [s]."""
        inside = (self.time >= start) & (self.time < end)
        return Innovations(self.time[inside], self.values[inside], self.variances[inside])


def observed(block: type[Estimator], component: str = "", innovations_only: bool = False) -> list[str]:
    """The states that are read here, of the block as a component of a system; its title by default."""
    states = ("innovation", "innovation_variance", *(() if innovations_only else ("x", "covariance")))
    names = [name for state in states for name in _flat(block, state)]
    return [f"{component or block.title()}.{name}" for name in ("accepted", *names)]


def innovations_of(block: type[Estimator], run: Mapping[str, Array], component: str = "") -> Innovations:
    """The innovations of a run, which has the observed states by name, (ticks,) each."""
    accepted = np.flatnonzero(run[f"{component or block.title()}.accepted"] > 0)
    return Innovations(
        np.asarray(accepted * TICK, dtype=np.float64),
        _columns(block, run, component, "innovation")[accepted],
        _columns(block, run, component, "innovation_variance")[accepted],
    )


def state_of(block: type[Estimator], run: Mapping[str, Array], component: str = "") -> Array:
    """The state (ticks, n) of a run."""
    return _columns(block, run, component, "x")


def covariance_of(block: type[Estimator], run: Mapping[str, Array], component: str = "") -> Array:
    """P = U D U^T (ticks, n, n) of a run, in the order of the state."""
    packed, order = _columns(block, run, component, "covariance"), list(block.order)
    n = len(order)
    U = np.broadcast_to(np.eye(n), (len(packed), n, n)).copy()
    U[(slice(None), *np.triu_indices(n, 1))] = packed[:, n:]
    P = np.empty_like(U)
    P[:, np.array(order)[:, None], np.array(order)] = (U * packed[:, None, :n]) @ U.transpose(0, 2, 1)
    return P


def nees(errors: Array, covariances: Array) -> Array:
    """The normalized estimation error squared (k,) of errors (k, n) with covariances (k, n, n)."""
    return np.asarray(np.einsum("ki,ki->k", errors, np.linalg.solve(covariances, errors[..., None])[..., 0]))


def mean_bounds(freedom: float, number: int, level: float = 0.95) -> tuple[float, float]:
    """Where the mean of so many independent chi-square values lies with a probability.

    Args:
        freedom: of each, on average.
    """
    low, high = stats.chi2.interval(level, freedom * number)
    return float(low / number), float(high / number)


def autocorrelation(whitened: Array, lags: int) -> Array:
    """Of each value's own series (f, m), without removing its mean, averaged over the values: (lags,).

    A value that no fix has, such as the course of an animal that stands, does not count.
    """
    known = whitened[:, (whitened != 0).any(axis=0)]
    power = (known**2).sum(axis=0)
    products = [(known[lag:] * known[:-lag]).sum(axis=0) / power for lag in range(1, lags + 1)]
    return np.asarray(np.mean(products, axis=1))


def _flat(block: type[Estimator], state: str) -> list[str]:
    return list(block.variables()[state].flat_names)


def _columns(block: type[Estimator], run: Mapping[str, Array], component: str, state: str) -> Array:
    return np.column_stack([run[f"{component or block.title()}.{name}"] for name in _flat(block, state)])
