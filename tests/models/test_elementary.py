"""The elementary functions against numpy's long double (for double) and double (for float).

`evaluate` executes an expression operation by operation in the precision's own type, as the printed C does.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from models.kit import elementary
from models.kit.elementary import Precision

Array = np.ndarray[Any, Any]

KIND: dict[Precision, Any] = {"double": np.float64, "float": np.float32}
WIDER: dict[Precision, Any] = {"double": np.longdouble, "float": np.float64}
LARGEST_ANGLE: dict[Precision, float] = {"double": 1e5, "float": 1e3}
POINTS = 200_000

LONG_DOUBLE_IS_WIDER = np.finfo(np.longdouble).nmant >= 63
needs_long_double = pytest.mark.skipif(not LONG_DOUBLE_IS_WIDER, reason="long double is double here")
both = pytest.mark.parametrize("precision", ["double", "float"])
both_measured = pytest.mark.parametrize(
    "precision", [pytest.param("double", marks=needs_long_double), "float"]
)

NAMES = {getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")}
OPERATIONS: dict[str, Callable[..., Array]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "sq": np.square,
    "twice": lambda a: a + a,
    "inv": lambda a: a.dtype.type(1) / a,
    "sqrt": np.sqrt,
    "floor": np.floor,
    "fabs": np.abs,
    "lt": np.less,
    "le": np.less_equal,
    "eq": np.equal,
    "ne": np.not_equal,
    "not": np.logical_not,
    "and": np.logical_and,
    "or": np.logical_or,
    "if_else_zero": lambda c, a: np.where(c != 0, a, a.dtype.type(0)),
}

x, y = ca.SX.sym("x"), ca.SX.sym("y")

SINCOS = {p: ca.vertcat(*elementary.sincos(x, p)) for p in KIND}
ATAN2 = {p: elementary.atan2(y, x, p) for p in KIND}
LOG = {p: elementary.log(x, p) for p in KIND}


def in_casadi(expression: Any) -> Any:
    return ca.Function("f", [x, y], [expression])


def count(expression: Any) -> Counter[str]:
    function = in_casadi(expression)
    names = (NAMES[function.instruction_id(k)] for k in range(function.n_instructions()))
    return Counter(name for name in names if name not in ("input", "output", "const"))


def constants(expression: Any) -> list[float]:
    function = in_casadi(expression)
    steps = range(function.n_instructions())
    return [function.instruction_constant(k) for k in steps if function.instruction_id(k) == ca.OP_CONST]


def evaluate(expression: Any, precision: Precision, x_values: Any, y_values: Any = 0.0) -> list[Array]:
    """Every element of `expression` at the points, each operation rounded to the precision."""
    kind = KIND[precision]
    points = [np.array(values, kind) for values in np.broadcast_arrays(x_values, y_values)]
    function = in_casadi(expression)
    registers: dict[int, Array] = {}
    results: dict[int, Array] = {}
    for k in range(function.n_instructions()):
        name = NAMES[function.instruction_id(k)]
        sources, targets = function.instruction_input(k), function.instruction_output(k)
        if name == "input":
            registers[targets[0]] = points[sources[0]]
        elif name == "const":
            registers[targets[0]] = np.full(points[0].shape, function.instruction_constant(k), kind)
        elif name == "output":
            results[targets[1]] = registers[sources[0]]
        else:
            registers[targets[0]] = OPERATIONS[name](*(registers[s] for s in sources)).astype(kind)
    return [results[k] for k in sorted(results)]


def largest_error(values: Array, exact: Array) -> float:
    """In ulp of the exact result, which comes in a wider type than the values."""
    ulp = np.spacing(np.abs(exact).astype(values.dtype)).astype(exact.dtype)
    return float(np.max(np.abs(values.astype(exact.dtype) - exact) / ulp))


def uniform(low: float, high: float, precision: Precision, seed: int = 1) -> Array:
    return np.random.default_rng(seed).uniform(low, high, POINTS).astype(KIND[precision])


@both_measured
@pytest.mark.parametrize("share_of_range", [1e-5, 4e-3, 1.0])
def test_sine_and_cosine_err_by_less_than_1_35_ulp(precision: Precision, share_of_range: float) -> None:
    largest = share_of_range * LARGEST_ANGLE[precision]
    angles = uniform(-largest, largest, precision)
    sine, cosine = evaluate(SINCOS[precision], precision, angles)
    exact = angles.astype(WIDER[precision])
    assert largest_error(sine, np.sin(exact)) < 1.35
    assert largest_error(cosine, np.cos(exact)) < 1.35


@needs_long_double
@both
def test_next_to_every_zero_the_range_reduction_loses_nothing(precision: Precision) -> None:
    # given the number nearest to each multiple of pi/2: the range reduction cancels almost all of its bits
    quadrants = np.arange(1, LARGEST_ANGLE[precision] // (np.pi / 2) + 1)
    half_pi = np.longdouble(np.pi / 2) + np.longdouble(6.123233995736766e-17)
    angles = (quadrants * half_pi).astype(KIND[precision])
    sine, cosine = evaluate(SINCOS[precision], precision, angles)
    exact = angles.astype(np.longdouble)
    odd = quadrants % 2 == 1
    assert largest_error(cosine[odd], np.cos(exact[odd])) < 0.6
    assert largest_error(sine[~odd], np.sin(exact[~odd])) < 0.6


@both_measured
@pytest.mark.parametrize("decades", [0, 3, 12])
def test_atan2_errs_by_less_than_2_ulp(precision: Precision, decades: int) -> None:
    angle = np.random.default_rng(2).uniform(-np.pi, np.pi, POINTS)
    size_x, size_y = 10 ** np.random.default_rng(3).uniform(-decades, decades, (2, POINTS))
    xs = (size_x * np.cos(angle)).astype(KIND[precision])
    ys = (size_y * np.sin(angle)).astype(KIND[precision])
    (result,) = evaluate(ATAN2[precision], precision, xs, ys)
    assert largest_error(result, np.arctan2(ys.astype(WIDER[precision]), xs.astype(WIDER[precision]))) < 2.0


@both_measured
@pytest.mark.parametrize(("low", "high"), [(-55, 24), (-32, 0), (-1, 0), (-0.01, 0.01)])
def test_log_errs_by_less_than_0_85_ulp(precision: Precision, low: float, high: float) -> None:
    values = np.exp2(uniform(low, high, "double")).astype(KIND[precision])
    values = values[values != 1]  # where it is exactly 0, see below
    (result,) = evaluate(LOG[precision], precision, values)
    assert largest_error(result, np.log(values.astype(WIDER[precision]))) < 0.85


@both
def test_zero_and_one_give_exact_results_without_negative_zeros(precision: Precision) -> None:
    sine, cosine = evaluate(SINCOS[precision], precision, [0.0, -0.0])
    assert sine.tolist() == [0.0, 0.0]
    assert not np.signbit(sine).any()
    assert cosine.tolist() == [1.0, 1.0]
    (logarithm,) = evaluate(LOG[precision], precision, [1.0])
    assert logarithm.tolist() == [0.0]
    (origin,) = evaluate(ATAN2[precision], precision, [0.0, -0.0, 0.0, -0.0], [0.0, 0.0, -0.0, -0.0])
    assert origin.tolist() == [0.0] * 4
    assert not np.signbit(origin).any()


@both
def test_atan2_on_axes_and_diagonals_is_the_angle_rounded(precision: Precision) -> None:
    eighths = {
        (1, 0): 0,
        (1, 1): 1,
        (0, 1): 2,
        (-1, 1): 3,
        (-1, 0): 4,
        (-1, -1): -3,
        (0, -1): -2,
        (1, -1): -1,
    }
    xs, ys = np.array(list(eighths)).T * 0.3
    (result,) = evaluate(ATAN2[precision], precision, xs, ys)
    assert result.tolist() == [KIND[precision](n * np.pi / 4) for n in eighths.values()]


@both
def test_atan2_takes_negative_zero_for_zero_and_stays_within_pi(precision: Precision) -> None:
    pi = KIND[precision](np.pi)
    (behind,) = evaluate(ATAN2[precision], precision, [-1.0] * 4, [0.0, -0.0, 1e-30, -1e-30])
    assert behind.tolist() == [pi, pi, pi, -pi]
    (all_around,) = evaluate(
        ATAN2[precision], precision, uniform(-1, 0, precision), uniform(-1e-6, 1e-6, precision)
    )
    assert np.abs(all_around).max() <= pi


@both
def test_sine_is_odd_and_cosine_even_to_the_bit(precision: Precision) -> None:
    angles = uniform(0, 4, precision)
    sine, cosine = evaluate(SINCOS[precision], precision, angles)
    mirrored_sine, mirrored_cosine = evaluate(SINCOS[precision], precision, -angles)
    assert np.count_nonzero(mirrored_sine != -sine) == 0
    assert np.count_nonzero(mirrored_cosine != cosine) == 0


def test_far_out_mirrored_angles_differ_at_most_where_two_quadrants_meet() -> None:
    # given angles so large that x 2/pi + 1/2 may round to an integer, which floor takes upwards on both sides
    angles = uniform(0, 1000, "float")
    pair = np.array(evaluate(SINCOS["float"], "float", angles))
    mirrored = np.array(evaluate(SINCOS["float"], "float", -angles)) * [[-1], [1]]
    assert np.count_nonzero(mirrored != pair) <= 20
    assert np.abs(mirrored - pair).max() <= 2**-23


@both
def test_atan2_is_odd_in_y_to_the_bit(precision: Precision) -> None:
    xs, ys = uniform(-1, 1, precision, seed=4), uniform(-1, 1, precision, seed=5)
    (result,) = evaluate(ATAN2[precision], precision, xs, ys)
    (mirrored,) = evaluate(ATAN2[precision], precision, xs, -ys)
    assert np.count_nonzero(mirrored != -result) == 0


@both
def test_no_result_leaves_its_interval(precision: Precision) -> None:
    largest = LARGEST_ANGLE[precision]
    sine, cosine = evaluate(SINCOS[precision], precision, uniform(-largest, largest, precision))
    assert max(np.abs(sine).max(), np.abs(cosine).max()) <= 1.0
    (logarithm,) = evaluate(LOG[precision], precision, uniform(2**-32, 1, precision))
    assert logarithm.max() <= 0.0  # the square root in Box and Muller's formula


@both
def test_not_a_number_and_infinity_do_not_pass_for_angles(precision: Precision) -> None:
    with np.errstate(invalid="ignore"):
        sine, cosine = evaluate(SINCOS[precision], precision, [np.nan, np.inf, -np.inf])
    assert np.isnan(sine).all()
    assert np.isnan(cosine).all()


def test_every_constant_of_the_float_version_is_a_float32() -> None:
    used = constants(ca.vertcat(SINCOS["float"], ATAN2["float"], LOG["float"]))
    assert [c for c in used if float(np.float32(c)) != c] == []
    assert len(used) > 30


@pytest.mark.parametrize(
    ("precision", "sincos", "sin", "atan2", "log"), [("double", 75, 65, 87, 67), ("float", 61, 51, 71, 58)]
)
def test_operations_are_as_many_as_documented(
    precision: Precision, sincos: int, sin: int, atan2: int, log: int
) -> None:
    assert count(SINCOS[precision]).total() == sincos
    assert count(elementary.sin(x, precision)).total() == sin
    assert count(elementary.cos(x, precision)).total() == sin + 1
    assert count(ATAN2[precision]).total() == atan2
    assert count(ATAN2[precision])["div"] == 1
    assert count(LOG[precision]).total() == log


@both
def test_casadi_evaluates_to_the_bits_of_the_separate_operations(precision: Precision) -> None:
    everything = ca.vertcat(SINCOS[precision], ATAN2[precision], LOG[precision])
    xs, ys = uniform(0.01, 5, "double")[:1000], uniform(-5, 5, "double", seed=6)[:1000]
    ours = np.array(evaluate(everything, "double", xs, ys))
    casadi = np.array(in_casadi(everything).map(1000)(xs[None, :], ys[None, :]))
    assert np.count_nonzero(ours != casadi) == 0


MIXED = ca.sparsify(
    ca.vertcat(
        ca.horzcat(ca.sin(x) * ca.cos(y), 0, ca.atan2(y - 1, x)),
        ca.horzcat(ca.if_else(x < y, ca.log(x), -ca.tan(0.1 * x)), ca.sqrt(ca.fabs(x * y)) / (1 + x**2), 0),
        ca.horzcat(ca.fmin(x, y) + ca.fmax(2 * x, y), ca.sign(y), ca.logic_and(x <= 2, ca.logic_not(x == y))),
    )
)


def test_lowered_expression_agrees_with_casadi_and_keeps_its_sparsity() -> None:
    lowered = elementary.lower(MIXED, "double")
    assert lowered.sparsity() == MIXED.sparsity()
    assert set(count(lowered)) <= set(OPERATIONS)
    both_ways = in_casadi(ca.horzcat(MIXED, lowered))
    for point in np.random.default_rng(7).uniform((0.01, -3), (3, 3), (200, 2)):
        theirs, ours = np.hsplit(np.array(both_ways(*point)), 2)
        np.testing.assert_allclose(ours, theirs, rtol=2e-15, atol=0)


def test_lowering_keeps_everything_else_as_it_is() -> None:
    kept = ca.vertcat(
        x + y,
        x - y,
        0.5 * x,
        x / y,
        -x,
        x * x,
        2 * x,
        1 / x,
        ca.sqrt(x),
        ca.floor(x),
        ca.fabs(x),
        x < y,
        x <= y,
    )
    kept = ca.vertcat(
        kept, x == y, x != y, ca.logic_not(x), ca.logic_and(x, y), ca.logic_or(x, y), ca.if_else(x, y, 0)
    )
    assert len(count(kept)) == len(OPERATIONS)
    assert str(elementary.lower(kept, "double")) == str(kept)


@both
def test_lowered_float_selects_and_signs(precision: Precision) -> None:
    lowered = elementary.lower(ca.vertcat(ca.fmin(x, y), ca.fmax(x, y), ca.sign(x)), precision)
    low, high, sign = evaluate(lowered, precision, [1.0, -2.0, 0.0], [3.0, -5.0, 0.0])
    assert low.tolist() == [1.0, -5.0, 0.0]
    assert high.tolist() == [3.0, -2.0, 0.0]
    assert sign.tolist() == [1.0, -1.0, 0.0]


@both
def test_sine_cosine_and_tangent_of_one_node_share_their_range_reduction(precision: Precision) -> None:
    angle = x + y
    lowered = elementary.lower(ca.vertcat(ca.sin(angle), ca.cos(angle), ca.tan(angle)), precision)
    expected = count(SINCOS[precision]) + Counter({"add": 1, "div": 1})
    assert count(lowered) == expected


def test_shared_nodes_stay_shared() -> None:
    root = ca.sqrt(ca.fabs(x * y))
    chain = root
    for _ in range(20):  # a tree of 2^20 leaves if sharing were lost
        chain = chain * chain + root / chain
    assert count(elementary.lower(chain, "double")) == count(chain)


@pytest.mark.parametrize(
    ("expression", "name"),
    [
        (ca.exp(x), "exp"),
        (x**y, "pow"),
        (x**1.5, "constpow"),
        (ca.fmod(x, y), "fmod"),
        (ca.asin(x), "asin"),
        (ca.ceil(x), "ceil"),
    ],
)
def test_other_operations_are_refused_by_name(expression: Any, name: str) -> None:
    with pytest.raises(
        ValueError, match=rf"^operation {name} would call libm, .*rewrite the equation with .*sqrt"
    ):
        elementary.lower(ca.vertcat(x, ca.sin(y) + expression), "double")


def test_constants_and_empty_expressions_pass() -> None:
    assert str(elementary.lower(ca.SX([1, 2]), "float")) == "[1, 2]"
    assert elementary.lower(ca.SX(0, 3), "double").shape == (0, 3)
