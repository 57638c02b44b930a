"""Sine, cosine, atan2 and logarithm made of + - * /, floor, fabs, comparisons and selects.

No two platforms' libm agree to the last bit (newlib and glibc differ by up to 4 ulp). C printed from the
expressions below calls no libm at all, so with `-ffp-contract=off` it gives the same bits everywhere.

Largest error in ulp found over millions of points, double and float; operations as CasADi counts them,
with four for a select:

    function        domain                             error, ulp      operations
    sin             |x| <= 1e5 (double), 1e3 (float)   1.31   1.33     65    51
    cos             the same                           1.33   1.32     66    52; both together 75, 61
    atan2           finite                             1.91   1.83     87    71
    log             [2^-55, 2^24]                      0.80   0.83     67    58

Sources: range reduction after Cody and Waite, Software Manual for the Elementary Functions (1980); the sum in
log after fdlibm's e_log.c. The polynomials are our own: Remez exchange for the relative error, in 80 digits,
with the coefficients rounded one by one from the lowest and the remaining ones fitted again after each.

Three rules keep the bits the same in CasADi's evaluation and in the printed C:
- Every constant of the float version is a float32, so that the printer loses nothing by its `f`.
- CasADi evaluates a select as (c ? a : 0) + (!c ? b : 0), which turns -0.0 into 0.0, where C has c ? a : b.
  So nothing that could be -0.0, and would be seen to be, is selected.
- No sum is compensated (Kahan, Dekker): CasADi simplifies (a - b) + b to a while an expression is built.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from operator import truediv
from typing import Literal

from models.kit import casadi as ca

Precision = Literal["double", "float"]

LONG = 5  # terms of a polynomial, beyond which it is split
_KEPT_UNARY = ("NEG", "SQ", "TWICE", "INV", "SQRT", "FLOOR", "FABS", "NOT")
_KEPT_BINARY = ("ADD", "SUB", "MUL", "DIV", "LT", "LE", "EQ", "NE", "AND", "OR", "IF_ELSE_ZERO")


@dataclass(frozen=True)
class _Constants:
    """Numbers of one precision; polynomials from the lowest power up."""

    two_over_pi: float
    half_pi: tuple[float, ...]  # parts whose sum is pi/2; times a quadrant all but the last are exact
    sin: tuple[float, ...]  # sin r = r + r z P(z), z = r^2, |r| <= pi/4
    cos: tuple[float, ...]  # cos r = 1 - (z/2 - z^2 P(z)), same z
    quarter_pi: tuple[float, float]  # the first part ends in two zero bits: up to 4 times it is exact
    atan: tuple[float, ...]  # atan t = t + t z P(z), z = t^2, |t| <= 1/2
    ln2: tuple[float, float]  # the first part ends in six zero bits: up to 63 times it is exact
    log: tuple[float, ...]  # 2 atanh s = 2 s + s z P(z), z = s^2, |s| <= 5/27, that is (1+s)/(1-s) >= 11/16


# fmt: off
_CONSTANTS: dict[Precision, _Constants] = {
    "double": _Constants(
        two_over_pi=0.6366197723675814,
        half_pi=(  # down to 2^-36, 2^-53, 2^-90 and the rest
            1.5707963267923333, 2.5632829192545614e-12, 6.123233995707727e-17, 2.9038559739793605e-28,
        ),
        sin=(  # degree 5 in z, relative error of the sine 2^-56.6
            -0.1666666666666663, 0.008333333333321842, -0.00019841269829361637, 2.75573135403487e-06,
            -2.505073490870542e-08, 1.5895492662797351e-10,
        ),
        cos=(  # degree 5 in z, 2^-62.8
            0.041666666666666595, -0.0013888888888873342, 2.480158728900206e-05, -2.755731421702453e-07,
            2.0875705392766603e-09, -1.1358750370912657e-11,
        ),
        quarter_pi=(0.7853981633974483, 3.061616997868383e-17),
        atan=(  # degree 11 in z, 2^-57.6
            -0.3333333333333298, 0.19999999999903104, -0.1428571427638483, 0.11111110659570536,
            -0.09090896242930631, 0.07692073888775891, -0.06663810492127001, 0.05858299326735829,
            -0.05122015060043619, 0.041865559502231156, -0.02743625794378348, 0.0101181401666679,
        ),
        ln2=(0.693147180559933, 1.23466660414777e-14),
        log=(  # degree 6 in z, 2^-57.6
            0.6666666666666867, 0.39999999998511965, 0.2857142894448826, 0.22222177940717072,
            0.18184622443415485, 0.1528749056904829, 0.15055596955659034,
        ),
    ),
    "float": _Constants(
        two_over_pi=0.6366197466850281,
        half_pi=(  # down to 2^-13, 2^-24, 2^-38 and the rest
            1.5706787109375, 0.0001175999641418457, 1.5890691429376602e-08, 2.5633440682570896e-12,
        ),
        sin=(-0.16666655242443085, 0.008332189172506332, -0.0001951829035533592),  # degree 2, 2^-27.9
        cos=(0.04166664555668831, -0.0013887309469282627, 2.4432329155388288e-05),  # degree 2, 2^-33.0
        quarter_pi=(0.785398006439209, 1.5695823663008923e-07),
        atan=(  # degree 4, 2^-27.5
            -0.3333323299884796, 0.19994167983531952, -0.14174212515354156, 0.1015578955411911,
            -0.05124957114458084,
        ),
        ln2=(0.693145751953125, 1.428606765330187e-06),
        log=(0.6666684150695801, 0.3996928930282593, 0.30094990134239197),  # degree 2, 2^-29.3
    ),
}
# fmt: on


def sincos(x: ca.SX, precision: Precision) -> tuple[ca.SX, ca.SX]:
    """Return sine and cosine of `x` [rad], which share their range reduction; elementwise for matrices.

    Up to 1e5 rad (double) or 1e3 rad (float) the quadrant's number fits the bits that the parts of pi/2 leave
    free; beyond, the error grows with |x|. sin(-0.0) is 0.0. Where x rounds to the middle between two
    quadrants, sin(-x) may differ from -sin(x), and cos(-x) from cos(x), in the last bit.
    """
    constants = _CONSTANTS[precision]
    x = ca.if_else(x == 0, 0, x)  # no -0.0 from here on
    quadrant = ca.floor(x * constants.two_over_pi + 0.5)
    part1, part2, part3, part4 = (quadrant * part for part in constants.half_pi)
    exact = x - part1 - part2  # no rounding yet: a multiple of the last bit's 2^-53 (float 2^-24) below 1
    r = exact - part3 - part4
    z = r * r
    # Not r + ..., which would count r's rounding as well; part4 tells only next to a zero of the sine.
    sine = exact + (r * z * _polynomial(constants.sin, z) - part3) - part4
    cosine = 1 - (0.5 * z - z * z * _polynomial(constants.cos, z))

    turned = quadrant - 4 * ca.floor(0.25 * quadrant)  # by so many quarters of a turn, 0 to 3
    half, quarter = turned >= 2, ca.logic_or(turned == 1, turned == 3)
    sine, cosine = ca.if_else(quarter, cosine, sine), ca.if_else(quarter, -sine, cosine)
    return ca.if_else(half, -sine, sine), ca.if_else(half, -cosine, cosine)


def sin(x: ca.SX, precision: Precision) -> ca.SX:
    """Return the sine of `x` [rad]; see `sincos`."""
    return sincos(x, precision)[0]


def cos(x: ca.SX, precision: Precision) -> ca.SX:
    """Return the cosine of `x` [rad]; see `sincos`."""
    return sincos(x, precision)[1]


def atan2(y: ca.SX, x: ca.SX, precision: Precision) -> ca.SX:
    """Return the angle of the point (`x`, `y`) in (-pi, pi] [rad], with a single division.

    atan2(0, 0) is 0. A zero has no sign here: -0.0 counts as 0.0, so that atan2(-0.0, -1) is +pi.
    The coordinates must be finite and below half of the largest number.
    """
    constants = _CONSTANTS[precision]
    a, b = ca.fabs(x), ca.fabs(y)
    steep, left, below = a < b, x < 0, y < 0
    low, high = ca.if_else(steep, a, b), ca.if_else(steep, b, a)

    # Turn the steeper part of the octant back by pi/4: low - high is exact there, so t is good to an ulp.
    diagonal = 0.5 * high < low
    denominator = ca.if_else(diagonal, high + low, high)
    t = ca.if_else(diagonal, low - high, low) / ca.if_else(denominator == 0, 1, denominator)
    z = t * t
    residue = t + t * z * _polynomial(constants.atan, z)

    # Mirror at the diagonal, then at the y axis: the angle is eighths * pi/4 + residue.
    eighths = ca.if_else(diagonal, 1, 0)
    eighths, residue = ca.if_else(steep, 2 - eighths, eighths), ca.if_else(steep, -residue, residue)
    eighths, residue = ca.if_else(left, 4 - eighths, eighths), ca.if_else(left, -residue, residue)
    quarter_pi, rest = constants.quarter_pi
    return (1 - 2 * below) * (eighths * quarter_pi + (eighths * rest + residue))


def log(x: ca.SX, precision: Precision) -> ca.SX:
    """Return the natural logarithm of `x` in [2^-55, 2^24]; outside, the result is finite but wrong.

    Below 1 that covers every uniform number of 32 or 53 bits but zero (Box-Muller).
    """
    constants = _CONSTANTS[precision]
    # Scale x into [11/16, 11/8] by powers of two, which is exact and needs no frexp. A step up that is not
    # taken leaves at most `step` - 1 doublings to do, and the smaller steps add up to no less.
    large = x > 11 / 8
    x = x * (1 + large * (2.0**-24 - 1))
    exponent = 24 * large
    for step in (24, 16, 8, 4, 2, 1):
        small = x < 11 / 16 * 2.0 ** (1 - step)
        x = x * (1 + small * (2.0**step - 1))
        exponent = exponent - step * small

    f = x - 1
    s = f / (2 + f)
    z = s * s
    half_square = 0.5 * (f * f)
    ln2, rest = constants.ln2
    correction = s * (half_square + z * _polynomial(constants.log, z)) + exponent * rest
    return exponent * ln2 - ((half_square - correction) - f)


def lower(expressions: ca.SX, precision: Precision) -> ca.SX:
    """Return `expressions` with every sin, cos, tan, atan2 and log replaced by the functions above.

    Shape, sparsity and sharing stay; sines and cosines of the same node share their range reduction. sign
    becomes a difference of comparisons, fmin and fmax become selects: of two zeros with different signs, and
    of a number and a NaN, either may result. Constants stay as they are: rounding them to float32 is the
    printer's task. A function of a constant never arrives here, CasADi folds it when the model is written.

    Raises ValueError, naming the operation, for any other that C would print as a call (pow, exp, fmod, ...).
    """
    # The angle is kept with its pair, lest another node come to lie at its address, which is the hash.
    pairs: dict[int, tuple[ca.SX, tuple[ca.SX, ca.SX]]] = {}

    def shared_sincos(angle: ca.SX) -> tuple[ca.SX, ca.SX]:
        key = angle.element_hash()
        if key not in pairs:
            pairs[key] = angle, sincos(angle, precision)
        return pairs[key][1]

    codes = _codes()
    by_name: dict[str, Callable[..., ca.SX]] = {
        **{name: partial(ca.SX.unary, codes[name]) for name in _KEPT_UNARY},
        **{name: partial(ca.SX.binary, codes[name]) for name in _KEPT_BINARY},
        "SIN": lambda x: shared_sincos(x)[0],
        "COS": lambda x: shared_sincos(x)[1],
        "TAN": lambda x: truediv(*shared_sincos(x)),
        "ATAN2": partial(atan2, precision=precision),
        "LOG": partial(log, precision=precision),
        "FMIN": lambda a, b: ca.if_else(a < b, a, b),
        "FMAX": lambda a, b: ca.if_else(a < b, b, a),
        "SIGN": lambda a: (a > 0) - (a < 0),
    }
    builders = {codes[name]: builder for name, builder in by_name.items()}
    symbols = ca.symvar(expressions)
    function = ca.Function("lower", symbols, [expressions])
    registers: dict[int, ca.SX] = {}
    results = ca.SX(expressions)
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        sources, targets = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_INPUT:
            registers[targets[0]] = symbols[sources[0]]
        elif operation == ca.OP_CONST:
            registers[targets[0]] = ca.SX(function.instruction_constant(k))
        elif operation == ca.OP_OUTPUT:
            results.nz[targets[1]] = registers[sources[0]]
        elif operation in builders:
            registers[targets[0]] = builders[operation](*(registers[source] for source in sources))
        else:
            name = next(name for name, code in codes.items() if code == operation)
            raise ValueError(
                f"operation {name.lower()} would call libm, whose bits differ between platforms; "
                f"rewrite the equation with {', '.join(sorted(known.lower() for known in by_name))}"
            )
    return results


@cache
def _codes() -> dict[str, int]:
    """CasADi's operations by name."""
    return {name[3:]: getattr(ca, name) for name in dir(ca) if name.startswith("OP_")}


def _polynomial(coefficients: tuple[float, ...], z: ca.SX) -> ca.SX:
    """Evaluate a polynomial, lowest power first in `coefficients`.

    A long one pair by pair (Estrin): half as many steps wait for another, for a square or two more. A short
    one by Horner's rule: the onboard processors take one step at a time anyway.
    """
    values = [ca.SX(c) for c in coefficients]
    while len(values) > LONG:
        pairs = [a + z * b for a, b in zip(values[::2], values[1::2], strict=False)]
        values = pairs + values[len(pairs) * 2 :]
        z = z * z
    value = values[-1]
    for coefficient in reversed(values[:-1]):
        value = coefficient + z * value
    return value
