"""What four_state settles at, against Riccati equations solved in other ways."""

from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console

from harness.report.figures import charts_of
from harness.studies import steady
from harness.studies.steady import (
    FIXES,
    PERIOD,
    Array,
    H,
    R,
    growth,
    lifted,
    process_noise,
    settle,
    single_rate,
    through_period,
    transition,
)
from harness.studies.study import Options
from models.kit.timing import TICK


def corrected(P: Array) -> Array:
    return np.asarray(np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H))  # the information form


@pytest.mark.parametrize("sigma", [0.1, 1.07])
def test_the_lifted_equation_gives_what_iteration_by_hand_comes_to(sigma: float) -> None:
    # given a filter without data, tick by tick for 2,000 s from a covariance of 1
    P = np.eye(3)
    for tick in range(2000 * PERIOD):
        if tick % PERIOD in FIXES:
            P = corrected(P)
        P = transition(TICK) @ P @ transition(TICK).T + process_noise(sigma)
    assert lifted(sigma) == pytest.approx(P, rel=1e-5)


def test_a_single_rate_is_one_fix_in_a_quarter_of_a_second() -> None:
    # given noise that is spread over the time between fixes, in 100 steps
    P, step = np.eye(3), 0.25 / 100
    for _ in range(400):
        P = corrected(P)
        for _ in range(100):
            P = transition(step) @ P @ transition(step).T + process_noise(0.2) * step / TICK
    P = corrected(P)
    gain, after = single_rate(0.2)
    sd = np.sqrt(np.diag(P))
    assert after / np.outer(sd, sd) == pytest.approx(P / np.outer(sd, sd), abs=0.02)
    assert gain == pytest.approx(P @ H.T @ np.linalg.inv(R), rel=0.02, abs=1e-4)


def test_what_has_not_settled_is_marked() -> None:
    result = steady.run(Options(), lambda percent: None)
    # by hand: after 1,200 s five time constants of 208 s have passed, but not of 964 s
    assert [row["sigma_accel"] for row in result["rows"] if not row["has_settled"]] == [5.0, 20.0, 151.7]
    off = {
        row["sigma_accel"]: abs(row["sd"]["bias"]["filter"] / row["sd"]["bias"]["periodic"] - 1)
        for row in result["rows"]
    }
    assert all((error > 0.01) == (sigma >= 5) for sigma, error in off.items())
    text = io.StringIO()
    steady.show(result, Console(file=text, width=170))
    lines = text.getvalue().splitlines()
    assert [line.split()[0] for line in lines if "*" in line[:20]] == ["5", "20", "151.7", "*"]
    assert "* not settled after 1200 s" in text.getvalue()
    (figure,) = steady.draw(result).values()
    assert all(chart["marks"] for grid in charts_of(figure) for chart in grid)
    hollow = [line for line in figure.axes[0].lines if line.get_markerfacecolor() == "none"]
    assert [np.asarray(line.get_xdata()).tolist() for line in hollow] == 3 * [[5.0, 20.0, 151.7]]


def test_the_filter_settles_at_the_covariance_and_gain_of_the_equation() -> None:
    own = settle(0.2)
    gain, after = through_period(lifted(0.2), 0.2)[0]
    assert own["sd"] == pytest.approx(np.sqrt(np.diag(after)), rel=1e-6)
    assert own["gain"] == pytest.approx(gain, rel=1e-4, abs=1e-8)


def test_without_fixes_the_position_s_variance_grows_as_in_closed_form() -> None:
    # given the covariance after a fix, carried on for 250 ticks
    _, after = through_period(lifted(0.2), 0.2)[0]
    P = after
    for _ in range(250):
        P = transition(TICK) @ P @ transition(TICK).T + process_noise(0.2)
    parts = growth(after, 0.2, 250)
    assert sum(parts.values()) == pytest.approx(P[2, 2], rel=1e-9)
    # the sum of k^2 for k < 250 is 5,177,125: 0.2^2 * 0.04^3 * that
    assert parts["acceleration noise"] == pytest.approx(13.2534, abs=1e-3)


def test_the_table_says_how_far_theory_is_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(steady, "SIGMAS", (0.1,))
    result = steady.run(Options(), lambda percent: None)
    text = io.StringIO()
    steady.show(result, Console(file=text, width=150))
    row = next(line for line in text.getvalue().splitlines() if line.lstrip().startswith("0.1 ")).split()
    assert row[:5] == ["0.1", "20.0", "0.0626", "+0", "-0.68"]
    assert len(steady.draw(result)["steady"].axes) == 2
