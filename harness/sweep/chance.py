"""Tail probabilities and quantiles for comparing points; importing scipy.stats for them takes a second."""

from __future__ import annotations

import math
from functools import cache
from statistics import NormalDist

import numpy as np

EXACT = 1000  # tosses up to which a tail is counted in whole numbers
SUMMED = 2000  # degrees of freedom up to which Student's distribution is summed term by term


@cache
def heads(least: int, tosses: int) -> float:
    """The probability of at least so many heads in so many tosses of a fair coin."""
    if least <= 0:
        return 1.0
    if least > tosses:
        return 0.0
    if tosses <= EXACT:
        return sum(math.comb(tosses, k) for k in range(least, tosses + 1)) / (1 << tosses)
    if 2 * least <= tosses:
        return 1.0 - heads(tosses - least + 1, tosses)
    terms, k = [1.0], least  # as shares of the first term, which is the largest
    while terms[-1] > 1e-18 and k < tosses:
        terms.append(terms[-1] * (tosses - k) / (k + 1))
        k += 1
    return _exactly(least, tosses) * math.fsum(terms)


def _exactly(k: int, n: int) -> float:
    """The probability of k heads in n tosses, 2 k > n; no large logarithms are subtracted (Loader 2000)."""
    if k == n:
        return 0.5**n
    excess = 2 * k / n - 1
    if excess < 0.25:  # the logarithms below would cancel
        exponent = math.fsum(excess ** (2 * j) / (j * (2 * j - 1)) for j in range(1, 30))
    else:
        exponent = (1 + excess) * math.log1p(excess) + (1 - excess) * math.log1p(-excess)
    errors = _stirling_error(n) - _stirling_error(k) - _stirling_error(n - k)
    return math.sqrt(n / (2 * math.pi * k * (n - k))) * math.exp(errors - n / 2 * exponent)


def _stirling_error(n: int) -> float:
    """log n! less Stirling's approximation of it."""
    if n < 16:
        return math.log(math.factorial(n)) - (n + 0.5) * math.log(n) + n - 0.5 * math.log(2 * math.pi)
    return (1 / 12 - (1 / 360 - (1 / 1260 - (1 / 1680 - 1 / 1188 / n**2) / n**2) / n**2) / n**2) / n


@cache
def student(level: float, freedom: int) -> float:
    """The quantile of Student's t distribution; the level is from 0.9 to below 1."""
    t = NormalDist().inv_cdf(level)
    if freedom > SUMMED:
        return _cornish_fisher(t, freedom)
    while True:  # the tail is convex: Newton's steps rise to the root, until rounding ends them
        tail, density = _tail(t, freedom)
        step = (tail - (1 - level)) / density
        if not t + step > t:
            return t
        t += step


def _tail(t: float, freedom: int) -> tuple[float, float]:
    """The probability beyond t > 0 (half the incomplete beta function I_x(a, 1/2)), and the density at t."""
    a, x = freedom / 2, freedom / (freedom + t * t)
    if a < 150:
        ratio = math.gamma(a + 0.5) / math.gamma(a)
    else:
        ratio = math.sqrt(a) * math.exp((-1 / 8 + (1 / 192 - 1 / 640 / a**2) / a**2) / a)
    density = ratio / math.sqrt(freedom * math.pi) * x ** (a + 0.5)
    n = np.arange(math.ceil(-40 / math.log(x)))  # then the terms are below 1e-17
    series = 1.0 + math.fsum(np.cumprod((a + 0.5 + n) / (a + 1 + n) * x))
    return density * t / freedom * series, density


def _cornish_fisher(z: float, freedom: int) -> float:
    """The quantile for many degrees of freedom: Abramowitz and Stegun 26.7.5."""
    terms = (
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160,
    )
    return z + math.fsum(term / freedom**power for power, term in enumerate(terms, start=1))
