"""The noise that makes the innovations most likely, and how well a recording determines it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import optimize, stats

from harness.tune.likelihood import Filter, Tuned

Array = npt.NDArray[np.float64]

DECADES = (-7.0, 4.0)  # of every noise: log10 of its value in SI
STARTS = (0.0, 1.0)  # decades by which the process noise of a search's start differs from the declared one
LEVEL = 0.95  # of the intervals
STEP = 0.05  # decades, the first step of a search for an interval's end
RESTARTS = 8  # of the search, where a profile finds a likelihood above the maximum
TOLERANCE = 0.01  # of log-likelihood: what a search leaves of it
WORST = 1e12  # the loss of noises whose likelihood is no number
SECANTS = 2  # steps between a value inside an interval and one outside


@dataclass(frozen=True)
class Fitted:
    """A noise as fitted.

    Attributes:
        value: the most likely one, in SI.
        low, high: ends of its profile likelihood's interval; 0 and infinity where there is no limit.
        profile: value -> twice the loss of log-likelihood there, of the points that were looked at.
    """

    value: float
    low: float
    high: float
    profile: dict[float, float]


class Fit:
    """Maximum likelihood over the fixes from `start` to `end` [s] of a recording.

    Attributes:
        noises: the fitted noises, in the order of `tuned.noises`.
        log_likelihood: at the maximum.
        settled: no profile finds a likelihood above it; else the intervals mean little.
    """

    def __init__(
        self,
        ekf: Filter,
        tuned: Tuned,
        start: float,
        end: float,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        self._filter, self._tuned, self._start, self._end = ekf, tuned, start, end
        self._ticks = int(np.ceil(end / ekf.block.sample_time)) + 1
        first = np.log10([noise.start for noise in tuned.noises])
        process = np.array([noise.name.startswith("sigma_") for noise in tuned.noises])
        searches = [self._search(first + more * process) for more in STARTS]
        best = min(searches, key=lambda search: search[1])
        best = self._search(best[0])
        for _ in range(RESTARTS):
            self._lowest = best
            self.noises = self._intervals(best, progress)
            self.settled = self._lowest[1] >= best[1] - TOLERANCE
            if self.settled:
                break
            best = self._search(self._lowest[0])
        self.log_likelihood = -best[1]
        self.fixes = len(ekf.innovations(self.parameters, self._ticks).between(start, end).time)

    @property
    def parameters(self) -> dict[str, float]:
        """The estimator's parameters as fitted."""
        return self._tuned.parameters([noise.value for noise in self.noises])

    def loss(self, decades: Array) -> float:
        """Minus the log-likelihood of noises given by their log10; `WORST` where it is no number."""
        innovations = self._filter.innovations(self._tuned.parameters((10.0**decades).tolist()), self._ticks)
        loss = -float(innovations.between(self._start, self._end).log_likelihood.sum())
        return loss if np.isfinite(loss) else WORST

    def _search(self, first: Array, held: int | None = None) -> tuple[Array, float]:
        """The least loss from a start; one noise may be held."""
        free = np.array([j for j in range(len(first)) if j != held], dtype=int)
        point = np.clip(first, *DECADES)

        def loss(values: Array) -> float:
            moved = point.copy()
            moved[free] = values
            return self.loss(moved)

        if not free.size:
            return point, self.loss(point)
        options = {"maxiter": 60, "eps": 1e-4, "ftol": 1e-8 if held is None else 1e-6}
        result = optimize.minimize(
            loss, point[free], method="L-BFGS-B", bounds=[DECADES] * len(free), options=options
        )
        point[free] = result.x
        return point, float(result.fun)

    def _intervals(self, best: tuple[Array, float], progress: Callable[[float], None] | None) -> list[Fitted]:
        noises = []
        for j in range(len(best[0])):
            noises.append(self._interval(j, *best))
            if progress:
                progress(100 * (j + 1) / len(best[0]))
        return noises

    def _interval(self, j: int, best: Array, least: float) -> Fitted:
        """The profile likelihood's interval of a noise: where the others cannot make up for it."""
        limit = float(np.sqrt(stats.chi2.ppf(LEVEL, 1)))
        profile = {float(10.0 ** best[j]): 0.0}

        def root_of_loss(decade: float, start: Array) -> tuple[float, Array]:
            """The root of twice the loss, which grows evenly with a normal likelihood; the others."""
            moved = start.copy()
            moved[j] = decade
            point, value = self._search(moved, held=j)
            if value < self._lowest[1]:
                self._lowest = point, value
            profile[float(10.0**decade)] = twice = 2 * (value - least)
            return float(np.sqrt(max(0.0, twice))), point

        ends = []
        for side in (-1, 1):
            inside, loss_inside, step, point = float(best[j]), 0.0, STEP, best
            while True:
                outside = float(np.clip(inside + side * step, *DECADES))
                loss_outside, moved = root_of_loss(outside, point)
                if loss_outside > limit or outside in DECADES:
                    break
                inside, loss_inside, step, point = outside, loss_outside, 2 * step, moved
            if loss_outside <= limit:
                ends.append(0.0 if side < 0 else np.inf)
                continue
            for _ in range(SECANTS):
                between = inside + (outside - inside) * (limit - loss_inside) / (loss_outside - loss_inside)
                loss, _ = root_of_loss(between, point)
                if loss > limit:
                    outside, loss_outside = between, loss
                else:
                    inside, loss_inside = between, loss
            between = inside + (outside - inside) * (limit - loss_inside) / (loss_outside - loss_inside)
            ends.append(float(10.0**between))
        return Fitted(float(10.0 ** best[j]), ends[0], ends[1], dict(sorted(profile.items())))
