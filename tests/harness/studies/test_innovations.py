"""What an estimator says about itself: innovations, covariance, and the bounds of a filter that is right."""

from __future__ import annotations

import numpy as np
import pytest

from harness.studies.consistency import ALONE, OwnWorld
from harness.studies.innovations import (
    Innovations,
    autocorrelation,
    covariance_of,
    innovations_of,
    mean_bounds,
    nees,
    observed,
    state_of,
)
from harness.studies.steady import FIXES, PERIOD, Array
from models.four_state import FourState
from models.kit.ekf import UNUSED
from models.kit.model import Model


def test_the_log_likelihood_is_that_of_normal_densities() -> None:
    # given two innovations: 0 with variance 1, and 2 with variance 4
    innovations = Innovations(np.zeros(1), np.array([[0.0, 2.0]]), np.array([[1.0, 4.0]]))
    # then -0.5 ln(2 pi) - 0.5 (1 + ln(8 pi)) = -0.91894 - 2.11209
    assert innovations.log_likelihood[0] == pytest.approx(-3.03102, abs=1e-5)
    assert innovations.nis[0] == pytest.approx(1.0)


def test_a_value_that_the_fix_lacks_has_no_part_in_nis_and_likelihood() -> None:
    # given two fixes: one with both values, one at rest without the second, a course
    with_course = Innovations(np.zeros(1), np.array([[1.0, 2.0]]), np.array([[1.0, 4.0]]))
    alone = Innovations(np.zeros(1), np.array([[1.0]]), np.array([[1.0]]))
    variances = np.array([[1.0, 4.0], [1.0, UNUSED]])
    both = Innovations(np.arange(2.0), np.array([[1.0, 2.0], [1.0, 3.0]]), variances)
    # then
    assert both.nis == pytest.approx([2.0, 1.0])
    assert both.freedom == 1.5
    assert both.log_likelihood == pytest.approx([with_course.log_likelihood[0], alone.log_likelihood[0]])


def test_nees_weighs_each_error_by_its_variance() -> None:
    assert nees(np.array([[1.0, 2.0]]), np.array([[[1.0, 0.0], [0.0, 4.0]]]))[0] == pytest.approx(2.0)


def test_bounds_of_a_mean_are_those_of_the_chi_square_table() -> None:
    # 3 degrees of freedom, 2.5 % and 97.5 %: 0.2158 and 9.348; 30 of them: 16.791 and 46.979
    assert mean_bounds(3, 1) == pytest.approx((0.2158, 9.348), abs=1e-3)
    assert mean_bounds(3, 10) == pytest.approx((1.6791, 4.6979), abs=1e-3)


def test_a_series_that_alternates_is_correlated_by_minus_one() -> None:
    whitened = np.array([[(-1.0) ** k] for k in range(100)])
    assert autocorrelation(whitened, 2) == pytest.approx([-0.99, 0.98])


def test_the_covariance_of_a_run_has_the_deviations_that_the_estimator_states() -> None:
    # given a walk to the north-east with fixes
    model, rows = Model(FourState, {"fuzzy": 0}), []
    names = [name.split(".")[1] for name in observed(FourState)]
    model.initialize()
    for k in range(60):
        for name, value in (
            ("accel_x", 0.3), ("pitch_meas", 0.1), ("heading_meas", 0.8), ("gps_fix", k % PERIOD in FIXES),
            ("gps_north", 0.05 * k), ("gps_east", 0.05 * k), ("gps_speed", 1.8),
            ("gps_h_acc", 3.5), ("gps_s_acc", 0.1),
        ):  # fmt: skip
            model[name] = float(value)
        model.step()
        rows.append([model[name] for name in names])
    run = {f"four_state.{name}": column for name, column in zip(names, np.array(rows).T, strict=True)}
    # then P, put together from its factors, has the squares of what the outputs say, and is symmetric
    P = covariance_of(FourState, run)[-1]
    for i, output in enumerate(("speed_sd", "accel_bias_sd", "north_sd", "east_sd")):
        assert np.sqrt(P[i, i]) == pytest.approx(model[output], rel=1e-12)
    assert np.abs(P - P.T).max() < 1e-12
    assert abs(P[0, 1]) > 0.01 * np.sqrt(P[0, 0] * P[1, 1])
    # and the state is the estimate, and each accepted fix has its innovations
    assert state_of(FourState, run)[-1] == pytest.approx(
        [model[n] for n in ("speed", "accel_bias", "north", "east")]
    )
    innovations = innovations_of(FourState, run)
    assert innovations.time == pytest.approx([0.28, 0.52, 0.76, 1.0, 1.28, 1.52, 1.76, 2.0, 2.28])


def nis_of(name: str, seeds: int) -> tuple[float, tuple[float, float]]:
    world = OwnWorld()
    innovations = [world.run(seed)[name].innovations for seed in range(1, seeds + 1)]
    values: Array = np.concatenate([i.nis for i in innovations])
    return float(values.mean()), mean_bounds(3, len(values), level=0.999)


def test_nis_of_a_filter_that_knows_its_noise_is_within_its_bounds() -> None:
    # 30 trials in the filter's own world: one set of seeds in a thousand would fail
    nis, (low, high) = nis_of("four_state, sigma 0.2", 30)
    assert low < nis < high


def test_nis_of_a_filter_that_believes_its_accelerometer_too_much_is_above_its_bounds() -> None:
    # D.14's 1 m/s2 a sample is 0.04 m/s a tick: sigma^2 * 0.04 = 0.04^2 asks for 0.2, not for 0.1
    assert ALONE["four_state, sigma 0.2"].parameters["sigma_constant"] ** 2 * 0.04 == pytest.approx(0.04**2)
    nis, (_, high) = nis_of("four_state, sigma 0.1 (D.7)", 30)
    assert nis > high
