"""Every estimator: transition, textbook filter, a million ticks in float32, bad input; what each adds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.canine_ahrs import CanineAhrs
from models.kit.block import Block
from models.kit.elementary import lower
from models.kit.model import Model
from models.seven_state import TUNINGS, SevenState
from models.six_state import SixState
from models.system import ESTIMATORS
from models.two_bias import TwoBias
from tests.models.motions import (
    DECLINATION,
    FIELD,
    Array,
    Columns,
    G,
    T,
    motion,
    noisy,
    run_in_circles,
    walk,
    without_fixes,
)

Make = Callable[..., Any]
long, complex_long = np.longdouble, np.clongdouble
WIDE = np.finfo(long).nmant >= 63

EACH = pytest.mark.parametrize("name", ESTIMATORS)
EACH_BOTH = pytest.mark.parametrize(
    ("name", "precision"), [(n, p) for n, block in ESTIMATORS.items() for p in block.precisions]
)


def measured(inputs: Columns, seed: int) -> Columns:
    """With noise on every sensor."""
    rng = np.random.default_rng(seed)
    n = len(inputs["accel_x"])
    extra = {
        "gyro_z": 0.02,
        "gps_course": 0.05,
        "mag_x": 1e-6,
        "mag_y": 1e-6,
        "roll_meas": 0.1,
        "pitch_meas": 0.1,
    }
    return noisy(inputs, seed) | {name: inputs[name] + rng.normal(0, sd, n) for name, sd in extra.items()}


def vectors(out: Columns, name: str) -> Array:
    """(ticks, size) of a vector state."""
    return np.column_stack([out[n] for n in out if n.startswith(f"{name}[")])


def dense(name: str, packed: Array) -> Array:
    """P in the order of the state from its packed factors: D, then U by rows."""
    order = list(ESTIMATORS[name].order)
    n = len(order)
    U = np.eye(n, dtype=long)
    U[np.triu_indices(n, 1)] = packed[n:]
    P = np.empty((n, n), dtype=long)
    P[np.ix_(order, order)] = U @ np.diag(packed[:n].astype(long)) @ U.T
    return P


# The equations


def four_states(x: Any, force: float, heading: float) -> Any:
    """Eq. 3.10-3.12."""
    return [force - x[1], 0, x[0] * np.cos(heading), x[0] * np.sin(heading)]


def six_states(x: Any, force: float, rate: float) -> Any:
    """Eq. B.2-B.5."""
    return [force - x[1], 0, rate - x[3], 0, x[0] * np.cos(x[2]), x[0] * np.sin(x[2])]


def seven_states(x: Any, force: float, rate: float) -> Any:
    """Eq. C.1, C.2 with the scale factors taken already, B.4, B.5."""
    return [*six_states(x, force, rate), 0]


CONTINUOUS = {
    "four_state": four_states, "two_bias": four_states, "six_state": six_states, "seven_state": seven_states,
}  # fmt: skip


def integrated(name: str, x: Any, force: float, other: float, steps: int = 8) -> Array:
    """Runge-Kutta of order 4 over a tick, independent of CasADi; takes complex states."""
    x, h = np.array(x), T / steps

    def f(x: Array) -> Array:
        return np.array(CONTINUOUS[name](x, force, other))

    for _ in range(steps):
        k1 = f(x)
        k2 = f(x + h / 2 * k1)
        k3 = f(x + h / 2 * k2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(x + h * k3))
    return np.asarray(x)


def complex_step(f: Callable[[Array], Array], x: Array, kind: Any = np.complex128) -> Array:
    """df/dx, exact to rounding."""
    h = 1e-40
    columns = [f(x.astype(kind) + 1j * h * np.eye(len(x), dtype=kind)[i]).imag / h for i in range(len(x))]
    return np.array(columns).T


def propagation(name: str) -> Any:
    """(x, acceleration, heading or turn rate) -> (x a tick later, transition), as the block computes it."""
    block = ESTIMATORS[name]
    symbols = {v.name: ca.SX.sym(v.name, v.width) for v in block.variables().values()}
    after, transition = block(symbols, set())._propagate()
    other = symbols["held_heading" if "held_heading" in symbols else "turn_rate"]
    both = lower(ca.horzcat(after, ca.densify(transition)), "double")
    return ca.Function("f", [symbols["x"], symbols["acceleration"], other], [both[:, 0], both[:, 1:]])


PROPAGATION = {name: propagation(name) for name in CONTINUOUS}
EACH_OF_THE_TEXT = pytest.mark.parametrize("name", CONTINUOUS)
QUARTERS = [math.radians(d) for d in range(-180, 181, 90)]


def test_each_estimator_has_its_equations_here_or_in_a_file_of_its_own() -> None:
    own = {"canine_tracker"}  # test_canine_tracker.py
    assert set(CONTINUOUS) == set(EXTREME) == set(ESTIMATORS) - own
    assert {name for name, _ in HARD} == set(ESTIMATORS)


@EACH_OF_THE_TEXT
@pytest.mark.parametrize("heading", [*QUARTERS, 3.13])  # the last turns past 180 degrees in the tick
@pytest.mark.parametrize("speed", [0.0, 4.0, -0.5])
def test_a_tick_and_its_transition_are_those_of_the_equations(
    name: str, heading: float, speed: float
) -> None:
    """The way over a tick is off by less than 0.1 micrometres (`travel`), its derivatives likewise."""
    own = {"four_state": [5.0, -6.0], "two_bias": [5.0, -6.0]}.get(name, [heading, 0.05, 5.0, -6.0])
    x = np.array([speed, 0.2, *own, *([0.3] if name == "seven_state" else [])])
    force, other = 8.0, heading if len(own) == 2 else 3.0
    after, transition = (np.array(a) for a in PROPAGATION[name](x, force, other))
    assert after.ravel() == pytest.approx(integrated(name, x, force, other), abs=1e-7)
    expected = complex_step(lambda z: integrated(name, z, force, other), x)
    assert transition == pytest.approx(expected, abs=2e-7)


@EACH_OF_THE_TEXT
def test_the_transition_is_unit_upper_triangular_in_the_order_of_the_factors(name: str) -> None:
    order = list(ESTIMATORS[name].order)
    pattern = np.array(PROPAGATION[name](np.arange(1.0, len(order) + 1), 1.0, 1.0)[1])[np.ix_(order, order)]
    assert np.array_equal(np.tril(pattern), np.eye(len(order)))


def after_a_tick(name: str, x: Array, force: float, other: float) -> Array:
    """The discrete equations by hand: exact for four states, `travel`'s formula for the others."""
    half = long(T) / 2
    if name in ("four_state", "two_bias"):
        acceleration = force - x[1]
        way = (x[0] + acceleration * half) * T
        return np.array(
            [x[0] + acceleration * T, x[1], x[2] + way * np.cos(other), x[3] + way * np.sin(other)]
        )
    acceleration, rate = force - x[1], other - x[3]
    along = (x[0] + acceleration * half) * T * (1 - (rate * half) ** 2 / 6)
    across = acceleration * rate * long(T) ** 3 / 12
    c, s = np.cos(x[2] + rate * half), np.sin(x[2] + rate * half)
    turned = [x[0] + acceleration * T, x[1], x[2] + rate * T, x[3], x[4] + along * c - across * s]
    return np.array([*turned, x[5] + along * s + across * c, *x[6:]])


class Plain:
    """The EKF of 3.2 with P itself, in long double: complex-step Jacobian, Joseph's form, scalars in turn."""

    def __init__(self, x: Array, P: Array) -> None:
        self.x, self.P = x.astype(long), P.astype(long)

    def predict(self, f: Callable[[Array], Array], Q: Any) -> None:
        phi = complex_step(f, self.x, complex_long)
        self.x = f(self.x)
        self.P = phi @ self.P @ phi.T + np.diag(np.array(Q, dtype=long))

    def correct(self, row: Mapping[int, float], y: float, r: float, angle: bool = False) -> tuple[Any, Any]:
        h = np.zeros(len(self.x), dtype=long)
        h[list(row)] = list(row.values())
        innovation = y - h @ self.x
        if angle:
            innovation -= 2 * long(math.pi) * np.round(innovation / (2 * long(math.pi)))
        variance = h @ self.P @ h + r
        gain = self.P @ h / variance
        self.x = self.x + gain * innovation
        rest = np.eye(len(h), dtype=long) - np.outer(gain, h)
        self.P = rest @ self.P @ rest.T + r * np.outer(gain, gain)
        return innovation, variance


def noise(name: str, sigma: float, p: Mapping[str, float]) -> list[float]:
    position = p["sigma_position"] ** 2
    if name in ("four_state", "two_bias"):
        return [sigma**2 * T, p["sigma_bias"] ** 2, position, position]  # eq. 3.16
    own = [sigma**2, *(p[n] ** 2 for n in ("sigma_bias", "sigma_heading", "sigma_gyro_bias"))]  # eq. B.10
    return [
        *own,
        position,
        position,
        *([p["sigma_mag_bias"] ** 2] if name == "seven_state" else []),
    ]  # eq. C.8


def textbook(name: str, inputs: Columns, out: Columns, p: Mapping[str, float]) -> list[tuple[Any, ...]]:
    """From the tick after the first on: x, P, and each scalar of the last fix as (innovation, variance)."""
    plain = Plain(vectors(out, "x")[0], dense(name, vectors(out, "covariance")[0]))
    four = name in ("four_state", "two_bias")
    running, other = False, (long(0), long(p["initial_bias_variance"]))
    results = []
    steps: list[tuple[Any, Any]] = []
    for k in range(1, len(out["x[1]"])):
        u = {n: float(v[k]) for n, v in inputs.items()}
        if four:
            drive = (u["accel_x"] - G * math.sin(u["pitch_meas"]), u["heading_meas"])
        else:
            drive = (p.get("accel_scale", 1.0) * u["accel_x"], p.get("gyro_scale", 1.0) * u["gyro_z"])
        plain.predict(
            partial(after_a_tick, name, force=drive[0], other=drive[1]), noise(name, out["sigma"][k], p)
        )
        if name == "seven_state":
            s, c = math.sin(u["roll_meas"]), math.cos(u["roll_meas"])
            down = s * u["mag_y"] + c * u["mag_z"]
            forward = math.cos(u["pitch_meas"]) * u["mag_x"] + math.sin(u["pitch_meas"]) * down
            heading = math.atan2(s * u["mag_z"] - c * u["mag_y"], forward) + DECLINATION
            plain.correct({2: 1, 6: 1}, heading, p["mag_heading_noise"] ** 2, angle=True)
        if u["gps_fix"]:
            r = (0.5 * u["gps_h_acc"]) ** 2
            steps = [plain.correct({0: 1}, u["gps_speed"], u["gps_s_acc"] ** 2)]
            if not four and u["gps_speed"] >= 0.5:
                r_course = (p["course_noise"] / u["gps_speed"]) ** 2
                steps.append(plain.correct({2: 1}, u["gps_course"], r_course, angle=True))
            elif not four:
                steps.append((0.0, math.inf))
            north = 2 if four else 4
            steps += [
                plain.correct({north + i: 1}, u[f"gps_{n}"], r) for i, n in enumerate(("north", "east"))
            ]
        if name == "two_bias" and u["gps_fix"] and (u["gps_speed"] < 3 if running else u["gps_speed"] > 3.5):
            kept = (plain.x[1], plain.P[1, 1])
            plain.P[1, :] = plain.P[:, 1] = 0
            plain.x[1], plain.P[1, 1] = other
            running, other = not running, kept
        results.append((plain.x.copy(), plain.P.copy(), steps))
    return results


def every_speed() -> Columns:
    """0 to 4.7 m/s, at rest for 12 s; round and round, so that the heading wraps; 10 s without GPS."""
    t = np.arange(1500) * T
    speed = np.where((t > 24) & (t < 36), 0.0, 2.4 - 2.3 * np.cos(0.35 * t))
    heading = (0.5 * t + 0.8 * np.sin(t) + math.pi) % (2 * math.pi) - math.pi
    return without_fixes(measured(motion(speed, heading), seed=21), 42, 52)


EXTREME: dict[str, list[dict[str, float]]] = {
    "four_state": [{}, {"fuzzy": 0, "sigma_constant": 1e-3}],
    "two_bias": [{}],
    "six_state": [{}, {"sigma_constant": 100, "sigma_heading": 0.1}],
    "seven_state": [TUNINGS["canine"], TUNINGS["pedestrian"]],
}


@pytest.mark.skipif(not WIDE, reason="a dense P needs more than a double's digits")
@pytest.mark.parametrize(("name", "parameters"), [(n, p) for n, ps in EXTREME.items() for p in ps])
def test_the_estimator_is_the_textbooks_filter(native: Make, name: str, parameters: dict[str, float]) -> None:
    inputs = every_speed()
    out = native(ESTIMATORS[name], "double", {"gate": 1e6, **parameters}).run(**inputs)
    assert out["accepted"].sum() == inputs["gps_fix"].sum() - 1  # the first one starts the filter
    p = {v.name: v.start[0] for v in ESTIMATORS[name].group("parameter")} | parameters
    x, packed = vectors(out, "x"), vectors(out, "covariance")
    innovation, variance = vectors(out, "innovation"), vectors(out, "innovation_variance")
    worst = np.zeros(3)
    for k, (expected_x, expected_P, steps) in enumerate(textbook(name, inputs, out, p), start=1):
        sd = np.sqrt(np.diag(expected_P))
        error = x[k] - expected_x
        for i in ESTIMATORS[name].angles:
            error[i] -= 2 * math.pi * np.round(error[i] / (2 * math.pi))
        worst[0] = max(worst[0], np.abs(error / sd).max())
        worst[1] = max(worst[1], np.abs((dense(name, packed[k]) - expected_P) / np.outer(sd, sd)).max())
        for i, (one, its_variance) in enumerate(steps):
            worst[2] = max(worst[2], abs(innovation[k, i] ** 2 / variance[k, i] - one**2 / its_variance))
        assert worst[:2].max() < 1e-9
    assert worst[2] < 1e-7


# Float32


HARD: list[tuple[str, dict[str, float]]] = [
    ("four_state", {}),  # sigma 151.7 at running speed
    ("two_bias", {"initial_bias_variance": 100}),
    ("six_state", {}),
    ("six_state", {"sigma_constant": 150, "sigma_heading": 1, "sigma_bias": 1}),
    ("seven_state", TUNINGS["canine"]),
    ("seven_state", TUNINGS["pedestrian"]),
    ("canine_tracker", {}),
    ("canine_tracker", {"rehearse": 0, "sigma_constant": 150, "reversion_time": 60, "sigma_bias": 1}),
]


@pytest.mark.parametrize(("name", "parameters"), HARD)
def test_the_covariance_stays_positive_in_float32_for_a_million_ticks(
    native: Make, name: str, parameters: dict[str, float]
) -> None:
    """Eleven hours at 4.86 m/s and slower, GPS failing for 10 s of every 40: 1000 outages."""
    block = ESTIMATORS[name]
    chunk, chunks = 100_000, 10
    inputs = measured(run_in_circles(chunk), seed=5)  # a chunk is 100 periods of outage
    inputs["gps_speed"] = np.where(np.arange(chunk) % 10_000 < 2_000, 2.0, inputs["gps_speed"])
    estimator = native(block, "float", {"gate": 1e6, **parameters})
    for _ in range(chunks):
        out = estimator.run(**inputs)
        assert all(np.isfinite(column).all() for column in out.values())
        assert (vectors(out, "covariance")[:, : len(block.order)] > 0).all()
        assert (vectors(out, "innovation_variance") > 0).all()
        assert out["valid"].all()
        assert np.abs(out["heading"]).max() <= math.pi
        assert out["north_sd"][inputs["gps_fix"]].max() < 2.5
        assert out["speed_sd"].max() > 4 * out["speed_sd"].min()  # the outage has its effect
    assert (estimator["bad_samples"], estimator["bad_fixes"]) == (0, 0)


@EACH_BOTH
def test_with_every_noise_and_variance_at_its_least_the_covariance_stays_positive(
    native: Make, name: str, precision: str
) -> None:
    """None of the least values makes a variance 0, by which the factors are divided."""
    block = ESTIMATORS[name]
    words = ("sigma_", "initial_", "_noise", "_floor", "_scale")
    least = {v.name: v.min for v in block.group("parameter") if any(word in v.name for word in words)}
    inputs = without_fixes(measured(walk(2000), seed=15), 20, 40)
    out = native(block, precision, {"gate": 1e6, **least}).run(**inputs)
    assert all(np.isfinite(column).all() for column in out.values())
    assert (vectors(out, "covariance")[:, : len(block.order)] > 0).all()


@EACH
def test_hours_of_dead_reckoning_at_the_largest_force_stay_finite_and_recover(
    native: Make, name: str
) -> None:
    block = ESTIMATORS[name]
    estimator = native(block, "float")
    still = motion(np.full(200, 1.0), np.zeros(200))
    estimator.run(**{n: column[:2] for n, column in still.items()})
    for _ in range(6):
        out = estimator.run(
            accel_x=np.full(90_000, 200.0), heading_meas=0.5, gyro_z=3.0, mag_x=FIELD, gps_fix=False
        )
        assert all(np.isfinite(column).all() for column in out.values())
        assert (vectors(out, "covariance")[:, : len(block.order)] > 0).all()
        assert not out["valid"][-1]
    out = estimator.run(**still)
    assert all(np.isfinite(column).all() for column in out.values())
    assert out["valid"][-1]
    assert abs(out["north"][-1] - 199 * T) < 3
    assert abs(out["speed"][-1] - 1) < 0.5


@EACH
def test_the_float_estimate_equals_the_double_one_up_to_rounding(native: Make, name: str) -> None:
    inputs = without_fixes(measured(walk(1500), seed=4), 30, 40)
    single, double = (native(ESTIMATORS[name], p).run(**inputs) for p in ("float", "double"))
    for output in ("north", "east", "speed", "heading", "accel_bias"):
        difference = np.abs(single[output] - double[output])
        assert (difference < 5e-4 + 1e-3 * double[f"{output}_sd"]).all(), output
        assert single[f"{output}_sd"] == pytest.approx(double[f"{output}_sd"], rel=5e-3), output


# Bad input

BAD = [math.nan, math.inf, -math.inf]


def bad_values(name: str, variable: str) -> list[float]:
    """Five: no number, and out of the declared range on both sides."""
    declared = ESTIMATORS[name].variables()[variable]
    assert declared.min is not None
    assert declared.max is not None
    return [*BAD, 1.01 * declared.max, declared.min - 0.01 * declared.max]


@pytest.mark.parametrize(
    ("name", "precision", "variable"),
    [(n, p, v) for n, b in ESTIMATORS.items() for p in b.precisions for v in b.samples],
)
def test_speed_and_heading_are_held_through_bad_samples(
    native: Make, name: str, precision: str, variable: str
) -> None:
    inputs = measured(walk(200), seed=8)
    bad = [51, 53, 58, 60, 65]  # no fix falls on them
    inputs[variable] = np.array(inputs[variable])
    inputs[variable][bad] = bad_values(name, variable)
    out = native(ESTIMATORS[name], precision, {"use_magnetometer": 0} if name == "seven_state" else {}).run(
        **inputs
    )
    assert out["bad_samples"][-1] == 5
    for k in bad:
        assert not inputs["gps_fix"][k]
        assert out["bad_samples"][k] == out["bad_samples"][k - 1] + 1
        assert out["speed"][k] == pytest.approx(out["speed"][k - 1], abs=1e-6)
        assert out["heading"][k] == pytest.approx(out["heading"][k - 1], abs=1e-6)
    assert all(np.isfinite(column).all() for column in out.values())


@pytest.mark.parametrize(
    ("name", "precision", "variable"),
    [(n, p, v) for n, b in ESTIMATORS.items() for p in b.precisions for v in b.fix],
)
def test_a_bad_fix_leaves_the_estimate_as_if_it_never_came(
    native: Make, name: str, precision: str, variable: str
) -> None:
    inputs = measured(walk(200), seed=9)
    bad = np.flatnonzero(inputs["gps_fix"])[[4, 6, 7, 12, 14]]
    skipped = {**inputs, "gps_fix": inputs["gps_fix"].copy()}
    skipped["gps_fix"][bad] = False
    inputs[variable] = np.array(inputs[variable])
    inputs[variable][bad] = bad_values(name, variable)
    out, expected = (native(ESTIMATORS[name], precision).run(**x) for x in (inputs, skipped))
    assert out["bad_fixes"][-1] == 5
    assert not out["accepted"][bad].any()
    for output in ESTIMATORS[name].flat_names("output"):
        assert np.array_equal(out[output], expected[output]), output


@EACH_BOTH
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_estimate_is_finite_and_its_covariance_positive_for_any_input(
    native: Make, name: str, precision: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    block, n = ESTIMATORS[name], 1000
    inputs: dict[str, Array] = {"gps_fix": rng.random(n) < rng.choice([0.02, 0.16, 1.0])}
    for v in (v for v in block.group("input") if v.name != "gps_fix"):
        assert v.min is not None
        assert v.max is not None
        column = rng.uniform(v.min, v.max, n) * rng.choice([1.0, 1e-3])
        wild = rng.random(n) < 0.1
        column[wild] = rng.choice([v.min, v.max, 2 * v.max, 1e30, -1e30, *BAD], wild.sum())
        inputs[v.name] = column
    out = native(block, precision, {"gate": float(rng.choice([0, 5, 1e6]))}).run(**inputs)
    assert all(np.isfinite(out[output]).all() for output in block.flat_names("output"))
    assert (vectors(out, "covariance")[out["started"] == 1][:, : len(block.order)] > 0).all()


BLOCKS: tuple[type[Block], ...] = (*ESTIMATORS.values(), CanineAhrs)


@pytest.mark.parametrize("block", BLOCKS)
def test_every_parameter_has_a_least_and_a_largest_value(block: type[Block]) -> None:
    assert [v.name for v in block.group("parameter") if v.min is None or v.max is None] == []


@pytest.mark.parametrize(
    ("block", "precision"),
    [(b, p) for b in BLOCKS for p in b.precisions],
)
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_outputs_are_finite_for_any_parameters_in_their_ranges(
    native: Make, block: type[Block], precision: str, seed: int
) -> None:
    # given parameters of which some are the least, some the largest declared, and a walk with an outage
    rng = np.random.default_rng(seed)
    parameters: dict[str, float] = {}
    for v in block.group("parameter"):
        assert v.min is not None
        assert v.max is not None
        for i, name in enumerate(v.flat_names):
            parameters[name] = float(rng.choice([v.min, v.max, v.start[i]], p=[0.25, 0.25, 0.5]))
    inputs = without_fixes(measured(walk(1500), seed=seed), 20, 40)
    out = native(block, precision, parameters).run(**inputs)
    # then every output is a number
    wrong = [name for name in block.flat_names("output") if not np.isfinite(out[name]).all()]
    assert wrong == []


# The recovery


@EACH_OF_THE_TEXT
def test_a_bias_far_from_the_truth_is_given_up_with_the_second_beginning(native: Make, name: str) -> None:
    """Kept for ever, it would carry the speed out of the gate between any two fixes."""
    inputs = motion(np.full(600, 1.0), np.zeros(600))
    estimator = native(ESTIMATORS[name], "double", {"gate": 5, "recovery_fixes": 2})
    estimator.run(**{n: column[:260] for n, column in inputs.items()})
    estimator["x[2]"] = 60.0
    out = estimator.run(**{n: column[260:] for n, column in inputs.items()})
    fixes = np.flatnonzero(inputs["gps_fix"][260:])
    assert out["accepted"][fixes].tolist() == [0] * 4 + [1] * (len(fixes) - 4)
    assert out["accel_bias"][fixes[1]] == 60  # the first beginning keeps it
    assert out["accel_bias"][fixes[3]] == 0
    initial = ESTIMATORS[name].variables()["initial_bias_variance"].start[0]
    assert out["accel_bias_sd"][fixes[3]] == pytest.approx(math.sqrt(initial))
    assert out["renewed"][-1] == 0


# Six and seven states


@pytest.mark.parametrize("name", ["six_state", "seven_state"])
def test_the_first_fix_gives_the_heading_if_it_moves(native: Make, name: str) -> None:
    """With the variance of B.11 and C.9, else with that of B.13 and C.11; the speed's is the fix's alone."""
    noise_, unknown = {"six_state": (0.5, 1e6), "seven_state": (0.1, 1e4)}[name]
    still = motion(np.full(1, 0.4), np.full(1, 2.0))
    moving = motion(np.full(1, 2.0), np.full(1, -2.0))
    for inputs, heading, deviation in ((still, 0.0, math.sqrt(unknown)), (moving, -2.0, noise_ / 2.0)):
        out = native(ESTIMATORS[name]).run(**inputs)
        assert out["heading"][0] == pytest.approx(heading)
        assert out["heading_sd"][0] == pytest.approx(deviation)
        assert out["speed_sd"][0] == pytest.approx(0.1)
        assert out["north_sd"][0] == pytest.approx(1.75)


def test_the_course_of_a_fix_at_rest_is_not_used(native: Make) -> None:
    inputs = motion(np.full(500, 2.0), np.full(500, 0.7))
    slow = np.arange(500) > 250
    inputs["gps_speed"] = np.where(slow, 0.49, 2.0)  # below `course_from`
    inputs["gps_course"] = np.where(slow, -2.0, 0.7)
    parameters = {"gate": 1e6, "sigma_position": 10.0}  # so that the positions say nothing of the heading
    out = native(SixState, "double", parameters).run(**inputs)
    assert out["heading"][-1] == pytest.approx(0.7, abs=0.02)
    assert out["innovation[2]"][-1] ** 2 / out["innovation_variance[2]"][-1] < 1e-20
    used = native(SixState, "double", parameters | {"course_from": 0.48}).run(**inputs)
    assert abs(used["heading"][-1] - 0.7) > 0.3


@pytest.mark.parametrize("name", ["six_state", "seven_state"])
def test_a_biased_gyro_is_found_out_and_the_heading_holds_through_an_outage(native: Make, name: str) -> None:
    inputs = without_fixes(walk(4000), 150, 160)
    inputs["gyro_z"] = inputs["gyro_z"] + 0.05
    parameters = {"accel_scale": 1, "gyro_scale": 1, "use_magnetometer": 0} if name == "seven_state" else {}
    out = native(ESTIMATORS[name], "double", parameters).run(**inputs)
    assert out["x[4]"][-1] == pytest.approx(0.05, abs=2e-3)
    assert np.abs(out["heading"] - inputs["heading_meas"])[-500:].max() < math.radians(4)


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.3, -0.2), (-0.5, 0.6)])
def test_the_magnetometer_gives_the_heading_at_rest_and_tilted(
    native: Make, roll: float, pitch: float
) -> None:
    """The pedestrian's tuning trusts it; the field of a level heading is turned into the body by hand."""
    heading = 2.4
    level = np.array(
        [math.cos(heading - DECLINATION) * FIELD, -math.sin(heading - DECLINATION) * FIELD, 4.3e-5]
    )
    cp, sp, cr, sr = math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
    pitched = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    rolled = np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
    body = rolled @ pitched @ level
    inputs = motion(np.zeros(1000), np.zeros(1000)) | {
        f"mag_{axis}": np.full(1000, value) for axis, value in zip("xyz", body, strict=True)
    }
    inputs |= {"roll_meas": np.full(1000, roll), "pitch_meas": np.full(1000, pitch)}
    out = native(SevenState, "double", TUNINGS["pedestrian"]).run(**inputs)
    assert out["heading"][-1] == pytest.approx(heading, abs=0.01)
    flat = native(SevenState, "double", TUNINGS["pedestrian"] | {"level_magnetometer": 0}).run(**inputs)
    off = math.remainder(math.atan2(-body[1], body[0]) + DECLINATION - heading, 2 * math.pi)
    assert math.remainder(flat["heading"][-1] - heading, 2 * math.pi) == pytest.approx(off, abs=0.01)


def test_a_bad_magnetic_sample_is_counted_and_changes_nothing(native: Make) -> None:
    for variable in SevenState.magnetic:
        inputs = measured(walk(200), seed=10)
        bad = [51, 53, 58, 60, 65]
        inputs[variable] = np.array(inputs[variable])
        inputs[variable][bad] = bad_values("seven_state", variable)
        out = native(SevenState, "double", TUNINGS["pedestrian"]).run(**inputs)
        # then on board the inertial unit is not taken for silent
        assert (out["bad_fields"][-1], out["bad_samples"][-1]) == (5, 0)
        assert all(np.isfinite(column).all() for column in out.values())
        turned = np.diff(out["x[3]"]) - (0.9 * inputs["gyro_z"][1:] - out["x[4]"][:-1]) * T  # beside the gyro
        corrected = np.flatnonzero(np.abs(turned) > 1e-12) + 1
        assert set(bad).isdisjoint(corrected)
        assert len(corrected) > 190


def test_where_there_is_no_magnetometer_the_seven_states_go_without_it(native: Make) -> None:
    inputs = measured(walk(200), seed=10) | {f"mag_{axis}": np.zeros(200) for axis in "xyz"}
    out = native(SevenState, "double", TUNINGS["pedestrian"]).run(**inputs)
    without = native(SevenState, "double", TUNINGS["pedestrian"] | {"use_magnetometer": 0}).run(**inputs)
    assert out["bad_samples"][-1] == 0
    for output in SevenState.flat_names("output"):
        assert out[output] == pytest.approx(without[output], rel=1e-12), output


def test_course_teaches_the_magnetometers_bias(native: Make) -> None:
    inputs = walk(4000)
    magnetic = inputs["heading_meas"] - DECLINATION + 0.3
    inputs |= {"mag_x": FIELD * np.cos(magnetic), "mag_y": -FIELD * np.sin(magnetic)}
    parameters = TUNINGS["pedestrian"] | {"accel_scale": 1, "gyro_scale": 1}
    out = native(SevenState, "double", parameters).run(**inputs)
    assert out["x[7]"][-1000:].mean() == pytest.approx(0.3, abs=0.02)
    assert np.abs(out["heading"] - inputs["heading_meas"])[-1000:].mean() < 0.03


def test_the_parameters_start_at_the_dogs_tuning_and_both_tunings_name_the_same() -> None:
    declared = SevenState.variables()
    assert TUNINGS["canine"] == {n: declared[n].start[0] for n in TUNINGS["pedestrian"]}


def test_with_either_tuning_of_table_c1_no_fix_of_a_walk_is_rejected(native: Make) -> None:
    """R in centimetres as in eq. C.9: the bias takes up what motion does not explain; speed strays."""
    inputs = noisy(walk(3000), seed=14, position=0.05)
    inputs |= {"gps_h_acc": np.full(3000, 0.02), "gps_s_acc": np.full(3000, 0.05)}
    for parameters in TUNINGS.values():
        out = native(SevenState, "double", parameters).run(**inputs)
        assert out["accepted"].sum() == inputs["gps_fix"].sum() - 1
    strict = native(SevenState, "double", TUNINGS["pedestrian"] | {"gate": 5}).run(**inputs)
    assert strict["accepted"].sum() < 0.95 * inputs["gps_fix"].sum()


@pytest.mark.parametrize("side", [1, -1])
def test_a_heading_that_turns_past_south_is_wrapped(side: int) -> None:
    # given 0.01 rad short of south, by a course whose deviation is 0.5 / 2 rad
    model = Model(SixState, {"initial_gyro_bias_variance": 1e-9})
    model.initialize()
    course = side * (math.pi - 0.01)
    fix = {"gps_fix": 1, "gps_speed": 2, "gps_course": course, "gps_h_acc": 100, "gps_s_acc": 0.1}
    for name, value in fix.items():
        model[name] = value
    model.step()
    # when it turns on by 3 rad/s for a tick, 0.12 rad
    model["gps_fix"], model["gyro_z"] = 0, side * 3.0
    model.step()
    assert model["heading"] == pytest.approx(-side * (math.pi - 0.11), abs=1e-9)
    # or a course 0.41 rad back corrects it, by half: both are about as uncertain
    model["gps_fix"], model["gyro_z"], model["gps_course"] = 1, 0.0, side * (math.pi - 0.3)
    model.step()
    assert model["heading"] == pytest.approx(side * (math.pi - 0.095), abs=0.002)


# Two biases


def test_each_gait_learns_its_own_bias_and_keeps_it_through_the_other(native: Make) -> None:
    """40 s of each in turn; the accelerometer is off by 0.2 m/s2 walking, by 1.5 m/s2 running."""
    t = np.arange(8000) * T
    levels = np.array([1, 1, 4.5, 1, 4.5, 1, 4.5, 1, 4.5])  # m/s, each from one multiple of 40 s to the next
    turns = np.arange(8) * 40.0
    speed = np.interp(
        t, np.column_stack([turns, turns + 3]).ravel(), np.column_stack([levels[:-1], levels[1:]]).ravel()
    )
    inputs = motion(speed, 2.0 * np.sin(0.1 * t))
    inputs["accel_x"] = inputs["accel_x"] + np.where(speed > 3.25, 1.5, 0.2)
    out = native(TwoBias, "double", {"fuzzy": 0, "sigma_constant": 0.3}).run(**inputs)
    switches = np.flatnonzero(np.diff(out["running"])) + 1
    assert len(switches) == 7
    for k in switches:
        assert inputs["gps_fix"][k]
        assert (inputs["gps_speed"][k] > 3.5) == out["running"][k]
    assert out["accel_bias"][-1] == pytest.approx(1.5 if out["running"][-1] else 0.2, abs=0.1)
    assert out["other_bias"][-1] == pytest.approx(0.2 if out["running"][-1] else 1.5, abs=0.15)


def test_a_switch_leaves_speed_position_and_their_covariance(native: Make) -> None:
    inputs = measured(motion(np.linspace(2.5, 4.5, 300), np.full(300, 0.4)), seed=13)
    out = native(TwoBias, "double", {"detection_below": 0}).run(**inputs)
    same = native(ESTIMATORS["four_state"]).run(**inputs)
    (k,) = np.flatnonzero(np.diff(out["running"])) + 1
    P, expected = (dense("four_state", vectors(o, "covariance")[k]) for o in (out, same))
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    rest = np.ix_([0, 2, 3], [0, 2, 3])
    assert np.abs((P - expected) / scale)[rest].max() < 1e-12
    assert P[1].tolist() == [0, 1, 0, 0]
    assert [out[f"x[{i}]"][k] for i in (1, 3, 4)] == [same[f"x[{i}]"][k] for i in (1, 3, 4)]
    assert (out["other_bias"][k], out["x[2]"][k]) == (same["x[2]"][k], 0)
    assert out["other_bias_variance"][k] == pytest.approx(float(expected[1, 1]), rel=1e-12)


# Rule 5 of SAFETY.md: good enough to lead by


@EACH
def test_rule_5_an_estimate_that_is_less_sure_than_the_limits_is_not_valid(native: Make, name: str) -> None:
    # given a walk whose fixes end after 10 s
    inputs = without_fixes(motion(np.full(1500, 1.0), np.zeros(1500)), 10, 60)
    out = native(ESTIMATORS[name]).run(**inputs)
    # when each deviation in turn is limited to what it comes to within the outage
    for outputs, limit in ((("north_sd", "east_sd"), "max_position_sd"), (("speed_sd",), "max_speed_sd")):
        largest = np.maximum.reduce([out[output] for output in outputs])
        bound = float(np.median(largest[250:600]))
        limited = native(ESTIMATORS[name], "double", {limit: bound}).run(**inputs)
        # then it is valid where the deviation is within the limit, and nothing else changes
        assert np.array_equal(limited["valid"], out["valid"] * (largest <= bound))
        assert 0 < limited["valid"].sum() < out["valid"].sum()
        assert np.array_equal(limited["speed"], out["speed"])


def elsewhere(places: Array) -> Columns:
    """A body that stands, whose fixes after 20 s are at these places north, in turn."""
    inputs = motion(np.zeros(1500), np.zeros(1500))
    away = np.flatnonzero(inputs["gps_fix"] & (np.arange(1500) * T >= 20))
    inputs["gps_north"][away] = np.resize(places, len(away))
    return inputs


@EACH
def test_rule_5_fixes_that_contradict_each_other_never_begin_the_filter_anew(native: Make, name: str) -> None:
    # given fixes that are kilometres apart, none near the body
    inputs = elsewhere(np.array([5e3, 9e3, -7e3, 6e3, -5e3]))
    # when the body is one of at most 15 m/s, or any
    slow, any_ = (
        native(ESTIMATORS[name], "double", {"gate": 5, "recovery_speed": speed}).run(**inputs)
        for speed in (15, 1e6)
    )
    # then
    assert np.abs(slow["north"]).max() < 50
    assert slow["rejected"].max() == 1
    assert np.abs(any_["north"]).max() > 4e3


@EACH
@pytest.mark.parametrize("time", [0, 2.0, 5.0])
def test_rule_5_fixes_that_agree_begin_it_anew_after_a_time(native: Make, name: str, time: float) -> None:
    inputs = elsewhere(np.array([300.0, 301.0, 299.0]))
    first, *_ = np.flatnonzero(inputs["gps_north"] > 200)
    parameters = {"gate": 5, "recovery_speed": 15, "recovery_time": time}
    out = native(ESTIMATORS[name], "double", parameters).run(**inputs)
    (begun, *_) = np.flatnonzero(out["north"] > 200)
    # four fixes at 4 Hz come in 0.75 s
    assert max(time, 0.75) <= (begun - first) * T < max(time, 0.75) + 0.26


@pytest.mark.parametrize("precision", ["double", "float"])
def test_the_heading_of_a_first_fix_is_wrapped(native: Make, precision: str) -> None:
    """A receiver may count its course from 0 to 360 deg."""
    inputs = {name: values[:1] for name, values in walk(2).items()}
    inputs |= {"gps_course": np.array([4.0]), "gps_speed": np.array([2.0])}
    out = native(SixState, precision).run(**inputs)
    assert out["started"][0]
    assert out["heading"][0] == pytest.approx(4 - 2 * math.pi, abs=1e-6)


def test_the_bias_of_running_is_as_unknown_at_first_as_the_parameter_says(native: Make) -> None:
    out = native(TwoBias, "double", {"initial_bias_variance": 0.04}).run(**walk(200, top=6.0))
    switched = int(np.flatnonzero(out["running"])[0])
    assert out["accel_bias_sd"][switched] == pytest.approx(0.2)
