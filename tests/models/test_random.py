"""MRG32k3a against L'Ecuyer's published numbers, exact integers and the independent package `mrg32k3a`."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mrg32k3a.mrg32k3a import MRG32k3a
from scipy import stats

from models.kit import random
from models.kit.elementary import lower
from models.kit.random import M1, M2, start_state
from models.system import SYSTEMS

DRAWS = 20_000

symbol = ca.SX.sym("state", 6)


def in_order(draw: Any, count: int) -> Any:
    """`count` draws in a row: state -> (values, last state), as the blocks compute them (no libm)."""
    values, state = draw(symbol)
    expressions = lower(
        ca.vertcat(ca.vertcat(*values) if isinstance(values, list) else values, state), "double"
    )
    return ca.Function("one", [symbol], [expressions[-6:], expressions[:-6]]).mapaccum(count)


UNIFORM = in_order(random.uniform, DRAWS)
NORMAL = in_order(random.normal, DRAWS)
TWELVE = in_order(lambda state: random.normals(state, 12), DRAWS // 12)


def draws(function: Any, state: tuple[int, ...]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    states, values = function(list(state))
    return np.array(values), np.array(states)


def exact_step(state: tuple[int, ...]) -> tuple[tuple[int, ...], float]:
    """The recurrence in Python's integers, as L'Ecuyer states it (1999, Fig. I)."""
    first = (1403580 * state[1] - 810728 * state[0]) % 4294967087
    second = (527612 * state[5] - 1370589 * state[3]) % 4294944443
    value = first - second if first > second else first - second + 4294967087
    return (state[1], state[2], first, state[4], state[5], second), value / 4294967088


def test_the_first_state_is_the_published_default() -> None:
    assert start_state(0, 0) == (12345,) * 6


def test_the_first_draws_are_the_published_ones() -> None:
    values, _ = draws(UNIFORM, start_state(0, 0))
    assert values[0, :2] == pytest.approx([0.12701112204657714, 0.3185275653967945], rel=1e-15)


def test_the_state_after_35_draws_is_the_published_one() -> None:
    """RngStreams' own test prints the state of its first stream after 2^5 + 3 steps."""
    _, states = draws(UNIFORM, start_state(0, 0))
    published = [1040577685, 3747037609, 277208355, 1712706441, 627445683, 2408037141]
    assert states[:, 34].tolist() == published


def test_streams_and_substreams_start_where_those_of_rngstreams_do() -> None:
    assert start_state(1, 0) == (3692455944, 1366884236, 2968912127, 335948734, 4161675175, 475798818)
    assert start_state(2, 0) == (1015873554, 1310354410, 2249465273, 994084013, 2912484720, 3876682925)
    assert start_state(0, 1) == (870504860, 2641697727, 884013853, 339352413, 2374306706, 3651603887)


def test_the_jump_matrices_are_those_of_rngstreams() -> None:
    (stream1, *_), (stream2, *_) = random.jumps(random.STREAM_BITS, 1)
    (substream1, *_), (substream2, *_) = random.jumps(random.SUBSTREAM_BITS, 1)
    assert substream1 == (
        (82758667, 1871391091, 4127413238),
        (3672831523, 69195019, 1871391091),
        (3672091415, 3528743235, 69195019),
    )
    assert substream2 == (
        (1511326704, 3759209742, 1610795712),
        (4292754251, 1511326704, 3889917532),
        (3859662829, 4292754251, 3708466080),
    )
    assert stream1 == (
        (2427906178, 3580155704, 949770784),
        (226153695, 1230515664, 3580155704),
        (1988835001, 986791581, 1230515664),
    )
    assert stream2 == (
        (1464411153, 277697599, 1610723613),
        (32183930, 1464411153, 1022607788),
        (2824425944, 32183930, 2093834863),
    )


def test_jumps_agree_with_the_independent_package() -> None:
    """Its streams are 2^141 draws apart, 2^14 of ours; its substreams 2^94, 2^18 of ours."""
    for stream, substream in ((1, 0), (0, 1), (3, 5)):
        theirs = MRG32k3a(s_ss_sss_index=[stream, substream, 0]).get_current_state()
        assert start_state(stream << 14, substream << 18) == theirs


@pytest.mark.parametrize(("seed", "substream"), [(0, 0), (1, 8), (2147483647, 9)])
def test_uniform_is_the_sequence_of_the_independent_package(seed: int, substream: int) -> None:
    state = start_state(seed, substream)
    theirs = MRG32k3a(ref_seed=state)  # type: ignore[arg-type]  # six numbers
    values, states = draws(UNIFORM, state)
    for k in range(2000):
        expected = theirs.random()
        assert states[:, k].tolist() == list(theirs.get_current_state())
        assert abs(values[0, k] - expected) <= math.ulp(expected)


first_half = st.integers(0, M1 - 1) | st.sampled_from([0, 1, M1 - 2, M1 - 1])
second_half = st.integers(0, M2 - 1) | st.sampled_from([0, 1, M2 - 2, M2 - 1])
ONE = ca.Function("one", [symbol], list(random.uniform(symbol)))


@settings(max_examples=500, deadline=None)
@given(st.tuples(first_half, first_half, first_half, second_half, second_half, second_half))
def test_doubles_carry_the_recurrence_exactly(state: tuple[int, ...]) -> None:
    value, following = ONE(list(state))
    exact_state, exact_value = exact_step(state)
    assert np.array(following).ravel().tolist() == list(exact_state)
    assert abs(float(value) - exact_value) <= math.ulp(exact_value)
    assert 2**-32 < float(value) <= math.nextafter(1 - 2**-32, 1)


@pytest.mark.parametrize("residue", [0, 1, M1 - 1])
def test_doubles_are_exact_where_the_quotient_is_largest_and_nearly_whole(residue: int) -> None:
    """Given the largest positive product, next to a multiple of the modulus, when reduced, then exactly."""
    inverse = pow(1403580, -1, M1)
    s1, s0 = max(((residue + 810728 * s0) * inverse % M1, s0) for s0 in range(20_000))
    assert (1403580 * s1 - 810728 * s0) / M1 > 1.4e6
    state = (s0, s1, 0, 1, 1, 1)
    assert exact_step(state)[0][2] == residue
    _, following = ONE(list(state))
    assert float(following[2]) == residue


def test_states_stay_whole_numbers_below_their_moduli() -> None:
    _, states = draws(UNIFORM, start_state(77, 3))
    assert np.array_equal(states, np.floor(states))
    assert states.min() >= 0
    assert states[:3].max() < M1
    assert states[3:].max() < M2


def test_uniform_is_uniform_and_uncorrelated() -> None:
    values, _ = draws(UNIFORM, start_state(11, 0))
    u = values[0]
    assert stats.kstest(u, "uniform").pvalue > 0.01
    assert stats.chisquare(np.histogram(u, 100, (0, 1))[0]).pvalue > 0.01
    pairs, _, _ = np.histogram2d(u[:-1:2], u[1::2], bins=10, range=[[0, 1], [0, 1]])
    assert stats.chisquare(pairs.ravel()).pvalue > 0.01


@pytest.mark.parametrize("function", [NORMAL, TWELVE], ids=["normal", "normals"])
def test_normal_has_mean_0_variance_1_and_the_tails_of_the_normal_distribution(function: Any) -> None:
    z = draws(function, start_state(12, 1))[0].ravel()
    n = z.size
    assert n > 19_000
    assert stats.ttest_1samp(z, 0).pvalue > 0.01
    assert 0.005 < stats.chi2.cdf((z**2).sum(), n) < 0.995
    assert stats.kstest(z, "norm").pvalue > 0.01
    assert stats.jarque_bera(z).pvalue > 0.01
    for bound in (2, 3):
        for tail in (z > bound, z < -bound):
            assert stats.binomtest(int(tail.sum()), n, stats.norm.sf(bound)).pvalue > 0.005


def test_the_twelve_draws_of_a_call_are_uncorrelated() -> None:
    z = draws(TWELVE, start_state(13, 1))[0]
    correlation = np.corrcoef(z)
    worst = max(abs(correlation[i, j]) for i, j in combinations(range(12), 2))
    assert worst < stats.norm.isf(0.001 / 66 / 2) / math.sqrt(z.shape[1])


def test_normal_is_box_and_muller_of_the_independent_uniforms() -> None:
    state = start_state(5, 5)
    theirs = MRG32k3a(ref_seed=state)  # type: ignore[arg-type]  # six numbers
    z, _ = draws(NORMAL, state)
    for k in range(1000):
        radius, angle = theirs.random(), theirs.random()
        expected = math.sqrt(-2 * math.log(radius)) * math.cos(2 * math.pi * angle - math.pi)
        assert z[0, k] == pytest.approx(expected, rel=1e-12, abs=1e-14)


def test_normal_stays_finite_at_both_ends_of_the_uniforms() -> None:
    """The largest magnitude is that of the smallest uniform, 1/(M1 + 1)."""
    radius = ca.SX.sym("u")
    f = ca.Function("radius", [radius], [lower(ca.sqrt(-2.0 * ca.log(radius)), "double")])
    assert float(f(random.NORM)) == pytest.approx(math.sqrt(2 * math.log(4294967088)), rel=1e-14)
    assert float(f(M1 * random.NORM)) == pytest.approx(math.sqrt(2 / 4294967088), rel=1e-6)


def test_substreams_do_not_overlap_within_ten_thousand_draws() -> None:
    """Plant's and sensors' substreams of some seeds: no state comes twice."""
    seen: set[tuple[float, ...]] = set()
    count = 0
    for seed in (0, 1, 2):
        for substream in range(12):
            _, states = draws(UNIFORM, start_state(seed, substream))
            seen.update(map(tuple, states[:, :10_000].T.tolist()))
            count += 10_000
    assert len(seen) == count


@pytest.mark.parametrize("name", SYSTEMS)
def test_no_two_streams_of_a_system_share_a_substream(name: str) -> None:
    """For equal seeds, plant and sensors must not draw the same numbers."""
    substreams = [s.substream for block in SYSTEMS[name].components.values() for s in block.streams()]
    assert len(substreams) >= 4
    assert len(set(substreams)) == len(substreams)
