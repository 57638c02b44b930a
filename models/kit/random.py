"""Random numbers as part of the model: MRG32k3a, whose arithmetic is exact in doubles.

L'Ecuyer, "Good parameters and implementations for combined multiple recursive random number generators",
Operations Research 47 (1999); streams and substreams by skip-ahead as in L'Ecuyer et al., "An
object-oriented random-number package with many long streams and substreams", ibid. 50 (2002). A block's
parameter `seed` selects one of 2^31 streams that are 2^127 draws apart; within it each purpose has a
substream of its own, 2^76 draws apart, so that one more draw for one purpose shifts no other.
"""

from __future__ import annotations

import math
from functools import cache

from models.kit import casadi as ca
from models.kit.declaration import SUBSTREAMS, SX

M1, M2 = 4294967087, 4294944443
A1 = ((0, 1, 0), (0, 0, 1), (-810728, 1403580, 0))
A2 = ((0, 1, 0), (0, 0, 1), (-1370589, 0, 527612))
BASE = 12345  # every component of stream 0's first state
MAX_SEED = 2**31 - 1
STREAM_BITS, SUBSTREAM_BITS = 127, 76
STREAM_DIGITS, SUBSTREAM_DIGITS = (
    31,
    (SUBSTREAMS - 1).bit_length(),
)  # binary digits of a stream's and a substream's number
NORM = 1.0 / (M1 + 1)

Matrix = tuple[tuple[int, ...], ...]


def uniform(state: SX) -> tuple[SX, SX]:
    """One draw from U(0, 1), at least 2^-32 and below 1: (value, next state); `state` has 6 elements."""
    first = 1403580.0 * state[1] - 810728.0 * state[0]
    first = first - M1 * ca.floor(first / M1)
    second = 527612.0 * state[5] - 1370589.0 * state[3]
    second = second - M2 * ca.floor(second / M2)
    difference = first - second
    value = (difference + ca.if_else(difference <= 0, float(M1), 0.0)) * NORM
    return value, ca.vertcat(state[1], state[2], first, state[4], state[5], second)


def normal(state: SX) -> tuple[SX, SX]:
    """One draw from N(0, 1) by Box and Muller from two uniforms: (value, next state)."""
    radius, state = uniform(state)
    angle, state = uniform(state)
    return ca.sqrt(-2.0 * ca.log(radius)) * ca.cos(2.0 * math.pi * angle - math.pi), state


def normals(state: SX, count: int) -> tuple[list[SX], SX]:
    """`count` independent draws from N(0, 1), two from each pair of uniforms: (values, next state)."""
    values: list[SX] = []
    while len(values) < count:
        first, state = uniform(state)
        second, state = uniform(state)
        radius, angle = ca.sqrt(-2.0 * ca.log(first)), 2.0 * math.pi * second - math.pi
        values += [radius * ca.cos(angle), radius * ca.sin(angle)]
    return values[:count], state


def start_state(seed: int, substream: int) -> tuple[int, ...]:
    """The six numbers at which a substream of the stream `seed` begins."""
    state: tuple[int, ...] = ()
    for recurrence, modulus in ((A1, M1), (A2, M2)):
        jump = _multiply(
            _power(recurrence, seed << STREAM_BITS, modulus),
            _power(recurrence, substream << SUBSTREAM_BITS, modulus),
            modulus,
        )
        state += tuple(sum(row) * BASE % modulus for row in jump)
    return state


def jumps(bits: int, digits: int) -> tuple[tuple[Matrix, ...], tuple[Matrix, ...]]:
    """The matrices by which C jumps ahead, of both recurrences: for 2^bits, 2^(bits+1), ... draws."""
    first, second = (
        tuple(_power(a, 1 << (bits + k), m) for k in range(digits)) for a, m in ((A1, M1), (A2, M2))
    )
    return first, second


def _multiply(a: Matrix, b: Matrix, modulus: int) -> Matrix:
    return tuple(
        tuple(
            sum(x * y for x, y in zip(row, column, strict=True)) % modulus for column in zip(*b, strict=True)
        )
        for row in a
    )


@cache
def _power(matrix: Matrix, exponent: int, modulus: int) -> Matrix:
    result: Matrix = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    while exponent:
        if exponent & 1:
            result = _multiply(result, matrix, modulus)
        matrix = _multiply(matrix, matrix, modulus)
        exponent >>= 1
    return result
