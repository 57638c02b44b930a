"""Which motion tells biases apart: known cases, and the filters' own transition."""

from __future__ import annotations

import io
from typing import Any

import control
import numpy as np
import pytest
from rich.console import Console

from harness.report.figures import charts_of
from harness.studies import observability
from harness.studies.observability import (
    SYSTEMS,
    direction,
    dynamics,
    judge,
    measurement,
    motions,
    over_a_tick,
)
from harness.studies.study import Options, run_study
from models.four_state import FourState
from models.kit.model import Model

OFFSET = "four_state with a pitch offset"


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    return run_study("observability", Options())


def test_the_transition_is_that_of_the_block() -> None:
    # given four_state at 2 m/s, heading 0.5 rad, and the same with each state moved by a little
    def after(moved: int | None) -> list[float]:
        model = Model(FourState)
        model.initialize()
        model["started"], model["accel_x"], model["heading_meas"] = 1, 0.7, 0.5
        for i, value in enumerate((2.0, 0.1, 3.0, 4.0)):
            model[f"x[{i + 1}]"] = value + (1e-4 if i == moved else 0.0)
        model.step()
        return [model[f"x[{i}]"] for i in range(1, 5)]

    slopes = np.array([np.subtract(after(i), after(None)) / 1e-4 for i in range(4)]).T
    # then a tick carries the difference as the transition says
    assert over_a_tick(dynamics("four_state", 2.0, 0.5, 0.0)) == pytest.approx(slopes, abs=1e-8)


def test_at_a_constant_pitch_bias_and_offset_are_one(result: dict[str, Any]) -> None:
    row = result["systems"][OFFSET]["walks straight"]
    assert (row["rank"], row["states"], row["condition"]) == (4, 5, None)
    # 1 m/s2 of bias looks like 1 / (9.81 cos 8.5 deg) rad = 5.905 deg of offset
    assert row["weakest"] == "accelerometer bias +1 m/s2 with pitch offset +5.9 deg"


def test_the_rank_is_that_of_the_observability_matrix() -> None:
    # given an animal that stands: a system that does not change, which `control` judges
    transition = over_a_tick(dynamics(OFFSET, 0.0, 0.0, -0.15))
    matrix = control.obsv(transition, measurement(OFFSET, 0.0)[0])
    assert np.linalg.matrix_rank(matrix) == judge(OFFSET, motions()["stands"])["rank"] == 4


def test_turns_do_not_tell_bias_and_offset_apart_but_sitting_does(result: dict[str, Any]) -> None:
    rows = result["systems"][OFFSET]
    assert rows["walks in turns"]["rank"] == 4
    assert rows["walks and sits"]["rank"] == rows["walks and sits"]["better_known"] == 5
    assert (
        rows["walks and sits"]["sd"]["accelerometer bias"] < 0.5 * rows["stands"]["sd"]["accelerometer bias"]
    )


def test_the_magnetometer_s_bias_is_known_only_from_motion(result: dict[str, Any]) -> None:
    rows = result["systems"]["seven_state"]
    assert rows["stands"]["weakest"].startswith("magnetometer bias")
    assert rows["stands"]["sd"]["magnetometer bias"] > 10 * rows["walks straight"]["sd"]["magnetometer bias"]


def test_a_direction_is_told_in_units_of_its_largest_part() -> None:
    # two states, 2 and 10 deg of deviation at the start: (0.6, 0.8) of them are 0.6 and 8 deg
    states = (SYSTEMS[OFFSET][1], SYSTEMS[OFFSET][4])
    assert (
        direction(states, np.array([0.6, 0.8])) == "pitch offset +1 deg with accelerometer bias +0.075 m/s2"
    )


def test_tables_and_picture_have_each_system(result: dict[str, Any]) -> None:
    text = io.StringIO()
    observability.show(result, Console(file=text, width=150))
    assert all(system in text.getvalue() for system in SYSTEMS)
    (figure,) = observability.draw(result).values()
    assert len(figure.axes) == 3
    assert all(chart["marks"] for grid in charts_of(figure) for chart in grid)


def test_without_noise_a_state_is_known_as_by_least_squares_with_what_was_known_before(
    result: dict[str, Any],
) -> None:
    # given all fixes of a straight walk as one problem in SI, with P0 as measurements of the start
    states, motion = SYSTEMS[OFFSET], motions()["walks straight"]
    rows, transition, fixes = [np.diag([1 / state.deviation for state in states])], np.eye(len(states)), 0
    for tick, (speed, heading, pitch) in enumerate(
        zip(motion.speed, motion.heading, motion.pitch, strict=True)
    ):
        if tick * 0.04 >= 0.25 * fixes - 1e-9:
            H, deviations = measurement(OFFSET, speed)
            rows.append(H @ transition / deviations[:, None])
            fixes += 1
        transition = over_a_tick(dynamics(OFFSET, speed, heading, pitch)) @ transition
    _, R = np.linalg.qr(np.vstack(rows))
    deviations = np.sqrt(np.sum(np.linalg.inv(R) ** 2, axis=1))
    # then bias and pitch offset, which it does not tell apart, are known as far as they were before
    known = result["systems"][OFFSET]["walks straight"]["sd_without_noise"]
    for state, deviation in zip(states, deviations, strict=True):
        assert known[state.name] == pytest.approx(deviation * state.scale, rel=1e-4), state.name
    assert 0.5 < known["accelerometer bias"] < 1.0
    assert 5.0 < known["pitch offset"] < 10.0
